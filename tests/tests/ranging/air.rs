//! The simulated air errs as recorded ones do. The statistics are computed here, from what whole nodes report, with
//! bounds from recordings in line of sight: a laboratory with DWM1001 and a motion-capture room.

use sim::scenario::{AirModel, Fidelity, Scenario};
use system_tests::{Run, TAG, anchor, moments, tag};

/// A link's residuals, and where the tag was.
type Link = Vec<(f64, [f64; 3])>;

/// Links of a scenario's first tag: residuals against the anchors' surveyed positions, less their common mean.
fn links(scenario: Scenario) -> Vec<Link> {
    let run = Run::of(scenario.clone());
    let mut links: Vec<Link> = scenario
        .anchors
        .iter()
        .map(|anchor| {
            let at = scenario.surveyed_m(anchor);
            let epochs = run.epochs(TAG).filter(|(_, epoch)| epoch.fix.asked > 0);
            let ranges = epochs.flat_map(|(_, epoch)| epoch.ranges.iter().map(|range| (epoch.truth_m, range.range)));
            let own = ranges.filter(|(_, range)| range.peer == anchor.address);
            own.map(|(truth_m, range)| (range.distance_m() - distance(at, truth_m), truth_m)).collect()
        })
        .collect();
    let (common_m, _) = moments(links.iter().flatten().map(|(residual_m, _)| *residual_m));
    links.iter_mut().flatten().for_each(|(residual_m, _)| *residual_m -= common_m);
    links
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

/// The standard deviation of successive differences over √2, metres.
fn white_m(link: &Link) -> f64 {
    moments(link.windows(2).map(|pair| pair[1].0 - pair[0].0)).1 / 2f64.sqrt()
}

/// The correlation of two residuals of a link, less its mean, whose positions are `apart_m` apart, ± 3 cm.
fn correlation(links: &[Link], apart_m: f64) -> f64 {
    let (mut covariance, mut variance) = (Vec::new(), Vec::new());
    for link in links {
        let (mean_m, _) = moments(link.iter().map(|(residual_m, _)| *residual_m));
        let few: Vec<_> = link.iter().step_by(5).map(|(residual_m, at)| (residual_m - mean_m, *at)).collect();
        variance.extend(few.iter().map(|(residual_m, _)| residual_m * residual_m));
        for (at, a) in few.iter().enumerate() {
            let near = few[at + 1..].iter().filter(|b| (distance(a.1, b.1) - apart_m).abs() < 0.03);
            covariance.extend(near.map(|b| a.0 * b.0));
        }
    }
    moments(covariance.into_iter()).0 / moments(variance.into_iter()).0
}

fn rms_m(links: &[Link]) -> f64 {
    let (mean_m, deviation_m) = moments(links.iter().flatten().map(|(residual_m, _)| *residual_m));
    mean_m.hypot(deviation_m)
}

/// A walk through the default room.
fn walk(air: AirModel, fidelity: Fidelity, seed: u64) -> Vec<Link> {
    let scenario = Scenario { air, fidelity, seed, seconds: 20.0, walls: Vec::new(), ..Scenario::rooms(8, 1) };
    links(scenario)
}

#[test]
fn links_of_a_walk_err_as_recorded_ones() {
    for fidelity in [Fidelity::Spi, Fidelity::Air] {
        let walks: Vec<_> = (1..=3).map(|seed| walk(AirModel::Recorded, fidelity, seed)).collect();
        let links: Vec<Link> = walks.iter().flatten().cloned().collect();
        // Recorded: 0.089 to 0.151 m.
        assert!((0.08..0.16).contains(&rms_m(&links)), "{fidelity:?}: {} m", rms_m(&links));
        // Recorded: 0.018 to 0.031 m in the median link.
        let mut white: Vec<f64> = links.iter().map(white_m).collect();
        white.sort_by(f64::total_cmp);
        assert!((0.015..0.04).contains(&white[white.len() / 2]), "{fidelity:?}: {white:?}");
        // Recorded: 0.60 and 0.55 at 0.05 to 0.1 m, 0.35 and 0.4 at 0.3 m, −0.15 and 0.04 at 1.5 m and beyond.
        for (apart_m, from, to) in [(0.08, 0.5, 0.95), (0.3, 0.2, 0.75), (2.0, -0.3, 0.3)] {
            let found = correlation(&links, apart_m);
            assert!((from..to).contains(&found), "{fidelity:?}, {apart_m} m: {found}");
        }
    }
}

#[test]
fn the_ideal_air_has_no_lasting_errors() {
    for fidelity in [Fidelity::Spi, Fidelity::Air] {
        let links = walk(AirModel::Ideal, fidelity, 1);
        // White noise of 0.017 to 0.025 m, and nothing else.
        assert!(rms_m(&links) < 0.03, "{fidelity:?}: {} m", rms_m(&links));
        assert!(correlation(&links, 0.08).abs() < 0.1, "{fidelity:?}");
    }
}

#[test]
fn links_of_a_tag_at_rest_do_not_average_out() {
    let head = "[simulation]\nseconds = 10\nfidelity = \"air\"\n".to_owned() + &tag("", "path_m = [[5, 3, 1.2]]");
    let anchors = (0..8).map(|i| anchor([f64::from(3 * (i % 4)), f64::from(8 * (i / 4)), 2.5], ""));
    let mut scenario = Scenario::parse(&(head + &anchors.collect::<String>())).unwrap();
    let mut means = Vec::new();
    for seed in 1..=4 {
        scenario.seed = seed;
        for link in links(scenario.clone()) {
            let (mean_m, deviation_m) = moments(link.iter().map(|(residual_m, _)| *residual_m));
            // A link that is wrong is as quiet as one that is not.
            assert!(link.len() > 500 && deviation_m < 0.06, "{} ranges, ± {deviation_m} m", link.len());
            means.push(mean_m);
        }
    }
    // The mean of 500 ranges with 0.03 m of white noise would be within 0.005 m.
    let (_, deviation_m) = moments(means.iter().copied());
    assert!((0.06..0.16).contains(&deviation_m), "{deviation_m} m: {means:?}");
}
