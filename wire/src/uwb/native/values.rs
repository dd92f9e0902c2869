//! Values in frames of native mode: distances, shares of the slots, positions. Each converts to and from its bytes on
//! the air.

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
    /// One slot in this many superframes, 2 to 127: the byte plus 128.
    OneIn(u8),
}

impl Share {
    const GREEDY: u8 = 127;

    #[inline]
    pub(super) fn parse(byte: u8) -> Result<Self, FrameError> {
        match byte {
            0 => Ok(Self::Release),
            1..Self::GREEDY => Ok(Self::Slots(byte)),
            Self::GREEDY => Ok(Self::Greedy),
            0x80 | 0x81 => Err(FrameError::Field),
            0x82.. => Ok(Self::OneIn(byte & 0x7F)),
        }
    }

    #[inline]
    pub(super) fn byte(self) -> u8 {
        match self {
            Self::Release => 0,
            Self::Slots(slots) => slots.clamp(1, Self::GREEDY - 1),
            Self::Greedy => Self::GREEDY,
            Self::OneIn(superframes) => 0x80 | superframes.clamp(2, 0x7F),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_and_distances_beyond_their_range_are_unknown() {
        assert_eq!(Position::from_metres([8389.0, 0.0, 0.0]), None);
        assert_eq!(Position::from_metres([0.0, f32::NAN, 0.0]), None);
        assert_eq!(Distance::from_metres(132.0), Distance::Unknown);
        assert_eq!(Distance::from_metres(f32::NAN), Distance::Unknown);
        assert_eq!(Distance::from_metres(-131.0), Distance::Quarters(-32_750));
    }
}
