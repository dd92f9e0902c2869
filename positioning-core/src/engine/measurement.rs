//! What goes into the engine.

use crate::{AnchorSet, Fix, Real};

/// Sums of magnitudes beyond this are no measurement, metres.
const FARTHEST_M: f64 = 1.0e5;

/// One thing that was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Measurement<T> {
    /// A range to an anchor.
    Range(Range<T>),
    /// All ranges, or differences, of a round have been given: the round's position is asked for.
    RoundEnd,
    /// A difference of two arrivals.
    Tdoa(Tdoa<T>),
    /// A position that RSSI values of beacons have together, by their path losses or by a map of them.
    BeaconPosition(BeaconPosition<T>),
    /// A height.
    Height {
        /// Metres.
        height: T,
        /// Standard deviation, metres.
        deviation: T,
    },
    /// A position from elsewhere.
    Position {
        /// Metres.
        position: [T; 3],
        /// Covariance, m².
        covariance: [[T; 3]; 3],
    },
}

/// A range to an anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range<T> {
    /// The anchor's address.
    pub anchor: u16,
    /// Where it stands, metres.
    pub place: [T; 3],
    /// Metres.
    pub distance: T,
    /// Standard deviation of the range's noise in line of sight, metres.
    pub deviation: T,
    /// Probability, 0 to 1, that the link is without line of sight; `None`: nobody asked.
    pub blocked: Option<T>,
    /// By how much the range is believed to be too long, metres; heeded only where the settings say so.
    pub excess: Option<T>,
}

/// A difference of two arrivals.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tdoa<T> {
    /// The anchor's address.
    pub anchor: u16,
    /// Where it stands, metres.
    pub place: [T; 3],
    /// The reference anchor's address. Differences to it that are given at the same time share its arrival and so its error.
    pub reference: u16,
    /// Where the reference anchor stands, metres.
    pub reference_place: [T; 3],
    /// The tag's distance to the anchor less that to the reference anchor, metres.
    pub difference: T,
    /// Standard deviations of the arrivals from the reference anchor and from the anchor, metres.
    pub deviations: [T; 2],
    /// Probabilities that their links are without line of sight.
    pub blocked: [Option<T>; 2],
}

/// A position in the plane by RSSI values of beacons.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeaconPosition<T> {
    /// Metres.
    pub position: [T; 2],
    /// Covariance, m²: xx, xy, yy.
    pub covariance: [T; 3],
    /// The share of it that stays with the place, 0 to 1.
    pub lasting: T,
}

/// A probability as it may be used; what is no number says nothing.
pub(super) fn known<T: Real>(blocked: Option<T>) -> Option<T> {
    blocked.filter(|p| p.is_finite()).map(|p| p.at_least(T::ZERO).at_most(T::ONE))
}

/// The same, but a range without an NLOS probability counts as line of sight.
pub(super) fn probability<T: Real>(blocked: Option<T>) -> T {
    known(blocked).unwrap_or(T::ZERO)
}

/// Whether all magnitudes are believable: NaN and infinity survive a sum, and fail it.
fn sane<T: Real>(magnitudes: T, deviation: T) -> bool {
    magnitudes <= T::of(FARTHEST_M) && deviation > T::ZERO && deviation <= T::of(FARTHEST_M)
}

fn magnitude<T: Real>(point: &[T; 3]) -> T {
    point[0].abs() + point[1].abs() + point[2].abs()
}

impl<T: Real> Range<T> {
    pub(super) fn is_sane(&self) -> bool {
        let excess = self.excess.unwrap_or(T::ZERO);
        sane(magnitude(&self.place) + self.distance.abs() + excess.abs(), self.deviation)
    }
}

impl<T: Real> Tdoa<T> {
    pub(super) fn is_sane(&self) -> bool {
        let places = magnitude(&self.place) + magnitude(&self.reference_place);
        self.anchor != self.reference
            && sane(places + self.difference.abs(), self.deviations[0])
            && sane(T::ZERO, self.deviations[1])
    }
}

impl<T: Real> BeaconPosition<T> {
    pub(super) fn is_sane(&self) -> bool {
        let ([x, y], [xx, xy, yy]) = (self.position, self.covariance);
        let zero = T::ZERO;
        xx > zero
            && yy > zero
            && position_is_sane(&[x, y, zero], &[[xx, xy, zero], [xy, yy, zero], [zero; 3]])
            && (T::ZERO..=T::ONE).contains(&self.lasting)
    }

    /// The same for a tag at this height. Whoever located it has judged the RSSI values.
    pub(super) fn at(&self, height: T) -> Fix<T, 3> {
        let ([x, y], [xx, xy, yy], zero) = (self.position, self.covariance, T::ZERO);
        Fix {
            position: [x, y, height],
            covariance: [[xx, xy, zero], [xy, yy, zero], [zero; 3]],
            dilution_of_precision: [zero; 3],
            used: AnchorSet(0),
            quality: T::ONE,
        }
    }
}

/// Whether a height with its deviation is one.
pub(super) fn height_is_sane<T: Real>(height: T, deviation: T) -> bool {
    sane(height.abs(), deviation)
}

/// Whether a position with its covariance is one.
pub(super) fn position_is_sane<T: Real>(position: &[T; 3], covariance: &[[T; 3]; 3]) -> bool {
    let sum = covariance.iter().flatten().fold(magnitude(position), |sum, element| sum + element.abs());
    sane(sum, T::ONE) && is_covariance(covariance)
}

/// Whether the lower triangle is that of a matrix without negative eigenvalues: no principal minor is negative, as far as
/// rounding can tell.
fn is_covariance<T: Real>(m: &[[T; 3]; 3]) -> bool {
    let slack = T::of(8.0) * T::EPSILON;
    let diagonal = (0..3).all(|axis| m[axis][axis] >= T::ZERO);
    let pairs = [(1, 0), (2, 0), (2, 1)];
    let pair = |(r, c): (usize, usize)| m[r][c].squared() <= m[r][r] * m[c][c] * (T::ONE + slack);
    let product = m[0][0] * m[1][1] * m[2][2];
    let determinant = product + T::of(2.0) * m[1][0] * m[2][0] * m[2][1]
        - m[0][0] * m[2][1].squared()
        - m[1][1] * m[2][0].squared()
        - m[2][2] * m[1][0].squared();
    diagonal && pairs.into_iter().all(pair) && determinant >= -slack * product
}
