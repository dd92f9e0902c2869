//! Errors that averaging does not remove: they stay with a link and a position, with a bearing, or with a node.
//!
//! Each link has two random fields over the positions of its ends. A field is a sum of plane waves (spectral
//! representation; Shinozuka and Deodatis, *Applied Mechanics Reviews* 44(4), 1991): wave vectors from a bank that all
//! links share, phases from the link's number. So a field is a function of seed, link and positions, without memory.
//! The first field shifts the range to both sides. The second one has a real and an imaginary part, as narrow-band
//! fading has: their power is the first path's loss; where the real part is high, an object is in the way, and the
//! range is too long, by decimetres and quietly. Each node has an antenna delay that turns with the bearing, and a
//! remainder of its calibration. A person who carries a node shadows the links behind him or her.

use super::propagation::{End, Material};
use crate::random::{Purpose, Stream, gauss, mix, stream};
use rand::Rng;
use rustc_hash::FxHashMap;
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// The size of lasting errors. [`LastingErrors::RECORDED`] has the source of each number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LastingErrors {
    /// Standard deviation of what calibration left of a node's antenna delay, metres.
    pub calibration_m: f64,
    /// Standard deviation of a node's antenna delay over all bearings, metres.
    pub bearing_m: f64,
    /// Standard deviation of a receiver's bias by power, as a share of the published bias.
    pub bias_share: f64,
    /// Standard deviation of a link's error over positions, metres …
    pub link_m: f64,
    /// … and the movement after which its correlation is 1/e, metres.
    pub link_length_m: f64,
    /// The same for the part that changes within a wavelength, metres.
    pub fine_m: f64,
    /// Its correlation length, metres.
    pub fine_length_m: f64,
    /// Mean loss of the first path by fading, dB …
    pub fading_db: f64,
    /// … and the movement after which it is another one, metres.
    pub fading_length_m: f64,
    /// How many standard deviations high the fading's real part is where an object is in the way. 1.64: one link in
    /// twenty.
    pub blocked_above: f64,
    /// By how much a link is too long, per standard deviation above, metres.
    pub blocked_m: f64,
}

impl LastingErrors {
    /// As in recordings in line of sight: a laboratory with DWM1001 (`leiria_128_los_pos1`, `leiria_128_move_slow`:
    /// ipleiria-robotics/indoor_positioning_uwb) and a motion-capture room (`cuhk_static`, `cuhk_dynamic_mid`:
    /// LIAS-CUHKSZ/Efficient-Pose-Estimation-via-UWB-measurements). Fitted so that the default room of `baliza
    /// simulate` has their statistics: `docs/reference/performance.md` has both side by side.
    pub const RECORDED: Self = Self {
        // Means of links differ by 0.055 to 0.066 m between anchors of a recording: two nodes, and bearings.
        calibration_m: 0.03,
        // Published: 10 to 15 cm of variation with rotation for an antenna that Decawave sells
        // (forum.qorvo.com/t/1872), up to ±15 cm for a link between DWM1000s (bitcraze/crazyflie-firmware#680). Two
        // harmonics of this size span up to 0.09 m.
        bearing_m: 0.025,
        // In the motion-capture room, the mean rises by 0.06 m from 2-3 m to 5-6 m. A share of what APS011 publishes.
        bias_share: 0.3,
        // A link's error less its mean: 0.070 m (motion capture) to 0.12 m (laboratory), with the parts below; its
        // correlation falls to 1/e within 0.3 to 0.5 m.
        link_m: 0.055,
        link_length_m: 0.2,
        // The root of half the mean squared difference of two ranges 2 to 5 cm apart is 0.041 to 0.073 m, of which
        // 0.025 m are white.
        fine_m: 0.03,
        fine_length_m: 0.02,
        // Received less first-path power in the laboratory: 3, 5, 11 dB at the 10th, 50th, 90th percentile; an error
        // hardly shows in it (mean 5.5 dB below 0.1 m, 9 dB above 0.4 m).
        fading_db: 5.0,
        fading_length_m: 0.4,
        // Too long by more than 0.25 m: 0.5 % (motion capture) to 5.5 % (laboratory) of ranges, for 0.3 to 0.8 m of
        // the way, with a white part of 0.02 to 0.05 m.
        blocked_above: 1.64,
        blocked_m: 0.38,
    };
}

/// Waves in each bank, and waves of each field.
const BANK: usize = 256;
const WAVES: usize = 8;
const FINE_WAVES: usize = 4;
/// Steps of an angle in a turn.
const STEPS: i64 = 4096;
/// No error changes within less than this, metres: a wavelength of channel 5 is 0.046 m.
const SHORTEST_M: f64 = 0.05;
/// Within this, metres, a position has not changed.
const NEAR_M: f64 = 0.001;
/// A shadow reaches this far to each side of the bearing away from the body: the cosine of 60°.
const SHADOW_EDGE: f64 = 0.5;

/// A wave's vector over the positions of both ends, turns per metre.
#[derive(Clone, Copy, Debug)]
struct Wave {
    by_end: [[f64; 3]; 2],
}

impl Wave {
    /// A wave of a field whose covariance over the movement h of one end is exp(−h²/2L²).
    fn smooth(length_m: f64, draws: &mut Stream) -> Self {
        Self { by_end: [(); 2].map(|()| [(); 3].map(|()| gauss(draws) / (TAU * length_m))) }
    }

    /// A wave of a field whose covariance is exp(−h/L): its vectors are Cauchy-distributed (Student's t with one degree
    /// of freedom), here up to the shortest wavelength.
    fn rough(length_m: f64, draws: &mut Stream) -> Self {
        loop {
            let wave = Self::smooth(length_m * gauss(draws).abs(), draws);
            let size = |k: [f64; 3]| k.iter().map(|x| x * x).sum::<f64>().sqrt();
            if wave.by_end.iter().all(|&k| size(k) < 1.0 / SHORTEST_M) {
                return wave;
            }
        }
    }

    fn turns(&self, a: [f64; 3], b: [f64; 3]) -> f64 {
        let [by_a, by_b] = self.by_end;
        (0..3).map(|i| by_a[i] * a[i] + by_b[i] * b[i]).sum()
    }
}

/// The banks of waves.
struct Banks {
    link: Vec<Wave>,
    fine: Vec<Wave>,
    fading: Vec<Wave>,
}

/// What lasting errors do to a link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Lasting {
    /// The excess of its length, metres.
    pub(crate) excess_m: f64,
    /// The loss of the first path, dB.
    pub(crate) first_path_loss_db: f64,
    /// The loss of the scattered power, dB.
    pub(crate) scattered_loss_db: f64,
}

/// An antenna, by its node's number: a first and a second harmonic of the bearing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Antenna {
    calibration_m: f64,
    bearing_m: f64,
    phases: [f64; 2],
    /// The factor of the bias by power at its receiver.
    pub(crate) bias_factor: f64,
}

impl Antenna {
    /// The excess length at a bearing from the antenna's front, radians.
    fn excess_m(&self, bearing: f64) -> f64 {
        let [first, second] = self.phases;
        self.calibration_m + self.bearing_m * ((bearing + first).cos() + (2.0 * bearing + second).cos())
    }
}

/// An end of a link, and how its node stands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Posture {
    pub(crate) end: End,
    pub(crate) antenna: Antenna,
    /// Where its front points, radians from the x axis.
    pub(crate) heading: f64,
    /// Whether a person carries it before him or her.
    pub(crate) worn: bool,
}

/// The last positions of a link's two ends, and its errors there.
type Known = ([[f64; 3]; 2], Lasting);

/// The lasting errors of all links of an air.
pub(crate) struct LastingField {
    errors: LastingErrors,
    seed: u64,
    banks: Banks,
    /// By the numbers of two ports, the lower one first.
    known: FxHashMap<(u32, u32), Known>,
}

impl LastingField {
    pub(crate) fn new(errors: LastingErrors, seed: u64) -> Self {
        let mut draws = stream(seed, Purpose::Lasting, 0);
        let mut bank = |draw: fn(f64, &mut Stream) -> Wave, length_m| {
            (0..BANK).map(|_| draw(length_m, &mut draws)).collect::<Vec<_>>()
        };
        let banks = Banks {
            link: bank(Wave::rough, errors.link_length_m),
            fine: bank(Wave::smooth, errors.fine_length_m),
            fading: bank(Wave::smooth, errors.fading_length_m),
        };
        Self { errors, seed, banks, known: FxHashMap::default() }
    }

    /// The antenna of a port.
    pub(crate) fn antenna(&self, port: u32) -> Antenna {
        let mut draws = stream(self.seed, Purpose::Lasting, 1 + u64::from(port));
        Antenna {
            calibration_m: self.errors.calibration_m * gauss(&mut draws),
            bearing_m: self.errors.bearing_m,
            phases: [TAU * draws.random::<f64>(), TAU * draws.random::<f64>()],
            bias_factor: 1.0 + self.errors.bias_share * gauss(&mut draws),
        }
    }

    /// The errors of a link whose ends are where they were last. An exchange takes less than a millimetre's movement.
    pub(crate) fn known(&self, a: End, b: End) -> Option<Lasting> {
        let (a, b) = if a.0 <= b.0 { (a, b) } else { (b, a) };
        let (at, lasting) = self.known.get(&(a.0, b.0))?;
        let is_near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < NEAR_M);
        (is_near(at[0], a.1) && is_near(at[1], b.1)).then_some(*lasting)
    }

    /// Computes the errors of a link, and keeps them.
    pub(crate) fn renew(&mut self, a: Posture, b: Posture) -> Lasting {
        let lasting = self.between(a, b);
        let (a, b) = if a.end.0 <= b.end.0 { (a.end, b.end) } else { (b.end, a.end) };
        self.known.insert((a.0, b.0), ([a.1, b.1], lasting));
        lasting
    }

    /// The lasting errors of a link. They are the same in both directions.
    pub(crate) fn between(&self, a: Posture, b: Posture) -> Lasting {
        let (a, b) = if a.end.0 <= b.end.0 { (a, b) } else { (b, a) };
        let link = mix(mix(self.seed ^ 0x1A57) ^ (u64::from(a.end.0) << 32 | u64::from(b.end.0)));
        let at = (a.end.1, b.end.1);
        let (shift, _) = sum(&self.banks.link, WAVES, mix(link ^ 1), at);
        let (fine, _) = sum(&self.banks.fine, FINE_WAVES, mix(link ^ 2), at);
        let (real, imaginary) = sum(&self.banks.fading, WAVES, mix(link ^ 3), at);
        let LastingErrors { link_m, fine_m, fading_db, blocked_above, blocked_m, .. } = self.errors;
        let own_m = link_m * shift + fine_m * fine + blocked_m * (real - blocked_above).max(0.0);
        let mut lasting = Lasting {
            excess_m: own_m,
            // The power of two normal numbers is exponential, with a mean of 2.
            first_path_loss_db: 0.5 * fading_db * (real * real + imaginary * imaginary),
            scattered_loss_db: 0.0,
        };
        for (here, there) in [(a, b), (b, a)] {
            let away = [there.end.1[0] - here.end.1[0], there.end.1[1] - here.end.1[1]];
            let bearing = away[1].atan2(away[0]) - here.heading;
            lasting.excess_m += here.antenna.excess_m(bearing);
            if here.worn {
                let shadow = ((-bearing.cos() - SHADOW_EDGE) / (1.0 - SHADOW_EDGE)).max(0.0);
                lasting.excess_m += Material::BODY.excess_m * shadow;
                lasting.first_path_loss_db += Material::BODY.attenuation_db * shadow;
                lasting.scattered_loss_db += 0.5 * Material::BODY.attenuation_db * shadow;
            }
        }
        lasting
    }
}

/// The sum of `count` waves of the bank, with phases by `hash`: real and imaginary part, each of standard deviation 1.
fn sum(bank: &[Wave], count: usize, hash: u64, (a, b): ([f64; 3], [f64; 3])) -> (f64, f64) {
    let (mut real, mut imaginary) = (0.0, 0.0);
    for number in 0..count {
        let random = mix(hash ^ (number as u64) << 8);
        // The bank has as many waves as a byte has values.
        let Some(wave) = bank.get((random & 0xFF) as usize) else { continue };
        let step = (wave.turns(a, b) * STEPS as f64) as i64 + (random >> 32) as i64;
        real += cosine(step);
        imaginary += cosine(step - STEPS / 4);
    }
    let scale = (2.0 / count as f64).sqrt();
    (scale * real, scale * imaginary)
}

/// The cosine of an angle in steps. The library's takes several times as long; steps change no error by 0.1 mm.
fn cosine(step: i64) -> f64 {
    static COSINES: LazyLock<Vec<f64>> =
        LazyLock::new(|| (0..STEPS).map(|step| (TAU * step as f64 / STEPS as f64).cos()).collect());
    COSINES.get((step & (STEPS - 1)) as usize).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANCHOR: [f64; 3] = [0.0, 0.0, 2.5];

    /// Only the errors of links, not of antennas.
    fn links() -> LastingField {
        LastingField::new(LastingErrors { calibration_m: 0.0, bearing_m: 0.0, ..LastingErrors::RECORDED }, 5)
    }

    fn standing(field: &LastingField, port: u32, at: [f64; 3]) -> Posture {
        Posture { end: (port, at), antenna: field.antenna(port), heading: 0.0, worn: false }
    }

    /// The excess of many links to a tag at `x` metres.
    fn excesses(field: &LastingField, x: f64) -> Vec<f64> {
        let of = |anchor| {
            let ends = (standing(field, anchor, ANCHOR), standing(field, 9_999, [x, 3.0, 1.2]));
            field.between(ends.0, ends.1).excess_m
        };
        (0..4_000).map(of).collect()
    }

    fn covariance(a: &[f64], b: &[f64]) -> f64 {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let (of_a, of_b) = (mean(a), mean(b));
        a.iter().zip(b).map(|(a, b)| (a - of_a) * (b - of_b)).sum::<f64>() / a.len() as f64
    }

    #[test]
    fn a_links_error_has_its_deviation_and_fades_with_the_movement() {
        let errors = LastingErrors { blocked_m: 0.0, fine_m: 0.0, ..LastingErrors::RECORDED };
        let field = LastingField::new(LastingErrors { calibration_m: 0.0, bearing_m: 0.0, ..errors }, 5);
        let here = excesses(&field, 2.0);
        assert!((covariance(&here, &here).sqrt() / errors.link_m - 1.0).abs() < 0.05);
        // exp(−h/L), from a bank of 256 waves.
        for (moved_m, expected) in [(0.05, 0.78), (0.2, 0.37), (1.5, 0.0)] {
            let there = excesses(&field, 2.0 + moved_m);
            let correlation = covariance(&here, &there) / covariance(&here, &here);
            assert!((correlation - expected).abs() < 0.1, "{moved_m} m: {correlation}");
        }
    }

    #[test]
    fn one_link_in_twenty_is_too_long_by_decimetres() {
        let errors = LastingErrors { link_m: 0.0, fine_m: 0.0, ..LastingErrors::RECORDED };
        let field = LastingField::new(LastingErrors { calibration_m: 0.0, bearing_m: 0.0, ..errors }, 5);
        let found = excesses(&field, 2.0);
        let blocked: Vec<f64> = found.iter().copied().filter(|excess_m| *excess_m > 0.0).collect();
        // The normal distribution has 5 % above 1.64; its mean there is 0.42 higher.
        let share = blocked.len() as f64 / found.len() as f64;
        let mean_m = blocked.iter().sum::<f64>() / blocked.len() as f64;
        assert!((share - 0.05).abs() < 0.015, "{share}");
        assert!((mean_m - 0.42 * errors.blocked_m).abs() < 0.03, "{mean_m}");
        assert!(found.iter().all(|excess_m| *excess_m >= 0.0));
    }

    #[test]
    fn both_directions_err_alike_and_again_at_the_same_positions() {
        let field = LastingField::new(LastingErrors::RECORDED, 7);
        let (a, b) = (standing(&field, 3, ANCHOR), standing(&field, 8, [4.0, 2.0, 1.0]));
        assert_eq!(field.between(a, b), field.between(b, a));
        assert_eq!(field.between(a, b), LastingField::new(LastingErrors::RECORDED, 7).between(a, b));
        assert_ne!(field.between(a, b), LastingField::new(LastingErrors::RECORDED, 8).between(a, b));
    }

    #[test]
    fn an_antennas_delay_turns_with_the_bearing() {
        let field = LastingField::new(LastingErrors { calibration_m: 0.0, ..LastingErrors::RECORDED }, 5);
        let antenna = field.antenna(4);
        let delays: Vec<f64> = (0..360).map(|degree| antenna.excess_m(f64::from(degree).to_radians())).collect();
        // Two harmonics with an amplitude of b have a deviation of √(b²/2 + b²/2) = b, and a mean of 0.
        let deviation_m = covariance(&delays, &delays).sqrt();
        assert!((deviation_m - LastingErrors::RECORDED.bearing_m).abs() < 1e-9, "{deviation_m}");
        assert!(delays.iter().sum::<f64>().abs() < 1e-9);
    }

    #[test]
    fn a_body_shadows_what_is_behind_it() {
        let field = links();
        let tag = Posture { worn: true, heading: 0.0, ..standing(&field, 8, [0.0, 0.0, 1.2]) };
        let bare = Posture { worn: false, ..tag };
        let shadow = |anchor_m: [f64; 3]| {
            let anchor = standing(&field, 1, anchor_m);
            let (worn, bare) = (field.between(tag, anchor), field.between(bare, anchor));
            (worn.excess_m - bare.excess_m, worn.first_path_loss_db - bare.first_path_loss_db)
        };
        assert_eq!(shadow([5.0, 0.0, 2.0]), (0.0, 0.0), "before");
        assert_eq!(shadow([0.0, 5.0, 2.0]), (0.0, 0.0), "beside");
        let (behind_m, behind_db) = shadow([-5.0, 0.0, 2.0]);
        assert!((behind_m - Material::BODY.excess_m).abs() < 1e-9, "{behind_m}");
        assert!((behind_db - Material::BODY.attenuation_db).abs() < 1e-9, "{behind_db}");
    }
}
