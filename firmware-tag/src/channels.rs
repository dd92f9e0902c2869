//! The channels between a tag's tasks. They carry rounds to the engine, guidance back to the exchange, sightings to the
//! engine, and the radio's quiet times to the Bluetooth scan. No sender waits: a full channel drops its oldest item.
//! The guidance contains how long the engine will be busy, so that the exchange makes no rounds that would be dropped.

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use firmware_common::counts::Tally;
use heapless::{Deque, Vec};
use positioning_core::ble::rssi::BeaconRssi;
use ranging::RadioDuration;
use ranging::exchange::{self, Difference, Differences, Guidance, Range};
use ranging::native::{MAX_ROUND, Rate};
use wire::ble::Advertised;
use wire::uwb::native::{Answer, UserData};

use crate::Sounding;
use crate::advertise::Found;
use crate::workload::Workload;

/// Rounds that may wait for the engine. If the engine is late by more, the oldest rounds are dropped.
const ROUNDS: usize = 2;
/// Sightings that may wait for the engine.
const SIGHTINGS: usize = 8;
/// Data of the user that may wait for polls.
pub const DATA: usize = 4;
/// Answers to messages of hosts that may wait for polls, and the polls that carry each.
const ANSWERS: usize = 2;
const ANSWER_POLLS: u8 = 2;
/// Messages of hosts that may wait for the program.
const MESSAGES: usize = 2;

/// Why data cannot be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SendError {
    /// There are no bytes, or more than [`UserData::MOST`].
    Length,
    /// [`DATA`] others wait. Rounds are made less often than data come: try again after a round.
    Full,
}

/// Data of the user that wait for polls, and the number of the next. Answers to hosts come first.
struct Outbox {
    next: u8,
    answers: Deque<(UserData, u8), ANSWERS>,
    waiting: Deque<(UserData, u8), DATA>,
}

impl Outbox {
    const fn new() -> Self {
        Self { next: 0, answers: Deque::new(), waiting: Deque::new() }
    }

    fn answer(&mut self, number: u8, answer: Answer) {
        if self.answers.is_full() {
            self.answers.pop_front();
        }
        // There is a place now.
        let _ = self.answers.push_back((UserData::answering(number, answer), ANSWER_POLLS));
    }

    fn front(&self) -> Option<UserData> {
        self.answers.front().or(self.waiting.front()).map(|(data, _)| *data)
    }

    fn push(&mut self, bytes: &[u8], polls: u8) -> Result<u8, SendError> {
        let data = UserData::new(self.next, bytes).ok_or(SendError::Length)?;
        self.waiting.push_back((data, polls.max(1))).map_err(|_| SendError::Full)?;
        self.next = self.next.wrapping_add(1);
        Ok(data.number())
    }

    /// A poll has carried the data with this [`UserData::id`].
    fn sent(&mut self, id: (bool, u8)) {
        note_sent(&mut self.answers, id);
        note_sent(&mut self.waiting, id);
    }
}

fn note_sent<const N: usize>(waiting: &mut Deque<(UserData, u8), N>, id: (bool, u8)) {
    let is_last = match waiting.front_mut() {
        Some((data, polls)) if data.id() == id => {
            *polls = polls.saturating_sub(1);
            *polls == 0
        }
        Some(_) | None => false,
    };
    if is_last {
        waiting.pop_front();
    }
}

/// The measurements of a round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measured<'a> {
    /// Ranges to the anchors that were asked.
    Ranges(exchange::Round<'a>),
    /// Differences of arrival times among anchors that ranged with each other.
    Differences(exchange::Differences<'a>),
    /// RSSI values of beacons, received in a window.
    RssiWindow(RssiWindow<'a>),
}

/// The RSSI values of beacons in a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RssiWindow<'a> {
    /// Continues the numbers of the rounds. It wraps.
    pub number: u16,
    /// The listed beacons that were received, the nearest first.
    pub rssis: &'a [BeaconRssi],
}

impl<'a> Measured<'a> {
    /// The round's number. It wraps.
    pub const fn number(&self) -> u16 {
        match self {
            Self::Ranges(round) => round.number,
            Self::Differences(round) => round.number,
            Self::RssiWindow(window) => window.number,
        }
    }

    /// The number of anchors that were asked. It is zero for RSSI values.
    pub const fn asked(&self) -> u8 {
        match self {
            Self::Ranges(round) => round.asked,
            Self::Differences(round) => round.asked,
            Self::RssiWindow(_) => 0,
        }
    }

    /// The number of ranges, differences or RSSI values.
    pub const fn count(&self) -> usize {
        match self {
            Self::Ranges(round) => round.ranges.len(),
            Self::Differences(round) => round.differences.len(),
            Self::RssiWindow(window) => window.rssis.len(),
        }
    }

    /// The ranges, if the round measured ranges.
    pub const fn ranges(&self) -> &'a [Range] {
        match self {
            Self::Ranges(round) => round.ranges,
            Self::Differences(_) | Self::RssiWindow(_) => &[],
        }
    }

    /// The differences with their reference, if the round measured differences.
    pub const fn differences(&self) -> Option<&exchange::Differences<'a>> {
        match self {
            Self::Ranges(_) | Self::RssiWindow(_) => None,
            Self::Differences(round) => Some(round),
        }
    }
}

/// A round that owns its measurements.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Round {
    /// When the poll was sent or received, microseconds since the node started.
    pub(crate) poll_us: u64,
    /// The impulse response of its last frame, if it was read.
    pub(crate) sounding: Option<Sounding>,
    owned: Owned,
}

/// A round without its measurements, and the measurements beside it.
#[derive(Clone, Debug, PartialEq)]
enum Owned {
    Ranges(exchange::Round<'static>, Vec<Range, MAX_ROUND>),
    Differences(exchange::Differences<'static>, Vec<Difference, MAX_ROUND>),
}

impl Round {
    fn of_ranges(round: &exchange::Round<'_>, poll_us: u64, sounding: Option<Sounding>) -> Self {
        let ranges = round.ranges.iter().take(MAX_ROUND).copied().collect();
        Self { poll_us, sounding, owned: Owned::Ranges(exchange::Round { ranges: &[], ..*round }, ranges) }
    }

    fn of_differences(round: &Differences<'_>, poll_us: u64, sounding: Option<Sounding>) -> Self {
        let differences = round.differences.iter().take(MAX_ROUND).copied().collect();
        let owned = Owned::Differences(exchange::Differences { differences: &[], ..*round }, differences);
        Self { poll_us, sounding, owned }
    }

    pub(crate) fn measured(&self) -> Measured<'_> {
        match &self.owned {
            Owned::Ranges(round, ranges) => Measured::Ranges(exchange::Round { ranges, ..*round }),
            Owned::Differences(round, differences) => {
                Measured::Differences(exchange::Differences { differences, ..*round })
            }
        }
    }
}

/// A beacon's advertisement that was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReceivedAdvertisement {
    /// The time of reception, microseconds since the node started.
    pub t_us: u64,
    /// The content of the advertisement.
    pub beacon: Advertised,
    /// The RSSI, dBm.
    pub rssi_dbm: i8,
}

/// A time without ranging.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Quiet {
    /// Its end, since the node started, microseconds.
    pub(crate) until_us: u64,
}

/// The channels between the tasks of one tag, for a `static`.
pub struct TaskChannels<M: RawMutex> {
    rounds: Channel<M, Round, ROUNDS>,
    guidance: Mutex<M, Cell<Guidance>>,
    workload: Mutex<M, RefCell<Workload>>,
    sightings: Channel<M, ReceivedAdvertisement, SIGHTINGS>,
    quiet: Signal<M, Quiet>,
    movement: Signal<M, ()>,
    /// The guidance has a rate that must be taken now and not at the next report.
    rouse: Signal<M, ()>,
    outbox: Mutex<M, RefCell<Outbox>>,
    messages: Channel<M, UserData, MESSAGES>,
    /// The program has asked for messages.
    takes_messages: AtomicBool,
    /// The rate that a host has asked for, rounds in 100 s; 0 is that of the record.
    asked_rate: Signal<M, u32>,
    /// The newest position, for the advertiser.
    found: Signal<M, Found>,
    /// Advertisements received from any sender: a sign that the scanner works.
    pub(crate) heard: Tally,
}

impl<M: RawMutex> TaskChannels<M> {
    /// Empty channels.
    pub const fn new() -> Self {
        Self {
            rounds: Channel::new(),
            guidance: Mutex::new(Cell::new(Guidance::NONE)),
            workload: Mutex::new(RefCell::new(Workload::new())),
            sightings: Channel::new(),
            quiet: Signal::new(),
            movement: Signal::new(),
            rouse: Signal::new(),
            outbox: Mutex::new(RefCell::new(Outbox::new())),
            messages: Channel::new(),
            takes_messages: AtomicBool::new(false),
            asked_rate: Signal::new(),
            found: Signal::new(),
            heard: Tally::new(),
        }
    }

    /// Passes a round to the engine, with the impulse response of its last frame if it was read. The poll was sent or
    /// received at `poll_us`, microseconds since the node started. Returns the number of older rounds that were
    /// dropped.
    pub fn put_ranges(&self, round: &exchange::Round<'_>, poll_us: u64, sounding: Option<Sounding>) -> u32 {
        put(&self.rounds, Round::of_ranges(round, poll_us, sounding))
    }

    /// The same for a round that was overheard.
    pub fn put_differences(&self, round: &Differences<'_>, poll_us: u64, sounding: Option<Sounding>) -> u32 {
        put(&self.rounds, Round::of_differences(round, poll_us, sounding))
    }

    pub(crate) async fn next_round(&self) -> Round {
        self.rounds.receive().await
    }

    /// The engine has taken a round at this time, microseconds since the node started.
    pub(crate) fn begin(&self, now_us: u64) {
        self.workload.lock(|workload| workload.borrow_mut().begin(now_us));
    }

    /// The engine has finished the round.
    pub(crate) fn end(&self, now_us: u64) {
        self.workload.lock(|workload| workload.borrow_mut().end(now_us));
    }

    /// Passes a received beacon advertisement to the engine. Returns the number of older sightings that were dropped.
    pub(crate) fn put_sighting(&self, heard: ReceivedAdvertisement) -> u32 {
        put(&self.sightings, heard)
    }

    pub(crate) async fn next_sighting(&self) -> ReceivedAdvertisement {
        self.sightings.receive().await
    }

    /// Sets the guidance for the protocol from now on. A rate stays until it is taken.
    pub(crate) fn guide(&self, guidance: Guidance) {
        self.guidance.lock(|cell| cell.set(Guidance { rate: guidance.rate.or(cell.get().rate), ..guidance }));
    }

    /// The tag must range at this rate at once, whatever it waits for.
    pub(crate) fn rouse(&self, rate: Rate) {
        self.guidance.lock(|cell| cell.set(Guidance { rate: Some(rate), ..cell.get() }));
        self.rouse.signal(());
    }

    /// Sends up to [`UserData::MOST`] bytes in this many polls, at least one, to the hosts of all anchors that receive
    /// them. A superframe has one such poll at most, which asks seven anchors at most. Without slots, and in
    /// DecaRanging, the data wait. Returns the number that hosts see: it counts the data and wraps.
    ///
    /// # Errors
    /// The bytes are none or too many, or too many data wait.
    pub fn send(&self, bytes: &[u8], polls: u8) -> Result<u8, SendError> {
        self.outbox.lock(|outbox| outbox.borrow_mut().push(bytes, polls))
    }

    /// The next message of a host to the tag's program. A message that comes while the program has not taken two
    /// earlier ones, or has never asked for one, is refused, and its host is told so.
    pub async fn next_message(&self) -> UserData {
        self.takes_messages.store(true, Ordering::Relaxed);
        self.messages.receive().await
    }

    /// A host has a message for the tag's program.
    pub(crate) fn put_message(&self, data: UserData) -> Answer {
        if !self.takes_messages.load(Ordering::Relaxed) {
            return Answer::Unknown;
        }
        self.messages.try_send(data).map_or(Answer::Full, |()| Answer::Taken)
    }

    /// Answers a host's message with this number, in the next polls.
    pub(crate) fn answer(&self, number: u8, answer: Answer) {
        self.outbox.lock(|outbox| outbox.borrow_mut().answer(number, answer));
    }

    /// The engine has found a position, which is advertised.
    pub(crate) fn tell_found(&self, found: Option<Found>) {
        found.into_iter().for_each(|found| self.found.signal(found));
    }

    /// The newest position that was not taken before.
    pub(crate) async fn next_found(&self) -> Found {
        self.found.wait().await
    }

    /// A host asks for this rate, rounds in 100 s; 0 is that of the record.
    pub(crate) fn ask_rate(&self, chz: u32) {
        self.asked_rate.signal(chz);
    }

    /// The rate that a host has asked for since the last call.
    pub(crate) fn asked_rate(&self) -> Option<u32> {
        self.asked_rate.try_take()
    }

    /// The data for the next poll. The last poll carried those with the [`UserData::id`] `carried`.
    #[inline(never)]
    pub(crate) fn data(&self, carried: Option<(bool, u8)>) -> Option<UserData> {
        self.outbox.lock(|outbox| {
            let mut outbox = outbox.borrow_mut();
            if let Some(id) = carried {
                outbox.sent(id);
            }
            outbox.front()
        })
    }

    /// Returns when another task has roused the tag and its rate has not been taken since.
    pub(crate) async fn roused(&self, now_us: impl Fn() -> u64) -> Guidance {
        loop {
            self.rouse.wait().await;
            let guidance = self.take_guidance(now_us());
            if guidance.rate.is_some() {
                return guidance;
            }
        }
    }

    /// The motion sensor reports movement.
    pub(crate) fn tell_movement(&self) {
        self.movement.signal(());
    }

    pub(crate) async fn next_movement(&self) {
        self.movement.wait().await;
    }

    pub(crate) fn take_guidance(&self, now_us: u64) -> Guidance {
        let waiting = self.rounds.len();
        let [left_us, round_us] = self.workload.lock(|workload| {
            let workload = workload.borrow();
            [workload.left_us(now_us, waiting), workload.round_us()]
        });
        let guidance = self.guidance.lock(|cell| cell.replace(Guidance { rate: None, ..cell.get() }));
        let [busy, busy_per_round] = [left_us, round_us].map(RadioDuration::from_micros);
        Guidance { busy, busy_per_round, ..guidance }
    }

    /// The radio is off the air until the end of `quiet`.
    pub(crate) fn tell_quiet(&self, quiet: Quiet) {
        self.quiet.signal(quiet);
    }

    pub(crate) async fn next_quiet(&self) -> Quiet {
        self.quiet.wait().await
    }
}

impl<M: RawMutex> Default for TaskChannels<M> {
    fn default() -> Self {
        Self::new()
    }
}

/// Adds an item at the end, and drops the oldest items while there is no room. Returns the number of dropped items.
fn put<M: RawMutex, T, const N: usize>(channel: &Channel<M, T, N>, mut item: T) -> u32 {
    let mut dropped = 0;
    while let Err(embassy_sync::channel::TrySendError::Full(back)) = channel.try_send(item) {
        item = back;
        // If another task took an item meanwhile, there is room as well.
        dropped += u32::from(channel.try_receive().is_ok());
    }
    dropped
}

#[cfg(test)]
mod tests {
    use super::*;
    use embassy_futures::{block_on, poll_once};
    use embassy_sync::blocking_mutex::raw::NoopRawMutex;
    use ranging::RadioInstant;

    fn round(number: u16) -> exchange::Round<'static> {
        exchange::Round { number, poll: RadioInstant::default(), asked: 4, ranges: &[] }
    }

    #[test]
    fn the_oldest_round_goes_when_the_engine_is_late() {
        let channels = TaskChannels::<NoopRawMutex>::new();
        let dropped: std::vec::Vec<u32> = (1..=4).map(|number| channels.put_ranges(&round(number), 0, None)).collect();
        assert_eq!(dropped, [0, 0, 1, 1]);
        assert_eq!(block_on(channels.next_round()).measured().number(), 3);
        assert_eq!(block_on(channels.next_round()).measured().number(), 4);
    }

    #[test]
    fn a_rate_waits_until_it_is_taken_and_a_position_stays() {
        let channels = TaskChannels::<NoopRawMutex>::new();
        channels.guide(Guidance { rate: Some(Rate::Greedy), ..Guidance::NONE });
        channels.guide(Guidance { position_m: Some([1.0, 2.0, 3.0]), turns: true, ..Guidance::NONE });
        let rate = Some(Rate::Greedy);
        let taken = Guidance { position_m: Some([1.0, 2.0, 3.0]), rate, turns: true, ..Guidance::NONE };
        assert_eq!(channels.take_guidance(0), taken);
        assert_eq!(channels.take_guidance(0), Guidance { rate: None, ..taken });
    }

    #[test]
    fn data_wait_until_as_many_polls_have_carried_them() {
        let channels = TaskChannels::<NoopRawMutex>::new();
        let of = |carried| channels.data(carried).map(|data| (data.number(), data.bytes().to_vec()));
        let after = |carried: Option<u8>| of(carried.map(|number| (false, number)));
        assert_eq!((channels.send(b"a", 2), channels.send(b"bc", 0)), (Ok(0), Ok(1)));
        assert_eq!([channels.send(&[], 1), channels.send(&[0; 25], 1)], [Err(SendError::Length); 2]);
        let (first, second) = (Some((0, b"a".to_vec())), Some((1, b"bc".to_vec())));
        // A number that is not the first one's is of an earlier poll.
        assert_eq!([None, Some(7), Some(0)].map(after), [first.clone(), first.clone(), first]);
        assert_eq!([Some(0), None].map(after), [second.clone(), second]);
        assert_eq!(after(Some(1)), None);
        for number in 2..2 + DATA as u8 {
            assert_eq!(channels.send(&[0; 24], 1), Ok(number));
        }
        assert_eq!(channels.send(b"d", 1), Err(SendError::Full));
        // Refused data take no number.
        assert_eq!(after(None).map(|(number, _)| number), Some(2));
    }

    #[test]
    fn who_is_roused_takes_the_rate_once() {
        let channels = TaskChannels::<NoopRawMutex>::new();
        let every = Rate::Every(RadioDuration::from_micros(100_000));
        channels.guide(Guidance { position_m: Some([1.0, 2.0, 3.0]), ..Guidance::NONE });
        channels.rouse(every);
        let taken = Guidance { position_m: Some([1.0, 2.0, 3.0]), rate: Some(every), ..Guidance::NONE };
        assert_eq!(block_on(channels.roused(|| 0)), taken);
        // A rate that a report has taken rouses no task. The next rate does.
        channels.rouse(every);
        channels.take_guidance(0);
        assert_eq!(poll_once(channels.roused(|| 0)), core::task::Poll::Pending);
        channels.rouse(Rate::Greedy);
        assert_eq!(block_on(channels.roused(|| 0)).rate, Some(Rate::Greedy));
    }

    #[test]
    fn ranging_hears_how_long_the_engine_will_be_busy() {
        let channels = TaskChannels::<NoopRawMutex>::new();
        let busy = |now_us| channels.take_guidance(now_us).busy.as_micros();
        channels.begin(10_000);
        channels.end(13_000);
        assert_eq!(busy(13_000), 0);
        channels.put_ranges(&round(1), 0, None);
        assert_eq!(busy(20_000), 3_000);
        block_on(channels.next_round());
        channels.begin(20_000);
        channels.put_ranges(&round(2), 0, None);
        // Two of the three milliseconds of the first, and three of the second.
        assert_eq!(busy(21_000), 5_000);
    }
}
