//! Reads the channel impulse response of a round's last frame. It reads while the radio awaits nothing else, and
//! computes the features of the response's shape, which are reported with the range.
//!
//! The radio has one accumulator, and the next reception overwrites it. Inside a round there is no time to read it:
//! reading takes 0.8 ms on a DWM1001, where responses follow each other every 0.25 ms. At the end of a round there is
//! time. The anchors take turns in being the last ([`Guidance::turns`](ranging::exchange::Guidance)), so that the
//! response of every anchor is read. The response of an anchor is read only once in a while, so that a tag that ranges
//! all the time is not slowed down: an obstacle in a link does not change every millisecond.

use heapless::Vec;
use positioning_core::nlos::{BEFORE, Shape, WINDOW, magnitude};
use ranging::exchange::{Action, Event, Report};
use ranging::native::MAX_ROUND;
use ranging::{Radio, ResponseWindow};

/// The least time from one reading of an anchor's response to the next, microseconds. With eight anchors the readings
/// take four per cent of a DWM1001's time.
const EVERY_US: u64 = 150_000;

/// The shape of one frame's impulse response.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sounding {
    /// The sender of the frame.
    pub peer: u16,
    /// The features of the shape.
    pub shape: Shape,
}

/// Reads impulse responses when they are wanted.
#[derive(Debug, Default)]
pub(crate) struct Sounder {
    /// Whether the engine wants them.
    pub(crate) wanted: bool,
    /// Anchors whose response was read, and when it may be read again, microseconds since the node started.
    read: Vec<(u16, u64), MAX_ROUND>,
    /// The sender of the frame that ended the round to be reported, and the index of its first path.
    last: Option<(u16, f32)>,
    sounding: Option<Sounding>,
}

impl Sounder {
    /// Observes the outcome of the last action, and the next action. It notes the frame that was just received if the
    /// last range of the round comes from it.
    pub(crate) fn observe(&mut self, event: &Event<'_>, action: &Action<'_>) {
        self.last = match (event, action) {
            (Event::Received(frame), Action::Report(Report::Round(round))) => {
                let of_frame = round.ranges.last().filter(|range| range.diagnostics == frame.diagnostics);
                of_frame.map(|range| (range.peer, frame.diagnostics.first_path_index))
            }
            _ => None,
        };
    }

    /// Reads what the radio still holds of that frame, if it is wanted and due.
    pub(crate) async fn look<R: Radio>(&mut self, radio: &mut R, now_us: u64) -> Result<bool, R::Error> {
        self.sounding = None;
        let Some((peer, first_path_index)) = self.last.take().filter(|(peer, _)| self.is_due(*peer, now_us)) else {
            return Ok(false);
        };
        let mut magnitudes = [0; WINDOW];
        let mut places = magnitudes.iter_mut();
        let window = ResponseWindow { first_path_index, before: BEFORE as u16, count: WINDOW as u16 };
        let take = |sample: ranging::Sample| {
            if let Some(place) = places.next() {
                *place = magnitude(sample.i, sample.q);
            }
        };
        if let Some(first) = radio.impulse_response(window, take).await? {
            self.note(peer, now_us.saturating_add(EVERY_US));
            let shape = Shape::of(&magnitudes, first_path_index - f32::from(first));
            self.sounding = shape.map(|shape| Sounding { peer, shape });
        }
        Ok(true)
    }

    fn is_due(&self, peer: u16, now_us: u64) -> bool {
        self.wanted && self.read.iter().all(|(read, next_us)| *read != peer || now_us >= *next_us)
    }

    /// Notes when this anchor's response may be read again. If the list is full, the entry that is due first is
    /// replaced.
    fn note(&mut self, peer: u16, next_us: u64) {
        if let Some((_, next)) = self.read.iter_mut().find(|(read, _)| *read == peer) {
            *next = next_us;
        } else if self.read.push((peer, next_us)).is_err()
            && let Some(oldest) = self.read.iter_mut().min_by_key(|(_, next)| *next)
        {
            *oldest = (peer, next_us);
        }
    }

    /// Takes the features of the round's last frame.
    pub(crate) fn take(&mut self) -> Option<Sounding> {
        self.sounding.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::convert::Infallible;
    use embassy_futures::block_on;
    use ranging::exchange::{Range, Round};
    use ranging::radio::{Capabilities, MAX_FRAME, RangeBias};
    use ranging::{Diagnostics, RadioDuration, RadioInstant, ReceiveError, RxFrame, Sample, Start, TransmitError};

    /// A radio that has an accumulator and nothing else. It counts the readings.
    struct Accumulator {
        samples: std::vec::Vec<Sample>,
        holds: bool,
        reads: usize,
    }

    impl Radio for Accumulator {
        type Error = Infallible;

        const CAPABILITIES: Capabilities =
            Capabilities { channels: &[], pulse_rates: &[], data_rates: &[], preambles: &[], delayed_step: 1 };

        async fn now(&mut self) -> Result<RadioInstant, Infallible> {
            Ok(RadioInstant::default())
        }

        fn antenna_delay(&self) -> RadioDuration {
            RadioDuration::ZERO
        }

        fn range_bias(&self) -> RangeBias {
            RangeBias::NONE
        }

        async fn transmit(&mut self, _: &[u8], _: Start, _: bool) -> Result<RadioInstant, TransmitError<Infallible>> {
            Err(TransmitError::Late)
        }

        async fn receive<'b>(
            &mut self,
            _: &'b mut [u8; MAX_FRAME],
            _: Start,
            _: RadioDuration,
            _: bool,
        ) -> Result<RxFrame<'b>, ReceiveError<Infallible>> {
            Err(ReceiveError::Timeout)
        }

        async fn idle(&mut self) -> Result<(), Infallible> {
            Ok(())
        }

        async fn impulse_response(
            &mut self,
            window: ResponseWindow,
            take: impl FnMut(Sample),
        ) -> Result<Option<u16>, Infallible> {
            self.reads += 1;
            let all = self.samples.len() as u16;
            let first = (window.first_path_index as u16).saturating_sub(window.before).min(all - window.count);
            self.samples.iter().skip(first.into()).take(window.count.into()).copied().for_each(take);
            Ok(self.holds.then_some(first))
        }
    }

    fn with(sample: impl Fn(i32) -> i16) -> Accumulator {
        Accumulator { samples: (0..1016).map(|at| Sample { i: sample(at), q: 0 }).collect(), holds: true, reads: 0 }
    }

    /// A peak of 1000 at sample 752, and noise of 0 to 6 elsewhere.
    fn peaked() -> Accumulator {
        with(|at| if at == 752 { 1000 } else { (at * 5 % 7) as i16 })
    }

    fn look(sounder: &mut Sounder, radio: &mut Accumulator, first_path_index: f32, now_us: u64) -> Option<Sounding> {
        look_at(7, sounder, radio, first_path_index, now_us)
    }

    fn look_at(
        peer: u16,
        sounder: &mut Sounder,
        radio: &mut Accumulator,
        first_path_index: f32,
        now_us: u64,
    ) -> Option<Sounding> {
        let diagnostics = Diagnostics { first_path_index, ..Diagnostics::default() };
        let frame = RxFrame { bytes: &[], rx_time: RadioInstant::default(), diagnostics };
        let range = Range { peer, distance_m: 3.0, deviation_m: 0.1, position_m: None, diagnostics };
        let round = Round { number: 1, poll: RadioInstant::default(), asked: 1, ranges: &[range] };
        sounder.observe(&Event::Received(frame), &Action::Report(Report::Round(round)));
        match block_on(sounder.look(radio, now_us)) {
            Ok(_) => sounder.take(),
            Err(never) => match never {},
        }
    }

    #[test]
    fn a_rounds_last_frame_is_sounded_now_and_then() {
        let (mut sounder, mut radio) = (Sounder { wanted: true, ..Sounder::default() }, peaked());
        let sounding = look(&mut sounder, &mut radio, 750.5, 5).unwrap();
        assert_eq!(sounding.peer, 7);
        // From 750.5 to 752: 1.5 samples of 1.0016026 ns.
        assert!((sounding.shape.first_path_to_peak_ns - 1.502_404).abs() < 1e-4, "{sounding:?}");
        assert_eq!(look(&mut sounder, &mut radio, 750.5, 150_004), None);
        assert_eq!(radio.reads, 1);
        assert!(look(&mut sounder, &mut radio, 750.5, 150_005).is_some());
        assert_eq!(sounder.take(), None, "one goes with one round");
    }

    #[test]
    fn every_anchor_has_its_own_time() {
        let (mut sounder, mut radio) = (Sounder { wanted: true, ..Sounder::default() }, peaked());
        let mut due = |peer, now_us| look_at(peer, &mut sounder, &mut radio, 750.5, now_us).is_some();
        // One more anchor than the list can hold: the one read first is removed, and is due again.
        assert!((0..=MAX_ROUND as u16).all(|peer| due(peer, peer.into())));
        assert!(!due(1, 10) && due(0, 10));
    }

    #[test]
    fn nothing_is_read_that_is_not_wanted_or_not_there() {
        let mut radio = peaked();
        assert_eq!(look(&mut Sounder::default(), &mut radio, 750.5, 0), None);
        assert_eq!(radio.reads, 0);
        let mut sounder = Sounder { wanted: true, ..Sounder::default() };
        radio.holds = false;
        assert_eq!(look(&mut sounder, &mut radio, 750.5, 0), None);
        // A window that ended after the frame: the accumulator may hold another frame.
        let round = Round { number: 1, poll: RadioInstant::default(), asked: 1, ranges: &[] };
        sounder.observe(&Event::Timeout, &Action::Report(Report::Round(round)));
        radio.holds = true;
        let Ok(_) = block_on(sounder.look(&mut radio, 0));
        assert_eq!((sounder.take(), radio.reads), (None, 1));
    }

    #[test]
    fn hostile_accumulators_make_no_panic_and_no_shape_of_nothing() {
        let first_paths = [0.0, 0.01, 1015.98, 5000.0, -1.0, f32::NAN, f32::INFINITY];
        for first_path_index in first_paths {
            for mut radio in [with(|_| 0), with(|_| i16::MIN), with(|_| i16::MAX)] {
                let mut sounder = Sounder { wanted: true, ..Sounder::default() };
                assert_eq!(look(&mut sounder, &mut radio, first_path_index, 0), None, "{first_path_index}");
            }
            let mut sounder = Sounder { wanted: true, ..Sounder::default() };
            let found = look(&mut sounder, &mut peaked(), first_path_index, u64::MAX);
            // At the ends of the accumulator the window is moved inside, and still contains the first path.
            assert_eq!(found.is_some(), (0.0..1016.0).contains(&first_path_index), "{first_path_index}");
        }
    }
}
