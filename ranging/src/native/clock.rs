//! The rate of an anchor's clock relative to the tag's, from successive polls and from the carrier.
//!
//! A poll leaves at a known instant of the tag's clock and arrives at an instant of the anchor's clock, which the
//! response contains. From poll to poll the anchor's clock gains or loses according to its rate. A Kalman filter
//! follows two states: the error of the anchor's last timestamp (ticks), and the rate (a fraction). It has three
//! noises: that of a reception's timestamp; the tag's motion between polls, which changes the time of flight; and the
//! wander of both crystals. The carrier integrator measures the rate alone. It is twenty times coarser, but available
//! with the first response. Both measure the same state, so the filter weights both by their variances.
//!
//! The carrier also identifies the sender of a frame: crystals differ by some millionths. Once an anchor's crystal is
//! known, a frame with another carrier is not the anchor's ([`expects`](ClockModel::expects)).

use crate::{RadioDuration, RadioInstant};

/// Standard deviation of a reception's timestamp, ticks: 0.1 ns (3 cm).
pub const STAMP_DEVIATION_TICKS: f32 = 6.4;
/// Standard deviation of the rate by the carrier integrator.
const CARRIER_DEVIATION: f32 = 0.2e-6;
/// Standard deviation of an unknown rate: two crystals of ±20 ppm.
const UNKNOWN_RATE_DEVIATION: f32 = 40e-6;
/// The rates of two intact crystals never differ by more than this.
const IMPLAUSIBLE_RATE: f32 = 100e-6;
/// A timestamp may jump by this many ticks (100 m: another path of the signal). A larger jump means that the anchor was
/// restarted.
const IMPLAUSIBLE_JUMP_TICKS: f32 = 21_000.0;
/// Wander of the rate, variance per second: 0.05 ppm after a second.
const RATE_WANDER: f32 = 2.5e-15;
/// Variance that is added for a crystal that was off: 0.1 ppm, until its temperature is the former one again.
const SLEEP_WANDER: f32 = 1e-14;
/// Wander of the time of flight by unsteady motion, ticks² per second: 10 cm after a second.
const FLIGHT_WANDER: f32 = 454.0;
/// An innovation beyond this many standard deviations is a jump.
const GATE: f32 = 5.0;
/// A carrier that differs by less than this is that of the same crystal in any case: a crystal changes by as much while
/// it warms up.
const SAME_CRYSTAL: f32 = 3e-6;
/// The spread of carriers before any measurement.
const UNKNOWN_SPREAD: f32 = 2e-6;
/// Weights of a new carrier in the spread of carriers. The spread rises quickly and sinks slowly, so that the estimate
/// is rather too large.
const RISING: f32 = 0.2;
const SINKING: f32 = 0.03;
/// Carriers are gated once this many were measured.
const SETTLED_AFTER: u8 = 20;
/// A carrier that was refused this many times in a row, always with a similar value, is accepted as the anchor's: its
/// crystal was replaced, or is much colder.
pub const RECOVERS_AFTER: u8 = 50;
/// Ticks per second.
const TICKS_PER_SECOND: f32 = crate::time::TICKS_PER_SECOND as f32;

/// What is known of an anchor's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockModel {
    /// The last poll: departure in the tag's clock, arrival in the anchor's.
    last: Option<(RadioInstant, RadioInstant)>,
    /// True arrival − timestamp of the last poll, ticks.
    offset: f32,
    /// (anchor's rate − tag's) / tag's.
    rate: f32,
    /// Variances of offset and rate, and their covariance.
    offset_variance: f32,
    covariance: f32,
    rate_variance: f32,
    /// Mean square of the difference between carriers and the rate.
    spread: f32,
    /// Carriers measured, at most [`SETTLED_AFTER`].
    carriers: u8,
    /// The rate by the last carrier that was refused …
    refused_rate: f32,
    /// … and the number of similar carriers refused in a row.
    refused: u8,
}

impl Default for ClockModel {
    fn default() -> Self {
        Self::new()
    }
}

impl ClockModel {
    /// Nothing known.
    pub const fn new() -> Self {
        Self {
            last: None,
            offset: 0.0,
            rate: 0.0,
            offset_variance: STAMP_DEVIATION_TICKS * STAMP_DEVIATION_TICKS,
            covariance: 0.0,
            rate_variance: UNKNOWN_RATE_DEVIATION * UNKNOWN_RATE_DEVIATION,
            spread: UNKNOWN_SPREAD * UNKNOWN_SPREAD,
            carriers: 0,
            refused_rate: 0.0,
            refused: 0,
        }
    }

    /// Whether a frame with this carrier, in parts per million, can be the anchor's. It cannot if the clock is known
    /// and the carrier differs from its rate by more than 5 deviations and 3 ppm. A carrier that comes often enough is
    /// accepted, and the model of the clock starts again.
    ///
    /// Call it before [`poll`](Self::poll) and [`carrier`](Self::carrier), which are for the anchor's frames.
    pub fn expects(&mut self, clock_offset_ppm: f32) -> bool {
        let measured = clock_offset_ppm * 1e-6;
        if self.carriers < SETTLED_AFTER || measured.is_nan() {
            return true;
        }
        let variance = self.spread + self.rate_variance;
        let is_far = |off: f32| off * off > GATE * GATE * variance && off.abs() > SAME_CRYSTAL;
        if !is_far(measured - self.rate) {
            self.refused = 0;
            return true;
        }
        let is_alike = self.refused > 0 && !is_far(measured - self.refused_rate);
        self.refused = if is_alike { self.refused.saturating_add(1) } else { 1 };
        self.refused_rate = measured;
        let insists = self.refused >= RECOVERS_AFTER;
        if insists {
            *self = Self::new();
        }
        insists
    }

    /// The tag's radio slept for `seconds`: no interval reaches across the sleep, but the crystal is the same.
    pub fn sleep(&mut self, seconds: f32) {
        let wander = RATE_WANDER * seconds + SLEEP_WANDER;
        let rate_variance = (self.rate_variance + wander).min(UNKNOWN_RATE_DEVIATION * UNKNOWN_RATE_DEVIATION);
        *self = Self { rate: self.rate, rate_variance, ..Self::new() };
    }

    /// The rate of the anchor's clock relative to the tag's, as a fraction, positive if it is faster.
    pub const fn rate(&self) -> f32 {
        self.rate
    }

    /// Variance of [`rate`](Self::rate).
    pub const fn rate_variance(&self) -> f32 {
        self.rate_variance
    }

    /// A poll left at `sent` of the tag's clock and arrived at `heard` of the anchor's.
    pub fn poll(&mut self, sent: RadioInstant, heard: RadioInstant) {
        let Some((last_sent, last_heard)) = self.last.replace((sent, heard)) else { return };
        let elapsed = sent.since(last_sent);
        let gained = RadioDuration::from_ticks(heard.since(last_heard).ticks() - elapsed.ticks()).ticks() as f32;
        let ticks = elapsed.ticks() as f32;
        if ticks <= 0.0 || (gained - self.offset).abs() > IMPLAUSIBLE_RATE * ticks + IMPLAUSIBLE_JUMP_TICKS {
            // The anchor or this tag's radio was restarted: its clock has a new origin.
            *self = Self { last: self.last, ..Self::new() };
            return;
        }
        let seconds = ticks / TICKS_PER_SECOND;
        let prior_rate_variance = self.rate_variance + RATE_WANDER * seconds;
        let prior_covariance = self.covariance + ticks * self.rate_variance;
        let prior_offset_variance = self.offset_variance
            + ticks * (2.0 * self.covariance + ticks * self.rate_variance)
            + FLIGHT_WANDER * seconds;
        let innovation = gained - self.offset - self.rate * ticks;
        let stamp_variance = STAMP_DEVIATION_TICKS * STAMP_DEVIATION_TICKS;
        let innovation_variance = prior_offset_variance + stamp_variance;
        self.rate_variance = prior_rate_variance;
        if innovation * innovation > GATE * GATE * innovation_variance {
            // The signal has found another path: the rate is unchanged.
            self.offset = 0.0;
            self.offset_variance = stamp_variance;
            self.covariance = 0.0;
            return;
        }
        let offset_gain = prior_offset_variance / innovation_variance;
        let rate_gain = prior_covariance / innovation_variance;
        self.offset = (offset_gain - 1.0) * innovation;
        self.rate += rate_gain * innovation;
        self.offset_variance = (1.0 - offset_gain) * prior_offset_variance;
        self.covariance = (1.0 - offset_gain) * prior_covariance;
        self.rate_variance -= rate_gain * prior_covariance;
    }

    /// The carrier of a frame from the anchor gives this rate, in parts per million.
    pub fn carrier(&mut self, clock_offset_ppm: f32) {
        let measured = clock_offset_ppm * 1e-6;
        if measured.is_nan() || measured.abs() > IMPLAUSIBLE_RATE {
            return;
        }
        let innovation = measured - self.rate;
        if self.carriers > 0 {
            // The first carrier has nothing to differ from.
            let excess = innovation * innovation - self.spread;
            self.spread += excess * if excess > 0.0 { RISING } else { SINKING };
        }
        self.carriers = self.carriers.saturating_add(1).min(SETTLED_AFTER);
        let variance = self.rate_variance + CARRIER_DEVIATION * CARRIER_DEVIATION;
        let gain = self.rate_variance / variance;
        let offset_gain = self.covariance / variance;
        self.rate += gain * innovation;
        self.offset += offset_gain * innovation;
        self.offset_variance -= offset_gain * self.covariance;
        self.covariance *= 1.0 - gain;
        self.rate_variance *= 1.0 - gain;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;

    /// Polls an anchor whose clock is fast by `rate`, every `period` s of the tag's clock. Timestamps have 0.1 ns of
    /// noise. Rate and time of flight wander by these variances per second.
    struct Polling {
        rng: Pcg64,
        rate: f64,
        wander: [f64; 2],
        period: f64,
        now: f64,
        anchor: f64,
        anchor_start: u64,
    }

    impl Polling {
        fn new(rate: f64, period: f64) -> Self {
            let mut rng = Pcg64::seed_from_u64(7);
            // Within a second of the wrap.
            let anchor_start = (1 << 40) - rng.random_range(0..60_000_000_000);
            Self { rng, rate, wander: [0.0, 0.0], period, now: 0.0, anchor: 0.0, anchor_start }
        }

        fn normal(&mut self, mean: f64, deviation: f64) -> f64 {
            Normal::new(mean, deviation).unwrap().sample(&mut self.rng)
        }

        fn poll(&mut self, model: &mut ClockModel, carrier_deviation_ppm: f64) {
            let [rate_wander, flight_wander] = self.wander.map(|variance| (variance * self.period).sqrt());
            let elapsed = self.period * crate::time::TICKS_PER_SECOND as f64;
            self.now += elapsed;
            self.anchor += elapsed * (1.0 + self.rate) + self.normal(0.0, flight_wander);
            self.rate += self.normal(0.0, rate_wander);
            let stamp = (self.anchor + self.normal(0.0, 6.4)).round() as u64;
            let sent = RadioInstant::from_ticks(self.now as u64 + (1 << 40) - 1_000_000);
            model.poll(sent, RadioInstant::from_ticks(self.anchor_start.wrapping_add(stamp)));
            let carrier = self.normal(self.rate * 1e6, carrier_deviation_ppm);
            model.carrier(carrier as f32);
        }
    }

    #[test]
    fn the_carrier_serves_until_polls_do_better() {
        let mut model = ClockModel::new();
        let mut polling = Polling::new(40e-6, 2.5e-3);
        polling.poll(&mut model, 0.2);
        // One carrier reading: four of its standard deviations.
        assert!((f64::from(model.rate()) - 40e-6).abs() < 0.8e-6, "{}", model.rate());
        assert!((model.rate_variance().sqrt() - 0.2e-6).abs() < 0.01e-6, "{}", model.rate_variance());
        for _ in 0..400 {
            polling.poll(&mut model, 0.2);
        }
        // 20 ppb over a reply of 2 ms make 6 mm.
        assert!((f64::from(model.rate()) - 40e-6).abs() < 20e-9, "{}", model.rate());
        assert!(model.rate_variance().sqrt() < 10e-9, "{}", model.rate_variance());
    }

    #[test]
    fn errors_are_as_large_as_the_filter_says() {
        // The mean of squared normalised errors of a consistent filter is 1.
        for period in [2.5e-3, 20e-3, 0.1] {
            let mut polling = Polling::new(-25e-6, period);
            polling.wander = [2.5e-15, 454.0];
            let mut model = ClockModel::new();
            let mut sum = 0.0;
            for round in 0..2000 {
                polling.poll(&mut model, 0.2);
                if round >= 500 {
                    sum += (f64::from(model.rate()) - polling.rate).powi(2) / f64::from(model.rate_variance());
                }
            }
            let mean = sum / 1500.0;
            assert!((0.7..1.3).contains(&mean), "period {period}: {mean}");
        }
    }

    #[test]
    fn a_restarted_anchor_is_begun_with_anew() {
        let mut model = ClockModel::new();
        let mut polling = Polling::new(10e-6, 2.5e-3);
        for _ in 0..100 {
            polling.poll(&mut model, 0.2);
        }
        polling.anchor_start = 12_345;
        polling.rate = 11e-6;
        polling.poll(&mut model, 0.2);
        assert!((f64::from(model.rate()) - 11e-6).abs() < 0.8e-6, "{}", model.rate());
        assert!(model.rate_variance().sqrt() > 0.1e-6);
        for _ in 0..100 {
            polling.poll(&mut model, 0.2);
        }
        assert!((f64::from(model.rate()) - 11e-6).abs() < 50e-9, "{}", model.rate());
    }

    #[test]
    fn a_jump_of_the_path_leaves_the_rate() {
        let mut model = ClockModel::new();
        let mut polling = Polling::new(-10e-6, 2.5e-3);
        for _ in 0..200 {
            polling.poll(&mut model, 0.2);
        }
        // Five metres farther: 1066 ticks. As a rate over 2.5 ms this would be 6.7 ppm.
        polling.anchor_start += 1066;
        for _ in 0..5 {
            polling.poll(&mut model, 0.2);
            assert!((f64::from(model.rate()) + 10e-6).abs() < 30e-9, "{}", model.rate());
        }
    }

    /// A model that has followed an anchor of this rate by 100 polls.
    fn settled(rate: f64, carrier_deviation_ppm: f64) -> (ClockModel, Polling) {
        let mut model = ClockModel::new();
        let mut polling = Polling::new(rate, 2.5e-3);
        for _ in 0..100 {
            assert!(model.expects(polling.normal(rate * 1e6, carrier_deviation_ppm) as f32));
            polling.poll(&mut model, carrier_deviation_ppm);
        }
        (model, polling)
    }

    #[test]
    fn a_frame_of_another_crystal_is_not_the_anchors() {
        let (mut model, _) = settled(20e-6, 0.2);
        // A change of 2 ppm by warming is accepted. A change of 5 ppm is another crystal, until it was received often
        // enough.
        assert!(model.expects(22.0));
        for _ in 0..3 * RECOVERS_AFTER {
            assert!(!model.expects(15.0));
            assert!(!model.expects(25.0));
        }
        // With the anchor's own frames in between it is never accepted.
        for _ in 0..3 * RECOVERS_AFTER {
            assert!(!model.expects(15.0));
            assert!(model.expects(20.1));
        }
    }

    #[test]
    fn an_anchor_with_another_crystal_is_followed_once_it_insists() {
        let (mut model, mut polling) = settled(20e-6, 0.2);
        polling.rate = -5e-6;
        polling.anchor_start = 77;
        let refused = (0..200).take_while(|_| !model.expects(-5.0)).count();
        assert_eq!(refused, usize::from(RECOVERS_AFTER) - 1);
        for _ in 0..100 {
            polling.poll(&mut model, 0.2);
        }
        assert!((f64::from(model.rate()) + 5e-6).abs() < 50e-9, "{}", model.rate());
    }

    #[test]
    fn a_radio_whose_carrier_tells_nothing_is_not_refused() {
        let (mut model, mut polling) = settled(5e-6, 10.0);
        let refused = (0..1000).filter(|_| !model.expects(polling.normal(5.0, 10.0) as f32)).count();
        assert_eq!(refused, 0);
    }

    #[test]
    fn nonsense_from_the_carrier_is_ignored() {
        let mut model = ClockModel::new();
        for ppm in [f32::NAN, f32::INFINITY, 500.0] {
            model.carrier(ppm);
            assert_eq!(model, ClockModel::new());
        }
    }
}
