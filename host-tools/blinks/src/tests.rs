//! Anchors with clocks that run at their own rates from any start, and tags at known places.

use super::*;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

const ANCHORS_M: [[f64; 3]; 6] =
    [[0.0, 0.0, 3.0], [12.0, 0.0, 4.0], [12.0, 9.0, 3.0], [0.0, 9.0, 4.0], [6.0, 0.0, 4.0], [6.0, 9.0, 3.0]];
const LIGHT_M_S: f64 = 299_792_458.0 / 1.000_293;
const TICKS_PER_SECOND: f64 = 63.897_6e9;

/// Anchors 1 to 6.
struct Site {
    rng: Pcg64,
    /// Start in ticks, and rate.
    clocks: Vec<(f64, f64)>,
    found: Multilateration,
    deviation_s: f64,
}

impl Site {
    fn new(seed: u64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let clocks = ANCHORS_M.map(|_| (rng.random_range(0.0..2_f64.powi(40)), rng.random_range(-20e-6..20e-6)));
        let mut found = Multilateration::default();
        for (anchor, position_m) in ANCHORS_M.iter().enumerate() {
            found.set_anchor(anchor as u16 + 1, *position_m);
        }
        Self { rng, clocks: clocks.to_vec(), found, deviation_s: 0.1e-9 }
    }

    /// What an anchor's clock shows, 40 bits.
    fn stamp(&mut self, anchor: usize, true_s: f64, noise: bool) -> u64 {
        let (start, rate) = self.clocks[anchor];
        let error_s = if noise { Normal::new(0.0, self.deviation_s).unwrap().sample(&mut self.rng) } else { 0.0 };
        (start + (true_s + error_s) * TICKS_PER_SECOND * (1.0 + rate)).rem_euclid(2_f64.powi(40)) as u64
    }

    fn arrival(source: u16, number: u16, frame: ArrivedFrame, ticks: u64) -> Arrival {
        Arrival { t_us: 0, source, number, frame, ticks, rx_power_cdbm: -8000, first_path_power_cdbm: -8100 }
    }

    /// All sync frames of a superframe.
    fn superframe(&mut self, number: u16) {
        for sender in 0..ANCHORS_M.len() {
            let sent_s = f64::from(number) * 0.1 + sender as f64 * 1.3e-3;
            for anchor in 0..ANCHORS_M.len() {
                let frame = if anchor == sender { ArrivedFrame::OwnSyncFrame } else { ArrivedFrame::SyncFrame };
                let way_s = distance(ANCHORS_M[sender], ANCHORS_M[anchor]) / LIGHT_M_S;
                let ticks = self.stamp(anchor, sent_s + way_s, anchor != sender);
                self.found.take(
                    sent_s,
                    sent_s,
                    anchor as u16 + 1,
                    &Self::arrival(sender as u16 + 1, number, frame, ticks),
                );
            }
        }
    }

    /// A blink at these anchors.
    fn blink(&mut self, tag: u16, number: u16, at_s: f64, tag_m: [f64; 3], anchors: &[usize]) {
        for &anchor in anchors {
            let ticks = self.stamp(anchor, at_s + distance(ANCHORS_M[anchor], tag_m) / LIGHT_M_S, true);
            self.found.take(at_s, at_s, anchor as u16 + 1, &Self::arrival(tag, number, ArrivedFrame::Blink, ticks));
        }
    }
}

const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];

#[test]
fn tags_are_found_where_they_are_by_clocks_that_nothing_else_ties_together() {
    for (seed, height_m) in [(1, Some(1.2)), (2, None)] {
        let mut site = Site::new(seed);
        let tags: Vec<[f64; 3]> = (0..10).map(|i| [1.0 + f64::from(i), 8.0 - 0.7 * f64::from(i), 1.2]).collect();
        (0..10).for_each(|tag| site.found.set_height(0x1001 + tag, height_m));
        let (mut errors_m, mut normalised) = (Vec::new(), 0.0);
        // The clocks wrap several times.
        for number in 0..400_u16 {
            site.superframe(number);
            for (tag, tag_m) in tags.iter().enumerate() {
                let at_s = f64::from(number) * 0.1 + 0.03 + tag as f64 * 5e-3;
                site.blink(0x1001 + tag as u16, number, at_s, *tag_m, &ALL);
            }
            for solved in site.found.advance(f64::from(number) * 0.1 + 0.09) {
                let tag_m = tags[usize::from(solved.tag - 0x1001)];
                assert_eq!(solved.received, 6);
                // The clocks are known from the second sync frame on.
                if solved.number < 3 {
                    continue;
                }
                let found = solved.outcome.expect("six anchors");
                let off: Vec<f64> = (0..2).map(|axis| f64::from(found.position_m[axis]) - tag_m[axis]).collect();
                let error_m = off[0].hypot(off[1]);
                errors_m.push(error_m);
                normalised +=
                    (0..2).map(|axis| off[axis].powi(2) / f64::from(found.covariance_m2[axis][axis])).sum::<f64>();
            }
        }
        errors_m.sort_by(f64::total_cmp);
        assert!(errors_m.len() > 3900, "{}", errors_m.len());
        let [p50, p90] = [0.5, 0.9].map(|share| errors_m[(share * errors_m.len() as f64) as usize]);
        assert!(p50 < 0.05 && p90 < 0.12, "{height_m:?}: {p50} {p90}");
        // Errors of links count as lasting ones, which there are none here: so the deviations are too large.
        assert!(normalised / (2.0 * errors_m.len() as f64) < 1.0, "{normalised}");
    }
}

#[test]
fn what_cannot_be_solved_says_why_and_late_reports_change_nothing() {
    let mut site = Site::new(3);
    site.found.set_height(9, Some(1.2));
    (0..5).for_each(|number| site.superframe(number));
    let tag_m = [4.0, 5.0, 1.2];
    site.blink(9, 1, 0.35, tag_m, &ALL[..2]);
    // The same again, and an anchor that nobody placed.
    site.blink(9, 1, 0.35, tag_m, &ALL[..2]);
    site.found.take(0.35, 0.35, 77, &Site::arrival(9, 1, ArrivedFrame::Blink, 5));
    assert!(site.found.advance(0.6).is_empty());
    let solved = site.found.advance(0.7);
    assert_eq!((solved.len(), solved[0].received), (1, 2));
    assert!(solved[0].outcome.is_err());
    site.blink(9, 1, 0.71, tag_m, &ALL);
    assert!(site.found.advance(2.0).is_empty(), "reports of a blink that was solved");
    // Without sync frames the clocks are not known.
    site.blink(9, 2, 5.0, tag_m, &ALL);
    let [alone] = site.found.advance(6.0)[..] else { panic!("one blink") };
    assert_eq!(alone.outcome, Err(SolveError::TooFewAnchors));
}

#[test]
fn a_clock_that_is_set_back_begins_anew() {
    let mut site = Site::new(6);
    site.found.set_height(9, Some(1.2));
    let tag_m = [4.0, 5.0, 1.2];
    site.found.take(1e6, 1e6, 1, &Site::arrival(9, 0, ArrivedFrame::Blink, 5));
    (0..5).for_each(|number| site.superframe(number));
    site.blink(9, 1, 0.35, tag_m, &ALL);
    let [solved] = site.found.advance(0.7)[..] else { panic!("one blink") };
    assert!(solved.outcome.is_ok() && solved.number == 1);
}

#[test]
fn an_anchor_that_restarts_is_left_out_and_comes_back() {
    let mut site = Site::new(4);
    site.found.set_height(9, Some(1.2));
    let tag_m = [4.0, 5.0, 1.2];
    let mut worst_m = 0_f64;
    for number in 0..60_u16 {
        if number == 30 {
            // In the middle of a superframe: what it said before is void.
            site.clocks[2].0 = 12_345.0;
        }
        site.superframe(number);
        site.blink(9, number, f64::from(number) * 0.1 + 0.05, tag_m, &ALL);
        for solved in site.found.advance(f64::from(number) * 0.1 + 0.09).into_iter().filter(|solved| solved.number > 3)
        {
            let found = solved.outcome.expect("five anchors at least");
            worst_m = worst_m.max(f64::from(found.position_m[0] - 4.0).hypot(f64::from(found.position_m[1] - 5.0)));
        }
    }
    assert!(worst_m < 0.3, "{worst_m}");
}

#[test]
fn hostile_reports_neither_panic_nor_take_all_memory() {
    let mut rng = Pcg64::seed_from_u64(5);
    let mut found = Multilateration::default();
    (1..4).for_each(|anchor| found.set_anchor(anchor, [f64::from(anchor), 0.0, f64::NAN]));
    for i in 0..200_000_u32 {
        let frame = [ArrivedFrame::Blink, ArrivedFrame::SyncFrame, ArrivedFrame::OwnSyncFrame][rng.random_range(0..3)];
        let mut arrival = Site::arrival(rng.random(), rng.random(), frame, rng.random());
        (arrival.rx_power_cdbm, arrival.first_path_power_cdbm) = (rng.random(), rng.random());
        found.take(f64::from(i) * 1e-6, 0.0, rng.random_range(0..5), &arrival);
    }
    assert!(found.waiting.len() <= MAX_WAITING);
    assert!(found.anchors.values().all(|anchor| anchor.stamps.len() <= MAX_STAMPS));
    let solved = found.advance(1e9);
    assert!(!solved.is_empty() && solved.iter().all(|solved| solved.outcome.is_err()));
    assert!(found.tags.len() <= MAX_TAGS);
    found.take(f64::NAN, f64::NAN, 1, &Site::arrival(1, 1, ArrivedFrame::Blink, 0));
    assert!(found.advance(f64::NAN).is_empty());
}
