//! Messages of a host to tags, on a small simulated air: from a gateway through anchors that do not receive the tag, to tags
//! that range as often as possible and to tags that sleep.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use crate::air::anchors::{anchor, drift};
use crate::air::{ANTENNA_DELAY, Air, Boxed, Owned, STAMPS, What};
use ranging::exchange::Protocol;
use ranging::native::{
    Anchor, AnchorConfig, AnchorTables, Network, NetworkKey, PollContent, Rate, Scheme, Tag, TagConfig,
};
use ranging::{PhyConfig, RadioDuration};
use wire::uwb::native::{
    Answer, Carried, Downlink, Frame, Message, Poll, SyncFrame, TagCommand, UserData, software_code,
};

/// Anchors 25 m apart in a row, with a reach of 30 m: each receives its neighbours.
const APART_M: f64 = 25.0;
const TAG: u16 = 0x100;

fn network(key: Option<u8>, seed: u64) -> Network {
    let key = key.map(|key| NetworkKey::new([key; 16], seed, software_code));
    Network { key, ..Network::new(0xBA1A, PhyConfig::FAST) }
}

/// What a gateway's host wants to tell tags.
type Host = Rc<RefCell<VecDeque<Downlink>>>;

fn gateway(network: Network, address: u16, host: &Host) -> Boxed {
    let mut anchor = Anchor::new(
        AnchorConfig {
            address,
            network,
            antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
            position_m: Some([0.0, 0.0, 2.0]),
            rounds: None,
        },
        AnchorTables::default(),
    );
    let host = host.clone();
    anchor.calibrate(&STAMPS);
    anchor.set_host(true);
    Box::new(move |now, pace, event| {
        if let Some(message) = host.borrow_mut().pop_front() {
            anchor.send_down(message);
        }
        anchor.pace(pace);
        anchor.step(now, event).into()
    })
}

/// A tag that answers each message in one poll, if it answers; it sleeps if it has a period.
fn tag(network: Network, period_ms: Option<u32>, answers: bool) -> Boxed {
    let mut tag = Tag::new(TagConfig {
        address: TAG,
        network,
        anchors: 8,
        rate: period_ms.map_or(Rate::Greedy, |ms| Rate::Every(RadioDuration::from_micros(1_000 * ms))),
        scheme: Scheme::SingleSided,
        tells: PollContent::Nothing,
        blinks: false,
    });
    if period_ms.is_some() {
        tag.doze();
    }
    tag.calibrate(&STAMPS);
    let mut answer = None;
    Box::new(move |now, pace, event| {
        if tag.carried().is_some() {
            answer = None;
        }
        tag.carry(answer);
        tag.pace(pace);
        match tag.step(now, event).into() {
            Owned::Sleep { from, duration, .. } => Owned::Sleep { from, duration, may: duration.as_micros() > 7_000 },
            Owned::Downlink { message, is_trusted } => {
                answer = answers.then(|| UserData::answering(message.data.number(), Answer::Taken));
                Owned::Downlink { message, is_trusted }
            }
            action => action,
        }
    })
}

/// A gateway, anchors in a row, and a tag near the last one.
struct Row {
    air: Air,
    host: Host,
    tag: usize,
}

impl Row {
    fn new(key: Option<u8>, anchors: u16, period_ms: Option<u32>, answers: bool) -> Self {
        let mut air = Air::new(PhyConfig::FAST, 5);
        air.reach = 1.2 * APART_M;
        let host = Host::default();
        air.add([0.0, 0.0, 2.0], 5.0, gateway(network(key, 1), 1, &host));
        for i in 1..anchors {
            let position = [APART_M * f64::from(i), 0.0, 2.0];
            air.add(position, drift(i), anchor(network(key, 1 + u64::from(i)), 1 + i, position, None));
        }
        let tag_at = [APART_M * f64::from(anchors - 1) + 10.0, 3.0, 1.0];
        // The anchors have become one network before.
        air.run_until(5.0);
        let tag = air.add(tag_at, 3.0, tag(network(key, 99), period_ms, answers));
        Self { air, host, tag }
    }

    fn send(&self, number: u8, command: TagCommand<'_>) {
        self.host.borrow_mut().push_back(Downlink::new(TAG, number, command).expect("it fits"));
    }

    /// The messages that the tag reported from `from` on: when, and whether nobody can have forged them.
    fn received(&self, from: f64) -> Vec<(f64, Downlink, bool)> {
        let of_tag = self.air.reports.iter().filter(|report| report.node == self.tag && report.time >= from);
        of_tag
            .filter_map(|report| match report.what {
                What::Downlink { message, is_trusted } => Some((report.time, message, is_trusted)),
                _ => None,
            })
            .collect()
    }

    /// The times of the sync frames that carry messages.
    fn sendings(&self, from: f64) -> Vec<f64> {
        let carries = |sync_frame: &SyncFrame| {
            let entries = sync_frame.relay.iter().flat_map(|relay| &relay.entries);
            entries.filter(|entry| matches!(entry.content, Carried::Downlink(_))).count() > 0
        };
        let sent = self.air.sent.iter().filter(|flight| flight.begin >= from);
        let sent = sent.filter(|flight| match Frame::parse(&flight.bytes).map(|frame| frame.message) {
            Ok(Message::SyncFrame(sync_frame)) => carries(&sync_frame),
            _ => false,
        });
        sent.map(|flight| flight.begin).collect()
    }
}

#[test]
fn a_message_goes_from_anchor_to_anchor_to_the_tag_and_ends_with_its_answer() {
    for key in [None, Some(7)] {
        for period_ms in [None, Some(1_000)] {
            let mut row = Row::new(key, 4, period_ms, true);
            row.air.run_until(20.0);
            row.send(200, TagCommand::Identify(9));
            row.air.run_until(40.0);
            let received = row.received(20.0);
            let &[(at, message, is_trusted)] = &received[..] else { panic!("{key:?} {period_ms:?}: {received:?}") };
            assert_eq!((message.tag, message.gateway, message.command()), (TAG, 1, Some(TagCommand::Identify(9))));
            assert_eq!(is_trusted, key.is_some());
            // Three hops of a superframe each at most; a tag that sleeps polls once a second and listens a superframe later.
            let most = if period_ms.is_none() { 0.8 } else { 2.8 };
            assert!(at < 20.0 + most, "{key:?} {period_ms:?}: after {} s", at - 20.0);
            // Nobody repeats it after the answer: the anchors far from the tag have passed it on before.
            assert!(row.sendings(at + 1.2).is_empty(), "{key:?} {period_ms:?}");
            assert!(row.sendings(20.0).len() <= 12, "{:?}", row.sendings(20.0));
        }
    }
}

#[test]
fn a_tag_that_does_not_answer_is_told_again_at_each_poll_and_a_newer_message_takes_the_place() {
    let mut row = Row::new(None, 2, Some(1_000), false);
    row.air.run_until(15.0);
    row.send(1, TagCommand::Data(b"first"));
    row.air.run_until(35.0);
    let times: Vec<f64> = row.received(15.0).iter().map(|(at, ..)| *at).collect();
    // Each second or so an anchor says that it has a message; what comes again within two seconds was repeated.
    assert!(times.len() >= 6 && times.windows(2).all(|pair| pair[1] - pair[0] > 1.9), "{times:?}");
    row.send(2, TagCommand::Data(b"second"));
    row.air.run_until(50.0);
    let received = row.received(35.0);
    let numbers: Vec<u8> = received.iter().map(|(_, message, _)| message.data.number()).collect();
    let change = numbers.iter().position(|number| *number == 2).expect("the newer message");
    assert!(change <= 2 && numbers[change..].iter().all(|number| *number == 2), "{numbers:?}");
    assert!(received[change].0 < 38.0, "{received:?}");
}

#[test]
fn a_tag_that_was_off_gets_its_message_when_it_is_there_again() {
    let mut row = Row::new(Some(3), 3, Some(1_000), true);
    row.air.switch_off(row.tag);
    row.air.run_until(10.0);
    row.send(9, TagCommand::Rate(500));
    row.air.run_until(60.0);
    assert!(row.sendings(12.0).is_empty(), "nobody repeats it meanwhile");
    row.air.switch_on(row.tag, tag(network(Some(3), 98), Some(1_000), true));
    row.air.run_until(120.0);
    let received = row.received(60.0);
    assert_eq!(received.len(), 1, "{received:?}");
    assert_eq!(received[0].1.command(), Some(TagCommand::Rate(500)));
}

#[test]
fn a_poll_with_an_answer_names_seven_anchors_as_one_with_data_does() {
    let mut row = Row::new(None, 2, None, true);
    row.air.run_until(10.0);
    row.send(77, TagCommand::Identify(1));
    row.air.run_until(12.0);
    let polls = row.air.sent.iter().filter_map(|flight| match Frame::parse(&flight.bytes).map(|frame| frame.message) {
        Ok(Message::Poll(Poll { data: Some(data), .. })) => data.answer().map(|answer| (data.number(), answer)),
        _ => None,
    });
    assert_eq!(polls.collect::<Vec<_>>(), [(77, Answer::Taken)]);
}
