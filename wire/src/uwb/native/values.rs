//! Values in frames of native mode: distances, shares of the slots, positions. Each converts to and from its bytes on
//! the air.

use super::{Period, Turns};
use crate::telemetry::{Outcome, is_definite};
use crate::uwb::FrameError;

/// A distance on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distance {
    /// The poll carries no distances.
    Unsent,
    /// Not known.
    Unknown,
    /// In units of 4 mm.
    Quarters(i16),
}

impl Distance {
    /// From metres; a distance that does not fit becomes unknown.
    #[inline]
    pub fn from_metres(metres: f32) -> Self {
        let units = metres * 250.0;
        if units > -32_767.5 && units < 32_767.0 {
            Self::Quarters((units + if units < 0.0 { -0.5 } else { 0.5 }) as i16)
        } else {
            Self::Unknown
        }
    }

    /// In metres.
    #[inline]
    pub fn metres(self) -> Option<f32> {
        match self {
            Self::Unsent | Self::Unknown => None,
            Self::Quarters(units) => Some(f32::from(units) / 250.0),
        }
    }
}

/// How many slots a tag requests: one byte on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Share {
    /// No more: byte 0.
    Release,
    /// This many a superframe, 1 to 126: bytes 1 to 126.
    Slots(u8),
    /// As many as a fair division allows: byte 127.
    Greedy,
    /// Turns by a lease: the code of the period plus 128 for slots, plus 192 for blinks.
    Leased(Turns),
}

impl Share {
    const GREEDY: u8 = 127;
    const BLINKS: u8 = 192;

    #[inline]
    pub(super) fn parse(byte: u8) -> Result<Self, FrameError> {
        match byte {
            0 => Ok(Self::Release),
            1..Self::GREEDY => Ok(Self::Slots(byte)),
            Self::GREEDY => Ok(Self::Greedy),
            0x80.. => {
                let period = Period::from_code(byte & 0x3F)?;
                Ok(Self::Leased(Turns { period, are_blinks: byte >= Self::BLINKS }))
            }
        }
    }

    #[inline]
    pub(super) fn byte(self) -> u8 {
        match self {
            Self::Release => 0,
            Self::Slots(slots) => slots.clamp(1, Self::GREEDY - 1),
            Self::Greedy => Self::GREEDY,
            Self::Leased(Turns { period, are_blinks }) => period.code() | if are_blinks { Self::BLINKS } else { 0x80 },
        }
    }

    /// The turns of a lease; `None` of other shares.
    #[inline]
    pub const fn leased(self) -> Option<Turns> {
        match self {
            Self::Leased(turns) => Some(turns),
            Self::Release | Self::Slots(_) | Self::Greedy => None,
        }
    }
}

/// A position on the air: millimetres, each coordinate within ±8388 m.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Position([i32; 3]);

impl Position {
    /// The largest coordinate, millimetres.
    const LIMIT: i32 = (1 << 23) - 1;
    const UNKNOWN: [i32; 3] = [-Self::LIMIT - 1, 0, 0];

    /// From metres; `None` for a value that is not a number or beyond 8388 m.
    #[inline]
    pub fn from_metres(metres: [f32; 3]) -> Option<Self> {
        let millimetres = metres.map(|m| m * 1e3);
        let fits = millimetres.iter().all(|mm| mm.abs() < Self::LIMIT as f32);
        fits.then(|| Self(millimetres.map(|mm| (mm + if mm < 0.0 { -0.5 } else { 0.5 }) as i32)))
    }

    /// In metres.
    #[inline]
    pub fn metres(self) -> [f32; 3] {
        self.0.map(|mm| mm as f32 / 1e3)
    }

    /// `None` is a position that its sender does not know.
    #[inline]
    pub(super) fn parse(bytes: [u8; 9]) -> Result<Option<Self>, FrameError> {
        let coordinate = |i: usize| i32::from_le_bytes([0, bytes[i], bytes[i + 1], bytes[i + 2]]) >> 8;
        let place = [0, 3, 6].map(coordinate);
        if place == Self::UNKNOWN {
            Ok(None)
        } else if place.iter().all(|mm| mm.abs() <= Self::LIMIT) {
            Ok(Some(Self(place)))
        } else {
            Err(FrameError::Field)
        }
    }

    #[inline]
    pub(super) fn bytes(position: Option<Self>) -> [u8; 9] {
        let [x, y, z] = position.map_or(Self::UNKNOWN, |p| p.0).map(i32::to_le_bytes);
        [x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]]
    }
}

/// A tag's position in its poll, as its bytes, which anchors pass on to their hosts. No node reads them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PolledPosition(pub [u8; PolledPosition::BYTES]);

impl PolledPosition {
    /// Its length on the air.
    pub const BYTES: usize = 16;
    /// The most rounds ago.
    pub const OLDEST: u8 = 127;
    const SUSPECT: u8 = 0x80;

    /// A position, metres, with its covariance, m², of the round before the poll's. It is suspect if its ranges contradict
    /// each other, or another place fits them, too. `None` for a position that is not a number or beyond 8388 m.
    #[inline(never)]
    pub fn new(position_m: [f32; 3], covariance_m2: [[f32; 3]; 3], is_suspect: bool) -> Option<Self> {
        let outcome = Outcome::position(position_m, covariance_m2, 0, 0.0);
        let Outcome::Position { position_tenth_mm, deviation_tenth_mm, correlation_127ths, .. } = outcome else {
            return None;
        };
        let mut bytes = [0; Self::BYTES];
        let (places, rest) = bytes.split_at_mut(9);
        let (deviations, rest) = rest.split_at_mut(3);
        for (place, tenth_mm) in places.as_chunks_mut().0.iter_mut().zip(position_tenth_mm) {
            let mm = (tenth_mm / 5 + tenth_mm.signum()) / 2;
            if mm.unsigned_abs() >= Position::LIMIT.unsigned_abs() {
                return None;
            }
            let [low, middle, high, _] = mm.to_le_bytes();
            *place = [low, middle, high];
        }
        for (code, tenth_mm) in deviations.iter_mut().zip(deviation_tenth_mm) {
            *code = deviation_code(tenth_mm);
        }
        for (byte, of_127) in rest.iter_mut().zip(correlation_127ths) {
            *byte = of_127 as u8;
        }
        bytes[Self::BYTES - 1] = if is_suspect { Self::SUSPECT | 1 } else { 1 };
        Some(Self(bytes))
    }

    /// The same, of this many rounds before the poll's, at most [`PolledPosition::OLDEST`].
    pub const fn of_rounds_ago(mut self, rounds_ago: u8) -> Self {
        self.0[15] = self.0[15] & Self::SUSPECT | rounds_ago & Self::OLDEST;
        self
    }

    /// How many rounds before that of the poll it was measured.
    pub const fn rounds_ago(self) -> u8 {
        self.0[15] & Self::OLDEST
    }

    /// Whether it is suspect.
    pub const fn is_suspect(self) -> bool {
        self.0[15] & Self::SUSPECT != 0
    }

    /// As the outcome of a round, whose ranges are not known here.
    ///
    /// # Errors
    /// The bytes are of no position, or of no covariance.
    pub fn outcome(self) -> Result<Outcome, FrameError> {
        let [place @ .., dx, dy, dz, xy, xz, yz, _] = self.0;
        let correlation_127ths = [xy, xz, yz].map(|byte| byte as i8);
        let position = Position::parse(place)?.filter(|_| is_definite(correlation_127ths));
        Ok(Outcome::Position {
            position_tenth_mm: position.ok_or(FrameError::Field)?.0.map(|mm| mm * 10),
            deviation_tenth_mm: [dx, dy, dz].map(deviation_tenth_mm),
            correlation_127ths,
            used: 0,
            quality_255ths: 0,
        })
    }
}

/// 0.1 mm of a code.
fn deviation_tenth_mm(code: u8) -> u32 {
    if code == 0 { 0 } else { ((16 + u32::from(code % 16)) << (code / 16)) * 10 / 16 }
}

/// The least code that is not less than a deviation in 0.1 mm; the greatest is 63 m.
fn deviation_code(tenth_mm: u32) -> u8 {
    if tenth_mm == 0 {
        return 0;
    }
    // In sixteenths of a millimetre, rounded up as the significand is: one that becomes 32 is 16 of the next exponent.
    let sixteenths = (tenth_mm.min(634_880) * 8).div_ceil(5).max(16);
    let exponent = sixteenths.ilog2() - 4;
    let code = 16 * exponent + sixteenths.div_ceil(1 << exponent) - 16;
    code.max(1) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deviation_is_never_less_and_at_most_a_sixteenth_more() {
        for tenth_mm in (1..2000).chain((2000..600_000).step_by(777)) {
            let coded = deviation_tenth_mm(deviation_code(tenth_mm));
            // Two units for the rounding of short ones.
            assert!((tenth_mm..=tenth_mm + tenth_mm / 16 + 2).contains(&coded) || tenth_mm < 10, "{tenth_mm}: {coded}");
        }
        // (16 + 15) · 2¹⁵ / 16 mm = 63.488 m.
        assert_eq!([0, 1, u32::MAX].map(deviation_code), [0, 1, 255]);
        assert_eq!([0, 1, 255].map(deviation_tenth_mm), [0, 10, 634_880]);
    }

    #[test]
    fn a_position_comes_back_as_an_outcome() {
        let covariance_m2 = [[0.04, 0.02, 0.01], [0.02, 0.09, 0.0], [0.01, 0.0, 0.25]];
        let polled = PolledPosition::new([1.2344, -5.6, 0.0], covariance_m2, false).unwrap();
        let Ok(Outcome::Position { position_tenth_mm, deviation_tenth_mm, correlation_127ths, .. }) = polled.outcome()
        else {
            panic!("a position")
        };
        // 0.02 / (0.2 · 0.3) = 1/3 = 42.3/127, 0.01 / (0.2 · 0.5) = 0.1 = 12.7/127.
        assert_eq!((position_tenth_mm, correlation_127ths), ([12_340, -56_000, 0], [42, 13, 0]));
        // Codes 25 · 2⁷, 19 · 2⁸ and 31 · 2⁸ or 16 · 2⁹ sixteenths of a millimetre.
        assert_eq!(deviation_tenth_mm, [2000, 3040, 5120]);
        for nowhere in [f32::NAN, 8388.7, -9000.0] {
            assert_eq!(PolledPosition::new([0.0, nowhere, 0.0], covariance_m2, false), None, "{nowhere}");
        }
        // Correlations of 1 of x with y and z, and of -1 of y with z, are of no covariance.
        let mut forged = polled;
        forged.0[12..15].copy_from_slice(&[127, 127, 129]);
        assert_eq!(forged.outcome(), Err(FrameError::Field));
    }

    #[test]
    fn positions_and_distances_beyond_their_range_are_unknown() {
        assert_eq!(Position::from_metres([8389.0, 0.0, 0.0]), None);
        assert_eq!(Position::from_metres([0.0, f32::NAN, 0.0]), None);
        assert_eq!(Distance::from_metres(132.0), Distance::Unknown);
        assert_eq!(Distance::from_metres(f32::NAN), Distance::Unknown);
        assert_eq!(Distance::from_metres(-131.0), Distance::Quarters(-32_750));
    }
}
