//! Advertisements: `baliza ble solve --method engine` and the tag's task.

use analysis::locate::ble::{BeaconSetup, RssiMethod, Solver};
use firmware_tag::{KnownBeacons, LocatorConfig, scan};
use recording::beacons::{Beacon, Capture, Sample};
use wire::ble::IBeacon;

use super::tag;

/// The coordinates are around zero, so that nothing is rounded differently, metres.
const CORNERS: [[f64; 3]; 4] = [[-4.0, -3.0, 2.5], [4.0, -3.0, 2.0], [4.0, 3.0, 2.5], [-4.0, 3.0, 2.25]];
const HEIGHT_M: f64 = 1.0;
/// The host's first advertisement is one hour after zero.
const BEGIN_US: u64 = 3_600_000_000;
/// The interval of a beacon's advertisements, milliseconds. An eighth of a second is exact in the host's seconds.
const INTERVAL_MS: u64 = 125;
const WINDOW_MS: u64 = 500;

/// Time, beacon and RSSI in dBm: twenty seconds of a walk in which the third beacon is silent for a while.
fn received() -> Vec<(u64, usize, i8)> {
    let mut state = 7_u32;
    let mut noise = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24) - 0.5
    };
    (0..4 * 20_000 / INTERVAL_MS)
        .filter_map(|k| {
            let (t_ms, beacon) = (k / 4 * INTERVAL_MS, (k % 4) as usize);
            let at = [-3.0 + 0.3e-3 * t_ms as f64, 0.5, HEIGHT_M];
            let square: f64 = at.iter().zip(CORNERS[beacon]).map(|(a, c)| (a - c) * (a - c)).sum();
            let rssi_dbm = (-59.0 - 11.0 * square.log10() + 8.0 * noise()).round() as i8;
            (beacon != 2 || !(5_000..13_000).contains(&t_ms)).then_some((t_ms, beacon, rssi_dbm))
        })
        .collect()
}

#[test]
fn a_walk_among_beacons_has_the_same_bits_on_tag_and_host() {
    let received = received();
    let listed: Vec<wire::config::Beacon> = (0..)
        .zip(CORNERS)
        .map(|(minor, position)| wire::config::Beacon {
            major: 1,
            minor,
            position_m: position.map(|metres| metres as f32),
            rssi_1m_dbm: (minor != 3).then_some(-59.0),
            path_loss_exponent: Some(2.2),
        })
        .collect();
    let config = LocatorConfig::new(Some(HEIGHT_M as f32), &[]).with_beacons(KnownBeacons::new(&listed, None));
    let of_tag = tag(config, |node, channels, work| {
        let mut advertisements = received.iter().peekable();
        for t_ms in 0..=20_000 {
            node.now_us.set(BEGIN_US + 1000 * t_ms);
            // First the work that is due by now, then what happens now.
            work();
            while let Some((_, beacon, rssi_dbm)) = advertisements.next_if(|(at_ms, ..)| *at_ms == t_ms) {
                let ibeacon = IBeacon { uuid: [1; 16], major: 1, minor: *beacon as u16, measured_power_dbm: -59 };
                scan::receive(channels, &node, &ibeacon.emit(), *rssi_dbm);
                work();
            }
        }
    });

    let beacons: Vec<Beacon> = CORNERS
        .iter()
        .enumerate()
        .map(|(i, [x, y, z])| Beacon {
            name: i.to_string(),
            position_m: [*x, *y],
            height_m: Some(*z),
            rssi_1m_dbm: (i != 3).then_some(-59.0),
            path_loss_exponent: Some(2.2),
            deviation_db: None,
        })
        .collect();
    let setup =
        BeaconSetup { window_s: 0.5, height_m: Some(HEIGHT_M), area_m: None, offset_db: 5.0, wall_db: 0.0, seed: 1 };
    // One capture per window. Its position is that of the window.
    let captures: Vec<Capture> = received
        .chunk_by(|(a, ..), (b, ..)| a / WINDOW_MS == b / WINDOW_MS)
        .map(|chunk| Capture {
            name: String::new(),
            t_s: Some(chunk[0].0 as f64 / 1000.0),
            truth_m: None,
            is_stay: false,
            samples: chunk
                .iter()
                .map(|(t_ms, beacon, rssi_dbm)| Sample {
                    beacon: beacon.to_string(),
                    rssi_dbm: f64::from(*rssi_dbm),
                    t_s: *t_ms as f64 / 1000.0,
                })
                .collect(),
        })
        .collect();
    let (of_host, _) = Solver::new(&beacons, &[], setup).solve(RssiMethod::Engine, &captures);

    assert_eq!((of_tag.len(), of_host.len()), (40, 40));
    for ((t_us, of_tag), of_host) in of_tag.into_iter().zip(of_host) {
        let (of_tag, of_host) = (of_tag.expect("a position"), of_host.outcome.expect("a position"));
        let [x_m, y_m, _] = of_tag.position_m.map(f64::from);
        assert_eq!([of_host.place.x_m, of_host.place.y_m], [x_m, y_m], "{t_us}");
        assert_eq!(of_host.covariance_xy, f64::from(of_tag.covariance_m2[0][1]), "{t_us}");
        assert_eq!(of_host.sigma.x_m, f64::from(of_tag.covariance_m2[0][0]).sqrt(), "{t_us}");
        assert_eq!(of_host.used, of_tag.used.count_ones() as usize, "{t_us}");
    }
}
