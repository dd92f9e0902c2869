//! A terminal's RSSI values to its position: phones and ESP32s that cannot solve themselves.
//!
//! The input is the samples of one request, the output is that of [`crate::rssi`]. Each request stands for itself: a
//! terminal asks when it likes, from seconds to hours apart, and its clock is its own.

use std::collections::BTreeMap;

use positioning_core::ble::signal::rssi;

use crate::model::SurveySample;
use crate::rssi::{KnownNode, RssiPosition, solve};

/// Samples older than this, before the latest one, are of another place, seconds.
const WINDOW_S: f64 = 10.0;

/// The position of a terminal from the samples of one request. Samples of unknown beacons, of values that no receiver
/// can have measured, and of more than ten seconds before the latest one do not count.
///
/// # Errors
/// Why there is none: `too-few-beacons` where no sample counts, else the reason of a solver.
pub fn locate(beacons: &BTreeMap<String, KnownNode>, samples: &[SurveySample]) -> Result<RssiPosition, &'static str> {
    let counts = samples.iter().filter(|sample| {
        sample.t_s.is_finite() && rssi(sample.rssi_dbm).is_ok() && beacons.contains_key(&sample.beacon)
    });
    let latest_s = counts.clone().map(|sample| sample.t_s).fold(f64::NEG_INFINITY, f64::max);
    let mut sums: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    for sample in counts.filter(|sample| latest_s - sample.t_s <= WINDOW_S) {
        let (sum_dbm, count) = sums.entry(&sample.beacon).or_default();
        *sum_dbm += sample.rssi_dbm;
        *count += 1.0;
    }
    solve(beacons, sums.into_iter().map(|(name, (sum_dbm, count))| (name, sum_dbm / count)), None)
}

#[cfg(test)]
mod tests {
    use positioning_core::MAX_ANCHORS;

    use super::*;

    fn known(places: &[[f64; 2]]) -> BTreeMap<String, KnownNode> {
        let beacon = |(k, [x, y]): (usize, &[f64; 2])| {
            let beacon =
                KnownNode { position_m: [*x, *y, 2.0], rssi_1m_dbm: Some(-60.0), path_loss_exponent: Some(2.0) };
            (format!("1-{k}"), beacon)
        };
        places.iter().enumerate().map(beacon).collect()
    }

    fn corners([x, y]: [f64; 2]) -> BTreeMap<String, KnownNode> {
        known(&[[x, y], [x + 8.0, y], [x, y + 8.0], [x + 8.0, y + 8.0]])
    }

    fn sample(k: usize, rssi_dbm: f64, t_s: f64) -> SurveySample {
        SurveySample { beacon: format!("1-{k}"), rssi_dbm, t_s }
    }

    /// Equal RSSI values.
    fn equal() -> Vec<SurveySample> {
        (0..4).map(|k| sample(k, -75.0, 0.1 * k as f64)).collect()
    }

    #[test]
    fn equal_values_at_the_corners_of_a_square_are_its_middle_wherever_it_is() {
        for at in [[0.0, 0.0], [50_000.0, -70_000.0]] {
            let found = locate(&corners(at), &equal()).expect("four beacons");
            assert!((found.position_m[0] - at[0] - 4.0).abs() < 0.02, "{found:?}");
            assert!((found.position_m[1] - at[1] - 4.0).abs() < 0.02, "{found:?}");
            // The square looks the same from both axes.
            assert!((found.sigma_m[0] - found.sigma_m[1]).abs() < 0.02 && found.cov_xy_m2.abs() < 0.02, "{found:?}");
            assert_eq!(found.used, 4);
        }
    }

    #[test]
    fn one_beacon_gives_a_position_about_itself_with_a_great_deviation() {
        // -80 dBm is 10^(20/20) = 10 m: on a circle of 10 m about it each axis alone deviates by 10/√2 = 7.1 m. The
        // terminal's place is limited by the beacons that are not received, here by a box of 46 m.
        let beacons = known(&[[0.0, 0.0], [20.0, 20.0], [-20.0, -20.0]]);
        let found = locate(&beacons, &[sample(0, -80.0, 0.0)]).expect("one beacon");
        assert!(found.position_m.iter().all(|at| at.abs() < 1.0), "{found:?}");
        assert!(found.sigma_m.iter().all(|sigma| (5.0..15.0).contains(sigma)), "{found:?}");
    }

    #[test]
    fn wrong_samples_do_not_count() {
        let beacons = corners([0.0, 0.0]);
        let expected = locate(&beacons, &equal()).expect("four beacons");
        let mut samples = equal();
        for wrong in [f64::NAN, f64::INFINITY, 60.0, 0.0, 127.0, -500.0] {
            samples.insert(0, sample(0, wrong, 0.0));
            samples.push(sample(3, -50.0, if wrong.is_finite() { f64::NAN } else { wrong }));
        }
        samples.push(SurveySample { beacon: "9-9".to_owned(), rssi_dbm: -40.0, t_s: 1e12 });
        samples.push(sample(0, -40.0, -11.0));
        samples.reverse();
        assert_eq!(locate(&beacons, &samples), Ok(expected));
    }

    #[test]
    fn thousands_of_samples_count_by_their_mean() {
        // -70 and -80 in turn: -75.
        let samples: Vec<SurveySample> =
            (0..40_000).map(|k| sample(k % 4, if k / 4 % 2 == 0 { -70.0 } else { -80.0 }, 1e-4 * k as f64)).collect();
        let expected = locate(&corners([0.0, 0.0]), &equal());
        assert_eq!(locate(&corners([0.0, 0.0]), &samples), expected);
        // More beacons than a solver takes: those that are received best count.
        let beacons = known(&(0..500).map(|k| [f64::from(k % 25), f64::from(k / 25)]).collect::<Vec<_>>());
        let samples: Vec<SurveySample> = (0..500).map(|k| sample(k, -60.0 - 0.1 * k as f64, 0.0)).collect();
        assert_eq!(locate(&beacons, &samples).map(|found| usize::from(found.used)), Ok(MAX_ANCHORS));
    }

    #[test]
    fn without_a_known_beacon_there_are_too_few() {
        assert_eq!(locate(&corners([0.0, 0.0]), &[]), Err("too-few-beacons"));
        assert_eq!(locate(&corners([0.0, 0.0]), &[sample(7, -60.0, 0.0)]), Err("too-few-beacons"));
        assert_eq!(locate(&BTreeMap::new(), &equal()), Err("too-few-beacons"));
        let mut wrong = corners([0.0, 0.0]);
        for (k, beacon) in wrong.values_mut().enumerate() {
            match k {
                0 => beacon.position_m[0] = f64::NAN,
                1 => beacon.path_loss_exponent = Some(-2.0),
                2 => beacon.rssi_1m_dbm = Some(f64::INFINITY),
                _ => beacon.position_m[1] = 1e300,
            }
        }
        assert_eq!(locate(&wrong, &equal()), Err("too-few-beacons"));
    }

    /// Terminals at random places, whose RSSI values deviate by 6 dB for shadows and whose receivers deviate by 5 dB:
    /// what the solver assumes.
    #[test]
    fn nineteen_of_twenty_positions_are_within_their_ellipse_of_95_percent() {
        let beacons = corners([0.0, 0.0]);
        let mut state = 1_u64;
        let mut uniform = || {
            // Knuth's MMIX generator, the upper bits.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let (mut within, trials) = (0, 500);
        for _ in 0..trials {
            let [x, y] = [8.0 * uniform(), 8.0 * uniform()];
            // Twelve uniform numbers minus six: mean 0, deviation 1.
            let mut gaussian = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            let offset_db = 5.0 * gaussian();
            let samples: Vec<SurveySample> = [[0.0, 0.0], [8.0, 0.0], [0.0, 8.0], [8.0, 8.0]]
                .iter()
                .enumerate()
                .map(|(k, [bx, by])| {
                    let distance_m = (x - bx).hypot(y - by).max(0.1);
                    sample(k, -60.0 - 20.0 * distance_m.log10() + offset_db + 6.0 * gaussian(), 0.0)
                })
                .collect();
            let found = locate(&beacons, &samples).expect("four beacons");
            let [dx, dy] = [x - found.position_m[0], y - found.position_m[1]];
            let ([sx, sy], xy) = (found.sigma_m, found.cov_xy_m2);
            let squared = (sy * sy * dx * dx - 2.0 * xy * dx * dy + sx * sx * dy * dy) / (sx * sx * sy * sy - xy * xy);
            // The 95th percentile of χ² with two degrees of freedom.
            within += u32::from(squared <= 5.991);
        }
        let share = f64::from(within) / f64::from(trials);
        assert!(share >= 0.95, "{share}");
    }
}
