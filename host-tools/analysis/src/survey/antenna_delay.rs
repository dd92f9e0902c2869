//! Antenna delays of nodes from ranges over known distances: what `baliza calibrate antenna-delay` does.
//!
//! The input is the error of every range, measured less true distance, with its two nodes. The output is the delay that
//! each node's record should have. A two-way range between nodes a and b is too long by (δa + δb) ticks of light's way,
//! where δ is the true delay of a node, the mean of both directions, less the delay that it ranged with (Decawave,
//! APS014, *DW1000 Antenna Delay Calibration*, 2.2). One pair gives one sum; the pairs of three nodes give each delay,
//! as there. More pairs are solved by weighted least squares.
//!
//! In a network of pairs without a cycle of an odd number of nodes (a tag and anchors) only the sums can be observed:
//! the delays of one side may grow as those of the other side shrink. The solution of least norm is taken then, and
//! these nodes are marked.

use std::collections::BTreeMap;

use baliza_report::median;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use ranging::time::METRES_PER_TICK;

/// Standard deviation of what stays in a link's range at one position, however often it is measured: 0.055 m that
/// changes over decimetres and 0.03 m that changes over centimetres, as recorded in line of sight
/// (`dw1000_sim::air::LastingErrors::RECORDED`).
const LINK_M: f64 = 0.063;
/// After this change of the distance, a link's error is another one: its correlation falls to 1/e within 0.3 to 0.5 m.
const PLACE_M: f64 = 0.5;
/// A median absolute deviation of a Gaussian distribution is its standard deviation divided by this.
const MAD: f64 = 1.4826;
/// The variance of the median of n Gaussian values is this times σ² ⁄ n.
const OF_MEDIAN: f64 = std::f64::consts::FRAC_PI_2;
/// Eigenvalues below this share of the largest one are those of unobservable delays.
const ZERO: f64 = 1e-9;

/// A range over a known distance.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownRange {
    /// The two nodes.
    pub nodes: [String; 2],
    /// The true distance, metres.
    pub distance_m: f64,
    /// The measured range, metres.
    pub range_m: f64,
}

/// What was measured between two nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The two nodes, in the order of their names.
    pub nodes: [String; 2],
    /// The number of ranges.
    pub ranges: usize,
    /// The median of the ranges' errors, metres.
    pub error_m: f64,
    /// Its standard deviation, metres.
    pub sigma_m: f64,
    /// What the delays leave of the error, metres.
    pub residual_m: f64,
}

/// The delay of a node.
#[derive(Clone, Debug, PartialEq)]
pub struct Delay {
    /// The node.
    pub node: String,
    /// What must be added to the delay of each direction, ticks.
    pub correction_ticks: f64,
    /// Its standard deviation, ticks; `None` where only sums with other nodes can be observed.
    pub sigma_ticks: Option<f64>,
    /// The number of other nodes to which there are ranges.
    pub pairs: usize,
    /// The number of ranges.
    pub ranges: usize,
}

/// The delays of all nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The nodes, in the order of their names.
    pub delays: Vec<Delay>,
    /// The pairs, in the order of their names.
    pub pairs: Vec<Pair>,
}

/// Finds the delays. Nodes in `known` have the right delay already.
pub fn calibrate(ranges: &[KnownRange], known: &[String]) -> Calibration {
    let mut pairs = pairs(ranges);
    let mut nodes: Vec<String> = pairs.iter().flat_map(|pair| pair.nodes.clone()).collect();
    nodes.sort();
    nodes.dedup();
    let free: Vec<&String> = nodes.iter().filter(|node| !known.contains(node)).collect();
    let place = |node: &String| free.iter().position(|free| *free == node);

    // Normal equations of δa + δb = error, weighted.
    let mut normal = DMatrix::<f64>::zeros(free.len(), free.len());
    let mut right = DVector::<f64>::zeros(free.len());
    for pair in &pairs {
        let weight = (METRES_PER_TICK / pair.sigma_m).powi(2);
        let places: Vec<usize> = pair.nodes.iter().filter_map(place).collect();
        for &row in &places {
            right[row] += weight * pair.error_m / METRES_PER_TICK;
            for &column in &places {
                normal[(row, column)] += weight;
            }
        }
    }
    let (inverse, unseen) = pseudo_inverse(normal);
    let solution = &inverse * right;
    let correction = |node: &String| place(node).map_or(0.0, |place| solution[place]);
    for pair in &mut pairs {
        let [one, other] = &pair.nodes;
        pair.residual_m = pair.error_m - (correction(one) + correction(other)) * METRES_PER_TICK;
    }
    // Residuals that are larger than their deviations widen the uncertainty; smaller ones do not narrow it.
    let observed = free.len() - unseen.len();
    let chi2 = pairs.iter().map(|pair| (pair.residual_m / pair.sigma_m).powi(2)).sum::<f64>();
    let wider = if pairs.len() > observed { (chi2 / (pairs.len() - observed) as f64).max(1.0) } else { 1.0 };

    let delay = |node: &String| {
        let own: Vec<&Pair> = pairs.iter().filter(|pair| pair.nodes.contains(node)).collect();
        let sigma_ticks = match place(node) {
            None => Some(0.0),
            Some(place) if unseen.iter().any(|vector| vector[place].abs() > 1e-6) => None,
            Some(place) => Some((wider * inverse[(place, place)]).sqrt()),
        };
        Delay {
            node: node.clone(),
            correction_ticks: correction(node),
            sigma_ticks,
            pairs: own.len(),
            ranges: own.iter().map(|pair| pair.ranges).sum(),
        }
    };
    Calibration { delays: nodes.iter().map(delay).collect(), pairs }
}

/// The inverse of a symmetric matrix without the directions in which it is zero, and these directions.
fn pseudo_inverse(matrix: DMatrix<f64>) -> (DMatrix<f64>, Vec<DVector<f64>>) {
    let size = matrix.nrows();
    let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(matrix);
    let largest = eigenvalues.iter().copied().fold(0.0, f64::max);
    let (mut inverse, mut unseen) = (DMatrix::zeros(size, size), Vec::new());
    for (value, vector) in eigenvalues.iter().zip(eigenvectors.column_iter()) {
        if *value > ZERO * largest {
            inverse += vector * vector.transpose() / *value;
        } else {
            unseen.push(vector.into_owned());
        }
    }
    (inverse, unseen)
}

/// The pairs of nodes, with the errors of their ranges.
fn pairs(ranges: &[KnownRange]) -> Vec<Pair> {
    let mut by_nodes: BTreeMap<[String; 2], Vec<&KnownRange>> = BTreeMap::new();
    for range in ranges {
        let mut nodes = range.nodes.clone();
        nodes.sort();
        by_nodes.entry(nodes).or_default().push(range);
    }
    let pair = |(nodes, ranges): ([String; 2], Vec<&KnownRange>)| {
        let errors: Vec<f64> = ranges.iter().map(|range| range.range_m - range.distance_m).collect();
        let error_m = median(errors.clone());
        let noise_m = MAD * median(errors.iter().map(|error| (error - error_m).abs()).collect());
        let (mut places, mut last_m) = (0.0, f64::NEG_INFINITY);
        for range in &ranges {
            if (range.distance_m - last_m).abs() >= PLACE_M {
                (places, last_m) = (places + 1.0, range.distance_m);
            }
        }
        let variance = OF_MEDIAN * noise_m.powi(2) / errors.len() as f64 + LINK_M.powi(2) / places;
        Pair { nodes, ranges: errors.len(), error_m, sigma_m: variance.sqrt(), residual_m: 0.0 }
    };
    by_nodes.into_iter().map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three ranges of a pair, whose median is too long by this number of ticks.
    fn measured(one: &str, other: &str, ticks: f64) -> [KnownRange; 3] {
        [-0.02, 0.0, 0.5].map(|noise_m| KnownRange {
            nodes: [one.to_owned(), other.to_owned()],
            distance_m: 5.0,
            range_m: 5.0 + ticks * METRES_PER_TICK + noise_m,
        })
    }

    fn of<'a>(found: &'a Calibration, node: &str) -> &'a Delay {
        found.delays.iter().find(|delay| delay.node == node).expect("the node")
    }

    #[test]
    fn three_nodes_have_each_delay_and_two_only_their_sum() {
        // Delays 10, −4 and 25 ticks: sums 6, 35 and 21. The half sum of all is 31; less the sum of the others it is
        // the delay of each (APS014, 2.2).
        let ranges = [measured("a", "b", 6.0), measured("c", "a", 35.0), measured("b", "c", 21.0)].concat();
        let found = calibrate(&ranges, &[]);
        for (node, ticks) in [("a", 10.0), ("b", -4.0), ("c", 25.0)] {
            let delay = of(&found, node);
            assert!((delay.correction_ticks - ticks).abs() < 1e-6, "{delay:?}");
            // A delay is half of a sum of three errors: √3 ⁄ 2 times the deviation of an error. That is the root of
            // 0.063² and π ⁄ 2 · (1.4826 · 0.02)² ⁄ 3 = 0.0666 m, or 14.19 ticks of 4.6904 mm: 12.29 ticks.
            assert!(delay.sigma_ticks.is_some_and(|sigma| (sigma - 12.29).abs() < 0.01), "{delay:?}");
        }
        let pair = calibrate(&measured("a", "b", 6.0), &[]);
        assert!(pair.delays.iter().all(|delay| (delay.correction_ticks - 3.0).abs() < 1e-6), "{pair:?}");
        assert!(pair.delays.iter().all(|delay| delay.sigma_ticks.is_none()), "{pair:?}");
        let known = calibrate(&measured("a", "b", 6.0), &["b".to_owned()]);
        assert!((of(&known, "a").correction_ticks - 6.0).abs() < 1e-6 && of(&known, "a").sigma_ticks.is_some());
    }

    #[test]
    fn a_tag_and_anchors_have_sums_only_and_their_ranges_become_right() {
        let sums = [("tag", "a", 12.0), ("tag", "b", 20.0), ("tag", "c", -3.0)];
        let found = calibrate(&sums.map(|(one, other, ticks)| measured(one, other, ticks)).concat(), &[]);
        assert!(found.delays.iter().all(|delay| delay.sigma_ticks.is_none()), "{found:?}");
        assert!(found.pairs.iter().all(|pair| pair.residual_m.abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn pairs_that_contradict_each_other_are_averaged_and_widen_the_uncertainty() {
        // Four nodes without errors, but one pair is 60 ticks too long.
        let names = ["a", "b", "c", "d"];
        let pairs = (0..4).flat_map(|one| (one + 1..4).map(move |other| (names[one], names[other])));
        let ranges: Vec<_> = pairs
            .flat_map(|(one, other)| measured(one, other, if (one, other) == ("a", "b") { 60.0 } else { 0.0 }))
            .collect();
        let found = calibrate(&ranges, &[]);
        // Normal equations by hand: 2 δi + Σδ = ri, r = (60, 60, 0, 0), so Σδ = 120 ⁄ 6 = 20, δa = δb = 20, δc = δd =
        // −10. Residuals: 20 of ab and of cd, −10 of the four others; their squares add up to 1200 ticks², with six
        // pairs for four unknowns. One pair's deviation is 14.19 ticks: 1200 ⁄ 14.19² ⁄ 2 = 2.98.
        assert!((of(&found, "a").correction_ticks - 20.0).abs() < 1e-6, "{found:?}");
        assert!((of(&found, "d").correction_ticks + 10.0).abs() < 1e-6, "{found:?}");
        // The inverse of 2 I + J has (1 − 1 ⁄ 6) ⁄ 2 = 5 ⁄ 12 on its diagonal: √(2.98 · 5 ⁄ 12) · 14.19 = 15.8 ticks.
        let sigma = of(&found, "a").sigma_ticks.expect("observed");
        assert!((sigma - 15.8).abs() < 0.1, "{sigma}");
    }

    #[test]
    fn a_link_that_moves_tells_more_than_one_at_rest() {
        let at = |distance_m: f64| KnownRange {
            nodes: ["a".to_owned(), "b".to_owned()],
            distance_m,
            range_m: distance_m + 0.1,
        };
        let resting = pairs(&[at(3.0), at(3.1), at(3.2)]);
        let moving = pairs(&[at(3.0), at(4.0), at(5.0), at(6.0)]);
        // One place and four: half the deviation.
        assert!((resting[0].sigma_m - 0.063).abs() < 1e-9 && (moving[0].sigma_m - 0.0315).abs() < 1e-9);
    }
}
