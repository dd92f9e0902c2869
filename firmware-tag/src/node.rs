//! A tag's program without the parts of its board. The board's binary sets up the board, starts the [`Node`], and
//! spawns a task for each part of the [`Tag`] that [`Memory::tag`] returns.

use core::convert::Infallible;

use embedded_hal_async::delay::DelayNs;
use firmware_common::TagProtocol;
use firmware_common::node::{Configured, Guard, Node, Reporter, TELEMETRY_BYTES, Tasks, fill};
use heapless::Vec;
use positioning_core::nlos::NodeModel;
use ranging::Restart;
use ranging::radio::Config;
use static_cell::StaticCell;
use wire::config::Role;
use wire::telemetry::Condition;
use wire::uwb::native::UserData;

use crate::motion::MotionSensor;
use crate::{
    AnchorPosition, LocatorConfig, RangingListener, RateControl, SendError, Sink, TelemetrySink, anchor_positions,
    motion,
};

pub use crate::nlos_model::NlosModelStore;

type TaskChannels = crate::TaskChannels<Guard>;

/// The memory that a tag's tasks work on, for a `static`.
pub struct Memory {
    machine: StaticCell<TagProtocol>,
    tag: StaticCell<Tag>,
    channels: StaticCell<TaskChannels>,
    anchors: StaticCell<Vec<AnchorPosition, { wire::config::MAX_ANCHORS }>>,
    #[cfg(feature = "ble")]
    record: StaticCell<wire::config::Record>,
    #[cfg(feature = "ble")]
    surveyed: StaticCell<crate::SiteModels<'static>>,
}

/// What only the task that owns the radio uses.
pub struct RangingParts<R: 'static> {
    /// The radio's driver.
    pub radio: &'static mut R,
    /// The tag's protocol.
    pub machine: &'static mut TagProtocol,
}

/// What the tasks of a tag share.
pub struct Tag {
    /// The tag's settings in the record.
    pub config: wire::config::Tag,
    channels: &'static TaskChannels,
    reporter: &'static Reporter,
    anchors: &'static [AnchorPosition],
    /// The NLOS classifier that lies in flash beside the record, see [`NlosModelStore`].
    pub nlos_model: Option<&'static NodeModel>,
    #[cfg(feature = "ble")]
    record: &'static wire::config::Record,
    #[cfg(feature = "ble")]
    surveyed: Option<&'static crate::SiteModels<'static>>,
}

impl Memory {
    /// Empty memory.
    pub const fn new() -> Self {
        Self {
            machine: StaticCell::new(),
            tag: StaticCell::new(),
            channels: StaticCell::new(),
            anchors: StaticCell::new(),
            #[cfg(feature = "ble")]
            record: StaticCell::new(),
            #[cfg(feature = "ble")]
            surveyed: StaticCell::new(),
        }
    }

    /// The tag that a record describes, with the radio's driver that `radio` creates. For a record of another role the
    /// function reports the fault and returns `None`.
    #[inline(never)]
    #[cold]
    pub fn tag<R>(
        &'static self,
        node: &mut Node,
        configured: &Configured,
        radio: impl FnOnce(Config) -> &'static mut R,
    ) -> Option<(RangingParts<R>, &'static mut Tag)> {
        let Configured { record, settings } = configured;
        match &settings.role {
            Role::Tag(config) => {
                node.tasks = Tasks::RangingAndEngine;
                let machine = fill(&self.machine, || TagProtocol::new(settings, config));
                let exchange = RangingParts { radio: radio(settings.radio), machine };
                let channels = fill(&self.channels, TaskChannels::new);
                let anchors = fill(&self.anchors, || anchor_positions(record));
                #[cfg(feature = "ble")]
                let record = fill(&self.record, || record.clone());
                let tag = fill(&self.tag, || Tag {
                    config: *config,
                    channels,
                    reporter: node.reporter,
                    anchors,
                    nlos_model: None,
                    #[cfg(feature = "ble")]
                    record,
                    #[cfg(feature = "ble")]
                    surveyed: None,
                });
                Some((exchange, tag))
            }
            Role::Anchor { .. } | Role::Advertiser(_) | Role::Scanner => {
                node.report(Condition::WrongRecord);
                None
            }
        }
    }

    /// Makes the tag use the survey's models of beacons from flash. May be called once in a program's run.
    #[cfg(feature = "ble")]
    pub fn use_beacon_models(
        &'static self,
        tag: &mut Tag,
        models: Result<wire::config::StoredSiteModels<'static>, wire::config::LoadError>,
        node: &Node,
    ) {
        let beacons = &tag.record.beacons;
        tag.surveyed =
            Some(fill(&self.surveyed, || crate::site_models(models, beacons, |condition| node.report(condition))));
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

impl Tag {
    /// The sink that its tasks report to.
    pub fn sink(&self) -> TelemetrySink<'static, Guard, TELEMETRY_BYTES> {
        TelemetrySink::new(self.reporter, self.config.report_ranges)
    }

    /// The task that owns the radio.
    pub async fn range<R: Restart>(
        &self,
        exchange: RangingParts<R>,
        delay: impl DelayNs,
        sink: &impl Sink,
    ) -> Infallible {
        crate::ranging(exchange.radio, delay, exchange.machine, self.channels, sink).await
    }

    /// What the task that owns the radio reports to, where a board has a loop of its own.
    pub fn listener<'s, S: Sink>(&self, sink: &'s S) -> RangingListener<'s, Guard, S> {
        RangingListener::new(self.channels, sink)
    }

    /// [`TaskChannels::send`](crate::TaskChannels::send): data for the hosts of anchors, from any task of the program.
    ///
    /// # Errors
    /// As there.
    pub fn send(&self, bytes: &[u8], polls: u8) -> Result<u8, SendError> {
        self.channels.send(bytes, polls)
    }

    /// [`TaskChannels::next_message`](crate::TaskChannels::next_message): what hosts tell the program.
    pub async fn next_message(&self) -> UserData {
        self.channels.next_message().await
    }

    /// The task that computes positions.
    pub async fn locate(&self, delay: impl DelayNs, sink: &impl Sink) -> Infallible {
        let locator = LocatorConfig::new(self.config.height_m, self.anchors).within(&self.config);
        let locator = locator.by(self.config.solver).with_model(self.nlos_model);
        #[cfg(feature = "ble")]
        let locator = locator.with_beacons(crate::KnownBeacons::of(self.record));
        #[cfg(feature = "ble")]
        let locator = match self.surveyed {
            Some(surveyed) => locator.with_site_models(surveyed),
            None => locator,
        };
        crate::engine::<{ crate::LISTED }, _>(self.channels, delay, locator, RateControl::of(&self.config), sink).await
    }

    /// The task of a motion sensor. It runs only if the record has a rate for a tag that lies still.
    pub async fn follow_motion(&self, sensor: impl MotionSensor, delay: impl DelayNs, sink: &impl Sink) {
        motion::run(self.channels, sensor, delay, sink).await;
    }

    /// Takes an advertisement that a scanner has received.
    #[cfg(feature = "ble")]
    pub fn receive(&self, data: &[u8], rssi_dbm: i8, sink: &impl Sink) {
        crate::scan::receive(self.channels, sink, data, rssi_dbm);
    }

    /// The task that advertises positions. It runs only if the record asks for it.
    pub async fn advertise(
        &self,
        sender: crate::advertise::Sender,
        advertiser: impl crate::advertise::Advertiser,
        delay: impl DelayNs,
    ) -> Infallible {
        crate::advertise::run(self.channels, sender, advertiser, delay).await
    }

    /// The task that switches a scanner on and off.
    #[cfg(feature = "ble")]
    pub async fn scan(
        &self,
        plan: crate::scan::Plan,
        scanner: impl crate::scan::Scanner,
        delay: impl DelayNs,
        sink: &impl Sink,
    ) -> Infallible {
        crate::scan::run(self.channels, plan, scanner, delay, sink).await
    }
}
