//! Shows results of the exchange on the display.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_time::{Delay, Timer};
use firmware_common::node::Guard;
use firmware_tag::{Observer, RoundOutcome};
use ranging::RadioInstant;
use ranging::exchange::{Action, Event, Guidance, Link, Report};
use ranging::node::Listener;
use ranging::radio::Sensors;
use wire::uwb::native::Downlink;

use crate::Lcd;
use crate::panel::Panel;

/// From one check for new content to the next, milliseconds.
const LOOK_MS: u64 = 100;

/// The panel, for a `static`. The exchange writes it, and the display's task reads it.
pub struct SharedPanel(Mutex<Guard, RefCell<Panel>>);

impl SharedPanel {
    /// Shows the content of a panel.
    pub const fn new(panel: Panel) -> Self {
        Self(Mutex::new(RefCell::new(panel)))
    }

    /// Shows the distances of a round, metres.
    pub fn measured(&self, distances_m: impl Iterator<Item = f32>) {
        self.0.lock(|panel| distances_m.for_each(|distance_m| panel.borrow_mut().measured(distance_m)));
    }

    /// Shows a change of the link.
    pub fn link(&self, link: Link) {
        match link {
            Link::Lost(_) | Link::Unsynchronised => self.0.lock(|panel| panel.borrow_mut().lost()),
            Link::Paired(_)
            | Link::Synchronised(_)
            | Link::Joined(_)
            | Link::NetworkFull
            | Link::Unlisted
            | Link::Coordinating
            | Link::Following(_) => {}
        }
    }
}

/// Keeps the display up to date.
#[embassy_executor::task]
pub async fn display(mut lcd: Lcd, panel: &'static SharedPanel) {
    // Its bus and pins cannot fail. A missing display is not detected.
    let _ = lcd.start(&mut Delay).await;
    loop {
        let text = panel.0.lock(|panel| panel.borrow().text());
        let _ = lcd.show(&text);
        Timer::after_millis(LOOK_MS).await;
    }
}

/// A listener that also shows its reports on the panel.
pub struct Shown<L> {
    /// The listener that gets the reports.
    pub listener: L,
    /// The panel that shows them.
    pub panel: &'static SharedPanel,
}

impl<L: Listener> Listener for Shown<L> {
    async fn report(&mut self, report: Report<'_>, present: RadioInstant) -> Guidance {
        match report {
            Report::Round(round) => self.panel.measured(round.ranges.iter().map(|range| range.distance_m)),
            // An anchor does not listen to rounds of others. The panel shows the distances of tags, not their positions.
            Report::Differences(_) | Report::Polled(_) | Report::Arrival(_) | Report::Downlink(_) => {}
            Report::Link(link) => self.panel.link(link),
        }
        self.listener.report(report, present).await
    }

    fn observe(&mut self, now: RadioInstant, event: &Event<'_>, action: &Action<'_>) {
        self.listener.observe(now, event, action);
    }

    fn sensed(&mut self, sensors: &Sensors) {
        self.listener.sensed(sensors);
    }

    fn refused(&mut self, frames: u32) {
        self.listener.refused(frames);
    }

    fn has_host(&self) -> bool {
        self.listener.has_host()
    }

    fn message(&mut self) -> Option<Downlink> {
        self.listener.message()
    }

    async fn radio_failed(&mut self, error: &impl core::fmt::Debug, failures: u32) {
        self.listener.radio_failed(error, failures).await;
    }
}

/// Shows a tag's results on the panel: the ranges of its rounds, and its link.
#[derive(Clone, Copy)]
pub struct OnPanel(pub &'static SharedPanel);

impl Observer for OnPanel {
    async fn epoch(&self, epoch: &RoundOutcome<'_>) {
        self.0.measured(epoch.measured.ranges().iter().map(|range| range.distance_m));
    }

    fn link(&self, link: Link) {
        self.0.link(link);
    }
}
