//! The channel impulse response that a receiver accumulates, and the diagnostics that follow from it.
//!
//! The accumulator contains pulses at the first path and at its echoes, an exponential tail, and noise. Its energy and
//! the energy of the first path are chosen so that the user manual's formulae (4.7.1, 4.7.2) return the received and
//! the first-path power: `C · 2¹⁷ = Σ |h|² = N² · 10^((P + A) / 10)` and `F₁² + F₂² + F₃² = N² · 10^((P₁ + A) / 10)`,
//! where P is the chip's own estimate. The estimate is too low above about −88 dBm (figure 22 of the manual).

use super::Reception;
use super::phy::{Phy, Prf, Sfd, SfdKind};
use crate::random::mix;
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// Echoes besides the first path.
const ECHOES: usize = 24;
/// Samples from the detected edge to the pulse's peak. With this value, and any fractional position of the edge, nearly
/// all of the pulse lies in the three samples of the first-path power.
const PEAK_AFTER_EDGE: f64 = 1.6;
/// The accumulator stops when its energy reaches this CIR_PWR, as in recordings of strong signals with long preambles.
const FULL_CIR_POWER: f64 = 12_000.0;
/// Received power and the chip's estimate of it, dBm (user manual, figure 22). Beyond the last point the curve is
/// continued straight.
const ESTIMATE_16: [(f64, f64); 5] = [(-90.0, -90.0), (-85.0, -87.5), (-77.0, -85.0), (-69.5, -82.5), (-64.0, -80.0)];
const ESTIMATE_64: [(f64, f64); 6] =
    [(-90.0, -90.0), (-86.5, -87.5), (-83.5, -85.0), (-80.0, -82.5), (-72.5, -80.0), (-60.0, -77.5)];

/// One path of the scattered power: samples after the first path, and its share of the amplitude.
#[derive(Clone, Copy, Debug, Default)]
struct Echo {
    delay: f64,
    weight: f64,
}

/// The arrival of the scattered power at one position. The sum of the squares of the weights is 1.
#[derive(Debug)]
struct Tail {
    echoes: [Echo; ECHOES],
    /// The strongest echo.
    strongest: Echo,
}

/// An accumulator, sample by sample, and its summary values.
#[derive(Clone, Debug)]
pub struct Response {
    /// Amplitude of the first path.
    first: f64,
    tail: &'static Tail,
    /// Amplitude of the tail's unit.
    scattered: f64,
    pulse_width: f64,
    noise_seed: u64,
    /// Samples: 992 or 1016.
    pub length: usize,
    /// Standard deviation of the noise in each of the real and imaginary parts.
    pub noise: f64,
    /// The index of the detected edge of the first path, samples.
    pub first_path: f64,
    /// CIR_PWR.
    pub cir_power: u16,
    /// RXPACC.
    pub rxpacc: u16,
    /// RXPACC_NOSAT.
    pub rxpacc_nosat: u16,
}

impl Response {
    /// The accumulator of a received frame.
    pub fn of(reception: &Reception) -> Self {
        let Phy { prf, channel, sfd, .. } = reception.phy;
        let constant_db = match prf {
            Prf::Mhz16 => 113.77,
            Prf::Mhz64 => 121.74,
        };
        let link = &reception.link;
        let estimate_dbm = estimated_dbm(prf, link.power_dbm);
        let first_dbm = link.first_path_dbm + estimate_dbm - link.power_dbm;
        let unit = 10f64.powf((estimate_dbm + constant_db) / 10.0);
        let gathered = f64::from(reception.symbols.max(1));
        let full = (FULL_CIR_POWER * 131_072.0 / unit).sqrt().floor().max(1.0);
        let adjustment = sfd_adjustment(sfd);
        let nosat = (reception.symbols + adjustment).min(0xFFF);
        let (n, rxpacc) = if gathered > full { (full, full as u16) } else { (gathered, nosat) };
        let energy = n * n * unit;
        let first_energy = (n * n * 10f64.powf((first_dbm + constant_db) / 10.0)).min(energy);

        // A standard deviation of 1 sample is 2.35 ns at half height: 500 MHz.
        let pulse_width = if Phy::is_wide(channel) { 0.6 } else { 1.0 };
        let first_path = 742.0 + unit_of(mix(reception.noise_seed ^ 0xF1)) * 9.0;
        let first_path = (first_path * 64.0).floor() / 64.0;
        let mut response = Self {
            first: 0.0,
            tail: Tail::of(link.place),
            scattered: 0.0,
            pulse_width,
            noise_seed: reception.noise_seed,
            length: if matches!(prf, Prf::Mhz16) { 992 } else { 1016 },
            noise: 0.0,
            first_path,
            cir_power: (energy / 131_072.0).round().min(65_535.0) as u16,
            rxpacc,
            rxpacc_nosat: nosat,
        };
        let head: f64 = (1..=3).map(|k| response.pulse(first_path.floor() + f64::from(k), first_path).powi(2)).sum();
        response.first = (first_energy / head).sqrt();
        let rest = energy - response.first * response.first * response.pulse_energy();
        response.scattered = (rest.max(0.0) / response.pulse_energy()).sqrt();
        let peak = response.first.max(response.scattered * response.tail.strongest.weight);
        response.noise = (2.2 * n.sqrt()).hypot(0.003 * peak) / 2f64.sqrt();
        response
    }

    /// The sample at `index`: real and imaginary part.
    pub fn sample(&self, index: usize) -> [i16; 2] {
        let at = index as f64;
        let random = mix(self.noise_seed ^ (index as u64).wrapping_mul(0x1000_0001));
        let (mut re, mut im) = (self.noise * near_gauss(random), self.noise * near_gauss(mix(random)));
        let mut arrive = |delay: f64, amplitude: f64, k: u64| {
            let x = (at - self.first_path - PEAK_AFTER_EDGE - delay) / self.pulse_width;
            if x.abs() < 6.0 {
                let height = amplitude * (-0.5 * x * x).exp();
                let [cos, sin] = direction(mix(self.noise_seed ^ (0xA0 + k)));
                re += height * cos;
                im += height * sin;
            }
        };
        arrive(0.0, self.first, 0);
        for (k, echo) in (1..).zip(&self.tail.echoes) {
            arrive(echo.delay, self.scattered * echo.weight, k);
        }
        [rounded(re) as i16, rounded(im) as i16]
    }

    /// Magnitude of the sample at `index`.
    pub fn magnitude(&self, index: usize) -> u16 {
        let [re, im] = self.sample(index);
        let (re, im) = (f64::from(re), f64::from(im));
        rounded((re * re + im * im).sqrt()) as u16
    }

    /// Magnitudes one, two and three samples beyond the integer part of the first path's index.
    pub fn first_path_amplitudes(&self) -> [u16; 3] {
        let edge = self.first_path as usize;
        [edge + 1, edge + 2, edge + 3].map(|i| self.magnitude(i))
    }

    /// Index and magnitude of the strongest sample.
    pub fn peak(&self) -> (u16, u16) {
        let Echo { delay, weight } = self.tail.strongest;
        let delay = if self.first >= self.scattered * weight { 0.0 } else { delay };
        let index = (self.first_path + PEAK_AFTER_EDGE + delay).round() as u16;
        (index, self.magnitude(usize::from(index)))
    }

    fn pulse(&self, at: f64, edge: f64) -> f64 {
        let x = (at - edge - PEAK_AFTER_EDGE) / self.pulse_width;
        (-0.5 * x * x).exp()
    }

    /// Energy of a pulse of height 1.
    fn pulse_energy(&self) -> f64 {
        std::f64::consts::PI.sqrt() * self.pulse_width
    }
}

impl Tail {
    /// The tail of a position: one of 256.
    fn of(place: u64) -> &'static Self {
        static TAILS: LazyLock<Vec<Tail>> = LazyLock::new(|| (0..256).map(Tail::draw).collect());
        &TAILS[(mix(place) >> 56) as usize]
    }

    /// Delays of 4 samples and more, plus 20 in the mean. Echoes are weaker the later they are: the power falls to a
    /// third in about 13 ns, as in a recorded flat (`README.md`).
    fn draw(number: u64) -> Self {
        let mut echoes: [Echo; ECHOES] = std::array::from_fn(|k| {
            let random = mix(mix(number) ^ (k as u64 + 1));
            let delay = (4.0 - 20.0 * (1.0 - unit_of(random)).ln()).min(200.0);
            Echo { delay, weight: (-delay / 25.0).exp() * (0.3 + unit_of(mix(random))) }
        });
        let norm = echoes.iter().map(|echo| echo.weight * echo.weight).sum::<f64>().sqrt();
        echoes.iter_mut().for_each(|echo| echo.weight /= norm);
        let strongest = echoes.iter().copied().max_by(|a, b| a.weight.total_cmp(&b.weight)).unwrap_or_default();
        Self { echoes, strongest }
    }
}

/// The chip's estimate of a received power.
pub fn estimated_dbm(prf: Prf, power_dbm: f64) -> f64 {
    let table: &[(f64, f64)] = match prf {
        Prf::Mhz16 => &ESTIMATE_16,
        Prf::Mhz64 => &ESTIMATE_64,
    };
    if power_dbm <= table[0].0 {
        return power_dbm;
    }
    let above = table.iter().position(|t| power_dbm <= t.0).unwrap_or(table.len() - 1);
    let (a, b) = (table[above - 1], table[above]);
    a.1 + (b.1 - a.1) * (power_dbm - a.0) / (b.0 - a.0)
}

/// The part of RXPACC that counts the delimiter (user manual, table 18).
fn sfd_adjustment(sfd: Sfd) -> u16 {
    match (sfd.kind, sfd.symbols) {
        (SfdKind::Ieee, 64) => 64,
        (SfdKind::Ieee, _) => 5,
        (SfdKind::Decawave, 64) => 82,
        (SfdKind::Decawave, 16) => 18,
        (SfdKind::Decawave, _) => 10,
        (SfdKind::User, _) => 0,
    }
}

/// A hash as a phase: cosine and sine of one of 256 angles.
fn direction(hash: u64) -> [f64; 2] {
    static ANGLES: LazyLock<[[f64; 2]; 256]> = LazyLock::new(|| {
        std::array::from_fn(|i| {
            let angle = TAU * i as f64 / 256.0;
            [angle.cos(), angle.sin()]
        })
    });
    ANGLES[(hash >> 56) as usize]
}

/// A hash as a nearly normal number of mean 0 and standard deviation 1: the sum of four uniform numbers.
fn near_gauss(hash: u64) -> f64 {
    let sum: u64 = (0..4).map(|i| hash >> (16 * i) & 0xFFFF).sum();
    (sum as f64 / 65_536.0 - 2.0) * 3f64.sqrt()
}

/// Rounds to the nearest integer. `f64::round` is a library call on plain x86-64.
fn rounded(x: f64) -> i64 {
    (x + 0.5f64.copysign(x)) as i64
}

/// A hash as a number from 0 to 1, 1 excluded.
fn unit_of(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::air::{Link, Payload, Rate, Sight};
    use crate::time::TrueTime;
    use std::rc::Rc;

    fn reception(power_dbm: f64, first_path_dbm: f64, symbols: u16, noise_seed: u64) -> Reception {
        let sfd = Sfd { kind: SfdKind::Ieee, symbols: 8 };
        let (prf, rate) = (Prf::Mhz64, Rate::Kbps6800);
        Reception {
            bytes: Rc::from([]),
            phy: Phy { channel: 5, code: 9, prf, rate, preamble: 128, sfd, long_frames: false },
            ranging: true,
            marker: TrueTime::ZERO,
            stamp_error_ps: 0.0,
            link: Link { power_dbm, first_path_dbm, delay_ps: 0.0, distance_m: 1.0, sight: Sight::Clear, place: 99 },
            sender_ppm: 0.0,
            symbols,
            payload: Payload::Good,
            noise_seed,
        }
    }

    #[test]
    fn the_manuals_formulae_give_the_powers_back() {
        for seed in 0..50 {
            let r = Response::of(&reception(-92.0, -94.0, 114, seed));
            assert_eq!((r.rxpacc, r.rxpacc_nosat), (119, 119));
            let n = f64::from(r.rxpacc) - 5.0;
            let rx = 10.0 * (f64::from(r.cir_power) * 131_072.0 / (n * n)).log10() - 121.74;
            assert!((rx + 92.0).abs() < 0.1, "{rx}");
            let f: f64 = r.first_path_amplitudes().iter().map(|&f| f64::from(f).powi(2)).sum();
            let fp = 10.0 * (f / (n * n)).log10() - 121.74;
            assert!((fp + 94.0).abs() < 0.6, "{fp}");
        }
    }

    #[test]
    fn the_samples_have_the_energy_that_cir_power_states() {
        let mut ratio = 0.0;
        for seed in 0..40 {
            let mut heard = reception(-80.0, -83.0, 114, seed);
            heard.link.place = seed;
            let r = Response::of(&heard);
            let noise = 2.0 * r.noise * r.noise * r.length as f64;
            let energy: f64 = (0..r.length).map(|i| f64::from(r.magnitude(i)).powi(2)).sum::<f64>() - noise;
            ratio += energy / (f64::from(r.cir_power) * 131_072.0) / 40.0;
        }
        // Echoes that overlap add up or cancel, depending on their phases. In the mean they do neither.
        assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
    }

    #[test]
    fn strong_signals_are_underestimated_as_the_manual_draws_it() {
        // User manual, figure 22, PRF 64: −72.5 dBm reads −80 dBm, −60 dBm reads −77.5 dBm.
        assert_eq!(estimated_dbm(Prf::Mhz64, -72.5), -80.0);
        assert_eq!(estimated_dbm(Prf::Mhz64, -60.0), -77.5);
        assert_eq!(estimated_dbm(Prf::Mhz64, -101.0), -101.0);
        assert_eq!(estimated_dbm(Prf::Mhz16, -64.0), -80.0);
        // Beyond the last point, with the last slope of 2.5 in 12.5 dB.
        assert!((estimated_dbm(Prf::Mhz64, -50.0) + 75.5).abs() < 1e-9);
    }

    #[test]
    fn long_preambles_fill_the_accumulator_before_they_end() {
        let r = Response::of(&reception(-75.0, -77.0, 1010, 3));
        assert!(r.rxpacc < r.rxpacc_nosat);
        assert_eq!(r.rxpacc_nosat, 1015);
        let n = f64::from(r.rxpacc);
        let rx = 10.0 * (f64::from(r.cir_power) * 131_072.0 / (n * n)).log10() - 121.74;
        // −75 dBm lies a third of the way from −80 to −72.5: the estimate is −82.5 + 2.5 · 2/3.
        assert!((rx + 80.833).abs() < 0.1, "{rx}");
    }

    #[test]
    fn a_weak_first_path_flattens_the_response_as_in_a_recorded_flat() {
        use positioning_core::nlos::{BEFORE, Shape, WINDOW};
        // Kolakowski's flat. In line of sight, the first path is 3.8 dB below the total power, the skewness near the
        // maximum is 1.48 and the delay 6.6 ns in the mean. If blocked, it is 9.3 dB below, with 0.92 and 10.7 ns.
        for (difference_db, skewness, delay_ns) in [(3.8, 1.48, 6.6), (9.3, 0.92, 10.7)] {
            let (mut found, mut delay) = (0.0, 0.0);
            for seed in 0..200 {
                let mut heard = reception(-82.0, -82.0 - difference_db, 114, seed);
                heard.link.place = seed;
                let response = Response::of(&heard);
                let first = response.first_path as usize - BEFORE;
                let window: [u16; WINDOW] = std::array::from_fn(|at| response.magnitude(first + at));
                let shape = Shape::of(&window, (response.first_path - first as f64) as f32).unwrap();
                found += f64::from(shape.skewness_near) / 200.0;
                delay += f64::from(shape.mean_excess_delay_ns) / 200.0;
            }
            assert!((found - skewness).abs() < 0.3, "{difference_db} dB: {found}");
            assert!((delay - delay_ns).abs() < 2.0, "{difference_db} dB: {delay}");
        }
    }
}
