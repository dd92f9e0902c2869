//! Compares schemes by number of frames and accuracy: `cargo run --release -p baliza-ranging --example schemes`
//! prints the table.
//!
//! Monte Carlo: one tag, eight anchors at 10 m. The tag's clock is 20 ppm fast and all anchors' are 20 ppm slow, and
//! the reverse. Reception timestamps have 0.1 ns (6.4 ticks, 3 cm) of noise and are rounded to the tick; the carrier's
//! reading has 0.2 ppm of noise. Times on the air are those of a DWM1001 at 6.81 Mbit/s with 128 preamble symbols. The
//! bias is that of the worst of the eight slots, the deviation is that of all slots together. Each scheme is simulated
//! for each [`Case`].

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use ranging::native::{self, ClockModel, Layout, Network, Span, Timing};
use ranging::time::METRES_PER_TICK;
use ranging::tof::{double_sided_asymmetric, double_sided_symmetric, single_sided, single_sided_corrected};
use ranging::{PhyConfig, RadioDuration, RadioInstant, TimeOfFlight};

const NETWORK: Network = Network::new(0xBA12, PhyConfig::FAST);
const ANCHORS: usize = 8;
const DISTANCE_M: f64 = 10.0;
const DRIFT_PPM: f64 = 20.0;
const STAMP_NOISE_TICKS: f64 = 6.4;
const CARRIER_NOISE_PPM: f64 = 0.2;
const TICKS_PER_MICROSECOND: f64 = 63_897.6;
const ROUND_US: f64 = 2500.0;
const SILENCE_US: f64 = 1e6;
/// Rounds that count.
const ROUNDS: usize = 2000;
/// Rounds before one that counts, so that the filters have settled.
const WARM_UP: usize = 100;
/// The change of the anchors' clocks from one round to the next and back again. A draught or a touch changes a crystal
/// by as much, but not at once.
const JUMP_PPM: f64 = 1.0;
/// Standard deviation of the change of a clock's rate in a second without rounds, parts per million: a crystal in a
/// room.
const WANDER_PPM: f64 = 0.05;

/// Boards that answer within 304 µs of a frame's end, and receive again within 72 µs.
fn layout(scheme: native::Scheme) -> Layout {
    let span = |micros| Span::at_least(RadioDuration::from_micros(micros));
    Layout { answer: span(304), listen_again: span(72), scheme }
}

/// A scheme to measure ranges to several anchors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComparedScheme {
    /// Poll and responses, four timestamps.
    SingleSided,
    /// The same, with the responder's clock estimated from the carrier of each response.
    WithCarrier,
    /// The same, with the responder's clock estimated from successive polls: native mode.
    WithPolls,
    /// Poll, responses, one final for all, reports; with the sum of equation 5-2 of P. M. de Rojas Malpartida's thesis
    /// (Universidad de Sevilla, 2021).
    SymmetricOneFinal,
    /// The same, the product form.
    AsymmetricOneFinal,
    /// The product form; anchors report the final's arrival in their next response: native mode with
    /// `scheme = "double-sided"`.
    AsymmetricToldLater,
    /// Poll, response, final and report with one anchor after the other, the product form.
    AsymmetricEach,
}

/// The clocks' behaviour before a round that counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Case {
    /// A round every 2.5 ms, steady clocks.
    Followed,
    /// A round a second. The clocks wander meanwhile.
    Silence,
    /// Followed, and then the anchors' clocks change their rate at once: the estimates of them are wrong.
    Jump,
}

/// The table's columns.
pub const CASES: [Case; 3] = [Case::Followed, Case::Silence, Case::Jump];

/// The errors of a scheme.
#[derive(Debug)]
pub struct Errors {
    /// Mean error in the slot where it is largest, metres.
    pub bias_m: f64,
    /// Standard deviation about the slots' means, metres.
    pub deviation_m: f64,
}

/// The table's rows.
pub const SCHEMES: [ComparedScheme; 7] = [
    ComparedScheme::SingleSided,
    ComparedScheme::WithCarrier,
    ComparedScheme::WithPolls,
    ComparedScheme::SymmetricOneFinal,
    ComparedScheme::AsymmetricOneFinal,
    ComparedScheme::AsymmetricToldLater,
    ComparedScheme::AsymmetricEach,
];

impl ComparedScheme {
    fn name(self) -> &'static str {
        match self {
            Self::SingleSided => "single-sided",
            Self::WithCarrier => "single-sided, rate by carrier",
            Self::WithPolls => "**single-sided, rate by successive polls**",
            Self::SymmetricOneFinal => "double-sided sum, one final, reports",
            Self::AsymmetricOneFinal => "double-sided product, one final, reports",
            Self::AsymmetricToldLater => "**double-sided product, one final, told in the next response**",
            Self::AsymmetricEach => "double-sided product, each anchor by itself",
        }
    }

    /// Frames until the tag has a range to each of `n` anchors.
    pub fn frames(self, n: usize) -> usize {
        match self {
            Self::SingleSided | Self::WithCarrier | Self::WithPolls => n + 1,
            Self::AsymmetricToldLater => n + 2,
            Self::SymmetricOneFinal | Self::AsymmetricOneFinal => 2 * n + 2,
            Self::AsymmetricEach => 4 * n,
        }
    }

    /// From the first pulse of the first frame to the last of the last, microseconds.
    pub fn micros(self, n: usize) -> f64 {
        let (phy, native) = (NETWORK.phy, self == Self::AsymmetricToldLater);
        let timing = Timing::of(
            &NETWORK,
            layout(if native { native::Scheme::DoubleSided } else { native::Scheme::SingleSided }),
        );
        let air = |bytes: usize| phy.airtime(bytes as u16).ticks();
        let answer = timing.layout.answer.duration().ticks();
        // Header and code 10, round 2, check bytes 2; five bytes for each instant, four for each interval.
        let (poll, response, report) = (air(14 + 2), air(14 + 9), air(14 + 5));
        let finals = |n: usize| air(14 + 4 + 5 * n);
        let ticks = match self {
            Self::SingleSided | Self::WithCarrier | Self::WithPolls | Self::AsymmetricToldLater => {
                timing.round(n).ticks()
            }
            Self::SymmetricOneFinal | Self::AsymmetricOneFinal => {
                let reports = report + (n as i64 - 1) * timing.response_slot.ticks();
                timing.round(n).ticks() + answer + finals(n) + answer + reports
            }
            Self::AsymmetricEach => n as i64 * (poll + response + finals(1) + report + 4 * answer) - answer,
        };
        ticks as f64 / TICKS_PER_MICROSECOND
    }
}

/// A clock: counts `count` ticks at the present round's beginning, fast by `drift`.
struct Clock {
    count: f64,
    drift: f64,
}

impl Clock {
    /// Its count `time` ticks after the round's beginning.
    fn stamp(&self, time: f64, noise: f64) -> RadioInstant {
        RadioInstant::from_ticks((self.count + time * (1.0 + self.drift) + noise).round() as u64)
    }

    /// The next round begins.
    fn pass(&mut self, time: f64) {
        self.count = (self.count + time * (1.0 + self.drift)).rem_euclid((1_u64 << 40) as f64);
    }
}

/// Errors of every slot, metres.
fn simulate(scheme: ComparedScheme, case: Case, sign: f64, rng: &mut Pcg64) -> Vec<Vec<f64>> {
    let stamp_noise = Normal::new(0.0, STAMP_NOISE_TICKS).unwrap();
    let carrier_noise = Normal::new(0.0, CARRIER_NOISE_PPM).unwrap();
    let wander = Normal::new(0.0, WANDER_PPM * 1e-6).unwrap();
    let timing = Timing::of(&NETWORK, layout(native::Scheme::SingleSided));
    let mut tag = Clock { count: ((1_u64 << 40) - 1_000_000_000) as f64, drift: sign * DRIFT_PPM * 1e-6 };
    let steady = -sign * DRIFT_PPM * 1e-6;
    let mut anchor = Clock { count: 123_456_789.0, drift: steady };
    let flight = DISTANCE_M / METRES_PER_TICK;
    let mut clocks = vec![ClockModel::new(); ANCHORS];
    let mut errors = vec![Vec::new(); ANCHORS];
    let rounds = match case {
        Case::Followed | Case::Silence => WARM_UP + ROUNDS,
        Case::Jump => WARM_UP * ROUNDS / 10,
    };
    let period_us = if case == Case::Silence { SILENCE_US } else { ROUND_US };
    for round in 0..rounds {
        tag.pass(period_us * TICKS_PER_MICROSECOND);
        anchor.pass(period_us * TICKS_PER_MICROSECOND);
        anchor.drift = match case {
            Case::Followed => steady,
            Case::Silence => anchor.drift + wander.sample(rng),
            Case::Jump if round % WARM_UP == WARM_UP - 1 => steady + JUMP_PPM * 1e-6,
            Case::Jump => steady,
        };
        let counts = match case {
            Case::Followed | Case::Silence => round >= WARM_UP,
            Case::Jump => round % WARM_UP == WARM_UP - 1,
        };
        for slot in 0..ANCHORS {
            let mut noise = || stamp_noise.sample(rng);
            // Polled alone, every anchor is the first to answer.
            let place = if scheme == ComparedScheme::AsymmetricEach { 0 } else { slot };
            let last = if scheme == ComparedScheme::AsymmetricEach { 0 } else { ANCHORS - 1 };
            let reply1 = timing.reply_in(place).ticks() as f64;
            let final_at = timing.reply_in(last).ticks() as f64 + timing.reply.ticks() as f64;
            // True times of departure, from which the responder's and the tag's timestamps follow.
            let poll_tx = tag.stamp(0.0, 0.0);
            let poll_rx = anchor.stamp(flight, noise());
            let resp_at = flight + reply1;
            let resp_tx = anchor.stamp(resp_at, 0.0);
            let resp_rx = tag.stamp(resp_at + flight, noise());
            let final_tx = tag.stamp(final_at, 0.0);
            let final_rx = anchor.stamp(final_at + flight, noise());
            let [round1, reply1] = [resp_rx.since(poll_tx), resp_tx.since(poll_rx)];
            let [round2, reply2] = [final_rx.since(resp_tx), final_tx.since(resp_rx)];
            let true_ppm = (anchor.drift - tag.drift) * 1e6;
            let carrier_ppm = (true_ppm + carrier_noise.sample(rng)) as f32;
            let tof = range(scheme, [round1, reply1, round2, reply2], carrier_ppm, &mut clocks[slot], poll_tx, poll_rx);
            if counts {
                errors[slot].push(f64::from(tof.metres()) - DISTANCE_M);
            }
        }
    }
    errors
}

fn range(
    scheme: ComparedScheme,
    [round1, reply1, round2, reply2]: [RadioDuration; 4],
    carrier_ppm: f32,
    clock: &mut ClockModel,
    poll_tx: RadioInstant,
    poll_rx: RadioInstant,
) -> TimeOfFlight {
    match scheme {
        ComparedScheme::SingleSided => single_sided(round1, reply1),
        ComparedScheme::WithCarrier => single_sided_corrected(round1, reply1, carrier_ppm * 1e-6),
        ComparedScheme::WithPolls => {
            clock.poll(poll_tx, poll_rx);
            clock.carrier(carrier_ppm);
            single_sided_corrected(round1, reply1, clock.rate())
        }
        ComparedScheme::SymmetricOneFinal => double_sided_symmetric(round1, reply1, round2, reply2),
        ComparedScheme::AsymmetricOneFinal | ComparedScheme::AsymmetricToldLater | ComparedScheme::AsymmetricEach => {
            double_sided_asymmetric(round1, reply1, round2, reply2).unwrap_or_default()
        }
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The worst slot's bias under either sign of the drift, and the deviation about the slots' means.
pub fn errors(scheme: ComparedScheme, case: Case) -> Errors {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut bias_m: f64 = 0.0;
    let mut squares = Vec::new();
    for sign in [1.0, -1.0] {
        for errors in simulate(scheme, case, sign, &mut rng) {
            let bias = mean(&errors);
            if bias.abs() > bias_m.abs() {
                bias_m = bias;
            }
            squares.extend(errors.iter().map(|error| (error - bias).powi(2)));
        }
    }
    Errors { bias_m, deviation_m: mean(&squares).sqrt() }
}

/// A length with a suitable unit.
fn length(metres: f64) -> String {
    if metres.abs() < 1.0 { format!("{:.1} cm", metres.abs() * 100.0) } else { format!("{:.2} m", metres.abs()) }
}

fn main() {
    println!(
        "| scheme | frames a fix, 4 / 8 anchors | µs a fix, 4 / 8 anchors | a round every 2.5 ms: bias of the worst slot, deviation | \
         a round a second | clocks that changed by {JUMP_PPM} ppm since the last round |"
    );
    println!("|---|---:|---:|---:|---:|---:|");
    for scheme in SCHEMES {
        let [four, eight] = [4, 8].map(|n| (scheme.frames(n), scheme.micros(n)));
        print!("| {} | {} / {} | {:.0} / {:.0} |", scheme.name(), four.0, eight.0, four.1, eight.1);
        for case in CASES {
            let Errors { bias_m, deviation_m } = errors(scheme, case);
            print!(" {}, {} |", length(bias_m), length(deviation_m));
        }
        println!();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn successive_polls_give_double_sided_accuracy_for_half_the_frames() {
        let [polls, double] = [ComparedScheme::WithPolls, ComparedScheme::AsymmetricOneFinal];
        for scheme in [polls, double] {
            let Errors { bias_m, deviation_m } = errors(scheme, Case::Followed);
            assert!(bias_m.abs() < 0.01 && deviation_m < 0.03, "{scheme:?}: {bias_m} m, {deviation_m} m");
        }
        assert!(2 * polls.frames(8) <= double.frames(8));
        assert!(polls.micros(8) < 0.6 * double.micros(8));
        // Two timestamps of 3.0 cm, halved: 2.12 cm. The error of the rate over replies of 0.5 to 2.1 ms adds less than
        // 2 mm.
        let Errors { deviation_m, .. } = errors(polls, Case::Followed);
        assert!((deviation_m - 0.0212).abs() < 0.002, "{deviation_m}");
    }

    #[test]
    fn single_sided_is_off_by_half_the_drift_of_the_reply() {
        // Poll's tail 83.1 + answer 304 + 138.4 to the RMARKER = 525.5 µs; a slot 189.7 + 72 + 3 = 264.7 µs.
        // ½ × 40 ppm × (525.5 + 7 × 264.7) µs × c = 14.26 m in the last slot.
        let Errors { bias_m, .. } = errors(ComparedScheme::SingleSided, Case::Followed);
        assert!((bias_m.abs() - 14.26).abs() < 0.05, "{bias_m}");
    }

    #[test]
    fn the_carrier_alone_is_coarse() {
        // 0.2 ppm over half of 0.53 to 2.38 ms, root mean square 1.57 ms: 4.7 cm; with the timestamps' 2.1 cm it is 5.2
        // cm.
        let Errors { bias_m, deviation_m } = errors(ComparedScheme::WithCarrier, Case::Followed);
        assert!(bias_m.abs() < 0.01 && (deviation_m - 0.052).abs() < 0.003, "{bias_m}, {deviation_m}");
    }

    #[test]
    fn the_sum_suffers_from_unequal_replies() {
        // The last anchor answers after 2.38 ms and gets its final 0.53 ms later: ¼ × 40 ppm × 1.85 ms × c = 5.55 m.
        let Errors { bias_m, .. } = errors(ComparedScheme::SymmetricOneFinal, Case::Followed);
        assert!((bias_m.abs() - 5.55).abs() < 0.05, "{bias_m}");
    }

    #[test]
    fn the_product_needs_no_model_of_clocks() {
        for scheme in SCHEMES {
            let product = match scheme {
                ComparedScheme::AsymmetricOneFinal
                | ComparedScheme::AsymmetricToldLater
                | ComparedScheme::AsymmetricEach => true,
                ComparedScheme::SingleSided
                | ComparedScheme::WithCarrier
                | ComparedScheme::WithPolls
                | ComparedScheme::SymmetricOneFinal => false,
            };
            for case in CASES.into_iter().filter(|_| product) {
                let Errors { bias_m, deviation_m } = errors(scheme, case);
                assert!(bias_m.abs() < 0.01 && deviation_m < 0.03, "{scheme:?}, {case:?}: {bias_m} m, {deviation_m} m");
            }
        }
    }

    #[test]
    fn a_model_of_clocks_stands_a_second_of_silence_and_not_a_jump() {
        // 0.05 ppm over half of up to 2.38 ms are 1.8 cm. The carrier and the poll itself reduce this to less than
        // half.
        let Errors { bias_m, deviation_m } = errors(ComparedScheme::WithPolls, Case::Silence);
        assert!(bias_m.abs() < 0.01 && (0.0212..0.028).contains(&deviation_m), "{bias_m} m, {deviation_m} m");
        // 1 ppm over half of 2.38 ms is 35.7 cm in the last slot: a single round gives nearly no information about it.
        let Errors { bias_m, .. } = errors(ComparedScheme::WithPolls, Case::Jump);
        assert!((bias_m.abs() - 0.357).abs() < 0.01, "{bias_m} m");
        let Errors { bias_m, .. } = errors(ComparedScheme::WithCarrier, Case::Jump);
        assert!(bias_m.abs() < 0.01, "{bias_m} m");
    }
}
