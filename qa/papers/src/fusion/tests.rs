//! Tests of the whole fusion: against independent references, and with hostile input.

use std::boxed::Box;
use std::vec::Vec;

use super::*;
use positioning_core::Area;

type OnNode = Box<Fusion<f32, 2, ON_NODE, 12, { states(2, 12, 6) }>>;

const POWER: ChannelModel<f32> = ChannelModel::Power { at_1m: -59.0, exponent: 2.0 };

fn fusion(sources: Sources) -> OnNode {
    Box::new(Fusion::new(FusionSettings { sources, ..FusionSettings::indoors(0.0) }))
}

fn observation(node: u16, place: [f32; 2], channel: ChannelModel<f32>, value: f32) -> Observation<f32> {
    Observation { node, place: [place[0], place[1], 0.0], channel, value }
}

fn distance(a: [f64; 2], b: [f32; 2]) -> f64 {
    (a[0] - f64::from(b[0])).hypot(a[1] - f64::from(b[1]))
}

const CORNERS: [[f32; 2]; 4] = [[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]];

/// Mean and deviation of a posterior over 0 to 10 m and 0 to 8 m, on a grid of 2 cm.
fn by_grid(density: impl Fn([f64; 2]) -> f64) -> ([f64; 2], f64) {
    let (mut sum, mut mean, mut square) = (0.0, [0.0; 2], 0.0);
    for i in 0..500 {
        for j in 0..400 {
            let p = [0.01 + 0.02 * f64::from(i), 0.01 + 0.02 * f64::from(j)];
            let w = density(p);
            sum += w;
            (mean[0], mean[1]) = (mean[0] + w * p[0], mean[1] + w * p[1]);
            square += w * (p[0] * p[0] + p[1] * p[1]);
        }
    }
    let mean = mean.map(|m| m / sum);
    (mean, (square / sum - mean[0] * mean[0] - mean[1] * mean[1]).sqrt())
}

#[test]
fn the_first_position_by_powers_is_that_of_a_fine_grid() {
    // One value a beacon: Gaussian of 3² + 5² dB², and one outlier in a hundred over 9 deviations.
    let values = [-79.0, -74.0, -73.0, -76.0];
    let (mean, spread) = by_grid(|p| {
        let variance: f64 = 9.0 + 25.0;
        let one = |(place, value): (&[f32; 2], &f32)| {
            let x = f64::from(*value) + 59.0 + 20.0 * distance(p, *place).max(0.1).log10();
            (-0.5 * x * x / variance).exp() / (std::f64::consts::TAU * variance).sqrt() + 0.01 / (9.0 * variance.sqrt())
        };
        CORNERS.iter().zip(&values).map(one).product()
    });
    let area = Some(Area { min: [0.0; 3], max: [10.0, 8.0, 1.0] });
    let errors: Vec<[f64; 2]> = (0..20)
        .map(|seed| {
            let mut fusion: OnNode =
                Box::new(Fusion::new(FusionSettings { area, seed, ..FusionSettings::indoors(0.0) }));
            for (k, (place, value)) in CORNERS.iter().zip(&values).enumerate() {
                fusion.observe(0, &observation(k as u16, *place, POWER, *value));
            }
            let estimate = fusion.step(0).expect("four beacons");
            [distance(mean, estimate.mean), f64::from(estimate.spread()) / spread]
        })
        .collect();
    // 24 positions are drawn: their mean is accurate to a fifth of the spread, 1 ⁄ √24, the worst one of twenty to
    // twice that.
    let worst = errors.iter().map(|[error, _]| *error).fold(0.0, f64::max);
    assert!(worst < 0.45 * spread, "{worst} of {spread}");
    assert!(errors.iter().all(|[_, ratio]| (0.75..1.3).contains(ratio)), "{errors:?} {spread}");
}

#[test]
fn straight_ranges_make_a_kalman_filter() {
    // Anchors a kilometre away along the axes, so that distances are coordinates. The reference is the textbook's
    // filter in f64, of position and velocity, with the same density of acceleration.
    let anchors = [[-1000.0, 0.0], [1000.0, 0.0], [0.0, -1000.0], [0.0, 1000.0]];
    let settings = FusionSettings {
        reach: 1200.0_f32,
        delay: DelayErrors { noise: 0.1, bias: 1e-3, blocked: 0.0, lasting: 1e9, ..DelayErrors::indoors() },
        acceleration: 0.7,
        ..FusionSettings::indoors(0.0)
    };
    let mut fusion: Box<Fusion<f32, 2, ON_NODE, 4, { states(2, 0, 4) }>> = Box::new(Fusion::new(settings));
    let mut random = Random::new(9);
    let (mut x, mut v, mut p) = (0.0_f64, 0.0_f64, [1e3, 0.0, 0.49]);
    let (q, dt) = (0.49, 0.2);
    let (mut square, mut count) = (0.0, 0.0);
    for k in 0..200_u32 {
        let at = [(0.1 * f64::from(k)).sin() * 2.0, 0.0];
        let mut sum = 0.0;
        for (node, anchor) in anchors.iter().enumerate() {
            let noise: f64 = random.normal();
            let range = (distance(at, *anchor) + 0.1 * noise) as f32;
            // Along x one range grows and the other shrinks.
            match node {
                0 => sum += f64::from(range) - 1000.0,
                1 => sum += 1000.0 - f64::from(range),
                _ => {}
            }
            fusion.observe(u64::from(k) * 200_000, &observation(node as u16, *anchor, ChannelModel::range(), range));
        }
        if k > 0 {
            let [a, b, c] = p;
            x += dt * v;
            p = [a + 2.0 * dt * b + dt * dt * c + q * dt.powi(3) / 3.0, b + dt * c + q * dt * dt / 2.0, c + q * dt];
        }
        // The mean of two ranges, 0.1 m each.
        let (s, innovation) = (p[0] + 0.005 + 0.000_05, sum / 2.0 - x);
        let gain = [p[0] / s, p[1] / s];
        (x, v) = (x + gain[0] * innovation, v + gain[1] * innovation);
        p = [p[0] * (1.0 - gain[0]), p[1] * (1.0 - gain[0]), p[2] - gain[1] * p[1]];
        let estimate = fusion.step(u64::from(k) * 200_000).expect("four anchors");
        if k >= 10 {
            square += (f64::from(estimate.mean[0]) - x).powi(2);
            count += 1.0;
        }
    }
    // The filter's deviation is 0.055 m. Kernels adapt to eight values, and 2048 positions are tried at the start.
    let difference = (square / count).sqrt();
    assert!(difference < 0.02, "{difference} beside {}", p[0].sqrt());
}

#[test]
fn a_blocked_anchor_does_not_pull() {
    let mut fusion = fusion(Sources::Delay);
    let at = [4.0, 3.0];
    let mut last = None;
    for k in 0..20_u64 {
        for (node, corner) in CORNERS.iter().enumerate() {
            let excess = if node == 3 { 2.0 } else { 0.0 };
            let range = (distance(at, *corner) + excess) as f32;
            fusion.observe(k * 200_000, &observation(node as u16, *corner, ChannelModel::range(), range));
        }
        last = fusion.step(k * 200_000).ok();
    }
    let error = distance(at, last.expect("four anchors").mean);
    assert!(error < 0.1, "{error}");
}

#[test]
fn a_beacon_is_calibrated_while_anchors_know_better() {
    // All powers are 8 dB too strong: a factor of 2.5 in distance. Anchors for ten seconds, then beacons alone.
    let mut fusion = fusion(Sources::Both);
    let at = [4.0, 3.0];
    let mut last = None;
    for k in 0..60_u64 {
        for (node, corner) in CORNERS.iter().enumerate() {
            let range = distance(at, *corner) as f32;
            if k < 50 {
                fusion.observe(k * 200_000, &observation(node as u16, *corner, ChannelModel::range(), range));
            }
            let power = -51.0 - 20.0 * range.log10();
            fusion.observe(k * 200_000, &observation(node as u16, *corner, POWER, power));
        }
        last = fusion.step(k * 200_000).ok();
    }
    let error = distance(at, last.expect("a track").mean);
    assert!(error < 0.4, "{error}");
}

#[test]
fn sources_are_heeded() {
    let power = observation(1, [0.0, 0.0], POWER, -60.0);
    let range = observation(1, [0.0, 0.0], ChannelModel::range(), 2.0);
    let verdicts = |sources| [fusion(sources).observe(0, &power), fusion(sources).observe(0, &range)];
    assert_eq!(verdicts(Sources::Power), [FusionVerdict::Held, FusionVerdict::Ignored]);
    assert_eq!(verdicts(Sources::Delay), [FusionVerdict::Ignored, FusionVerdict::Held]);
    assert_eq!(verdicts(Sources::Both), [FusionVerdict::Held, FusionVerdict::Held]);
}

#[test]
fn a_delay_in_ticks_is_its_affine_distance() {
    // 300 ticks of 0.0047 m, minus an antenna delay of 100 ticks.
    let channel = ChannelModel::Delay { offset: -0.47, scale: 0.0047 };
    assert!((channel.level(300.0_f64) - 0.94).abs() < 1e-12);
}

#[test]
fn what_is_no_value_is_refused() {
    let mut fusion = fusion(Sources::Both);
    for value in [f32::NAN, f32::INFINITY, 127.0, 0.0, 5.0, -200.0] {
        assert_eq!(fusion.observe(0, &observation(1, [0.0; 2], POWER, value)), FusionVerdict::NotSane, "{value}");
    }
    for value in [f32::NAN, f32::NEG_INFINITY, 1e9] {
        assert_eq!(fusion.observe(0, &observation(1, [0.0; 2], ChannelModel::range(), value)), FusionVerdict::NotSane);
    }
    let nowhere = observation(1, [f32::NAN, 0.0], POWER, -60.0);
    assert_eq!(fusion.observe(0, &nowhere), FusionVerdict::NotSane);
    let flat = ChannelModel::Power { at_1m: -59.0, exponent: 0.0 };
    assert_eq!(fusion.observe(0, &observation(1, [0.0; 2], flat, -60.0)), FusionVerdict::NotSane);
    assert_eq!(fusion.step(1), Err(Missing::TooFewNodes));
}

#[test]
fn two_nodes_do_not_begin_a_track_and_one_continues_it() {
    let mut fusion = fusion(Sources::Both);
    for node in 0..2 {
        fusion.observe(0, &observation(node, CORNERS[usize::from(node)], POWER, -70.0));
    }
    assert_eq!(fusion.step(0), Err(Missing::TooFewNodes));
    for (node, corner) in CORNERS.iter().enumerate() {
        fusion.observe(200_000, &observation(node as u16, *corner, POWER, -73.0));
    }
    assert!(fusion.step(200_000).is_ok_and(|estimate| estimate.started && estimate.nodes == 4));
    fusion.observe(400_000, &observation(0, CORNERS[0], POWER, -73.0));
    assert!(fusion.step(400_000).is_ok_and(|estimate| !estimate.started && estimate.nodes == 1));
}

#[test]
fn nodes_at_one_place_make_a_ring_and_no_panic() {
    let mut fusion = fusion(Sources::Both);
    for node in 0..4 {
        fusion.observe(0, &observation(node, [5.0, 5.0], ChannelModel::range(), 3.0));
    }
    let estimate = fusion.step(0).expect("four nodes");
    // All directions are alike: the deviation is the radius.
    assert!((estimate.spread() - 3.0).abs() < 0.6, "{}", estimate.spread());
}

#[test]
fn uncertainty_grows_without_values_until_the_gap() {
    let mut fusion = fusion(Sources::Delay);
    for (node, corner) in CORNERS.iter().enumerate() {
        let range = distance([4.0, 3.0], *corner) as f32;
        fusion.observe(0, &observation(node as u16, *corner, ChannelModel::range(), range));
    }
    let spreads: Vec<f32> = (0..=10).filter_map(|s| fusion.step(s * 1_000_000).ok()).map(|e| e.spread()).collect();
    assert!(spreads.len() == 11 && spreads.windows(2).all(|pair| pair[0] < pair[1]), "{spreads:?}");
    assert_eq!(fusion.step(10_200_000), Err(Missing::Gap));
    assert_eq!(fusion.step(10_400_000), Err(Missing::TooFewNodes));
}

#[test]
fn a_clock_that_begins_anew_begins_a_track_anew_and_overtaken_values_count() {
    let mut fusion = fusion(Sources::Delay);
    let mut round = |now: u64, backwards: u64| {
        for (node, corner) in CORNERS.iter().enumerate() {
            let range = distance([4.0, 3.0], *corner) as f32;
            let now = now - backwards * node as u64;
            assert_eq!(
                fusion.observe(now, &observation(node as u16, *corner, ChannelModel::range(), range)),
                FusionVerdict::Held
            );
        }
        fusion.step(now).map(|estimate| estimate.started)
    };
    assert_eq!(round(60_000_000, 100_000), Ok(true));
    assert_eq!(round(60_200_000, 100_000), Ok(false));
    assert_eq!(round(1_000_000, 0), Ok(true));
    assert_eq!(round(u64::MAX, 0), Err(Missing::Gap));
}

#[test]
fn a_kidnapped_tag_is_found_again() {
    let mut fusion = fusion(Sources::Delay);
    let mut error = f64::NAN;
    for k in 0..60_u64 {
        let at = if k < 20 { [2.0, 2.0] } else { [9.0, 7.0] };
        for (node, corner) in CORNERS.iter().enumerate() {
            let range = distance(at, *corner) as f32;
            fusion.observe(k * 200_000, &observation(node as u16, *corner, ChannelModel::range(), range));
        }
        error = fusion.step(k * 200_000).map_or(f64::NAN, |estimate| distance(at, estimate.mean));
    }
    assert!(error < 0.3, "{error}");
}

#[test]
fn a_full_table_refuses_until_a_node_falls_silent() {
    let mut fusion = fusion(Sources::Power);
    for node in 0..12 {
        assert_eq!(fusion.observe(0, &observation(node, CORNERS[0], POWER, -60.0)), FusionVerdict::Held);
    }
    assert_eq!(fusion.observe(0, &observation(12, CORNERS[0], POWER, -60.0)), FusionVerdict::NoRoom);
    assert_eq!(fusion.observe(6_000_000, &observation(12, CORNERS[0], POWER, -60.0)), FusionVerdict::Held);
}

#[test]
fn space_has_four_anchors_and_three_coordinates() {
    let mut fusion: Box<Fusion<f32, 3, ON_NODE, 8, { states(3, 0, 8) }>> =
        Box::new(Fusion::new(FusionSettings::indoors(0.0)));
    let at = [4.0_f32, 3.0, 1.0];
    let places = [[0.0, 0.0, 3.0], [10.0, 0.0, 0.2], [10.0, 8.0, 2.8], [0.0, 8.0, 0.3], [5.0, 4.0, 3.0]];
    let mut last = None;
    for k in 0..10_u64 {
        for (node, place) in places.iter().enumerate() {
            let value = at.iter().zip(place).map(|(a, b): (&f32, &f32)| (a - b).powi(2)).sum::<f32>().sqrt();
            let range = Observation { node: node as u16, place: *place, channel: ChannelModel::range(), value };
            fusion.observe(k * 200_000, &range);
        }
        last = fusion.step(k * 200_000).ok();
    }
    let mean = last.expect("five anchors").mean;
    let error = mean.iter().zip(at).map(|(m, a)| (m - a).powi(2)).sum::<f32>().sqrt();
    assert!(error < 0.2, "{mean:?}");
}

#[test]
fn a_node_has_room_for_it() {
    // 24 hypotheses of 17 states: means, covariances, shares and weights are 24 · (17 + 17² + 9 + 3) numbers, 30.5 kB;
    // windows of eight values with their times.
    let size = size_of::<Fusion<f32, 2, ON_NODE, 9, { states(2, 5, 4) }>>();
    assert!(size < 33_000, "{size}");
}
