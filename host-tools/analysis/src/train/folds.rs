//! Folds of placements for cross-validation, and a balanced choice of receptions from the others.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;

use super::samples::TrainingSample;

/// Assigns placements to `count` folds, direct and blocked ones separately, so that the other folds always have both
/// classes. Returns the fold of each placement; the result is the same for the same seed.
pub fn deal(samples: &[&TrainingSample], placements: usize, count: usize, seed: u64) -> Vec<usize> {
    let (mut votes, mut present) = (vec![0_i64; placements], vec![false; placements]);
    for sample in samples {
        votes[sample.placement] += if sample.blocked == Some(true) { 1 } else { -1 };
        present[sample.placement] = true;
    }
    let (mut blocked, mut direct): (Vec<usize>, Vec<usize>) =
        (0..placements).filter(|&place| present[place]).partition(|&place| votes[place] > 0);
    let mut random = Pcg64::seed_from_u64(seed);
    direct.shuffle(&mut random);
    blocked.shuffle(&mut random);
    let mut folds = vec![0; placements];
    for (turn, place) in direct.into_iter().chain(blocked).enumerate() {
        folds[place] = turn % count.max(1);
    }
    folds
}

/// At most `most` receptions of either class. Every placement of the class gives the same number, spread evenly over
/// it, because a longer recording of a placement is not more evidence.
pub fn balanced<'a>(samples: &[&'a TrainingSample], most: usize) -> Vec<&'a TrainingSample> {
    let mut chosen = Vec::new();
    for class in [false, true] {
        let mut placements: BTreeMap<usize, Vec<&TrainingSample>> = BTreeMap::new();
        for sample in samples.iter().filter(|sample| sample.blocked == Some(class)) {
            placements.entry(sample.placement).or_default().push(sample);
        }
        let share = most / placements.len().max(1);
        for here in placements.into_values() {
            let count = here.len().min(share.max(1));
            chosen.extend((0..count).map(|i| here[i * here.len() / count]));
        }
    }
    chosen
}

/// Weights of receptions: both classes have the same sum, and within a class every placement has the same. All
/// weights sum to one.
pub fn weights(samples: &[&TrainingSample]) -> Vec<f64> {
    let key = |sample: &TrainingSample| (sample.blocked == Some(true), sample.placement);
    let mut counts = BTreeMap::new();
    for sample in samples {
        *counts.entry(key(sample)).or_insert(0_usize) += 1;
    }
    let placements = |class| counts.keys().filter(|(blocked, _)| *blocked == class).count();
    let of = [placements(false), placements(true)];
    let classes = of.iter().filter(|&&count| count > 0).count();
    samples
        .iter()
        .map(|sample| {
            let key = key(sample);
            1.0 / (classes * of[usize::from(key.0)] * counts[&key]) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use positioning_core::nlos::Features;

    fn samples(counts: &[(usize, bool)]) -> Vec<TrainingSample> {
        let make = |(placement, &(count, blocked)): (usize, &(usize, bool))| {
            let sample =
                TrainingSample { placement, blocked: Some(blocked), features: Features::default(), error_m: None };
            std::iter::repeat_n(sample, count)
        };
        counts.iter().enumerate().flat_map(make).collect()
    }

    #[test]
    fn whole_placements_go_to_one_fold_and_classes_are_spread() {
        let samples = samples(&[(5, false), (9, true), (2, false), (7, true), (1, true), (3, true)]);
        let samples: Vec<&TrainingSample> = samples.iter().collect();
        let folds = deal(&samples, 6, 2, 3);
        assert_eq!(folds, deal(&samples, 6, 2, 3), "the same for the same seed");
        assert_ne!(folds[0], folds[2], "the two direct placements");
        assert_eq!(folds.iter().filter(|&&fold| fold == 0).count(), 3);
        let others: Vec<_> = (0..20).map(|seed| deal(&samples, 6, 2, seed)).collect();
        assert!(others.iter().any(|other| *other != folds), "the seed matters");
    }

    #[test]
    fn the_choice_is_even() {
        let samples = samples(&[(100, false), (50, true), (10, true), (40, true)]);
        let samples: Vec<&TrainingSample> = samples.iter().collect();
        let chosen = balanced(&samples, 60);
        let of = |placement| chosen.iter().filter(|sample| sample.placement == placement).count();
        // 60 of one direct placement; 60/3 = 20 of each blocked one, of which one has only 10.
        assert_eq!([of(0), of(1), of(2), of(3)], [60, 20, 10, 20]);
    }

    #[test]
    fn classes_and_placements_weigh_as_much() {
        let samples = samples(&[(4, false), (2, true), (6, true)]);
        let samples: Vec<&TrainingSample> = samples.iter().collect();
        let weights = weights(&samples);
        // ½ for the direct placement, ¼ for each blocked one: ½/4, ¼/2, ¼/6.
        assert!((weights[0] - 0.125).abs() < 1e-12 && (weights[4] - 0.125).abs() < 1e-12);
        assert!((weights[6] - 0.25 / 6.0).abs() < 1e-12);
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
