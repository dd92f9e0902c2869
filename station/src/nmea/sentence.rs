//! A position as sentences of NMEA 0183: GGA, RMC and GST.
//!
//! The talker is `GN`, a combination of navigation systems: QGIS takes only `GP` and `GN`, and `GP` would say GPS. What
//! a positioning system indoors does not know stays empty: the dilution of precision, and speed and course. The number
//! of satellites is that of the anchors or beacons that were used. GST has the standard deviations.

use std::fmt::Write;

use positioning_core::geodesy::Geographic;

use crate::Utc;
use crate::model::{GeographicOrigin, TagPosition};

/// Parts of a minute of arc: seven decimals, 0.2 mm.
const PARTS: u64 = 10_000_000;

/// A position: GGA with the quality 1 (a fix), RMC that is valid and autonomous, GST.
///
/// The qualities 6 and 8 and the modes `E` and `S` (estimated, simulated) would not be more honest: the standard has
/// them with a status that is not valid, and consumers drop such positions.
pub fn fix(position: &TagPosition, origin: GeographicOrigin) -> String {
    let place = origin.0.geographic(position.x_m, position.y_m, position.z_m);
    let (time, date) = time_and_date(position.t);
    let Geographic { latitude_deg, longitude_deg, height_m } = place;
    let at = format!("{},{}", angle(latitude_deg, 2, ['N', 'S']), angle(longitude_deg, 3, ['E', 'W']));
    let (height, separation) = (metres(height_m, 3), metres(origin.0.geoid_separation_m(), 1));
    let used = position.used.min(99);
    let mut text = sentence(&format!("GGA,{time},{at},1,{used:02},,{height},{separation},,"));
    text += &sentence(&format!("RMC,{time},A,{at},,,{date},,,A"));
    let (variance_x, variance_y) = (position.sigma_x_m.powi(2), position.sigma_y_m.powi(2));
    let [east, north, both] = origin.0.covariance_east_north(variance_x, variance_y, position.cov_xy_m2);
    // The eigenvalues of the covariance, and the azimuth of the greater one's vector.
    let (mean, half) = ((east + north) / 2.0, ((east - north) / 2.0).hypot(both));
    let azimuth_deg = (0.5 * (2.0 * both).atan2(north - east)).to_degrees().rem_euclid(180.0);
    let [major, minor, north, east] = [mean + half, mean - half, north, east].map(|variance| variance.max(0.0).sqrt());
    let up = position.sigma_z_m.map(|sigma_m| format!("{sigma_m:.3}")).unwrap_or_default();
    text += &sentence(&format!("GST,{time},,{major:.3},{minor:.3},{azimuth_deg:.1},{north:.3},{east:.3},{up}"));
    text
}

/// There is no position: GGA with the quality 0 and RMC that is not valid.
pub fn no_fix(t: Utc) -> String {
    let (time, date) = time_and_date(t);
    sentence(&format!("GGA,{time},,,,,0,00,,,,,,,")) + &sentence(&format!("RMC,{time},V,,,,,,,{date},,,N"))
}

/// A sentence with the talker before and the checksum after its fields: the exclusive or of all between `$` and `*`.
fn sentence(fields: &str) -> String {
    let text = format!("GN{fields}");
    let checksum = text.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("${text}*{checksum:02X}\r\n")
}

/// `hhmmss.sss` and `ddmmyy`.
fn time_and_date(t: Utc) -> (String, String) {
    let t = t.civil();
    let time = format!("{:02}{:02}{:02}.{:03}", t.hour(), t.minute(), t.second(), t.millisecond());
    (time, format!("{:02}{:02}{:02}", t.day(), t.month(), t.year().rem_euclid(100)))
}

/// Degrees, minutes and the half of the earth: `dddmm.mmmmmmm,W`.
fn angle(degrees: f64, digits: usize, [positive, negative]: [char; 2]) -> String {
    // At most 180 · 60 · 1e7, which the conversion keeps.
    let parts = (degrees.abs() * 60.0 * PARTS as f64).round() as u64;
    let (minutes, parts) = (parts / PARTS, parts % PARTS);
    let half = if degrees < 0.0 { negative } else { positive };
    format!("{:0digits$}{:02}.{parts:07},{half}", minutes / 60, minutes % 60)
}

/// A length and its unit; both empty where it is unknown.
fn metres(length_m: Option<f64>, decimals: usize) -> String {
    let mut text = String::new();
    if let Some(length_m) = length_m {
        let _ = write!(text, "{length_m:.decimals$}");
    }
    text + if length_m.is_some() { ",M" } else { "," }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(text: &str) -> GeographicOrigin {
        serde_json::from_str(text).unwrap()
    }

    fn position() -> TagPosition {
        TagPosition {
            site: "hall".to_owned(),
            tag: "0x1001".to_owned(),
            t: "2026-11-22T08:01:09.0457Z".parse().unwrap(),
            x_m: 1000.0,
            y_m: 0.0,
            z_m: Some(0.0),
            sigma_x_m: 0.3,
            sigma_y_m: 0.4,
            sigma_z_m: Some(0.25),
            cov_xy_m2: 0.0,
            room: None,
            used: 6,
            doubt: None,
        }
    }

    const NORTH: &str = r#"{"latitude_deg": 40.332, "longitude_deg": -3.766, "y_azimuth_deg": 0, "height_m": 700,
        "geoid_separation_m": 51.04}"#;

    /// The exclusive or as the standard describes it, bit by bit.
    fn has_its_checksum(sentence: &str) -> bool {
        let (text, sum) = sentence.strip_prefix('$').unwrap().split_once('*').unwrap();
        let bit = |bit: u32| text.bytes().filter(|byte| byte >> bit & 1 == 1).count() % 2;
        let expected: usize = (0..8).map(|at| bit(at) << at).sum();
        sum.len() == 2 && usize::from_str_radix(sum, 16) == Ok(expected)
    }

    #[test]
    fn a_position_is_three_sentences_with_their_checksums() {
        // Without the geoid's separation PROJ finds 40.331999401579, -3.754233656681, 700.078274 (tests of `geodesy`).
        // 51.04 m of separation shorten the kilometre by 1000 · 51.04 / 6,386,000 = 8.0 mm, that is 9.4e-8° to the
        // west, and so -3.754233751 (PROJ with h_0 = 751.04: -3.7542337507, 751.118273). Minutes: 0.331999401579 · 60 =
        // 19.9199641; 0.7542337507 · 60 = 45.2540250.
        let text = fix(&position(), origin(NORTH));
        let lines: Vec<_> = text.split_terminator("\r\n").collect();
        let [gga, rmc, gst] = lines.as_slice() else { panic!("{text}") };
        assert!(lines.iter().all(|line| line.len() <= 80 && has_its_checksum(line)), "{text}");
        let fields = |line: &str| line.split(['$', ',', '*']).map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(
            fields(gga)[1..16],
            [
                "GNGGA",
                "080109.045",
                "4019.9199641",
                "N",
                "00345.2540250",
                "W",
                "1",
                "06",
                "",
                "700.078",
                "M",
                "51.0",
                "M",
                "",
                ""
            ]
        );
        assert_eq!(
            fields(rmc)[1..14],
            ["GNRMC", "080109.045", "A", "4019.9199641", "N", "00345.2540250", "W", "", "", "221126", "", "", "A"]
        );
        // y, the greater deviation, points north.
        assert_eq!(fields(gst)[1..10], ["GNGST", "080109.045", "", "0.400", "0.300", "0.0", "0.400", "0.300", "0.250"]);
    }

    #[test]
    fn deviations_are_those_to_the_north_and_to_the_east() {
        // y at 30°: its deviation 0.4 counts for the north with cos² = 3/4, that of x, 0.3, with 1/4:
        // √(0.16 · 0.75 + 0.09 · 0.25) = 0.3775; east √(0.16 · 0.25 + 0.09 · 0.75) = 0.3279.
        let turned = NORTH.replace("\"y_azimuth_deg\": 0", "\"y_azimuth_deg\": 30");
        let gst = fix(&position(), origin(&turned));
        assert!(gst.contains("GST,080109.045,,0.400,0.300,30.0,0.377,0.328,0.250*"), "{gst}");
        // Fully correlated, equal deviations: a line from south-west to north-east, √2 · 0.3 long.
        let line = TagPosition { sigma_y_m: 0.3, cov_xy_m2: 0.09, sigma_z_m: None, ..position() };
        let gst = fix(&line, origin(NORTH));
        assert!(gst.contains("GST,080109.045,,0.424,0.000,45.0,0.300,0.300,*"), "{gst}");
    }

    #[test]
    fn what_is_unknown_is_empty() {
        let flat = TagPosition { z_m: None, sigma_z_m: None, ..position() };
        let text = fix(&flat, origin(r#"{"latitude_deg": -0.5, "longitude_deg": 100.25, "y_azimuth_deg": 0}"#));
        let gga = text.lines().next().unwrap();
        // 1000 m to the east of 100.25°: 15.539 minutes. The height, its unit, the separation and its unit are empty.
        assert!(gga.starts_with("$GNGGA,080109.045,0030.000") || gga.starts_with("$GNGGA,080109.045,0029.9"), "{gga}");
        assert!(gga.contains(",S,10015.5") && gga.contains(",E,1,06,,,,,,,*"), "{gga}");
        assert_eq!(gga.split(',').count(), 15);
    }

    #[test]
    fn without_a_position_both_sentences_say_so() {
        // The exclusive or of "GNGGA,235959.999,,,,,0,00,,,,,,," and of "GNRMC,235959.999,V,,,,,,,311226,,,N" by
        // pynmea2 1.19: 6E and 5E.
        let text = no_fix("2026-12-31T23:59:59.999999Z".parse().unwrap());
        assert_eq!(text, "$GNGGA,235959.999,,,,,0,00,,,,,,,*6E\r\n$GNRMC,235959.999,V,,,,,,,311226,,,N*5E\r\n");
        assert!(text.lines().all(has_its_checksum), "{text}");
    }

    #[test]
    fn minutes_are_carried_to_degrees() {
        assert_eq!(angle(-3.999_999_999_999, 3, ['E', 'W']), "00400.0000000,W");
        assert_eq!(angle(0.0, 2, ['N', 'S']), "0000.0000000,N");
        assert_eq!(angle(180.0, 3, ['E', 'W']), "18000.0000000,E");
    }
}
