//! Beacons from a separate file, `beacons_csv`, with the results of `baliza calibrate path-loss`, for the tags.

use std::path::Path;

use site::Calibrated;
use wire::config::Beacon;

use recording::UserError;
use recording::beacons::read_beacons;

/// Reads the file.
///
/// # Errors
/// The file is wrong, or a name does not end in the major and the minor number.
pub(super) fn read(file: &Path) -> Result<Vec<Calibrated>, UserError> {
    let beacon = |beacon: recording::beacons::Beacon| {
        let Some((major, minor)) = numbers(&beacon.name) else {
            let what = "is not named by its numbers: major-minor, or network-major-minor as decode has it";
            return Err(UserError::file(file, format!("beacon {:?} {what}", beacon.name)));
        };
        let [x, y] = beacon.position_m;
        let position_m = [x, y, beacon.height_m.unwrap_or(0.0)].map(|metres| metres as f32);
        let [rssi_1m_dbm, path_loss_exponent] =
            [beacon.rssi_1m_dbm, beacon.path_loss_exponent].map(|known| known.map(|known| known as f32));
        Ok(Calibrated {
            beacon: Beacon { major, minor, position_m, rssi_1m_dbm, path_loss_exponent },
            height_is_known: beacon.height_m.is_some(),
        })
    };
    read_beacons(file)?.into_iter().map(beacon).collect()
}

/// The major and the minor number at the end of a name.
pub(super) fn numbers(name: &str) -> Option<(u16, u16)> {
    let (rest, minor) = name.rsplit_once('-')?;
    let major = rest.rsplit_once('-').map_or(rest, |(_, major)| major);
    Some((major.parse().ok()?, minor.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::numbers;

    #[test]
    fn a_beacons_numbers_stand_at_the_end_of_its_name() {
        assert_eq!(numbers("7-12"), Some((7, 12)));
        assert_eq!(numbers("fda50693-7-12"), Some((7, 12)));
        assert_eq!((numbers("12"), numbers("a-b"), numbers("7-70000")), (None, None, None));
    }
}
