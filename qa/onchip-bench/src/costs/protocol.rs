//! Measures the protocols of native mode, step by step: a tag and four anchors on an [`air`](super::air), from the first
//! sync frame on. Each step is assigned to a kind. The node's own loop runs the protocols, so that the exchange may take any
//! course.

use core::convert::Infallible;
use core::hint::black_box;
use core::pin::pin;

use embassy_futures::join::{join, join_array};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_common::Reporter;
use firmware_tag::{TaskChannels, TelemetrySink};
use ranging::exchange::{Action, Event, Guidance, Protocol, Report};
use ranging::native::{Anchor, AnchorConfig, AnchorMemory, Network, PollContent, Rate, Scheme, Tag, TagConfig};
use ranging::node::{self, Listener};
use ranging::{Pace, PhyConfig, RadioInstant, StampModel};
use wire::uwb::native::{Frame, Message};

use super::air::{ANTENNA_DELAY, World};
use super::{Mean, since};
use crate::instrument::stamp;

const NETWORK: Network = Network::new(0xBA1A, PhyConfig::FAST);
const ANCHORS: usize = 4;
/// The time for the tag to join, and for some rounds.
const LIFE_US: u64 = 1_500_000;

/// The costs of the steps, instructions.
#[derive(Default)]
pub struct MachineCosts {
    /// A tag makes its poll.
    pub poll_made: Mean,
    /// An anchor answers a poll.
    pub poll_answered: Mean,
    /// A tag receives a response.
    pub response_received: Mean,
    /// A tag receives the last response and reports the round.
    pub round_ended: Mean,
    /// A sync frame is received.
    pub beacon_received: Mean,
    /// A sync frame is made.
    pub beacon_made: Mean,
    /// A frame for another node is ignored.
    pub overheard: Mean,
    /// The next action is chosen.
    pub scheduled: Mean,
    /// From a tag's report of a round to the continuation of the exchange.
    pub handover: Mean,
}

impl MachineCosts {
    /// The mean that a step of the node with this address belongs to.
    fn of(&self, address: u16, event: &Event<'_>, action: &Action<'_>) -> Option<&Mean> {
        let message = |bytes: &[u8]| Frame::parse(bytes).ok().map(|frame| frame.message);
        let sent = match action {
            Action::Transmit { frame, .. } => message(frame),
            Action::Receive { .. }
            | Action::WaitUntil(_)
            | Action::Sleep { .. }
            | Action::Compensate
            | Action::Report(_) => None,
        };
        match event {
            Event::Received(received) => {
                let frame = Frame::parse(received.bytes).ok()?;
                match frame.message {
                    Message::Poll(_) => Some(if sent.is_some() { &self.poll_answered } else { &self.overheard }),
                    Message::Response(_) if frame.destination != address => Some(&self.overheard),
                    Message::Response(_) => Some(match action {
                        Action::Report(_) => &self.round_ended,
                        Action::Transmit { .. }
                        | Action::Receive { .. }
                        | Action::WaitUntil(_)
                        | Action::Sleep { .. }
                        | Action::Compensate => &self.response_received,
                    }),
                    Message::SyncFrame(_) => Some(&self.beacon_received),
                    Message::Request(_) | Message::Final { .. } | Message::Challenge(_) | Message::RelayFrame(_) => {
                        None
                    }
                }
            }
            Event::Started
            | Event::Sent(_)
            | Event::NotSent
            | Event::Corrupt
            | Event::Timeout
            | Event::Late
            | Event::Woken
            | Event::Reported => match sent {
                Some(Message::Poll(_)) => Some(&self.poll_made),
                Some(Message::SyncFrame(_)) => Some(&self.beacon_made),
                Some(_) => None,
                None => Some(&self.scheduled),
            },
        }
    }
}

/// A protocol whose steps are measured.
struct Measured<'a, M> {
    machine: M,
    address: u16,
    costs: &'a MachineCosts,
    reported: Option<u32>,
}

impl<M: Protocol> Protocol for Measured<'_, M> {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let begun = stamp();
        let action = black_box(self.machine.step(black_box(now), black_box(event)));
        let instructions = since(begun);
        if let Some(mean) = self.costs.of(self.address, &event, &action) {
            mean.add(instructions);
        }
        self.reported = match &action {
            Action::Report(Report::Round(_)) => Some(stamp()),
            Action::Report(_)
            | Action::Transmit { .. }
            | Action::Receive { .. }
            | Action::WaitUntil(_)
            | Action::Sleep { .. }
            | Action::Compensate => None,
        };
        action
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        self.machine.calibrate(stamps);
    }

    fn pace(&mut self, pace: Pace) {
        self.machine.pace(pace);
    }

    fn guide(&mut self, guidance: Guidance) {
        if let Some(reported) = self.reported.take() {
            self.costs.handover.add(since(reported));
        }
        self.machine.guide(guidance);
    }
}

/// Measures the costs.
///
/// # Panics
/// The air has no place for five nodes.
pub fn measure() -> MachineCosts {
    let costs = MachineCosts::default();
    let world = World::new(NETWORK.phy);
    let anchors = core::array::from_fn::<_, ANCHORS, _>(|i| anchor(&world, i, &costs));
    let tag = async {
        let radio = world.add();
        let config = TagConfig {
            address: 0x100,
            network: NETWORK,
            anchors: 4,
            rate: Rate::Greedy,
            scheme: Scheme::SingleSided,
            tells: PollContent::Nothing,
            blinks: false,
        };
        let machine = Measured { address: config.address, machine: Tag::new(config), costs: &costs, reported: None };
        let reporter = Reporter::<NoopRawMutex, 256, _>::new(|| world.now_us());
        let handover = TaskChannels::<NoopRawMutex>::new();
        let radio = radio.expect("the air has room");
        firmware_tag::ranging(radio, world.delay(), machine, &handover, &TelemetrySink::new(&reporter, false)).await
    };
    world.run(LIFE_US, pin!(join(tag, join_array(anchors))));
    costs
}

async fn anchor(world: &World, number: usize, costs: &MachineCosts) -> Infallible {
    let place = [[0.0, 0.0, 2.5], [8.0, 0.0, 2.0], [8.0, 6.0, 2.5], [0.0, 6.0, 2.0]][number % 4];
    let mut radio = world.add().expect("the air has room");
    let config = AnchorConfig {
        address: number as u16 + 1,
        network: NETWORK,
        antenna_delay: ANTENNA_DELAY,
        position_m: Some(place),
        rounds: None,
    };
    let mut memory = AnchorMemory::<8>::new();
    let machine = Anchor::new(config, (&mut memory).into());
    let mut machine = Measured { address: config.address, machine, costs, reported: None };
    node::run(&mut radio, &mut world.delay(), &mut machine, &mut Silent).await
}

struct Silent;

impl Listener for Silent {
    async fn report(&mut self, _: Report<'_>, _: RadioInstant) -> Guidance {
        Guidance::NONE
    }

    async fn radio_failed(&mut self, _: &impl core::fmt::Debug, _: u32) {}
}
