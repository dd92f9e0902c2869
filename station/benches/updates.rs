//! The time of an update of the live state: 1,000 tags at 10 Hz, with 12 ranges a position, on a floor of 20 rooms, 5
//! zones and 50 anchors.
//!
//! `cargo bench -p baliza-station`. One element is one position, with its ranges. 10,000 of them a second must take
//! less than a quarter of one core: 25 µs each.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use station_core::model::{NodeRole, RangeMeasurement, Zone, ZoneKind};
use station_core::state::StateLimits;
use station_core::{LiveState, ReportKind, SolvedFrom, SourceReport, Utc};

const TAGS: u32 = 1000;
const ANCHORS: u32 = 50;
const RANGES: u32 = 12;
const SITE: &str = "floor";

/// Rooms of 8 m by 8 m, five in a row, and zones over four of them each.
fn zones() -> Vec<Zone> {
    let square = |name: String, kind, x: f64, y: f64, side: f64| Zone {
        site: SITE.to_owned(),
        name,
        kind,
        corners_m: vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side]],
        alarm: false,
    };
    let room =
        |k: u32| square(format!("room {k}"), ZoneKind::Room, f64::from(8 * (k % 5)), f64::from(8 * (k / 5)), 8.0);
    let zone = |k: u32| square(format!("zone {k}"), ZoneKind::Zone, f64::from(6 * k), f64::from(4 * k), 16.0);
    (0..20).map(room).chain((0..5).map(zone)).collect()
}

fn anchor_m(k: u32) -> [f64; 3] {
    [f64::from(4 * (k % 10)), f64::from(8 * (k / 10)), 2.5]
}

fn live() -> LiveState {
    let mut live = LiveState::new(StateLimits::default());
    live.set_zones(zones());
    for k in 0..ANCHORS {
        let what = ReportKind::Node {
            node: format!("0x{:04X}", 0x100 + k),
            name: None,
            role: NodeRole::Anchor,
            position_m: Some(anchor_m(k)),
        };
        live.apply(&SourceReport { t: Utc::default(), site: SITE.to_owned(), what });
    }
    live
}

/// The reports of a tenth of a second: each tag walks at 1 m/s.
fn tenth(step: u32) -> Vec<SourceReport> {
    let t = Utc::clamped(1_700_000_000_000_000) + Duration::from_millis(u64::from(100 * step));
    let mut reports = Vec::new();
    for k in 0..TAGS {
        let (name, site) = (format!("0x{:04X}", 0x1000 + k), SITE.to_owned());
        let phase = f64::from(step) * 0.01 + f64::from(k);
        let position_m = [20.0 + 18.0 * phase.cos(), 16.0 + 14.0 * phase.sin()];
        for j in 0..RANGES {
            let anchor = (k + 4 * j) % ANCHORS;
            let [x, y, z] = anchor_m(anchor);
            let range_m = ((x - position_m[0]).powi(2) + (y - position_m[1]).powi(2) + (z - 1.0).powi(2)).sqrt();
            let what = ReportKind::Range {
                tag: name.clone(),
                anchor: format!("0x{:04X}", 0x100 + anchor),
                round: None,
                range: RangeMeasurement {
                    rx_power_dbm: Some(-80.0),
                    first_path_power_dbm: Some(-83.0),
                    clock_offset_ppm: Some(-2.35),
                    ..RangeMeasurement::of(range_m)
                },
            };
            reports.push(SourceReport { t, site: site.clone(), what });
        }
        let what = ReportKind::Position {
            tag: name,
            round: None,
            position_m,
            z_m: Some(1.0),
            sigma_m: [0.1, 0.15],
            sigma_z_m: None,
            cov_xy_m2: 0.005,
            used: 12,
            solved_from: SolvedFrom::Ranges,
            doubt: None,
        };
        reports.push(SourceReport { t, site, what });
    }
    reports
}

fn updates(criterion: &mut Criterion) {
    let tenths: Vec<Vec<SourceReport>> = (0..20).map(tenth).collect();
    let mut live = live();
    let mut group = criterion.benchmark_group("live state");
    group.throughput(Throughput::Elements(u64::from(TAGS)));
    let mut turn = tenths.iter().cycle();
    group.bench_function("a position with 12 ranges, 1,000 tags", |bencher| {
        bencher.iter(|| {
            for report in turn.next().into_iter().flatten() {
                black_box(live.apply(black_box(report)));
            }
        });
    });
    group.finish();
}

criterion_group!(benches, updates);
criterion_main!(benches);
