//! A map as bytes: the host writes it, and a node reads it from its flash without a copy in memory.
//!
//! The layout, with little-endian numbers:
//! - `"FM"`, the version, flags (bit 0: with deviations), the number of points in two bytes, the number of beacons in
//!   one, 0;
//! - the origin's position, two times four bytes of centimetres;
//! - the unit of coordinates in two bytes of millimetres;
//! - the identity of each beacon in two bytes;
//! - the fall-back RSSI of each beacon in one byte;
//! - the points: x and y in units, one byte each; one byte per RSSI; with deviations, half a byte per RSSI, the lower
//!   half first;
//! - a CRC-16 (IBM-3740) of everything before it.
//!
//! The byte of an RSSI counts half decibels below 0 dBm. 0 means that the beacon is not received there. A map of 200
//! points × 12 beacons has 2.8 kB, with deviations 4.0 kB.

use core::fmt;

use crate::Real;

/// The version of the layout. A reader accepts no other version.
pub const VERSION: u8 = 1;
/// The most beacons of a map: the number that a tag may be configured with.
pub const MAX_BEACONS: usize = 24;
/// The most points of a map for a node.
pub const MAX_NODE_POINTS: usize = 200;
/// The step of a deviation's half byte, dB. Half byte 0 is one step.
pub const DEVIATIONS_DB: f64 = 0.75;

pub(super) const MAGIC: [u8; 2] = *b"FM";
pub(super) const HEADER: usize = 18;
pub(super) const WITH_DEVIATIONS: u8 = 1;
pub(super) const CHECKSUM: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// Why bytes are not a map, or numbers do not make one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MapError {
    /// The bytes do not begin like a map, or there are none.
    Missing,
    /// The map has a version that is not supported.
    Version(u8),
    /// The bytes end early, or the checksum is wrong.
    Corrupt,
    /// The map is well-formed, but has no points or no beacons, too many beacons, or invalid numbers.
    Invalid,
    /// The buffer is too small to hold the map.
    TooLong,
}

impl fmt::Display for MapError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => write!(f, "not a map of levels"),
            Self::Version(version) => write!(f, "a map of version {version}, where {VERSION} is read"),
            Self::Corrupt => write!(f, "a damaged map"),
            Self::Invalid => write!(f, "a map whose numbers make none"),
            Self::TooLong => write!(f, "a map that is too long"),
        }
    }
}

impl core::error::Error for MapError {}

/// A map that has been checked; it borrows the bytes from which it was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Map<'a> {
    /// The bytes of the whole map, for passing on.
    bytes: &'a [u8],
    identities: &'a [u8],
    fallbacks: &'a [u8],
    points: &'a [u8],
    origin_cm: [i32; 2],
    unit_mm: u16,
    deviations: bool,
}

/// A point of a map, in the map's own numbers.
pub(super) struct Row<'a> {
    /// Coordinates in units.
    pub units: [u8; 2],
    /// RSSI values in half decibels below 0 dBm; 0: not received.
    pub rssis: &'a [u8],
    /// The half bytes of the deviations; empty without deviations.
    pub deviations: &'a [u8],
}

impl<'a> Map<'a> {
    /// Reads a map from the beginning of `bytes`. Returns the map and the bytes after it.
    ///
    /// # Errors
    /// The bytes are not a map, or the map is not valid.
    pub fn decode(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), MapError> {
        let Some((&[m0, m1, version, flags, p0, p1, beacons, reserved, x0, x1, x2, x3, y0, y1, y2, y3, u0, u1], body)) =
            bytes.split_first_chunk::<HEADER>()
        else {
            return Err(if bytes.starts_with(&MAGIC) { MapError::Corrupt } else { MapError::Missing });
        };
        if [m0, m1] != MAGIC {
            return Err(MapError::Missing);
        }
        if version != VERSION {
            return Err(MapError::Version(version));
        }
        let (deviations, beacons) = (flags & WITH_DEVIATIONS != 0, usize::from(beacons));
        let length = usize::from(u16::from_le_bytes([p0, p1])) * stride(beacons, deviations);
        let (identities, body) = body.split_at_checked(2 * beacons).ok_or(MapError::Corrupt)?;
        let (fallbacks, body) = body.split_at_checked(beacons).ok_or(MapError::Corrupt)?;
        let (points, body) = body.split_at_checked(length).ok_or(MapError::Corrupt)?;
        let (checksum, rest) = body.split_first_chunk::<2>().ok_or(MapError::Corrupt)?;
        let covered = bytes.get(..bytes.len() - body.len()).ok_or(MapError::Corrupt)?;
        if CHECKSUM.checksum(covered) != u16::from_le_bytes(*checksum) {
            return Err(MapError::Corrupt);
        }
        let (unit_mm, unknown) = (u16::from_le_bytes([u0, u1]), flags & !WITH_DEVIATIONS | reserved);
        let silent = fallbacks.contains(&0);
        if points.is_empty() || !(1..=MAX_BEACONS).contains(&beacons) || unit_mm == 0 || unknown != 0 || silent {
            return Err(MapError::Invalid);
        }
        let origin_cm = [i32::from_le_bytes([x0, x1, x2, x3]), i32::from_le_bytes([y0, y1, y2, y3])];
        let bytes = bytes.get(..bytes.len() - rest.len()).ok_or(MapError::Corrupt)?;
        Ok((Self { bytes, identities, fallbacks, points, origin_cm, unit_mm, deviations }, rest))
    }

    /// The map's bytes.
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The origin of the map's coordinates, metres, and the map relative to that origin. An origin far from a site's
    /// grid then costs no digits of an `f32`.
    pub fn about_its_origin(self) -> ([f64; 2], Self) {
        (self.origin_cm.map(|cm| f64::from(cm) / 100.0), Self { origin_cm: [0; 2], ..self })
    }

    /// The number of points; at least one.
    pub fn points(&self) -> usize {
        self.points.len() / self.stride()
    }

    /// The number of beacons; at least one, at most [`MAX_BEACONS`].
    pub fn beacons(&self) -> usize {
        self.fallbacks.len()
    }

    /// Whether the map's RSSI values have deviations: [`locate`](super::locate) needs them.
    pub fn has_deviations(&self) -> bool {
        self.deviations
    }

    /// The identities of the beacons, in their order, as the map's maker numbers them. On a tag the identity is the
    /// beacon's minor.
    pub fn identities(&self) -> impl Iterator<Item = u16> + 'a {
        self.identities.as_chunks::<2>().0.iter().map(|&bytes| u16::from_le_bytes(bytes))
    }

    /// The positions of the points, metres, in their order.
    pub fn positions<T: Real>(&self) -> impl Iterator<Item = [T; 2]> + '_ {
        self.rows().map(|row| self.place(row.units.map(|units| T::count(units.into()))))
    }

    /// The RSSI values of a point, dBm, in the order of beacons; `None`: not received there. Empty where there is no
    /// such point.
    pub fn rssis<T: Real>(&self, point: usize) -> impl Iterator<Item = Option<T>> + '_ {
        let rssis = self.rows().nth(point).map_or(&[][..], |row| row.rssis);
        rssis.iter().map(|&code| (code != 0).then(|| T::of(-0.5) * T::count(code.into())))
    }

    /// The step between the lattice's points, or the step to which surveyed points are rounded, metres.
    pub fn unit<T: Real>(&self) -> T {
        T::of(0.001) * T::count(self.unit_mm.into())
    }

    /// The RSSI values that count for beacons that are not received, in the map's own numbers.
    pub(super) fn fallbacks(&self) -> &'a [u8] {
        self.fallbacks
    }

    /// The points, in the map's own numbers.
    pub(super) fn rows(&self) -> impl Iterator<Item = Row<'a>> + use<'a> {
        let beacons = self.beacons();
        self.points.chunks_exact(self.stride()).filter_map(move |row| {
            let (&units, row) = row.split_first_chunk::<2>()?;
            let (rssis, deviations) = row.split_at_checked(beacons)?;
            Some(Row { units, rssis, deviations })
        })
    }

    /// Coordinates in units, as metres.
    pub(super) fn place<T: Real>(&self, units: [T; 2]) -> [T; 2] {
        let [x, y] = units.map(|units| units * self.unit());
        let [x0, y0] = self.origin_cm.map(|cm| T::of(0.01) * T::of(f64::from(cm)));
        [x0 + x, y0 + y]
    }

    fn stride(&self) -> usize {
        stride(self.beacons(), self.deviations)
    }
}

/// The number of bytes of a point.
pub(super) fn stride(beacons: usize, deviations: bool) -> usize {
    2 + beacons + if deviations { beacons.div_ceil(2) } else { 0 }
}

#[cfg(test)]
pub(super) mod tests {
    use std::vec::Vec;

    use super::super::{Point, encode};
    use super::*;

    /// A map of these points, without deviations.
    pub fn surveyed(points: &[([f64; 2], &[Option<f64>])]) -> Vec<u8> {
        let points: Vec<_> =
            points.iter().map(|&(position_m, rssis)| Point { position_m, rssis, deviations: &[] }).collect();
        let beacons = points[0].rssis.len();
        let mut buffer = [0; 8192];
        let fallbacks = std::vec![-95.0; beacons];
        let identities: Vec<u16> = (1..).take(beacons).collect();
        encode(&points, &identities, &fallbacks, None, &mut buffer).expect("encoded").to_vec()
    }

    #[test]
    fn bytes_are_as_documented() {
        // Two beacons, two points. The points are 1.00 m and 3.55 m in x, in 255 units of 10 mm. −60 dBm is 120 half
        // decibels, −70.5 dBm 141.
        let bytes = surveyed(&[([1.0, 2.0], &[Some(-60.0), None]), ([3.55, 2.0], &[Some(-70.5), Some(-95.0)])]);
        let expected = [
            b'F', b'M', 1, 0, 2, 0, 2, 0, 100, 0, 0, 0, 200, 0, 0, 0, 10, 0, // header
            1, 0, 2, 0, 190, 190, // identities, fall-backs
            0, 0, 120, 0, 255, 0, 141, 190, // points
        ];
        assert_eq!(bytes[..bytes.len() - 2], expected);
        let (map, rest) = Map::decode(&bytes).expect("decoded");
        assert_eq!((map.points(), map.beacons(), map.has_deviations(), rest), (2, 2, false, &[][..]));
        assert_eq!(map.bytes(), bytes);
        assert_eq!(map.identities().collect::<Vec<_>>(), [1, 2]);
        assert_eq!(map.rssis::<f32>(0).collect::<Vec<_>>(), [Some(-60.0), None]);
        assert_eq!(map.rssis::<f32>(2).count(), 0);
        let positions: Vec<[f64; 2]> = map.positions().collect();
        assert!((positions[1][0] - 3.55).abs() < 1e-9 && (positions[1][1] - 2.0).abs() < 1e-9, "{positions:?}");
    }

    #[test]
    fn every_flipped_bit_and_every_cut_is_noticed() {
        let bytes = surveyed(&[([0.0, 0.0], &[Some(-60.0), Some(-70.0)]), ([5.0, 4.0], &[Some(-80.0), None])]);
        for bit in 0..8 * bytes.len() {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(Map::decode(&flipped).is_err(), "bit {bit}");
        }
        for length in 0..bytes.len() {
            assert!(Map::decode(&bytes[..length]).is_err(), "{length} bytes");
        }
        assert_eq!(Map::decode(&[]), Err(MapError::Missing));
        assert_eq!(Map::decode(&bytes[..10]), Err(MapError::Corrupt));
    }

    #[test]
    fn what_is_well_formed_but_no_map_is_refused() {
        let bytes = surveyed(&[([0.0, 0.0], &[Some(-60.0)])]);
        let resealed = |at: usize, value: u8| {
            let mut bytes = bytes.clone();
            bytes[at] = value;
            let end = bytes.len() - 2;
            let checksum = CHECKSUM.checksum(&bytes[..end]).to_le_bytes();
            bytes[end..].copy_from_slice(&checksum);
            Map::decode(&bytes).map(drop)
        };
        assert_eq!(resealed(2, 7), Err(MapError::Version(7)));
        assert_eq!(resealed(3, 2), Err(MapError::Invalid), "an unknown flag");
        assert_eq!(resealed(4, 200), Err(MapError::Corrupt), "more points than bytes");
        assert_eq!(resealed(7, 1), Err(MapError::Invalid), "what is reserved");
        assert_eq!(resealed(16, 0), Err(MapError::Invalid), "no unit");
        assert_eq!(resealed(20, 0), Err(MapError::Invalid), "a fall-back that is not heard");
        // A header alone: no points, no beacons.
        let mut empty = [0; HEADER + 2];
        empty[..3].copy_from_slice(b"FM\x01");
        empty[16] = 1;
        let checksum = CHECKSUM.checksum(&empty[..HEADER]).to_le_bytes();
        empty[HEADER..].copy_from_slice(&checksum);
        assert_eq!(Map::decode(&empty), Err(MapError::Invalid));
    }

    #[test]
    fn what_follows_a_map_is_given_back() {
        let mut bytes = surveyed(&[([0.0, 0.0], &[Some(-60.0)])]);
        bytes.extend([1, 2, 3]);
        assert_eq!(Map::decode(&bytes).expect("decoded").1, [1, 2, 3]);
    }
}
