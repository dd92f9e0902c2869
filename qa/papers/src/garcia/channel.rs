//! Simulated impulse responses of the paper's platform: 5 GS/s, pulses of 577 MHz. The arrival is where the response
//! first exceeds 40 % of its peak, in a window of 201 samples around the peak.
//!
//! A link has constant paths (furniture). Every reception adds paths of its own (people), changes all amplitudes a
//! little, and adds noise. The direct path of a link in line of sight is its strongest. A blocked direct path goes
//! through an obstacle, which attenuates it by 6 to 20 dB and delays it; reflections are then stronger than it.
//! Arrivals of reflections are a Poisson process with exponentially falling power (A. Saleh and R. Valenzuela, IEEE
//! JSAC 5(2), 1987, a single cluster).

use baliza_report::mean;
use rand::Rng;

use accuracy::draw::normal;

/// Time between two samples, nanoseconds.
const SAMPLE_NS: f64 = 0.2;
/// Samples of the window, around the peak.
const WINDOW: usize = 201;
/// Samples of the simulated response.
const LENGTH: usize = 500;
/// The sample of the direct path.
const DIRECT: usize = 150;
/// The arrival is where the response first exceeds this share of its peak.
const THRESHOLD: f64 = 0.4;
/// Root mean square width of a pulse of 577 MHz at −10 dB, nanoseconds.
const PULSE_NS: f64 = 0.75;
/// Number of reflections a nanosecond.
const PATHS_PER_NS: f64 = 0.35;
/// After this number of nanoseconds the power of reflections has fallen to 1 ⁄ e.
const DECAY_NS: f64 = 10.0;
/// Amplitude of the first reflections, relative to a direct path.
const REFLECTED: f64 = 0.35;
/// Share of the reflections' power that is constant from reception to reception.
const STAYING: f64 = 0.7;
/// Noise of a sample, relative to a direct path.
const NOISE: f64 = 0.03;
/// Speed of light, metres a nanosecond.
const LIGHT_M_PER_NS: f64 = 0.299_792_458;

/// Deviation of a direct arrival, metres.
pub const DIRECT_SIGMA_M: f32 = 0.1;
/// Additional deviation of a blocked arrival, metres, once for its constant part and once for its changing part.
pub const BLOCKED_SIGMA_M: f32 = 1.2;

/// A path: its delay behind the direct one, nanoseconds, and its amplitude.
type Path = (f64, f64);

/// A link between a beacon and a point.
#[derive(Clone, Debug)]
pub struct DrawnLink {
    /// The direct path through the obstacle.
    through: Path,
    reflections: Vec<Path>,
}

/// The result of one reception.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundArrival {
    /// The arrival as a distance, metres.
    pub distance_m: f64,
    /// The skewness of the window (equation 2).
    pub skewness: f64,
    /// Whether the link was really blocked.
    pub blocked: bool,
}

impl DrawnLink {
    /// Draws a link.
    pub fn draw(random: &mut impl Rng) -> Self {
        let loss_db: f64 = random.random_range(6.0..20.0);
        let through = (random.random_range(0.3..2.0), 10.0_f64.powf(-loss_db / 20.0));
        Self { through, reflections: reflections(random) }
    }

    /// One reception over `distance_m`.
    pub fn receive(&self, random: &mut impl Rng, distance_m: f64, blocked: bool) -> FoundArrival {
        let response = self.response(random, blocked);
        let peak = (0..LENGTH).max_by(|&a, &b| response[a].total_cmp(&response[b])).unwrap_or(DIRECT);
        let begin = peak.saturating_sub(WINDOW / 2).min(LENGTH - WINDOW);
        let window = &response[begin..begin + WINDOW];
        let least = THRESHOLD * response[peak];
        let first = begin + window.iter().position(|&sample| sample > least).unwrap_or(0);
        // A single pulse exceeds 40 % of its peak this long before its centre: the platform's calibration.
        let ahead_ns = PULSE_NS * (-2.0 * THRESHOLD.ln()).sqrt();
        let late_ns = (first as f64 - DIRECT as f64) * SAMPLE_NS + ahead_ns;
        FoundArrival { distance_m: distance_m + LIGHT_M_PER_NS * late_ns, skewness: skewness(window), blocked }
    }

    /// Magnitudes of the response.
    fn response(&self, random: &mut impl Rng, blocked: bool) -> [f64; LENGTH] {
        let direct = if blocked { self.through } else { (0.0, 1.0) };
        let fleeting = reflections(random);
        let staying = self.reflections.iter().map(|&(ns, a)| (ns, a * STAYING.sqrt()));
        let fleeting = fleeting.into_iter().map(|(ns, a)| (ns, a * (1.0 - STAYING).sqrt()));
        let mut response = [0.0; LENGTH];
        for (ns, amplitude) in std::iter::once(direct).chain(staying).chain(fleeting) {
            let amplitude = amplitude * (1.0 + 0.1 * normal(random));
            let middle = DIRECT as f64 + ns / SAMPLE_NS;
            let reach = 4.0 * PULSE_NS / SAMPLE_NS;
            let begin = (middle - reach).max(0.0) as usize;
            let end = ((middle + reach) as usize).min(LENGTH - 1);
            for (at, sample) in response.iter_mut().enumerate().take(end + 1).skip(begin) {
                let x = (at as f64 - middle) * SAMPLE_NS / PULSE_NS;
                *sample += amplitude * (-0.5 * x * x).exp();
            }
        }
        response.map(|sample| (sample + NOISE * normal(random)).abs())
    }
}

/// Reflections of random sign.
fn reflections(random: &mut impl Rng) -> Vec<Path> {
    let mut paths = Vec::new();
    let mut ns = 0.0;
    loop {
        ns += -random.random_range(f64::MIN_POSITIVE..1.0_f64).ln() / PATHS_PER_NS;
        if ns > 5.0 * DECAY_NS {
            return paths;
        }
        let amplitude = REFLECTED * (-0.5 * ns / DECAY_NS).exp() * normal(random);
        paths.push((ns, amplitude));
    }
}

/// E[(c − µ)³] ⁄ E[(c − µ)²]^(3⁄2) (equation 2).
fn skewness(window: &[f64]) -> f64 {
    let middle = mean(window.iter().copied());
    let moment = |power| mean(window.iter().map(|sample| (sample - middle).powi(power)));
    moment(3) / moment(2).powf(1.5)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn the_skewness_of_one_sample_out_of_four_is_that_of_a_hand_calculation() {
        // Mean ¼; second moment (3 · 1⁄16 + 9⁄16) ⁄ 4 = 3⁄16; third (−3 · 1⁄64 + 27⁄64) ⁄ 4 = 6⁄64; (6⁄64) ⁄ (3⁄16)^1.5
        // = 1.1547.
        assert!((skewness(&[0.0, 0.0, 0.0, 1.0]) - 1.154_700_5).abs() < 1e-6);
    }

    #[test]
    fn a_lone_direct_path_arrives_in_time_and_a_lost_one_late() {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let link = DrawnLink { through: (0.0, 0.05), reflections: vec![(10.0, 0.8)] };
        let mut mean =
            |blocked: bool| (0..200).map(|_| link.receive(&mut random, 5.0, blocked).distance_m).sum::<f64>() / 200.0;
        assert!((mean(false) - 5.0).abs() < 0.1);
        // The detected arrival is a reflection, about ten nanoseconds late, or a transient path before it.
        assert!(mean(true) > 6.0);
    }
}
