//! One loop for both roles of a node: with one for each role, an image takes 2 KiB of flash and 1 KiB of RAM more.

use ranging::exchange::{Action, Event, Guidance, Report};
use ranging::node::Listener;
use ranging::radio::Sensors;
use ranging::{Radio, RadioInstant};
use wire::uwb::native::{Downlink, UserData};

/// The listener of a node's role.
pub enum RoleListener<A, T> {
    /// That of an anchor.
    Anchor(A),
    /// That of a tag.
    Tag(T),
}

/// Calls the listener of the role.
macro_rules! of_role {
    ($role:expr, $listener:ident => $call:expr) => {
        match $role {
            RoleListener::Anchor($listener) => $call,
            RoleListener::Tag($listener) => $call,
        }
    };
}

impl<A: Listener, T: Listener> Listener for RoleListener<A, T> {
    async fn report(&mut self, report: Report<'_>, present: RadioInstant) -> Guidance {
        of_role!(self, listener => listener.report(report, present).await)
    }

    async fn look<R: Radio>(&mut self, radio: &mut R, report: &Report<'_>) -> Result<bool, R::Error> {
        of_role!(self, listener => listener.look(radio, report).await)
    }

    fn observe(&mut self, now: RadioInstant, event: &Event<'_>, action: &Action<'_>) {
        of_role!(self, listener => listener.observe(now, event, action));
    }

    fn sensed(&mut self, sensors: &Sensors) {
        of_role!(self, listener => listener.sensed(sensors));
    }

    fn refused(&mut self, frames: u32) {
        of_role!(self, listener => listener.refused(frames));
    }

    fn has_host(&self) -> bool {
        of_role!(self, listener => listener.has_host())
    }

    fn message(&mut self) -> Option<Downlink> {
        of_role!(self, listener => listener.message())
    }

    fn guidance(&mut self) -> Option<Guidance> {
        of_role!(self, listener => listener.guidance())
    }

    async fn roused(&mut self) -> Guidance {
        of_role!(self, listener => listener.roused().await)
    }

    fn data(&mut self, carried: Option<(bool, u8)>) -> Option<UserData> {
        of_role!(self, listener => listener.data(carried))
    }

    async fn radio_failed(&mut self, error: &impl core::fmt::Debug, failures: u32) {
        of_role!(self, listener => listener.radio_failed(error, failures).await);
    }
}
