//! Between the quantised numbers of the wire and SI units.
//!
//! Numbers beyond the wire's range become its greatest or least. One that is none (NaN) never becomes zero: a position with such a
//! coordinate is told as [`Reason::NotFinite`], a deviation as the greatest, a power as [`UNKNOWN_POWER`].

use positioning_core::{Real, SolveError};

use crate::telemetry::{Diagnostics, Difference, Fix, Message, Outcome, Range, Reason, RoomEstimate, RoomProbability};

/// Of lengths.
const PER_METRE: f32 = 1e4;
/// Of powers and of parts per million.
const HUNDREDTHS: f32 = 100.0;
/// Of indices in the accumulator.
const PER_SAMPLE: f32 = 64.0;
/// Of correlations.
const FULL: f32 = 127.0;

/// Stands for a power or an offset that is not known.
pub const UNKNOWN_POWER: i16 = i16::MIN;

/// To the nearest integer; what is none stays none.
fn nearest(value: f32) -> f32 {
    // `as` cuts towards zero.
    value + if value < 0.0 { -0.5 } else { 0.5 }
}

/// 0.1 mm, at the ends of the range saturated; NaN as the greatest.
pub fn length(metres: f32) -> i32 {
    if metres.is_nan() { i32::MAX } else { nearest(metres * PER_METRE) as i32 }
}

/// 0.1 mm of a deviation; zero is for exactly known, so nothing else becomes it.
pub fn deviation(metres: f32) -> u32 {
    if metres <= 0.0 {
        0
    } else if metres.is_nan() {
        u32::MAX
    } else {
        (nearest(metres * PER_METRE) as u32).max(1)
    }
}

fn metres(length: i32) -> f64 {
    f64::from(length) / f64::from(PER_METRE)
}

/// Hundredths; NaN and infinities as [`UNKNOWN_POWER`], which no finite value becomes.
fn hundredths(value: f32) -> i16 {
    if value.is_finite() { (nearest(value * HUNDREDTHS) as i16).max(-i16::MAX) } else { UNKNOWN_POWER }
}

fn from_hundredths(value: i16) -> Option<f64> {
    (value != UNKNOWN_POWER).then(|| f64::from(value) / f64::from(HUNDREDTHS))
}

/// Three lengths, where all are numbers.
pub fn lengths(metres: [f32; 3]) -> Option<[i32; 3]> {
    metres.iter().all(|coordinate| coordinate.is_finite()).then(|| metres.map(length))
}

impl Message {
    /// When it was made, since the node started, microseconds.
    pub fn t_us(&self) -> u64 {
        match self {
            Self::Hello(hello) => hello.t_us,
            Self::Fix(fix) => fix.t_us,
            Self::Range(range) => range.t_us,
            Self::Sighting(sighting) => sighting.t_us,
            Self::State(state) => state.t_us,
            Self::Counters(counters) => counters.t_us,
            Self::Reset(reset) => reset.t_us,
            Self::Difference(difference) => difference.t_us,
            Self::Room(room) => room.t_us,
        }
    }
}

impl RoomEstimate {
    /// The rooms that it names, the more probable one first.
    pub fn rooms(&self) -> &[RoomProbability] {
        match self {
            Self::Unknown => &[],
            Self::Room(room) => core::slice::from_ref(room),
            Self::Between(rooms) => rooms,
        }
    }
}

impl RoomProbability {
    /// A room with its probability, 0 to 1; what is beyond, or no number, as the nearest, or 0.
    pub fn new(room: u8, probability: f32) -> Self {
        // The conversion saturates.
        Self { room, probability: nearest(probability * 255.0) as u8 }
    }

    /// How probable it is, 0 to 1.
    pub fn probability(self) -> f64 {
        f64::from(self.probability) / 255.0
    }
}

impl Outcome {
    /// A position, metres, with its covariance, m²; bit i of `used` is the round's i-th range, `quality` is from 0 to 1.
    ///
    /// A variance of zero is one of a coordinate that was given. A position that is none becomes [`Reason::NotFinite`].
    pub fn position(position_m: [f32; 3], covariance_m2: [[f32; 3]; 3], used: u16, quality: f32) -> Self {
        let Some(position) = lengths(position_m) else { return Self::Reason(Reason::NotFinite) };
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = covariance_m2;
        // A variance below zero is zero that rounding moved.
        let [x, y, z] = [xx, yy, zz].map(|variance| if variance < 0.0 { 0.0 } else { Real::sqrt(variance) });
        // Where a deviation is zero or none, so is the quotient none, which `as` makes 0.
        let correlation =
            [xy / (x * y), xz / (x * z), yz / (y * z)].map(|rho| nearest(rho.clamp(-1.0, 1.0) * FULL) as i8);
        let quality = nearest(quality * f32::from(u8::MAX)) as u8;
        Self::Position { position, deviation: [x, y, z].map(deviation), correlation, used, quality }
    }
}

impl Fix {
    /// Metres, in the anchors' frame.
    pub fn position_m(&self) -> Option<[f64; 3]> {
        match self.outcome {
            Outcome::Position { position, .. } => Some(position.map(metres)),
            Outcome::Reason(_) => None,
        }
    }

    /// Standard deviation of each coordinate, metres; zero for a height that was given.
    pub fn deviation_m(&self) -> Option<[f64; 3]> {
        match self.outcome {
            Outcome::Position { deviation, .. } => Some(deviation.map(|value| f64::from(value) / f64::from(PER_METRE))),
            Outcome::Reason(_) => None,
        }
    }

    /// Covariance, m².
    pub fn covariance_m2(&self) -> Option<[[f64; 3]; 3]> {
        let Outcome::Position { correlation, .. } = self.outcome else { return None };
        let [x, y, z] = self.deviation_m()?;
        let [xy, xz, yz] = correlation.map(|rho| f64::from(rho) / f64::from(FULL));
        let (xy, xz, yz) = (xy * x * y, xz * x * z, yz * y * z);
        Some([[x * x, xy, xz], [xy, y * y, yz], [xz, yz, z * z]])
    }

    /// Which of the round's ranges were used: bit i is the i-th.
    pub fn used(&self) -> Option<u16> {
        match self.outcome {
            Outcome::Position { used, .. } => Some(used),
            Outcome::Reason(_) => None,
        }
    }

    /// How far the ranges agree with the position, 0 to 1.
    pub fn quality(&self) -> Option<f64> {
        match self.outcome {
            Outcome::Position { quality, .. } => Some(f64::from(quality) / f64::from(u8::MAX)),
            Outcome::Reason(_) => None,
        }
    }

    /// Why there is no position.
    pub fn reason(&self) -> Option<Reason> {
        match self.outcome {
            Outcome::Position { .. } => None,
            Outcome::Reason(reason) => Some(reason),
        }
    }

    /// From the poll to the publication, seconds.
    pub fn age_s(&self) -> f64 {
        f64::from(self.age_us) / 1e6
    }
}

impl Range {
    /// Metres; slightly negative values happen at arm's length.
    pub fn distance_m(&self) -> f64 {
        metres(self.distance)
    }

    /// Standard deviation expected with line of sight, metres.
    pub fn deviation_m(&self) -> f64 {
        f64::from(self.deviation) / f64::from(PER_METRE)
    }

    /// Where the anchor says it stands, metres.
    pub fn place_m(&self) -> Option<[f64; 3]> {
        Some(self.place?.map(metres))
    }
}

impl Difference {
    /// Metres.
    pub fn difference_m(&self) -> f64 {
        metres(self.difference)
    }

    /// Standard deviation expected with line of sight, beside the reference's, metres.
    pub fn deviation_m(&self) -> f64 {
        f64::from(self.deviation) / f64::from(PER_METRE)
    }

    /// Where the anchor says it stands, metres.
    pub fn place_m(&self) -> Option<[f64; 3]> {
        Some(self.place?.map(metres))
    }
}

impl Diagnostics {
    /// Received power, dBm; `None` where the receiver gave none.
    pub fn rx_power_dbm(&self) -> Option<f64> {
        from_hundredths(self.rx_power)
    }

    /// Power of the first path, dBm; `None` where the receiver gave none.
    pub fn first_path_power_dbm(&self) -> Option<f64> {
        from_hundredths(self.first_path_power)
    }

    /// Place of the first path in the accumulator, samples.
    pub fn first_path_index(&self) -> f64 {
        f64::from(self.first_path_index) / f64::from(PER_SAMPLE)
    }

    /// The sender's clock against ours, parts per million, positive where it is faster; `None` where the receiver gave none.
    pub fn clock_offset_ppm(&self) -> Option<f64> {
        from_hundredths(self.clock_offset)
    }
}

impl From<baliza_dw1000::Diagnostics> for Diagnostics {
    fn from(measured: baliza_dw1000::Diagnostics) -> Self {
        Self {
            rx_power: hundredths(measured.rx_power_dbm),
            first_path_power: hundredths(measured.first_path_power_dbm),
            first_path_index: nearest(measured.first_path_index * PER_SAMPLE) as u16,
            first_path_amplitudes: measured.first_path_amplitudes,
            cir_power: measured.cir_power,
            preamble_count: measured.preamble_count,
            noise_deviation: measured.noise_deviation,
            clock_offset: hundredths(measured.clock_offset_ppm),
        }
    }
}

/// What is not known becomes NaN.
impl From<Diagnostics> for baliza_dw1000::Diagnostics {
    fn from(told: Diagnostics) -> Self {
        let known = |value: Option<f64>| value.map_or(f32::NAN, |value| value as f32);
        Self {
            rx_power_dbm: known(told.rx_power_dbm()),
            first_path_power_dbm: known(told.first_path_power_dbm()),
            first_path_index: told.first_path_index() as f32,
            first_path_amplitudes: told.first_path_amplitudes,
            cir_power: told.cir_power,
            preamble_count: told.preamble_count,
            noise_deviation: told.noise_deviation,
            clock_offset_ppm: known(told.clock_offset_ppm()),
        }
    }
}

impl From<SolveError> for Reason {
    fn from(reason: SolveError) -> Self {
        match reason {
            SolveError::TooFewAnchors => Self::TooFewAnchors,
            SolveError::TooManyAnchors => Self::TooManyAnchors,
            SolveError::NotFinite => Self::NotFinite,
            SolveError::CoincidentAnchors => Self::CoincidentAnchors,
            SolveError::CollinearAnchors => Self::CollinearAnchors,
            SolveError::RangesDisjoint => Self::RangesDisjoint,
            SolveError::Diverged => Self::Diverged,
            SolveError::SightUnknown => Self::SightUnknown,
        }
    }
}

impl From<Reason> for SolveError {
    fn from(reason: Reason) -> Self {
        match reason {
            Reason::TooFewAnchors => Self::TooFewAnchors,
            Reason::TooManyAnchors => Self::TooManyAnchors,
            Reason::NotFinite => Self::NotFinite,
            Reason::CoincidentAnchors => Self::CoincidentAnchors,
            Reason::CollinearAnchors => Self::CollinearAnchors,
            Reason::RangesDisjoint => Self::RangesDisjoint,
            Reason::Diverged => Self::Diverged,
            Reason::SightUnknown => Self::SightUnknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fix of a position alone.
    fn fix(position_m: [f32; 3], covariance_m2: [[f32; 3]; 3]) -> Fix {
        Fix {
            t_us: 0,
            round: 0,
            age_us: 0,
            asked: 4,
            outcome: Outcome::position(position_m, covariance_m2, 0b1011, 0.5),
            solver: crate::telemetry::Solver::Track,
        }
    }

    fn diagonal(xx: f32, yy: f32, zz: f32) -> [[f32; 3]; 3] {
        [[xx, 0.0, 0.0], [0.0, yy, 0.0], [0.0, 0.0, zz]]
    }

    #[test]
    fn a_position_keeps_tenths_of_millimetres_and_its_covariance() {
        // σ = 0.3, 0.2 and 0.5 m; ρxy = 0.0315 ⁄ 0.06 = 0.525, ρxz = −0.0705 ⁄ 0.15 = −0.47, ρyz = 0.
        let told = fix([1.23456, -2.0, 0.00004], [[0.09, 0.0315, -0.0705], [0.0315, 0.04, 0.0], [-0.0705, 0.0, 0.25]]);
        assert_eq!(told.position_m(), Some([1.2346, -2.0, 0.0]));
        assert_eq!(told.deviation_m(), Some([0.3, 0.2, 0.5]));
        // 0.525 · 127 = 66.7, −0.47 · 127 = −59.7; 0.5 · 255 = 127.5, rounded away from zero.
        let Outcome::Position { correlation, quality, .. } = told.outcome else { panic!("{told:?}") };
        assert_eq!((correlation, quality, told.used(), told.reason()), ([67, -60, 0], 128, Some(0b1011), None));
        let covariance = told.covariance_m2().expect("a position");
        // 67 ⁄ 127 · 0.06, −60 ⁄ 127 · 0.15.
        let expected = [[0.09, 0.03165, -0.07087], [0.03165, 0.04, 0.0], [-0.07087, 0.0, 0.25]];
        for (row, expected) in covariance.iter().zip(expected) {
            assert!(row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{covariance:?}");
        }
    }

    #[test]
    fn a_position_a_kilometre_away_keeps_its_tenths_too() {
        let place = [999.9876, -999.9876, 0.0];
        let told = fix(place, diagonal(1.0, 1.0, 1.0)).position_m().expect("a position");
        assert!(told.iter().zip(place).all(|(told, place)| (told - f64::from(place)).abs() < 1e-4), "{told:?}");
    }

    #[test]
    fn what_is_no_number_is_never_told_as_zero() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let told = fix([0.0, bad, 0.0], diagonal(1.0, 1.0, 1.0));
            assert_eq!((told.reason(), told.position_m()), (Some(Reason::NotFinite), None));
        }
        let greatest = f64::from(u32::MAX) / 1e4;
        let told = fix([0.0; 3], diagonal(f32::NAN, f32::INFINITY, -1e-9));
        assert_eq!(told.deviation_m(), Some([greatest, greatest, 0.0]));
        assert_eq!(length(f32::NAN), i32::MAX);
    }

    #[test]
    fn a_deviation_is_zero_only_where_it_was() {
        // 10⁻¹² m² is a micrometre squared.
        assert_eq!(fix([0.0; 3], diagonal(1e-12, 0.0, 1e-8)).deviation_m(), Some([0.0001, 0.0, 0.0001]));
    }

    #[test]
    fn numbers_beyond_the_wire_become_its_ends() {
        assert_eq!([1e30, -1e30].map(length), [i32::MAX, i32::MIN]);
        assert_eq!([1e30, -1e30].map(deviation), [u32::MAX, 0]);
        assert_eq!([1e30, -1e30, f32::NAN].map(hundredths), [i16::MAX, -i16::MAX, UNKNOWN_POWER]);
    }

    #[test]
    fn diagnostics_come_back_as_fine_as_the_wire_has_them() {
        let measured = baliza_dw1000::Diagnostics {
            rx_power_dbm: -79.254,
            first_path_power_dbm: f32::NEG_INFINITY,
            first_path_index: 745.516,
            first_path_amplitudes: [1, 2, 3],
            cir_power: 4,
            preamble_count: 5,
            noise_deviation: 6,
            clock_offset_ppm: -2.349,
        };
        let told = Diagnostics::from(measured);
        // 745.516 · 64 = 47713.02.
        assert_eq!((told.rx_power, told.first_path_index, told.clock_offset), (-7925, 47_713, -235));
        let back = baliza_dw1000::Diagnostics::from(told);
        assert!(back.first_path_power_dbm.is_nan());
        let known = baliza_dw1000::Diagnostics { first_path_power_dbm: 0.0, ..back };
        let expected = baliza_dw1000::Diagnostics {
            rx_power_dbm: -79.25,
            first_path_power_dbm: 0.0,
            first_path_index: 745.515_6,
            clock_offset_ppm: -2.35,
            ..measured
        };
        assert_eq!(known, expected);
    }

    #[test]
    fn reasons_are_those_of_the_core() {
        let told = [
            Reason::TooFewAnchors,
            Reason::TooManyAnchors,
            Reason::NotFinite,
            Reason::CoincidentAnchors,
            Reason::CollinearAnchors,
            Reason::RangesDisjoint,
            Reason::Diverged,
            Reason::SightUnknown,
        ];
        let names = "too-few-anchors too-many-anchors not-finite coincident-anchors collinear-anchors ranges-disjoint \
                     diverged sight-unknown";
        assert!(told.iter().map(|reason| reason.as_str()).eq(names.split(' ')));
        assert!(told.iter().all(|reason| Reason::from(SolveError::from(*reason)) == *reason));
    }
}
