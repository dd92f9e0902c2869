//! The k nearest neighbours (Barral et al., 3.1: k = 47, city-block distance, equation 1): the share of them that is
//! blocked.
//!
//! The same code works with all receptions of a training on a desktop and with a reduced set of prototypes on a node.
//! Coordinates are in steps of 1/256 deviation, two bytes each, read from flash without a copy.

use heapless::Vec;

use super::{Classifier, Feature, Features, Inputs};

/// The most neighbours that vote.
pub const MAX_NEIGHBOURS: usize = 47;

/// Receptions that are known to be direct or blocked.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Nearest<'a> {
    /// The inputs.
    pub inputs: Inputs,
    /// k: the number of neighbours that vote, 1 to [`MAX_NEIGHBOURS`].
    pub neighbours: u8,
    /// Direct paths: for each, one coordinate per input, made by [`Nearest::coordinate`].
    pub los: &'a [u8],
    /// Blocked paths, in the same form.
    pub nlos: &'a [u8],
}

impl Nearest<'_> {
    /// The two bytes of one input.
    pub fn coordinate(input: f32) -> [u8; 2] {
        steps(input).to_le_bytes()
    }

    /// The number of receptions.
    pub fn prototypes(&self) -> usize {
        (self.los.len() + self.nlos.len()) / (2 * self.inputs.len().max(1))
    }
}

/// A coordinate in steps of 1/256; a conversion to an integer saturates.
fn steps(input: f32) -> i16 {
    (input * 256.0) as i16
}

/// A prototype among the nearest.
#[derive(Clone, Copy)]
struct Neighbour {
    distance: u32,
    blocked: bool,
}

impl Classifier for Nearest<'_> {
    fn name(&self) -> &'static str {
        // Fewer neighbours vote where each prototype represents many receptions.
        if usize::from(self.neighbours) == MAX_NEIGHBOURS { "nearest" } else { "nearest-reduced" }
    }

    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        self.inputs.for_each_feature(visit);
    }

    fn nlos_probability(&self, features: &Features) -> Option<f32> {
        let inputs = self.inputs.of(features)?;
        let most = usize::from(self.neighbours).min(MAX_NEIGHBOURS);
        // The nearest prototypes so far, the nearest first.
        let mut near: Vec<Neighbour, MAX_NEIGHBOURS> = Vec::new();
        for (prototypes, blocked) in [(self.los, false), (self.nlos, true)] {
            for prototype in prototypes.chunks_exact(2 * inputs.len().max(1)) {
                let coordinates = prototype.as_chunks::<2>().0.iter();
                let distance = coordinates
                    .zip(&inputs)
                    .map(|(&bytes, &input)| i32::from(i16::from_le_bytes(bytes)).abs_diff(i32::from(steps(input))))
                    .sum();
                if near.len() == most {
                    if near.last().is_some_and(|farthest| farthest.distance <= distance) {
                        continue;
                    }
                    near.pop();
                }
                let place = near.iter().position(|other| other.distance > distance).unwrap_or(near.len());
                // There is room: a full list has lost its last entry.
                let _ = near.insert(place, Neighbour { distance, blocked });
            }
        }
        let blocked = near.iter().filter(|neighbour| neighbour.blocked).count();
        // Laplace's rule of succession: none of 47 is rare, not impossible.
        (!near.is_empty()).then(|| (blocked as f32 + 1.0) / (near.len() as f32 + 2.0))
    }

    fn is_sane(&self) -> bool {
        let whole = |prototypes: &[u8]| prototypes.len().is_multiple_of(2 * self.inputs.len());
        self.inputs.is_sane()
            && whole(self.los)
            && whole(self.nlos)
            && (1..=MAX_NEIGHBOURS.min(self.prototypes())).contains(&usize::from(self.neighbours))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nlos::testing::{at, two_inputs};

    fn bytes(points: &[[f32; 2]]) -> std::vec::Vec<u8> {
        points.iter().flatten().flat_map(|&x| Nearest::coordinate(x)).collect()
    }

    fn nearest<'a>(los: &'a [u8], nlos: &'a [u8], neighbours: u8) -> Nearest<'a> {
        Nearest { inputs: two_inputs(), neighbours, los, nlos }
    }

    #[test]
    fn neighbours_are_near_by_city_blocks() {
        // From (0, 0), the city-block distance is 1.5 to the blocked (0.75, 0.75) and 1.25 to the direct (1.25, 0).
        // The Euclidean distances are 1.06 and 1.25.
        let (los, nlos) = (bytes(&[[1.25, 0.0]]), bytes(&[[0.75, 0.75]]));
        let one = nearest(&los, &nlos, 1);
        assert_eq!(one.prototypes(), 2);
        // None of one: (0 + 1)/(1 + 2).
        assert_eq!(one.nlos_probability(&at(0.0, 0.0)), Some(1.0 / 3.0));
        assert_eq!(nearest(&los, &nlos, 2).nlos_probability(&at(0.0, 0.0)), Some(0.5));
    }

    #[test]
    fn votes_are_those_of_an_exhaustive_search() {
        // A lattice of 200 points, blocked where (x + y) is large. The reference sorts all of them.
        let points: std::vec::Vec<[f32; 2]> =
            (0..200).map(|i| [(i % 20) as f32 / 4.0 - 2.5, (i / 20) as f32 / 4.0 - 1.2]).collect();
        let (nlos, los): (std::vec::Vec<[f32; 2]>, std::vec::Vec<[f32; 2]>) =
            points.iter().partition(|p| p[0] + p[1] > 0.3);
        let (los_bytes, nlos_bytes) = (bytes(&los), bytes(&nlos));
        let classifier = nearest(&los_bytes, &nlos_bytes, 47);
        let mut seen = [false; 2];
        for i in 0..50 {
            let (x, y) = (i as f32 * 0.077 - 1.9, i as f32 * 0.0531 - 1.3);
            let mut all: std::vec::Vec<(f32, bool)> = los
                .iter()
                .map(|p| (p, false))
                .chain(nlos.iter().map(|p| (p, true)))
                .map(|(p, blocked)| ((p[0] - x).abs() + (p[1] - y).abs(), blocked))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            let votes = all[..47].iter().filter(|(_, blocked)| *blocked).count() as f32;
            let p = classifier.nlos_probability(&at(x, y)).expect("known");
            // The step of a coordinate may swap two points of equal distance, within 2/256.
            assert!((p - (votes + 1.0) / 49.0).abs() <= 1.01 / 49.0, "{p} {votes}");
            seen[usize::from(votes > 23.0)] = true;
        }
        assert_eq!(seen, [true; 2]);
    }

    #[test]
    fn without_prototypes_or_features_nothing_is_known() {
        assert_eq!(nearest(&[], &[], 3).nlos_probability(&at(0.0, 0.0)), None);
        assert_eq!(nearest(&[0; 8], &[], 3).nlos_probability(&Features::default()), None);
    }
}
