//! Encodes points and RSSI values as the bytes of a map.

use super::map::{CHECKSUM, DEVIATIONS_DB, HEADER, MAGIC, MAX_BEACONS, MapError, VERSION, WITH_DEVIATIONS, stride};

/// A point of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point<'a> {
    /// The position, metres.
    pub position_m: [f64; 2],
    /// One RSSI per beacon, dBm; `None`: not received there.
    pub rssis: &'a [Option<f64>],
    /// The standard deviation of each beacon's RSSI at a visit, dB; empty for a map of surveyed points.
    pub deviations: &'a [f64],
}

/// Writes a map to the beginning of `buffer` and returns its bytes.
///
/// `identities` name the beacons. `fallbacks` are the RSSI values that count for beacons that are not received, dBm
/// (table 5.3). The points of a lattice are multiples of `unit_m` apart, at most 255 in each direction. Without
/// `unit_m`, the unit is as small as the extent of the points allows.
///
/// # Errors
/// Points or beacons are missing or too many, lists differ in length, numbers are not finite or out of range, or the
/// buffer is too small.
pub fn encode<'b>(
    points: &[Point<'_>],
    identities: &[u16],
    fallbacks: &[f64],
    unit_m: Option<f64>,
    buffer: &'b mut [u8],
) -> Result<&'b [u8], MapError> {
    let beacons = fallbacks.len();
    let deviations = points.first().is_some_and(|point| !point.deviations.is_empty());
    let count = u16::try_from(points.len()).map_err(|_| MapError::Invalid)?;
    if count == 0 || !(1..=MAX_BEACONS).contains(&beacons) || identities.len() != beacons {
        return Err(MapError::Invalid);
    }
    let axis = |axis: usize| points.iter().filter_map(move |point| point.position_m.get(axis).copied());
    // Centimetres are finer than the accuracy of a map.
    let down = |low: f64| rounded(libm::floor(low * 100.0 + 1.0e-6), i32::MIN, i32::MAX);
    let [x0, y0] = [0, 1].map(|a| down(axis(a).fold(f64::INFINITY, f64::min)));
    let origin_cm = [x0?, y0?];
    let extents =
        origin_cm.iter().enumerate().map(|(a, cm)| axis(a).fold(f64::NEG_INFINITY, f64::max) - f64::from(*cm) / 100.0);
    let unit_mm = unit_m.map_or_else(|| up(extents.fold(0.0, f64::max) / 255.0 * 1000.0), |unit| unit * 1000.0);
    let unit_mm = rounded(unit_mm, 1, 65535)?;
    let unit_m = f64::from(unit_mm) / 1000.0;

    let mut out = Writer { buffer, at: 0 };
    let [m0, m1] = MAGIC;
    let unit = u16::try_from(unit_mm).map_err(|_| MapError::Invalid)?.to_le_bytes();
    let flags = if deviations { WITH_DEVIATIONS } else { 0 };
    out.write(&[m0, m1, VERSION, flags])?;
    out.write(&count.to_le_bytes())?;
    out.write(&[u8::try_from(beacons).map_err(|_| MapError::Invalid)?, 0])?;
    for cm in origin_cm {
        out.write(&cm.to_le_bytes())?;
    }
    out.write(&unit)?;
    for identity in identities {
        out.write(&identity.to_le_bytes())?;
    }
    for fallback in fallbacks {
        out.write(&[code(*fallback)?])?;
    }
    for point in points {
        let wanted = if deviations { beacons } else { 0 };
        if point.rssis.len() != beacons || point.deviations.len() != wanted {
            return Err(MapError::Invalid);
        }
        for (coordinate, cm) in point.position_m.iter().zip(origin_cm) {
            let units = rounded((coordinate - f64::from(cm) / 100.0) / unit_m, 0, 255)?;
            out.write(&[u8::try_from(units).map_err(|_| MapError::Invalid)?])?;
        }
        for rssi in point.rssis {
            out.write(&[rssi.map_or(Ok(0), code)?])?;
        }
        for pair in point.deviations.chunks(2) {
            let half = |at: usize| pair.get(at).map_or(Ok(0), |deviation| half(*deviation));
            out.write(&[half(0)? | half(1)? << 4])?;
        }
    }
    debug_assert_eq!(out.at, HEADER + 3 * beacons + points.len() * stride(beacons, deviations));
    let checksum = CHECKSUM.checksum(out.buffer.get(..out.at).ok_or(MapError::TooLong)?);
    out.write(&checksum.to_le_bytes())?;
    let end = out.at;
    buffer.get(..end).ok_or(MapError::TooLong)
}

/// Half decibels below 0 dBm.
fn code(rssi_dbm: f64) -> Result<u8, MapError> {
    u8::try_from(rounded(-2.0 * rssi_dbm, 1, 255)?).map_err(|_| MapError::Invalid)
}

/// A deviation's half byte; a deviation outside its range becomes the least or the greatest.
fn half(deviation_db: f64) -> Result<u8, MapError> {
    let steps = deviation_db / DEVIATIONS_DB - 1.0;
    if !steps.is_finite() {
        return Err(MapError::Invalid);
    }
    u8::try_from(rounded(steps.clamp(0.0, 15.0), 0, 15)?).map_err(|_| MapError::Invalid)
}

/// The nearest whole number, if it is in the range.
fn rounded(value: f64, least: i32, most: i32) -> Result<i32, MapError> {
    let nearest = libm::round(value);
    if nearest >= f64::from(least) && nearest <= f64::from(most) { Ok(nearest as i32) } else { Err(MapError::Invalid) }
}

/// The next whole number upwards, at least 1.
fn up(value: f64) -> f64 {
    libm::ceil(value - 1.0e-6).max(1.0)
}

struct Writer<'b> {
    buffer: &'b mut [u8],
    at: usize,
}

impl Writer<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<(), MapError> {
        let end = self.at + bytes.len();
        self.buffer.get_mut(self.at..end).ok_or(MapError::TooLong)?.copy_from_slice(bytes);
        self.at = end;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Map, Point};
    use super::*;

    fn tried(rssis: &[Option<f64>], deviations: &[f64], position_m: [f64; 2]) -> Result<usize, MapError> {
        encode(&[Point { position_m, rssis, deviations }], &[1], &[-90.0], None, &mut [0; 64]).map(<[u8]>::len)
    }

    #[test]
    fn numbers_that_are_none_or_out_of_range_are_refused() {
        assert_eq!(tried(&[Some(-60.0)], &[], [0.0, 0.0]), Ok(18 + 3 + 3 + 2));
        assert_eq!(tried(&[Some(f64::NAN)], &[], [0.0, 0.0]), Err(MapError::Invalid));
        assert_eq!(tried(&[Some(0.0)], &[], [0.0, 0.0]), Err(MapError::Invalid));
        assert_eq!(tried(&[Some(-128.0)], &[], [0.0, 0.0]), Err(MapError::Invalid));
        assert_eq!(tried(&[Some(-60.0)], &[f64::NAN], [0.0, 0.0]), Err(MapError::Invalid));
        assert_eq!(tried(&[Some(-60.0)], &[], [f64::NAN, 0.0]), Err(MapError::Invalid));
        assert_eq!(tried(&[Some(-60.0)], &[], [3.0e7, 0.0]), Err(MapError::Invalid), "beyond the world");
        assert_eq!(tried(&[], &[], [0.0, 0.0]), Err(MapError::Invalid), "a level is missing");
        assert_eq!(tried(&[Some(-60.0)], &[1.0, 1.0], [0.0, 0.0]), Err(MapError::Invalid), "a deviation too many");
    }

    #[test]
    fn empty_maps_and_small_buffers_are_refused() {
        let point = Point { position_m: [0.0, 0.0], rssis: &[Some(-60.0)], deviations: &[] };
        assert_eq!(encode(&[], &[1], &[-90.0], None, &mut [0; 64]), Err(MapError::Invalid));
        assert_eq!(encode(&[point], &[], &[], None, &mut [0; 64]), Err(MapError::Invalid));
        assert_eq!(encode(&[point], &[1, 2], &[-90.0], None, &mut [0; 64]), Err(MapError::Invalid));
        assert_eq!(encode(&[point], &[1; 25], &[-90.0; 25], None, &mut [0; 64]), Err(MapError::Invalid));
        assert_eq!(encode(&[point], &[1], &[-90.0], Some(0.0), &mut [0; 64]), Err(MapError::Invalid));
        for room in 0..26 {
            assert_eq!(encode(&[point], &[1], &[-90.0], None, &mut [0; 64][..room]), Err(MapError::TooLong), "{room}");
        }
    }

    #[test]
    fn a_full_map_of_a_node_fits_four_kibibytes() {
        let (rssis, deviations) = ([Some(-60.0); 12], [4.0; 12]);
        let mut points = [Point { position_m: [0.0, 0.0], rssis: &rssis, deviations: &[] }; 200];
        for (index, point) in points.iter_mut().enumerate() {
            point.position_m = [(index / 20) as f64, (index % 20) as f64];
        }
        let mut buffer = [0; 4096];
        assert_eq!(encode(&points, &[0; 12], &[-90.0; 12], None, &mut buffer).expect("fits").len(), 2856);
        points.iter_mut().for_each(|point| point.deviations = &deviations);
        assert_eq!(encode(&points, &[0; 12], &[-90.0; 12], None, &mut buffer).expect("fits").len(), 4056);
    }

    #[test]
    fn a_lattice_far_from_the_origin_keeps_its_places() {
        let points = [[-7000.0, 42.0], [-6999.54, 42.46], [-6998.16, 42.0]];
        let points = points.map(|position_m| Point { position_m, rssis: &[Some(-60.0)], deviations: &[3.0] });
        let mut buffer = [0; 128];
        let bytes = encode(&points, &[9], &[-90.0], Some(0.46), &mut buffer).expect("encoded");
        let (map, _) = Map::decode(bytes).expect("decoded");
        assert!(map.has_deviations() && (map.unit::<f64>() - 0.46).abs() < 1e-12);
        for (position, point) in map.positions::<f64>().zip(points) {
            assert!((position[0] - point.position_m[0]).abs() < 1e-6, "{position:?}");
            assert!((position[1] - point.position_m[1]).abs() < 1e-6, "{position:?}");
        }
    }
}
