//! The costs of native mode's protocols, frame by frame, for a tag ten metres from each of four anchors.

use core::hint::black_box;

use onchip_bench::instrument::Instrument;
use ranging::exchange::{Action, Event, Protocol, Report};
use ranging::native::{
    Anchor, AnchorConfig, AnchorMemory, Layout, Network, PollContent, Rate, Scheme, Tag, TagConfig, Timing,
};
use ranging::{Diagnostics, PhyConfig, RadioDuration, RadioInstant, RxFrame, StampModel, Start};
use semihosting::println;
use wire::uwb::native::{Frame, Member, Message, OWNED_SYNC_SLOTS, Share, SyncFrame};
use wire::uwb::{BROADCAST, FrameBuffer};

const NETWORK: Network = Network::new(0xBA1A, PhyConfig::FAST);
const TAG: u16 = 0x100;
const ANCHORS: u16 = 4;
const ANTENNA_DELAY: RadioDuration = RadioDuration::from_ticks(16_436);
/// The radio, a DW1000 in the network's configuration.
const STAMPS: StampModel = StampModel {
    delayed_step: baliza_dw1000::CAPABILITIES.delayed_step,
    antenna_delay: ANTENNA_DELAY,
    range_bias: baliza_dw1000::bias::of(&NETWORK.phy),
};
/// Ten metres: 10 / 299 704 645 s.
const FLIGHT: RadioDuration = RadioDuration::from_ticks(2132);

/// Measures and prints.
pub fn print(instrument: &mut Instrument) {
    let (mut tag, now) = tag_in_network();
    let (poll, now) = print_poll(instrument, &mut tag, now);
    let departure = now.plus(ANTENNA_DELAY);
    settle(tag.step(departure, Event::Sent(departure)));
    let Message::Poll(asked) = Frame::parse(poll.bytes()).expect("a poll").message else { panic!("no poll") };
    for asked in &asked.anchors {
        let (response, start) = print_answer(instrument, asked.address, poll.bytes(), departure);
        let rx_time = STAMPS.departure(start).plus(FLIGHT);
        print_response(instrument, &mut tag, heard(response.bytes(), rx_time));
    }
}

/// A tag that has received the sync frames of all anchors, and the end of the last.
fn tag_in_network() -> (Tag, RadioInstant) {
    let mut tag = Tag::new(TagConfig {
        address: TAG,
        network: NETWORK,
        anchors: 4,
        rate: Rate::Greedy,
        scheme: Scheme::SingleSided,
        tells: PollContent::Nothing,
        blinks: false,
    });
    tag.calibrate(&STAMPS);
    let now = RadioInstant::from_ticks(1 << 39);
    settle(tag.step(now, Event::Started));
    let timing = Timing::of(&NETWORK, NETWORK.first_layout());
    for anchor in 0..ANCHORS {
        let sync_frame = sync_frame(anchor as u8, 1);
        let rx_time = now.plus(timing.sync_frame(anchor.into()));
        settle(tag.step(rx_time, Event::Received(heard(sync_frame.bytes(), rx_time))));
        if anchor == 0 {
            settle(tag.step(rx_time, Event::Reported));
        }
    }
    (tag, now.plus(timing.sync_frame(ANCHORS.into())))
}

/// The step in which the tag makes its poll. Returns the poll and when that is.
fn print_poll(instrument: &mut Instrument, tag: &mut Tag, mut now: RadioInstant) -> (FrameBuffer, RadioInstant) {
    let mut event = Event::Timeout;
    loop {
        let before = tag.clone();
        let (at, what) = (now, event);
        match tag.step(now, event) {
            Action::Transmit { frame, start, .. } => {
                let cost = instrument.cost_on(&before, |tag| {
                    black_box(tag.step(black_box(at), black_box(what)));
                });
                cost.print(format_args!("frame poll {}", frame.len()), &[]);
                assert!(matches!(start, Start::At(_)), "the table takes the poll for one that leaves at its instant");
                return (copied(frame), now);
            }
            Action::Receive { window, .. } => (now, event) = (now.plus(window), Event::Timeout),
            Action::WaitUntil(instant) => (now, event) = (instant, Event::Woken),
            Action::Sleep { from, duration } => (now, event) = (from.plus(duration), Event::Woken),
            Action::Compensate => event = Event::Woken,
            Action::Report(_) => event = Event::Reported,
        }
    }
}

/// The step in which an anchor answers the poll that left at `departure`. Returns the response and when it is sent.
fn print_answer(
    instrument: &mut Instrument,
    address: u16,
    poll: &[u8],
    departure: RadioInstant,
) -> (FrameBuffer, RadioInstant) {
    let mut memories = [const { AnchorMemory::new() }; 3];
    let mut memories = memories.iter_mut();
    let mut state = || anchor_in(memories.next().expect("there are three"), address, departure);
    let mut anchor = state();
    let poll_rx = departure.plus(FLIGHT);
    let frame = heard(poll, poll_rx);
    let Action::Transmit { frame: response, start: Start::At(start), .. } =
        anchor.step(poll_rx, Event::Received(frame))
    else {
        panic!("no response")
    };
    let cost = instrument.cost_twice(state, |anchor| {
        black_box(anchor.step(black_box(poll_rx), black_box(Event::Received(frame))));
    });
    cost.print(format_args!("frame answer {}", response.len()), &[]);
    (copied(response), start)
}

/// An anchor that a sync frame of another anchor has told when to answer.
fn anchor_in(memory: &mut AnchorMemory<4>, address: u16, now: RadioInstant) -> Anchor<'_> {
    let config =
        AnchorConfig { address, network: NETWORK, antenna_delay: ANTENNA_DELAY, position_m: None, rounds: None };
    let mut anchor = Anchor::new(config, memory.into());
    anchor.calibrate(&STAMPS);
    settle(anchor.step(now, Event::Started));
    let sync_frame = sync_frame(address as u8, address + 1);
    settle(anchor.step(now, Event::Received(heard(sync_frame.bytes(), now))));
    anchor
}

/// The step in which the tag makes a range of a response; after the last, also the ranges of the round.
fn print_response(instrument: &mut Instrument, tag: &mut Tag, response: RxFrame<'_>) {
    let rx_time = response.rx_time;
    let cost = instrument.cost_on(tag, |tag| {
        black_box(tag.step(black_box(rx_time), black_box(Event::Received(response))));
    });
    cost.print(format_args!("frame response {}", response.bytes.len()), &[]);
    if let Action::Report(Report::Round(round)) = tag.step(rx_time, Event::Received(response)) {
        for range in round.ranges {
            println!("range {} {:08x}", range.peer, range.distance_m.to_bits());
        }
    }
}

/// A frame that outlives the step which made it.
fn copied(frame: &[u8]) -> FrameBuffer {
    let mut copy = FrameBuffer::new();
    Frame::parse(frame).expect("a frame").emit(&mut copy);
    copy
}

fn settle(action: Action<'_>) {
    black_box(action);
}

fn heard(bytes: &[u8], rx_time: RadioInstant) -> RxFrame<'_> {
    // −81.5 dBm in the chip's estimate are −77 dBm, where the range bias at PRF 64 is zero (APS011).
    RxFrame { bytes, rx_time, diagnostics: Diagnostics { rx_power_dbm: -81.5, ..Diagnostics::default() } }
}

fn sync_frame(slot: u8, coordinator: u16) -> FrameBuffer {
    let sync_frame = SyncFrame {
        session: None,
        superframe: 7,
        term: 1,
        age: 0,
        hops: u8::from(slot > 0),
        coordinator,
        slot,
        slot_owners: [0; OWNED_SYNC_SLOTS],
        request: None,
        wish: Layout::LEAST,
        wishes_relay_slots: false,
        heard: 0,
        version: 1,
        countdown: 0,
        layout: NETWORK.first_layout(),
        layout_is_new: false,
        position: None,
        leased: 0,
        has_relay_slots: false,
        relay: None,
        neighbour: None,
        leases: Default::default(),
        polls: Default::default(),
        members: [Member { tag: TAG, share: Share::Greedy }].into_iter().collect(),
    };
    let mut out = FrameBuffer::new();
    Frame {
        sequence: 0,
        pan: NETWORK.pan,
        destination: BROADCAST,
        source: u16::from(slot) + 1,
        message: Message::SyncFrame(sync_frame),
    }
    .emit(&mut out);
    out
}
