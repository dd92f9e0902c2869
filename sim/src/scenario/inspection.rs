//! A look into a scenario's tags: each step of their protocols, and a change of their engines' settings. Documents that
//! show a round with all its numbers use it, and tests that change one constant.

use std::fmt;
use std::rc::Rc;

use positioning_core::engine;
use ranging::exchange::{Action, Event, Guidance, Protocol};
use ranging::radio::Sensors;
use ranging::{Pace, RadioInstant, StampModel};
use wire::uwb::native::{Downlink, UserData};

/// Sees a step of the protocol of the tag with this address: the event, and the action that follows.
pub type StepObserver = Rc<dyn Fn(u16, &Event<'_>, &Action<'_>)>;

/// A look into all tags of a scenario.
#[derive(Clone)]
pub struct Inspection {
    /// Changes the settings of a tag's engine, after those of its record.
    pub tune: fn(&mut engine::Settings<f32>),
    /// Sees the steps.
    pub step: StepObserver,
}

impl Inspection {
    /// The settings stay, and nobody looks.
    pub fn none() -> Self {
        Self::tuned(|_| ())
    }

    /// Only the settings change.
    pub fn tuned(tune: fn(&mut engine::Settings<f32>)) -> Self {
        Self { tune, step: Rc::new(|_, _, _| ()) }
    }
}

impl fmt::Debug for Inspection {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("Inspection").finish_non_exhaustive()
    }
}

/// A protocol whose steps are seen.
pub(super) struct Inspected<P> {
    inner: P,
    address: u16,
    step: StepObserver,
}

impl<P> Inspected<P> {
    pub(super) fn new(inner: P, address: u16, inspection: &Inspection) -> Self {
        Self { inner, address, step: inspection.step.clone() }
    }
}

impl<P: Protocol> Protocol for Inspected<P> {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let action = self.inner.step(now, event);
        (self.step)(self.address, &event, &action);
        action
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        self.inner.calibrate(stamps);
    }

    fn sense(&mut self, sensors: Sensors) {
        self.inner.sense(sensors);
    }

    fn pace(&mut self, pace: Pace) {
        self.inner.pace(pace);
    }

    fn guide(&mut self, guidance: Guidance) {
        self.inner.guide(guidance);
    }

    fn set_host(&mut self, has_host: bool) {
        self.inner.set_host(has_host);
    }

    fn refused_frames(&self) -> u32 {
        self.inner.refused_frames()
    }

    fn carried(&mut self) -> Option<(bool, u8)> {
        self.inner.carried()
    }

    fn send_down(&mut self, message: Downlink) {
        self.inner.send_down(message);
    }

    fn carry(&mut self, data: Option<UserData>) {
        self.inner.carry(data);
    }

    fn rouse(&mut self, guidance: Guidance) {
        self.inner.rouse(guidance);
    }
}
