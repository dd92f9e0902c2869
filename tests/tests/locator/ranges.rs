//! Ranges: `baliza track` and the tag's task.

use std::path::Path;

use analysis::Setup;
use analysis::locate::track::{Tracker, Weighting, settings};
use firmware_tag::{AnchorPosition, LocatorConfig};
use positioning_core::nlos::{Feature, Features};
use ranging::exchange::{Range, Round};
use ranging::{Diagnostics, RadioInstant};
use recording::Diagnostics as RowDiagnostics;
use recording::{Anchor, Coordinates, Epochs, Files, Height, Measured, MeasurementMode, Recording, Space, by_time};

use super::tag;

/// The tag's height, metres.
const HEIGHT_M: f64 = 1.0;

/// A walk under four anchors, 20 rounds per second. One link becomes half a metre too long, which its powers show, and
/// ranges are lost.
fn drawn() -> Recording {
    let corners = [[-5.0, -4.0, 2.5], [5.0, -4.0, 2.75], [5.0, 4.0, 0.5], [-5.0, 4.0, 2.25]];
    let anchor = |(i, [x_m, y_m, z_m]): (usize, [f64; 3])| Anchor {
        name: i.to_string(),
        place: Coordinates { x_m, y_m, z_m: Some(z_m) },
    };
    let mut state = 1_u32;
    let mut noise = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24) - 0.5
    };
    let mut epochs = Epochs::default();
    for k in 0..200 {
        let t_s = 0.05 * f64::from(k);
        let at = [-3.0 + 0.7 * t_s, 0.2 * t_s, HEIGHT_M];
        let ranges = corners.iter().enumerate().filter_map(|(anchor, corner)| {
            let blocked = anchor == 2 && k > 80;
            let distance: f64 = at.iter().zip(corner).map(|(a, c)| (a - c) * (a - c)).sum::<f64>().sqrt();
            let range_m = distance + 0.1 * noise() + if blocked { 0.5 } else { 0.0 };
            let diagnostics = row(-80.0, if blocked { -96.0 } else { -81.5 });
            (noise() < 0.4).then_some(Measured { anchor, range_m, t_s: None, line_of_sight: None, diagnostics })
        });
        epochs.push(&k.to_string(), Some(t_s), None);
        ranges.for_each(|range| epochs.push_range(&range));
    }
    let anchors = corners.into_iter().enumerate().map(anchor).collect();
    Recording { tag: None, anchors, epochs }
}

fn row(power_dbm: f32, first_path_dbm: f32) -> RowDiagnostics {
    let mut features = Features::default();
    features.set(Feature::PowerDifference, power_dbm - first_path_dbm);
    RowDiagnostics { features, power_dbm, ..RowDiagnostics::default() }
}

/// A recording that is not part of the project. If it is missing, this is printed.
fn recorded(name: &str) -> Option<Recording> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("BALIZA_DATA").map_or(beside, Into::into).join(name);
    if !folder.is_dir() {
        eprintln!("{name} is not in {}: not replayed", folder.display());
        return None;
    }
    let (anchors, ranges) = (folder.join("anchors.csv"), folder.join("ranges.csv"));
    let files = Files {
        anchors: &anchors,
        measured: &ranges,
        mode: MeasurementMode::Ranges,
        truth: None,
        anchor_heights: true,
        truth_heights: false,
    };
    let mut recording = Recording::read(&files).expect("a recording").remove(0);
    // The diagnostics as the tag has them: the two powers alone.
    let mut epochs = Epochs::default();
    for epoch in recording.epochs.iter() {
        epochs.push(epoch.name, epoch.t_s, epoch.truth);
        for range in epoch.ranges.iter() {
            let diagnostics = row(range.diagnostics.power_dbm, first_path_dbm(&range.diagnostics));
            epochs.push_range(&Measured { diagnostics, ..range });
        }
    }
    recording.epochs = epochs;
    Some(recording)
}

fn first_path_dbm(row: &RowDiagnostics) -> f32 {
    row.power_dbm - row.features.get(Feature::PowerDifference).unwrap_or(f32::NAN)
}

fn has_the_same_bits(recording: &Recording) {
    // All coordinates are within 128 m: the host keeps the site's origin.
    let anchors: Vec<AnchorPosition> = (0..)
        .zip(&recording.anchors)
        .map(|(address, Anchor { place, .. })| {
            let z_m = place.z_m.expect("a height");
            AnchorPosition { address, position_m: [place.x_m, place.y_m, z_m].map(|c| c as f32) }
        })
        .collect();
    let order = by_time(recording.epochs.times_s());
    let first_s = recording.epochs.times_s().nth(order[0]).flatten().expect("a time");
    let config = LocatorConfig::new(Some(HEIGHT_M as f32), &anchors);
    let of_tag = tag(config, |node, channels, work| {
        for (number, &at) in (0_u16..).zip(&order) {
            let epoch = recording.epochs.get(at).expect("an epoch");
            let ranges: Vec<Range> = epoch
                .ranges
                .iter()
                .map(|range| Range {
                    peer: range.anchor as u16,
                    distance_m: range.range_m as f32,
                    deviation_m: 0.03,
                    position_m: None,
                    diagnostics: Diagnostics {
                        rx_power_dbm: range.diagnostics.power_dbm,
                        first_path_power_dbm: first_path_dbm(&range.diagnostics),
                        ..Diagnostics::default()
                    },
                })
                .collect();
            // The host's first epoch is one hour after zero.
            let now_us = ((epoch.t_s.expect("a time") - first_s + 3600.0) * 1.0e6).round() as u64;
            let round = Round { number, poll: RadioInstant::default(), asked: ranges.len() as u8, ranges: &ranges };
            assert_eq!(channels.put_ranges(&round, now_us, None), 0);
            node.now_us.set(now_us);
            work();
        }
    });
    let setup = Setup::of(Space::Plane(Height::Fixed(HEIGHT_M)));
    let mut host = Tracker::new(&recording.anchors, setup, settings(&setup, Weighting::Weigh), None);
    assert_eq!(of_tag.len(), order.len());
    let mut found = 0;
    for (&at, (_, outcome)) in order.iter().zip(of_tag) {
        let epoch = recording.epochs.get(at).expect("an epoch");
        let of_host = host.follow(&epoch).outcome;
        // If no range of a round was used, the host reports the predicted position of the track, and the tag reports
        // nothing.
        let Ok(position) = outcome else {
            assert!(
                of_host.is_err() || of_host.is_ok_and(|position| position.used == 0),
                "{}: {of_host:?}",
                epoch.name
            );
            continue;
        };
        let of_host = of_host.expect("a position of the host, as of the tag");
        let [x_m, y_m, _] = [0, 1, 2].map(|axis| f64::from(position.position_m[axis]));
        assert_eq!([of_host.place.x_m, of_host.place.y_m], [x_m, y_m], "{}", epoch.name);
        assert_eq!(of_host.covariance_xy, f64::from(position.covariance_m2[0][1]), "{}", epoch.name);
        let [sigma_x, sigma_y, _] = position.deviation_m().map(f64::from);
        assert_eq!([of_host.sigma.x_m, of_host.sigma.y_m], [sigma_x, sigma_y], "{}", epoch.name);
        assert_eq!(of_host.used, position.used.count_ones() as usize, "{}", epoch.name);
        found += 1;
    }
    assert!(found * 10 > order.len() * 9, "{found} of {}", order.len());
}

#[test]
fn a_drawn_walk_has_the_same_bits_on_tag_and_host() {
    has_the_same_bits(&drawn());
}

#[test]
fn recorded_ranges_have_the_same_bits_on_tag_and_host() {
    for name in ["leiria_128_nlos_pos1", "leiria_128_move_slow", "cuhk_dynamic_mid"] {
        if let Some(recording) = recorded(name) {
            has_the_same_bits(&recording);
        }
    }
}
