//! A position, or why there is none.

use core::fmt;

use positioning_core::{Flag, Real, SolveError};
use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use super::or_default;
use crate::telemetry::quantised::{deviation, deviation_m, metres, nearest, position};
use crate::telemetry::text::{Centimetres, text};
use crate::telemetry::{Body, Tone};

/// Units of a correlation of 1.
const FULL: f32 = 127.0;

/// A position, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fix {
    /// When it was published, since the node started, microseconds.
    pub t_us: u64,
    /// Counts the rounds, wrapping.
    pub round: u16,
    /// From the poll to the publication, microseconds.
    pub age_us: u32,
    /// Anchors asked. Zero: the position is from beacons, and `round` continues from the last round's number.
    pub asked: u8,
    /// The result of the round.
    pub outcome: Outcome,
    /// The solver of the position.
    #[serde(deserialize_with = "or_default")]
    pub solver: Solver,
    /// What makes the position doubtful. Nothing takes no byte, as long as this is the last field.
    #[serde(deserialize_with = "or_default", skip_serializing_if = "Doubt::is_none")]
    pub doubt: Doubt,
}

/// What makes a position doubtful beyond its deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
pub enum Doubt {
    /// Nothing, or the node is of a build that does not report it.
    #[default]
    None,
    /// Ranges contradict each other, and those that agree are too few to confirm the position.
    Suspect,
    /// The ranges fit this place too, 0.1 mm.
    Ambiguous([i32; 3]),
}

impl Doubt {
    /// The doubt of a flag; the other place in metres.
    pub fn of(flag: Option<Flag>, alternative_m: Option<[f32; 3]>) -> Self {
        match (flag, alternative_m.and_then(position)) {
            (None, _) => Self::None,
            (Some(Flag::Ambiguous), Some(tenth_mm)) => Self::Ambiguous(tenth_mm),
            (Some(Flag::Suspect), _) | (Some(Flag::Ambiguous), None) => Self::Suspect,
        }
    }

    fn is_none(&self) -> bool {
        *self == Self::None
    }

    /// The flag.
    pub fn flag(self) -> Option<Flag> {
        match self {
            Self::None => None,
            Self::Suspect => Some(Flag::Suspect),
            Self::Ambiguous(_) => Some(Flag::Ambiguous),
        }
    }

    /// The other place, metres.
    pub fn alternative_m(self) -> Option<[f64; 3]> {
        match self {
            Self::None | Self::Suspect => None,
            Self::Ambiguous(tenth_mm) => Some(tenth_mm.map(metres)),
        }
    }
}

text!(Doubt, |this| this;
    Self::None => (""),
    Self::Suspect => (", suspect"),
    Self::Ambiguous([x, y, z]) => (
        ", ambiguous: or x={} y={} z={}",
        Centimetres::of_tenth_mm(*x), Centimetres::of_tenth_mm(*y), Centimetres::of_tenth_mm(*z)
    ),
);

/// The solver of a tag's positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Solver {
    /// Unknown: the node is of an older build, which does not report it, or of a newer one.
    #[default]
    Unknown,
    /// A tracking filter, which every range updates.
    Track,
    /// `robust`, each round alone.
    Robust,
    /// `b-wls`, each round alone.
    BWls,
    /// `b-wls-r`, each round alone.
    BWlsR,
    /// `bounding-box`, each round alone.
    BoundingBox,
}

impl Solver {
    /// Its name, as in the config record; `None` if it is unknown.
    pub fn as_str(self) -> Option<&'static str> {
        match self {
            Self::Unknown => None,
            Self::Track => Some("track"),
            Self::Robust => Some("robust"),
            Self::BWls => Some("b-wls"),
            Self::BWlsR => Some("b-wls-r"),
            Self::BoundingBox => Some("bounding-box"),
        }
    }
}

/// The result of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// A position.
    Position {
        /// 0.1 mm.
        position_tenth_mm: [i32; 3],
        /// Standard deviations, 0.1 mm; zero for a configured height.
        deviation_tenth_mm: [u32; 3],
        /// Correlations xy, xz, yz in 1/127.
        correlation_127ths: [i8; 3],
        /// Bit i: the round's i-th range, or the i-th nearest beacon, was used.
        used: u16,
        /// Agreement of the ranges with the position, in 1/255.
        quality_255ths: u8,
    },
    /// No position, with the reason.
    Reason(SolveError),
}

impl Outcome {
    /// A position, metres, with its covariance, m². Bit i of `used` is the round's i-th range; `quality` is from 0 to
    /// 1.
    ///
    /// A variance of zero is that of a configured coordinate. A position that is not finite becomes
    /// [`SolveError::NotFinite`].
    pub fn position(position_m: [f32; 3], covariance_m2: [[f32; 3]; 3], used: u16, quality: f32) -> Self {
        let Some(position_tenth_mm) = position(position_m) else { return Self::Reason(SolveError::NotFinite) };
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = covariance_m2;
        // A variance below zero is a zero with a rounding error.
        let [x, y, z] = [xx, yy, zz].map(|variance| if variance < 0.0 { 0.0 } else { Real::sqrt(variance) });
        // If a deviation is zero or not a number, the quotient is not a number either, and `as` makes it 0.
        let correlation_127ths = whole_127ths([xy / (x * y), xz / (x * z), yz / (y * z)]);
        let quality_255ths = nearest(quality * f32::from(u8::MAX)) as u8;
        let deviation_tenth_mm = [x, y, z].map(deviation);
        Self::Position { position_tenth_mm, deviation_tenth_mm, correlation_127ths, used, quality_255ths }
    }
}

/// Correlations xy, xz, yz in 1/127. Rounding may make the matrix of a long thin ellipsoid singular, or its least
/// eigenvalue negative: then the ellipsoid becomes a little thicker.
fn whole_127ths(correlations: [f32; 3]) -> [i8; 3] {
    // Plus 2/127 of the unit matrix. Rounding moves an eigenvalue by at most 1/127.
    const THICKER: f32 = FULL - 2.0;
    let rounded = |full: f32| correlations.map(|rho| nearest(rho.clamp(-1.0, 1.0) * full) as i8);
    let whole = rounded(FULL);
    if is_definite(whole) { whole } else { rounded(THICKER) }
}

/// Whether the least eigenvalue of the matrix of correlations exceeds 1/254, by its leading minors.
pub(crate) fn is_definite(correlation_127ths: [i8; 3]) -> bool {
    // 127 less a half, in halves.
    const DIAGONAL: i32 = 253;
    let [a, b, c] = correlation_127ths.map(|rho| 2 * i32::from(rho));
    let determinant = DIAGONAL.pow(3) + 2 * a * b * c - DIAGONAL * (a * a + b * b + c * c);
    a.abs() < DIAGONAL && determinant > 0
}

impl Fix {
    /// Metres, in the anchors' frame.
    pub fn position_m(&self) -> Option<[f64; 3]> {
        match self.outcome {
            Outcome::Position { position_tenth_mm, .. } => Some(position_tenth_mm.map(metres)),
            Outcome::Reason(_) => None,
        }
    }

    /// Standard deviation of each coordinate, metres; zero for a configured height.
    pub fn deviation_m(&self) -> Option<[f64; 3]> {
        match self.outcome {
            Outcome::Position { deviation_tenth_mm, .. } => Some(deviation_tenth_mm.map(deviation_m)),
            Outcome::Reason(_) => None,
        }
    }

    /// Covariance, m².
    pub fn covariance_m2(&self) -> Option<[[f64; 3]; 3]> {
        let Outcome::Position { correlation_127ths, .. } = self.outcome else { return None };
        let [x, y, z] = self.deviation_m()?;
        let [xy, xz, yz] = correlation_127ths.map(|rho| f64::from(rho) / f64::from(FULL));
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

    /// Agreement of the ranges with the position, 0 to 1.
    pub fn quality(&self) -> Option<f64> {
        match self.outcome {
            Outcome::Position { quality_255ths, .. } => Some(f64::from(quality_255ths) / f64::from(u8::MAX)),
            Outcome::Reason(_) => None,
        }
    }

    /// Why there is no position.
    pub fn reason(&self) -> Option<SolveError> {
        match self.outcome {
            Outcome::Position { .. } => None,
            Outcome::Reason(reason) => Some(reason),
        }
    }

    /// From the poll to the publication, seconds.
    pub fn age_s(&self) -> f64 {
        f64::from(self.age_us) / 1e6
    }

    /// The part that a line shows: the position, or why there is none.
    fn found(&self) -> Result<Found, SolveError> {
        let Outcome::Position { position_tenth_mm, deviation_tenth_mm, used, .. } = self.outcome else {
            return Err(self.reason().unwrap_or(SolveError::NotFinite));
        };
        let deviation = deviation_in_space(deviation_tenth_mm);
        let position = position_tenth_mm.map(Centimetres::of_tenth_mm);
        let (used, age_ms, by) = (used.count_ones(), self.age_us.saturating_add(500) / 1000, By(self.solver));
        let [.., height_deviation] = deviation_tenth_mm;
        Ok(if height_deviation == 0 {
            Found::Plane { position, deviation, used, age_ms, by }
        } else {
            Found::Space { position, deviation, used, age_ms, by }
        })
    }
}

/// The standard deviation of the distance to the true position.
pub(super) fn deviation_in_space(deviation_tenth_mm: [u32; 3]) -> Centimetres {
    let squares = deviation_tenth_mm.map(|axis| u64::from(axis).saturating_mul(axis.into()));
    let size = squares.into_iter().fold(0, u64::saturating_add).isqrt();
    Centimetres::of_tenth_mm(i32::try_from(size).unwrap_or(i32::MAX))
}

/// A position with its standard deviation (of the distance to the true position: in the plane if the height was
/// configured, else in space), the anchors used, its age in ms, and its solver.
enum Found {
    Space { position: [Centimetres; 3], deviation: Centimetres, used: u32, age_ms: u32, by: By },
    Plane { position: [Centimetres; 3], deviation: Centimetres, used: u32, age_ms: u32, by: By },
}

text!(Found, |this| this;
    Self::Space { position: [x, y, z], deviation, used, age_ms, by } =>
        ("x={} y={} z={} ±{} m, {} anchors, {} ms{}", x, y, z, deviation, used, age_ms, by),
    Self::Plane { position: [x, y, z], deviation, used, age_ms, by } =>
        ("x={} y={} z={} (given) ±{} m, {} anchors, {} ms{}", x, y, z, deviation, used, age_ms, by),
);

/// The solver of a position, if known.
struct By(Solver);

text!(By, |this| this.0.as_str();
    Some(name) => (", {}", name),
    None => (""),
);

/// A fix as a line of the log.
pub struct FixLine {
    /// The fix.
    pub fix: Fix,
    /// Anchors that answered in its round.
    pub answered: u8,
}

text!(FixLine, |this| this.fix.found();
    Ok(found) => ("fix {}{}", found, this.fix.doubt),
    Err(reason) =>
        ("no fix: {} ({} of {} answered){}", reason.as_str(), this.answered, this.fix.asked, By(this.fix.solver)),
);

impl fmt::Display for Fix {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.found() {
            Ok(found) => write!(out, "{found}{}", self.doubt),
            Err(reason) => write!(out, "none: {}, {} asked", reason.as_str(), self.asked),
        }
    }
}

#[cfg(feature = "host")]
impl Fix {
    /// The columns of doubtful positions.
    pub const FLAGS: [&str; 4] = ["flag", "alt_x_m", "alt_y_m", "alt_z_m"];
    /// The table of positions.
    pub const POSITIONS: crate::telemetry::Table = crate::telemetry::Table {
        name: "positions",
        rows: "positions",
        counted: "rounds",
        about: "Positions and rounds without one, as solve writes them",
        columns: &[
            "method",
            "x_m",
            "y_m",
            "z_m",
            "sigma_x_m",
            "sigma_y_m",
            "sigma_z_m",
            "used",
            "reason",
            Self::FLAGS[0],
            Self::FLAGS[1],
            Self::FLAGS[2],
            Self::FLAGS[3],
        ],
    };
}

impl Body for Fix {
    const KIND: &'static str = "fix";
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = Some(Self::POSITIONS);

    fn round(&self) -> Option<u16> {
        Some(self.round)
    }

    fn tone(&self) -> Tone {
        match self.outcome {
            Outcome::Position { .. } if self.doubt == Doubt::None => Tone::Good,
            Outcome::Position { .. } | Outcome::Reason(_) => Tone::Warning,
        }
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        use crate::telemetry::host::rounded;
        let [x, y, z] = self.position_m().map_or([None; 3], |position| position.map(Some));
        let [sigma_x, sigma_y, sigma_z] = self.deviation_m().map_or([None; 3], |deviation| deviation.map(Some));
        let [alt_x, alt_y, alt_z] = self.doubt.alternative_m().map_or([None; 3], |place| place.map(Some));
        let used_ranges = |used: u16| (0..16).filter(|bit| used >> bit & 1 == 1).collect::<std::vec::Vec<u16>>();
        serde_json::json!({
            "round": self.round,
            "age_s": self.age_s(),
            "asked": self.asked,
            "x_m": x,
            "y_m": y,
            "z_m": z,
            "sigma_x_m": sigma_x,
            "sigma_y_m": sigma_y,
            // A configured height has none.
            "sigma_z_m": sigma_z.filter(|sigma| *sigma != 0.0),
            "covariance_m2": self.covariance_m2().map(|rows| rows.map(|row| row.map(|value| rounded(value, 1e9)))),
            "used": self.used().map(u16::count_ones),
            "used_ranges": self.used().map(used_ranges),
            "quality": self.quality().map(|quality| rounded(quality, 1e3)),
            "reason": self.reason().map(SolveError::as_str),
            "solver": self.solver.as_str(),
            "flag": self.doubt.flag().map(Flag::as_str),
            "alt_x_m": alt_x,
            "alt_y_m": alt_y,
            "alt_z_m": alt_z.filter(|_| sigma_z != Some(0.0)),
        })
    }

    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        use std::string::{String, ToString};
        let known = |values: Option<[f64; 3]>| {
            values.map_or([const { String::new() }; 3], |of| of.map(crate::telemetry::metres))
        };
        // A configured height has no deviation, and no other place has another one.
        let is_given = self.deviation_m().is_some_and(|[.., z]| z == 0.0);
        let of_height = |text: String| if is_given { String::new() } else { text };
        let [sigma_x, sigma_y, sigma_z] = known(self.deviation_m());
        let [alt_x, alt_y, alt_z] = known(self.doubt.alternative_m());
        let mut fields = std::vec!["tag".to_string()];
        fields.extend(known(self.position_m()));
        fields.extend([sigma_x, sigma_y, of_height(sigma_z)]);
        fields.push(self.used().map_or_else(String::new, |used| used.count_ones().to_string()));
        fields.push(self.reason().map_or_else(String::new, |reason| reason.as_str().to_string()));
        fields.push(self.doubt.flag().map_or_else(String::new, |flag| flag.as_str().to_string()));
        fields.extend([alt_x, alt_y, of_height(alt_z)]);
        fields
    }
}

#[cfg(test)]
mod tests {
    use std::string::{String, ToString};

    use super::*;

    /// A fix with only a position.
    fn fix(position_m: [f32; 3], covariance_m2: [[f32; 3]; 3]) -> Fix {
        Fix {
            t_us: 0,
            round: 0,
            age_us: 0,
            asked: 4,
            outcome: Outcome::position(position_m, covariance_m2, 0b1011, 0.5),
            solver: Solver::Track,
            doubt: Doubt::None,
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
        let Outcome::Position { correlation_127ths, quality_255ths, .. } = told.outcome else { panic!("{told:?}") };
        assert_eq!(
            (correlation_127ths, quality_255ths, told.used(), told.reason()),
            ([67, -60, 0], 128, Some(0b1011), None)
        );
        let covariance = told.covariance_m2().expect("a position");
        // 67 ⁄ 127 · 0.06, −60 ⁄ 127 · 0.15.
        let expected = [[0.09, 0.03165, -0.07087], [0.03165, 0.04, 0.0], [-0.07087, 0.0, 0.25]];
        for (row, expected) in covariance.iter().zip(expected) {
            assert!(row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{covariance:?}");
        }
    }

    #[test]
    fn the_covariance_of_a_long_thin_ellipsoid_has_an_inverse() {
        // Of a position that is one of two, 6 m apart; ρ = −0.9992 would become −1.
        let told = fix([0.0; 3], [[5.758, -8.740, 0.0], [-8.740, 13.2875, 0.0], [0.0; 3]]);
        let [[xx, xy, _], [_, yy, _], _] = told.covariance_m2().expect("a position");
        assert!(xx * yy - xy * xy > 0.01 * xx * yy, "{xx} {xy} {yy}");
        // 1 m along each of these axes, 3 cm across it.
        for (i, j) in (0..20).flat_map(|i| (0..20).map(move |j| (i, j))) {
            let [polar, azimuth] = [i, j].map(|k| f64::from(k) * 0.157);
            let axis = [polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()];
            let covariance = [0, 1, 2].map(|row| {
                [0, 1, 2].map(|column| (axis[row] * axis[column] + if row == column { 0.0009 } else { 0.0 }) as f32)
            });
            let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = fix([0.0; 3], covariance).covariance_m2().expect("one");
            let second = xx * yy - xy * xy;
            let third = zz * second - yy * xz * xz - xx * yz * yz + 2.0 * xy * xz * yz;
            assert!(second > 0.0 && third > 0.0, "{axis:?}: {second}, {third}");
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
            assert_eq!((told.reason(), told.position_m()), (Some(SolveError::NotFinite), None));
        }
        let greatest = f64::from(u32::MAX) / 1e4;
        let told = fix([0.0; 3], diagonal(f32::NAN, f32::INFINITY, -1e-9));
        assert_eq!(told.deviation_m(), Some([greatest, greatest, 0.0]));
    }

    #[test]
    fn a_deviation_is_zero_only_where_it_was() {
        // 10⁻¹² m² is a micrometre squared.
        assert_eq!(fix([0.0; 3], diagonal(1e-12, 0.0, 1e-8)).deviation_m(), Some([0.0001, 0.0, 0.0001]));
    }

    fn line(deviation_tenth_mm: [u32; 3]) -> String {
        let outcome = Outcome::Position {
            position_tenth_mm: [32_149, -450, 15_000],
            deviation_tenth_mm,
            correlation_127ths: [0; 3],
            used: 0b11_0111_1000,
            quality_255ths: 255,
        };
        let fix =
            Fix { t_us: 0, round: 0, age_us: 12_400, asked: 8, outcome, solver: Solver::BWls, doubt: Doubt::None };
        FixLine { fix, answered: 6 }.to_string()
    }

    #[test]
    fn a_fix_in_space_and_in_the_plane() {
        // √(300² + 400² + 350²) = 610: 6.1 cm. √(300² + 400²) = 500: 5 cm.
        assert_eq!(line([300, 400, 350]), "fix x=3.21 y=-0.05 z=1.50 ±0.06 m, 6 anchors, 12 ms, b-wls");
        assert_eq!(line([300, 400, 0]), "fix x=3.21 y=-0.05 z=1.50 (given) ±0.05 m, 6 anchors, 12 ms, b-wls");
        // The root of three times the square of the longest is more than a length can be.
        assert!(line([u32::MAX; 3]).contains("±214748.36 m"));
    }

    #[test]
    fn no_fix_tells_how_many_answered() {
        let outcome = Outcome::Reason(SolveError::TooFewAnchors);
        let fix = Fix { t_us: 0, round: 0, age_us: 0, asked: 4, outcome, solver: Solver::Unknown, doubt: Doubt::None };
        assert_eq!(FixLine { fix, answered: 2 }.to_string(), "no fix: too-few-anchors (2 of 4 answered)");
        assert_eq!(fix.to_string(), "none: too-few-anchors, 4 asked");
    }

    #[test]
    fn a_doubtful_position_is_a_warning_with_its_other_place() {
        let sure = fix([3.2149, -0.045, 1.5], diagonal(0.0009, 0.0016, 0.0));
        let other = Doubt::of(Some(Flag::Ambiguous), Some([3.2149, 12.3456, 1.5]));
        assert_eq!(other, Doubt::Ambiguous([32_149, 123_456, 15_000]));
        let shown = |doubt| {
            let fix = Fix { doubt, ..sure };
            (fix.to_string(), FixLine { fix, answered: 4 }.to_string(), fix.tone())
        };
        // √(300² + 400²) = 500: 5 cm.
        let text = "x=3.21 y=-0.05 z=1.50 (given) ±0.05 m, 3 anchors, 0 ms, track";
        let expected = |more: &str, tone| (std::format!("{text}{more}"), std::format!("fix {text}{more}"), tone);
        assert_eq!(shown(Doubt::None), expected("", Tone::Good));
        assert_eq!(shown(Doubt::Suspect), expected(", suspect", Tone::Warning));
        assert_eq!(shown(other), expected(", ambiguous: or x=3.21 y=12.35 z=1.50", Tone::Warning));
    }

    #[test]
    fn a_flag_is_never_lost() {
        let place = Some([1.0, 2.0, 3.0]);
        assert_eq!(Doubt::of(None, place), Doubt::None);
        assert_eq!(Doubt::of(Some(Flag::Suspect), place), Doubt::Suspect);
        // Where the other place is not known, the position is doubtful all the same.
        for unknown in [None, Some([f32::NAN, 2.0, 3.0])] {
            assert_eq!(Doubt::of(Some(Flag::Ambiguous), unknown), Doubt::Suspect);
        }
    }

    #[cfg(feature = "host")]
    #[test]
    fn a_row_has_the_other_height_only_in_space() {
        let doubt = Doubt::Ambiguous([10_000, -20_000, 15_000]);
        let ends = |zz| Fix { doubt, ..fix([1.0, 2.0, 1.5], diagonal(0.01, 0.01, zz)) }.fields().split_off(9);
        assert_eq!(ends(0.04), ["ambiguous", "1.0000", "-2.0000", "1.5000"]);
        assert_eq!(ends(0.0), ["ambiguous", "1.0000", "-2.0000", ""]);
        assert_eq!(fix([1.0, 2.0, 1.5], diagonal(0.01, 0.01, 0.04)).fields().split_off(9), ["", "", "", ""]);
    }
}
