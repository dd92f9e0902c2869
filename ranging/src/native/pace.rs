//! How quick this node is, measured while it runs.
//!
//! Inputs are instants of the radio's own clock ([`Pace`](crate::Pace)): when the command for a transmission had
//! reached the chip, when the receiver was on again, and when a frame had been processed. Outputs are the lead, which
//! is the time before its own transmissions at which the node decides, and the node's request for the network's layout.
//!
//! Peers wait for a node's answers and for its receiver in every round. So the node requests what most of its samples
//! need. Its own transmissions cost only itself, so its lead follows the longest sample. A board that became slower
//! (another task, flash, a compiler) shows it by a few late answers, or by a single late transmission. The estimates of
//! a board that became quicker sink slowly.

use super::ReplyDelay;
use crate::RadioDuration;
use wire::uwb::layout::{Layout, Scheme, Span};

/// Added to a measured duration: the chip's own start (10 µs from the command to the first pulse), the steps of timers
/// …
const MARGIN: RadioDuration = RadioDuration::from_micros(30);
/// … and for the node's own transmissions also an interrupt of a Bluetooth controller (40 µs): a longer lead costs nobody
/// else. Added is this, …
const LEAD_MARGIN: RadioDuration = RadioDuration::from_micros(60);
/// … and this fraction of the duration. To the time until the receiver is on again only this is added: if it is slightly
/// late for a frame, it has lost only some symbols of the preamble.
const MARGIN_SHARE: i64 = 8;
/// To the time until a response was processed this is added: the radio's second buffer holds the next one meanwhile.
const READING_MARGIN_SHARE: i32 = 16;
/// The estimate sinks by this fraction of its distance to a shorter sample …
const DECAY: i32 = 64;
/// … and rises by at most this fraction of itself for a longer one, …
const RISE: i32 = 16;
/// … one of a gap between responses, of which a round has up to seven, by this fraction …
const RISE_OF_GAP: i32 = 7 * RISE;
/// … unless this many samples in a row were longer. Then the board has become slower, and the estimate rises to the
/// shortest of them at once.
const SLOWER_AFTER: u8 = 4;
/// A longer sample does not measure the board.
const LONGEST: RadioDuration = RadioDuration::from_micros(10_000);

/// An upper limit of durations.
#[derive(Clone, Copy, Debug)]
struct Limit {
    /// Of at most 20 ms, which a record may pin: they fit into 32 bits, which a node's processor is quick with.
    ticks: i32,
    is_measured: bool,
    /// Samples in a row that were longer, and the shortest of them.
    longer: u8,
    shortest: i32,
}

impl Limit {
    const fn starting_at(duration: RadioDuration) -> Self {
        Self { ticks: duration.ticks() as i32, is_measured: false, longer: 0, shortest: 0 }
    }

    /// Takes a sample into a limit of nearly all durations: a longer sample counts at once, so that about one in some
    /// dozens of samples is longer.
    fn take_at_once(&mut self, sample: RadioDuration) {
        let sample = ticks(sample);
        if !self.is_measured || sample > self.ticks { self.set(sample) } else { self.sink(sample) }
    }

    /// Takes a sample into a limit of most durations, chosen by its cost. A slot that is longer by x costs x in every
    /// round. A sample beyond the limit costs one answer. So the limit follows small variations at once, but single
    /// long samples, whatever their length, raise it little: if a fraction p of the samples is long, by about
    /// 64·p / `rise` of itself. This holds for the first sample too, against what the node assumed of itself.
    fn take_by_cost(&mut self, sample: RadioDuration, rise: i32) {
        let sample = ticks(sample);
        if sample <= self.ticks {
            if self.is_measured { self.sink(sample) } else { self.set(sample) }
        } else {
            self.is_measured = true;
            self.shortest = if self.longer == 0 { sample } else { self.shortest.min(sample) };
            self.longer += 1;
            if self.longer >= SLOWER_AFTER {
                self.set(self.shortest);
            } else {
                self.ticks = sample.min(self.ticks + self.ticks / rise);
            }
        }
    }

    fn set(&mut self, ticks: i32) {
        (self.ticks, self.is_measured, self.longer) = (ticks, true, 0);
    }

    fn sink(&mut self, sample: i32) {
        self.ticks -= (self.ticks - sample) / DECAY;
        self.longer = 0;
    }

    /// The limit was too short by an unknown amount.
    fn grow(&mut self) {
        self.ticks = (self.ticks + self.ticks / 4).min(ticks(LONGEST));
    }

    fn with_share(&self) -> RadioDuration {
        with_share(self.duration())
    }

    fn with_margin(&self) -> RadioDuration {
        with_margin(self.duration())
    }

    const fn duration(&self) -> RadioDuration {
        RadioDuration::from_ticks(self.ticks as i64)
    }
}

/// The sample's ticks, with nonsense bounded.
fn ticks(sample: RadioDuration) -> i32 {
    sample.ticks().clamp(0, LONGEST.ticks()) as i32
}

fn with_share(duration: RadioDuration) -> RadioDuration {
    RadioDuration::from_ticks(duration.ticks() + duration.ticks() / MARGIN_SHARE)
}

fn with_margin(duration: RadioDuration) -> RadioDuration {
    RadioDuration::from_ticks(with_share(duration).ticks() + MARGIN.ticks())
}

/// The node's measurements of itself, or the values of its config record instead.
#[derive(Clone, Debug)]
pub struct Meter {
    pinned: Option<ReplyDelay>,
    answer: Limit,
    /// It has had to answer. Until then `answer` is a limit of most transmissions: both write a frame after a wake-up.
    /// The lead says too much: a single transmission that had to wait for other work makes that long.
    was_asked: bool,
    listen_again: Limit,
    lead: Limit,
    /// As `lead`, for a frame that leaves as soon as possible.
    immediate: Limit,
    reading: Limit,
    /// The time on the air of a response.
    next: RadioDuration,
}

impl Meter {
    /// Nothing measured yet. Pinned values are not measured.
    pub const fn new(pinned: Option<ReplyDelay>) -> Self {
        let start = match pinned {
            Some(pinned) => pinned,
            None => ReplyDelay::START,
        };
        Self {
            pinned,
            answer: Limit::starting_at(start.answer),
            was_asked: false,
            listen_again: Limit::starting_at(start.listen_again),
            lead: Limit::starting_at(start.transmit),
            immediate: Limit::starting_at(start.transmit),
            reading: Limit::starting_at(RadioDuration::from_ticks(start.answer.ticks() / 2)),
            next: RadioDuration::ZERO,
        }
    }

    /// From the end of a frame until the command for the answer had reached the chip.
    pub fn answered(&mut self, after: RadioDuration) {
        self.first_hand_answer().take_by_cost(after, RISE);
    }

    /// The limit of answers, without what transmissions say of it.
    fn first_hand_answer(&mut self) -> &mut Limit {
        if !self.was_asked {
            (self.answer, self.was_asked) = (Limit::starting_at(ReplyDelay::START.answer), true);
        }
        &mut self.answer
    }

    /// From the end of a frame until the receiver was on again.
    pub fn listened(&mut self, after: RadioDuration) {
        self.listen_again.take_by_cost(after, RISE_OF_GAP);
    }

    /// As [`listened`](Self::listened), where tags that only listen receive the same responses. They can request
    /// nothing, so the longest sample counts.
    pub fn listened_for_listeners(&mut self, after: RadioDuration) {
        self.listen_again.take_at_once(after);
    }

    /// From the end of a response until the node had processed it. The next response, which lasts `next`, comes
    /// meanwhile.
    pub fn dealt_with(&mut self, after: RadioDuration, next: RadioDuration) {
        self.reading.take_by_cost(after, RISE_OF_GAP);
        self.next = next;
    }

    /// As [`dealt_with`](Self::dealt_with), for another frame, which takes longer than a response. It counts only as
    /// long as no response was measured, and if the node is more than twice as slow as it assumed.
    pub fn dealt_with_other(&mut self, after: RadioDuration, next: RadioDuration) {
        if !self.reading.is_measured && after.ticks() > ReplyDelay::START.answer.ticks() {
            self.reading.ticks = ticks(after);
            self.next = next;
        }
    }

    /// From a decision to transmit at once to the first pulse.
    pub fn left(&mut self, after: RadioDuration) {
        self.immediate.take_at_once(after);
    }

    /// From the instant at which the node was to wake until the command for a transmission had reached the chip. If the
    /// node was reading a frame then, it may have decided before that instant: only a longer time counts.
    pub fn led(&mut self, after: RadioDuration, was_awaited: bool) {
        if was_awaited && !self.was_asked {
            self.transmitted(after);
        }
        if was_awaited || after > self.lead.duration() {
            self.lead.take_at_once(after);
        }
    }

    /// Until the node was asked: afterwards, in each round, this is not done.
    #[cold]
    fn transmitted(&mut self, after: RadioDuration) {
        self.answer.take_by_cost(after, RISE);
    }

    /// The node decided this long after the instant at which it was to wake, too late for a transmission. Who was halted
    /// is not slow.
    pub fn overslept(&mut self, after: RadioDuration) {
        if after.ticks() <= LONGEST.ticks() {
            self.lead.take_at_once(RadioDuration::from_ticks(i64::from(self.lead.ticks + ticks(after))));
        }
    }

    /// An answer was too late, and the radio does not measure by how much.
    pub fn answer_was_late(&mut self) {
        self.first_hand_answer().grow();
    }

    /// A transmission was too late, and the radio does not measure by how much.
    pub fn lead_was_short(&mut self) {
        self.lead.grow();
    }

    /// How long before a transmission's first pulse the node must wake and decide.
    ///
    /// A pinned lead that proved too short is increased, with the same margin: otherwise the node would be silent for
    /// ever.
    pub fn lead(&self) -> RadioDuration {
        match self.pinned {
            Some(pinned) if self.lead.is_measured => pinned.transmit.max(self.lead.with_margin()),
            Some(pinned) => pinned.transmit.max(self.lead.duration()),
            None => RadioDuration::from_ticks(self.lead.with_share().ticks() + LEAD_MARGIN.ticks()),
        }
    }

    /// From a decision to transmit at once to the first pulse. If no frame has left at once yet: as for any
    /// transmission.
    pub fn immediate(&self) -> RadioDuration {
        if self.immediate.is_measured { self.immediate.with_margin() } else { self.lead() }
    }

    /// The approximate time from the end of a frame until the node has processed it. If only the time of an answer is
    /// known: half of it.
    pub fn reading(&self) -> RadioDuration {
        let half = RadioDuration::from_ticks(self.answer.duration().ticks() / 2);
        if self.reading.is_measured { self.reading.duration() } else { half }
    }

    /// This node's request for the network's layout: nothing if it has measured nothing.
    pub fn wish(&self, scheme: Scheme) -> Layout {
        let measured = |limit: &Limit, span| if limit.is_measured { Span::at_least(span) } else { Span::default() };
        let [answer, listen_again] = match self.pinned {
            Some(pinned) => [pinned.answer, pinned.listen_again].map(Span::at_least),
            None => {
                let listen_again = measured(&self.listen_again, self.listen_again.with_share());
                // Unless a response was awaited, there is no gap to request.
                let is_known = self.next > RadioDuration::ZERO;
                let reading = i64::from(self.reading.ticks + self.reading.ticks / READING_MARGIN_SHARE);
                let gap = RadioDuration::from_ticks(reading - self.next.ticks());
                let gap = if is_known { Span::at_least(gap) } else { Span::default() };
                [measured(&self.answer, self.answer.with_margin()), listen_again.max(gap)]
            }
        };
        Layout { answer, listen_again, scheme }
    }

    /// The layout of a network that this node founds.
    pub fn first_layout(&self) -> Layout {
        let first = Layout {
            answer: Span::at_least(self.answer.with_margin()),
            listen_again: Span::at_least(self.listen_again.with_share()),
            scheme: Scheme::SingleSided,
        };
        if self.pinned.is_some() { self.wish(Scheme::SingleSided) } else { first }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn us(micros: u32) -> RadioDuration {
        RadioDuration::from_micros(micros)
    }

    #[test]
    fn one_late_start_counts_at_once_and_is_forgotten_slowly() {
        let mut meter = Meter::new(None);
        meter.led(us(200), true);
        // 200 + 25 + 60.
        assert_eq!(meter.lead().as_micros(), 285);
        meter.led(us(800), true);
        assert_eq!(meter.lead().as_micros(), 960);
        meter.led(us(0), false);
        assert_eq!(meter.lead().as_micros(), 960);
        for _ in 0..64 {
            meter.led(us(200), true);
        }
        // 200 + 600 · (1 − 1/64)^64 = 200 + 600 · 0.365 = 419 µs; 419 · 9/8 + 60 = 531.
        assert!((529..=534).contains(&meter.lead().as_micros()), "{:?}", meter.lead());
    }

    #[test]
    fn who_listens_again_late_asks_for_an_eighth_more_and_who_reads_long_for_a_sixteenth_more() {
        let mut meter = Meter::new(None);
        meter.listened(us(64));
        // 64 + 8 = 72 µs = (16 + 2) · 2².
        assert_eq!(meter.wish(Scheme::SingleSided).listen_again.duration(), us(72));
        // A frame takes 320 µs, and the next one lasts 230: 320 + 20 − 230 = 110; the next span is (16 + 12) · 2² = 112.
        (0..4).for_each(|_| meter.dealt_with(us(320), us(230)));
        assert_eq!(meter.wish(Scheme::SingleSided).listen_again.duration(), us(112));
    }

    /// What a node requests for its answers after these samples of microseconds.
    fn asks_after(samples: impl IntoIterator<Item = u32>) -> RadioDuration {
        let mut meter = Meter::new(None);
        samples.into_iter().for_each(|sample| meter.answered(us(sample)));
        meter.wish(Scheme::SingleSided).answer.duration()
    }

    #[test]
    fn a_stall_now_and_then_costs_the_network_little_whatever_its_length() {
        // 250 + 31.25 + 30 = 311 µs; the next span is 320.
        assert_eq!(asks_after([250; 40]), us(320));
        // One in forty: 4 · 250 / 40 = 25 µs more, and 16 more just after a stall: 291 + 36 + 30 = 357; the next span
        // is 368. The longest sample would ask for 3,405 µs.
        let stalled = |stall| (0..400).map(move |number| if number % 40 == 39 { stall } else { 250 });
        assert!((us(320)..=us(368)).contains(&asks_after(stalled(3_000))), "{:?}", asks_after(stalled(3_000)));
        assert_eq!(asks_after(stalled(9_000)), asks_after(stalled(3_000)));
    }

    #[test]
    fn a_long_frame_now_and_then_costs_a_gap_between_responses_less_than_an_answer() {
        // One in ten takes twice as long, as a line of the log does: 64 · 300 / 10 / 112 = 17 µs more, and 3 just after
        // one: 320 · 9/8 − 200 = 160 µs, after 137 without. The spans are 144 and 160, or 168.
        let mut meter = Meter::new(None);
        (0..400).for_each(|number| meter.dealt_with(us(if number % 10 == 9 { 600 } else { 300 }), us(200)));
        let gap = meter.wish(Scheme::SingleSided).listen_again.duration();
        assert!((us(144)..=us(168)).contains(&gap), "{gap:?}");
    }

    #[test]
    fn small_variations_count_at_once() {
        // 264 + 33 + 30 = 327 µs; the next span is 336.
        assert_eq!(asks_after([250, 250, 264]), us(336));
    }

    #[test]
    fn a_board_that_became_slower_asks_for_it_after_four_answers() {
        // The shortest of the four: 900 + 112.5 + 30 = 1,042.5 µs = 1,088 as a span, (16 + 1) · 2⁶.
        assert_eq!(asks_after([250, 250, 2_000, 900, 950, 3_000]), us(1_088));
    }

    #[test]
    fn before_its_first_round_a_node_knows_only_whether_it_is_very_slow() {
        let mut meter = Meter::new(None);
        let gap = |meter: &Meter| meter.wish(Scheme::SingleSided).listen_again;
        // A response may take half of this sync frame's 500 µs, which is assumed anyway.
        meter.dealt_with_other(us(500), us(180));
        assert_eq!(gap(&meter), Span::default());
        // 800 · 17/16 − 180 = 670 µs; the next span is (16 + 5) · 2⁵ = 672.
        meter.dealt_with_other(us(800), us(180));
        assert_eq!(gap(&meter).duration(), us(672));
        // The first response counts instead: 600 · 17/16 − 180 = 457.5; 464 = (16 + 13) · 2⁴.
        meter.dealt_with(us(600), us(180));
        meter.dealt_with_other(us(800), us(180));
        assert_eq!(gap(&meter).duration(), us(464));
    }

    #[test]
    fn what_is_pinned_is_not_measured() {
        let pinned = ReplyDelay { answer: us(256), listen_again: us(64), transmit: us(150) };
        let mut meter = Meter::new(Some(pinned));
        meter.answered(us(900));
        meter.led(us(100), true);
        assert_eq!(meter.lead(), us(150));
        // A pinned value that is too short is increased: 800 + 100 + 30.
        meter.led(us(800), true);
        assert_eq!(meter.lead(), us(930));
        let wish = meter.wish(Scheme::DoubleSided);
        assert_eq!([wish.answer.duration(), wish.listen_again.duration()], [us(256), us(64)]);
    }

    #[test]
    fn who_was_never_asked_answers_as_quickly_as_it_sends() {
        let mut meter = Meter::new(None);
        meter.led(us(90), false);
        assert_eq!(meter.wish(Scheme::SingleSided), Layout::LEAST, "ready before its time");
        meter.led(us(160), true);
        // 160 + 20 + 30 = 210 µs; the next span is (16 + 11) · 2³ = 216 µs.
        assert_eq!(meter.wish(Scheme::SingleSided).answer.duration(), us(216));
        // Other work was in the way of one: it counts as the sixteenth part, 170 + 21 + 30.
        meter.led(us(4_050), true);
        assert_eq!(meter.wish(Scheme::SingleSided).answer.duration(), us(224));
        meter.answered(us(400));
        // 400 + 50 + 30 = 480 µs = (16 + 14) · 2⁴.
        assert_eq!(meter.wish(Scheme::SingleSided).answer.duration(), us(480));
    }

    #[test]
    fn who_has_measured_nothing_asks_for_nothing_and_founds_with_time_to_spare() {
        let meter = Meter::new(None);
        assert_eq!(meter.wish(Scheme::SingleSided), Layout::LEAST);
        // 500 · 9/8 + 30 = 592.5 µs, rounded up to (16 + 3) · 2⁵ = 608.
        assert_eq!(meter.first_layout().answer.duration(), us(608));
    }

    #[test]
    fn who_woke_too_late_to_send_wakes_earlier_by_as_much() {
        let mut meter = Meter::new(None);
        meter.led(us(120), true);
        meter.overslept(us(200));
        // 320 + 40 + 60.
        assert_eq!(meter.lead().as_micros(), 420);
    }

    #[test]
    fn nonsense_is_bounded() {
        let mut meter = Meter::new(None);
        meter.led(RadioDuration::from_ticks(i64::MAX), true);
        meter.answered(RadioDuration::from_ticks(i64::MIN));
        for _ in 0..100 {
            meter.lead_was_short();
        }
        assert_eq!(meter.lead().as_micros(), 11_310);
    }
}
