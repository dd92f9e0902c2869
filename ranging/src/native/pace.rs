//! How quick this node is, measured while it runs.
//!
//! Inputs are instants of the radio's own clock ([`Pace`](crate::Pace)): when the command for a transmission had
//! reached the chip, when the receiver was on again, and when a frame had been processed. Outputs are the lead, which
//! is the time before its own transmissions at which the node decides, and the node's request for the network's layout.
//! A board that became slower (another task, flash, a compiler) shows it by a single late start. The estimate of a
//! board that became quicker sinks slowly.

use super::ReplyDelay;
use crate::RadioDuration;
use wire::uwb::layout::{Layout, Scheme, Span};

/// Added to a measured duration: the chip's own start (10 µs from the command to the first pulse), the steps of timers
/// …
const MARGIN: RadioDuration = RadioDuration::from_micros(30);
/// … and this fraction of the duration. To the time until the receiver is on again only this is added: if the receiver
/// is slightly late for a frame, it has lost only some symbols of the preamble.
const MARGIN_SHARE: i64 = 8;
/// The quantile sinks by this fraction of its distance to a shorter sample.
const DECAY: i64 = 64;
/// A longer sample does not measure the board.
const LONGEST: RadioDuration = RadioDuration::from_micros(10_000);

/// A high quantile of durations: it rises to a longer sample at once and sinks slowly, so that about one in some dozens
/// of samples is longer.
#[derive(Clone, Copy, Debug)]
struct Quantile {
    ticks: i64,
    is_measured: bool,
}

impl Quantile {
    const fn starting_at(duration: RadioDuration) -> Self {
        Self { ticks: duration.ticks(), is_measured: false }
    }

    fn take(&mut self, sample: RadioDuration) {
        let sample = sample.ticks().clamp(0, LONGEST.ticks());
        if !self.is_measured || sample > self.ticks {
            self.ticks = sample;
        } else {
            self.ticks -= (self.ticks - sample) / DECAY;
        }
        self.is_measured = true;
    }

    /// The quantile was too short by an unknown amount.
    fn grow(&mut self) {
        self.ticks = (self.ticks + self.ticks / 4).min(LONGEST.ticks());
    }

    fn with_share(&self) -> RadioDuration {
        with_share(RadioDuration::from_ticks(self.ticks))
    }

    fn with_margin(&self) -> RadioDuration {
        with_margin(RadioDuration::from_ticks(self.ticks))
    }
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
    answer: Quantile,
    listen_again: Quantile,
    lead: Quantile,
    /// As `lead`, for a frame that leaves as soon as possible.
    immediate: Quantile,
    reading: Quantile,
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
            answer: Quantile::starting_at(start.answer),
            listen_again: Quantile::starting_at(start.listen_again),
            lead: Quantile::starting_at(start.transmit),
            immediate: Quantile::starting_at(start.transmit),
            reading: Quantile::starting_at(RadioDuration::from_ticks(start.answer.ticks() / 2)),
        }
    }

    /// From the end of a frame until the command for the answer had reached the chip.
    pub fn answered(&mut self, after: RadioDuration) {
        self.answer.take(after);
    }

    /// From the end of a frame until the receiver was on again.
    pub fn listened(&mut self, after: RadioDuration) {
        self.listen_again.take(after);
    }

    /// From the end of a frame until the node had processed it. The next frame, which lasts `next`, comes meanwhile.
    pub fn dealt_with(&mut self, after: RadioDuration, next: RadioDuration) {
        self.reading.take(after);
        self.listen_again.take(RadioDuration::from_ticks(with_margin(after).ticks() - next.ticks()));
    }

    /// From a decision to transmit at once to the first pulse.
    pub fn left(&mut self, after: RadioDuration) {
        self.immediate.take(after);
    }

    /// From the instant at which the node was to wake until the command for a transmission had reached the chip. If the
    /// node was reading a frame then, it may have decided before that instant: only a longer time counts.
    pub fn led(&mut self, after: RadioDuration, was_awaited: bool) {
        if was_awaited || after.ticks() > self.lead.ticks {
            self.lead.take(after);
        }
    }

    /// The node decided this long after the instant at which it was to wake, too late for a transmission.
    pub fn overslept(&mut self, after: RadioDuration) {
        self.lead.take(RadioDuration::from_ticks(self.lead.ticks.saturating_add(after.ticks().max(0))));
    }

    /// An answer was too late, and the radio does not measure by how much.
    pub fn answer_was_late(&mut self) {
        self.answer.grow();
    }

    /// A transmission was too late, and the radio does not measure by how much.
    pub fn lead_was_short(&mut self) {
        self.lead.grow();
    }

    /// How long before a transmission's first pulse the node must wake and decide.
    ///
    /// A pinned lead that proved too short is increased: otherwise the node would be silent for ever.
    pub fn lead(&self) -> RadioDuration {
        match self.pinned {
            Some(pinned) => pinned.transmit.max(RadioDuration::from_ticks(self.lead.ticks)),
            None => self.lead.with_margin(),
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
        let half = self.answer_or_lead().ticks / 2;
        RadioDuration::from_ticks(if self.reading.is_measured { self.reading.ticks } else { half })
    }

    /// A node that was never asked takes as long for an answer as for any transmission: both write a frame after a
    /// wake-up.
    fn answer_or_lead(&self) -> &Quantile {
        if self.answer.is_measured || !self.lead.is_measured { &self.answer } else { &self.lead }
    }

    /// This node's request for the network's layout: nothing if it has measured nothing.
    pub fn wish(&self, scheme: Scheme) -> Layout {
        let measured =
            |quantile: &Quantile, span| if quantile.is_measured { Span::at_least(span) } else { Span::default() };
        let (answer, listen_again) = (self.answer_or_lead(), &self.listen_again);
        let [answer, listen_again] = match self.pinned {
            Some(pinned) => [pinned.answer, pinned.listen_again].map(Span::at_least),
            None => [measured(answer, answer.with_margin()), measured(listen_again, listen_again.with_share())],
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
        // 200 + 25 + 30.
        assert_eq!(meter.lead().as_micros(), 255);
        meter.led(us(800), true);
        assert_eq!(meter.lead().as_micros(), 930);
        meter.led(us(0), false);
        assert_eq!(meter.lead().as_micros(), 930);
        for _ in 0..64 {
            meter.led(us(200), true);
        }
        // 200 + 600 · (1 − 1/64)^64 = 200 + 600 · 0.365 = 419 µs; 419 · 9/8 + 30 = 501.
        assert!((499..=504).contains(&meter.lead().as_micros()), "{:?}", meter.lead());
    }

    #[test]
    fn who_listens_again_late_asks_for_an_eighth_more_and_who_reads_long_for_the_rest_of_that() {
        let mut meter = Meter::new(None);
        meter.listened(us(64));
        // 64 + 8 = 72 µs = (16 + 2) · 2².
        assert_eq!(meter.wish(Scheme::SingleSided).listen_again.duration(), us(72));
        // A frame takes 320 µs, and the next one starts after 230: 320 + 40 + 30 − 230 = 160, and 20 more: (16 + 7) ·
        // 2³ = 184.
        meter.dealt_with(us(320), us(230));
        assert_eq!(meter.wish(Scheme::SingleSided).listen_again.duration(), us(184));
    }

    #[test]
    fn what_is_pinned_is_not_measured() {
        let pinned = ReplyDelay { answer: us(256), listen_again: us(64), transmit: us(150) };
        let mut meter = Meter::new(Some(pinned));
        meter.answered(us(900));
        meter.led(us(100), true);
        assert_eq!(meter.lead(), us(150));
        // A pinned value that is too short is increased.
        meter.led(us(900), true);
        assert_eq!(meter.lead(), us(900));
        let wish = meter.wish(Scheme::DoubleSided);
        assert_eq!([wish.answer.duration(), wish.listen_again.duration()], [us(256), us(64)]);
    }

    #[test]
    fn who_was_never_asked_answers_as_quickly_as_it_sends() {
        let mut meter = Meter::new(None);
        meter.led(us(160), true);
        // 160 + 20 + 30 = 210 µs; the next span is (16 + 11) · 2³ = 216 µs.
        assert_eq!(meter.wish(Scheme::SingleSided).answer.duration(), us(216));
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
        // 320 + 40 + 30.
        assert_eq!(meter.lead().as_micros(), 390);
    }

    #[test]
    fn nonsense_is_bounded() {
        let mut meter = Meter::new(None);
        meter.led(RadioDuration::from_ticks(i64::MAX), true);
        meter.answered(RadioDuration::from_ticks(i64::MIN));
        for _ in 0..100 {
            meter.lead_was_short();
        }
        assert_eq!(meter.lead().as_micros(), 11_280);
    }
}
