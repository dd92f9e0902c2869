//! The filter as a whole.

use super::{Estimate, ParticleFilter, Settings, Towards, turned};
use crate::Area;
use crate::ble::path_loss::{PathLoss, Wall};
use crate::ble::rssi::{RssiLikelihood, RssiObservation};

const ROOM: Area<f64, 2> = Area { min: [0.0, 0.0], max: [10.0, 8.0] };

fn is_near(estimate: &Estimate<f64>, place: [f64; 2], within: f64) -> bool {
    (estimate.position[0] - place[0]).hypot(estimate.position[1] - place[1]) < within
}

fn still(wander: f64) -> Settings<f64> {
    Settings { position: 0.0, wander, approach: 0.0, speed: 0.0, ..Settings::walking() }
}

#[test]
fn one_step_is_the_product_of_prior_and_likelihood() {
    // A normal prior of 2 m about (0, 0) and a likelihood of 1 m about (3, 0): the mean is 3 · 4 ⁄ 5 = 2.4, the
    // variance 4 ⁄ 5.
    let mut filter = ParticleFilter::<f64, 20_000>::new(still(0.0), 3);
    filter.start_at([0.0, 0.0], [2.0, 2.0]);
    let estimate = filter.step(0, &[], &Towards { position: [3.0, 0.0], deviation: 1.0 }).expect("particles");
    assert!(is_near(&estimate, [2.4, 0.0], 0.08), "{estimate:?}");
    assert!((estimate.covariance[0][0] - 0.8).abs() < 0.08, "{estimate:?}");
    assert!((estimate.covariance[1][1] - 0.8).abs() < 0.08 && estimate.covariance[0][1].abs() < 0.05, "{estimate:?}");
}

#[test]
fn noise_of_the_position_grows_with_the_time() {
    // 0.5 m per √s over 2 s: a variance of 0.5 per axis, for all lengths of steps.
    for step_us in [200_000, 1_000_000] {
        let mut filter = ParticleFilter::<f64, 5_000>::new(still(0.5), 4);
        filter.start_at([1.0, 1.0], [0.0, 0.0]);
        let mut last = None;
        for at_us in (0..=2_000_000).step_by(step_us) {
            last = filter.step(at_us, &[], &|_: [f64; 2]| 0.0);
        }
        let estimate = last.expect("particles");
        assert!((estimate.covariance[0][0] - 0.5).abs() < 0.05 && estimate.effective > 0.999, "{estimate:?}");
    }
}

#[test]
fn walkers_spread_and_do_not_approach_their_mean() {
    // Nothing is received for 10 s: 4² + 1² · 10 = 26 m² per axis, and 0.2² · 0.5² · 20 = 0.2 m² by the speed's noise,
    // half of it per axis. A filter whose particles approach their mean has 3 m² instead.
    let mut filter = ParticleFilter::<f64, 5_000>::new(Settings::walking(), 6);
    filter.start_at([0.0, 0.0], [4.0, 4.0]);
    let steps = (0..=20).map(|step| filter.step(step * 500_000, &[], &|_: [f64; 2]| 0.0).expect("particles"));
    let last = steps.last().expect("some");
    assert!((last.covariance[0][0] - 26.1).abs() < 1.5 && (last.covariance[1][1] - 26.1).abs() < 1.5, "{last:?}");
}

#[test]
fn each_particle_has_the_offset_of_its_position() {
    // Three scans at (2, 6) of three beacons, 5 dB too strong, each counted half, against a grid of 0.1 m and 0.2 dB
    // over positions and offsets. The shared variance is 1 ⁄ (1 ⁄ 16 + 3 · ½ · 3 ⁄ 9) = 1.7778 dB².
    let beacons = [[0.0, 0.0], [10.0, 1.0], [4.0, 8.0]];
    let path_loss = PathLoss { level_1m: -50.0, exponent: 2.0, deviation: 3.0 };
    let at = |beacon: [f64; 2], at: [f64; 2]| {
        let square = (beacon[0] - at[0]).powi(2) + (beacon[1] - at[1]).powi(2) + 0.09;
        -50.0 - 10.0 * square.log10()
    };
    let heard = beacons.map(|beacon_m| RssiObservation {
        beacon_m,
        above_m: 0.0,
        rssi_dbm: at(beacon_m, [2.0, 6.0]) + 5.0,
        path_loss,
    });
    let mut filter = ParticleFilter::<f64, 20_000>::new(Settings { roughening: 0.0, ..Settings::staying() }, 7);
    filter.start_in(&ROOM);
    let (mut variance, mut last) = (16.0_f64, None);
    for step in 0..3 {
        let rssis = RssiLikelihood::of(&heard, variance.sqrt(), 0.5);
        last = filter.step(step, &[], &rssis);
        variance = rssis.offset_variance();
    }
    let found = last.expect("particles");
    assert!((variance - 1.777_8).abs() < 1e-3, "{variance}");
    let (mut sum, mut mean) = (0.0, [0.0; 3]);
    for (x, y) in (0..100).flat_map(|x| (0..80).map(move |y| (f64::from(x) * 0.1 + 0.05, f64::from(y) * 0.1 + 0.05))) {
        for offset in (-100..=100).map(|offset| f64::from(offset) * 0.2) {
            let misfit: f64 = heard.iter().map(|one| (one.rssi_dbm - at(one.beacon_m, [x, y]) - offset).powi(2)).sum();
            let weight = (-0.5 * (1.5 * misfit / 9.0 + offset * offset / 16.0)).exp();
            sum += weight;
            mean = [mean[0] + weight * x, mean[1] + weight * y, mean[2] + weight * offset];
        }
    }
    let mean = mean.map(|each| each / sum);
    assert!(is_near(&found, [mean[0], mean[1]], 0.1), "{found:?} {mean:?}");
    assert!((found.offset[0] - mean[2]).abs() < 0.1, "{found:?} {mean:?}");
}

#[test]
fn the_thesis_filter_settles_where_the_kernel_points() {
    let mut filter = ParticleFilter::<f64, 500>::new(Settings::thesis(), 5);
    filter.start_in(&ROOM);
    let kernel = Towards { position: [7.0, 2.0], deviation: 2.5 };
    let mut sum = [0.0; 2];
    for step in 0..60_u64 {
        let estimate = filter.step(step * 200_000, &[], &kernel).expect("particles");
        if step >= 20 {
            sum = [sum[0] + estimate.position[0] / 40.0, sum[1] + estimate.position[1] / 40.0];
        }
    }
    assert!((sum[0] - 7.0).hypot(sum[1] - 2.0) < 0.2, "{sum:?}");
}

#[test]
fn particles_stay_on_their_side_of_a_wall() {
    // A very long wall at x = 5; the likelihood pulls to the other side.
    let wall = [Wall { ends: [[5.0, -1.0e3], [5.0, 1.0e3]], attenuation: 0.0 }];
    let mut filter = ParticleFilter::<f64, 300>::new(Settings::walking(), 6);
    filter.start_in(&Area { min: [0.0, 0.0], max: [4.9, 8.0] });
    let beyond = Towards { position: [7.0, 4.0], deviation: 2.0 };
    for step in 0..50_u64 {
        let estimate = filter.step(step * 200_000, &wall, &beyond).expect("particles");
        assert!(estimate.position[0] < 5.0, "{estimate:?}");
    }
    assert!(filter.particles.iter().all(|particle| particle.at[0] <= 5.0));
}

#[test]
fn equal_seeds_give_equal_ways_and_others_do_not() {
    let way = |seed| {
        let mut filter = ParticleFilter::<f32, 64>::new(Settings::walking(), seed);
        filter.start_at([0.0, 0.0], [3.0, 3.0]);
        let kernel = Towards { position: [1.0, 2.0], deviation: 1.0 };
        (0..10_u64).filter_map(|step| filter.step(step * 200_000, &[], &kernel)).last().expect("particles").position
    };
    assert_eq!(way(1), way(1));
    assert_ne!(way(1), way(2));
}

#[test]
fn impossible_likelihoods_and_times_leave_a_filter_that_works() {
    let mut filter = ParticleFilter::<f64, 200>::new(Settings::walking(), 7);
    let kernel = Towards { position: [4.0, 4.0], deviation: 1.0 };
    assert_eq!(filter.step(0, &[], &kernel), None, "nobody started it");
    filter.start_in(&ROOM);
    filter.step(10_000_000, &[], &kernel).expect("particles");
    for impossible in [f64::NAN, f64::NEG_INFINITY, f64::INFINITY] {
        assert_eq!(filter.step(10_200_000, &[], &move |_: [f64; 2]| impossible), None);
    }
    // Half of the room is impossible.
    let half = |at: [f64; 2]| if at[0] < 5.0 { -at[0].abs() } else { f64::NAN };
    assert!(filter.step(10_400_000, &[], &half).expect("particles").position[0] < 5.0);
    // Far away from all particles: the weights do not vanish, and `best` shows it.
    let far = filter.step(10_600_000, &[], &Towards { position: [1.0e4, 0.0], deviation: 1.0 }).expect("particles");
    assert!(far.best < -1.0e6, "{far:?}");
    filter.start_in(&ROOM);
    for at_us in [20_000_000, 5_000_000, 0, u64::MAX, u64::MAX] {
        let estimate = filter.step(at_us, &[], &kernel).expect("particles");
        assert!(is_near(&estimate, [4.0, 4.0], 2.0), "{estimate:?}");
    }
    filter.start_at([f64::NAN, 0.0], [1.0, 1.0]);
    assert!(!filter.is_started());
}

#[test]
fn a_filter_of_no_particles_and_of_one_is_no_trouble() {
    let kernel = Towards { position: [1.0_f32, 1.0], deviation: 1.0 };
    let mut none = ParticleFilter::<f32, 0>::new(Settings::thesis(), 1);
    none.start_at([0.0, 0.0], [1.0, 1.0]);
    assert_eq!(none.step(0, &[], &kernel), None);
    let mut one = ParticleFilter::<f32, 1>::new(Settings::thesis(), 1);
    one.start_at([0.0, 0.0], [1.0, 1.0]);
    assert!(one.step(0, &[], &kernel).expect("a particle").position[0].is_finite());
}

#[test]
fn a_turn_is_near_its_angle_and_keeps_the_length() {
    for hundredths in -260..=260 {
        let angle = f64::from(hundredths) / 100.0;
        let [cosine, sine] = turned(angle);
        assert!((cosine * cosine + sine * sine - 1.0).abs() < 1e-12);
        assert!((sine.atan2(cosine) - angle).abs() < 0.008 * angle.abs() + 1e-12, "{angle}");
    }
}
