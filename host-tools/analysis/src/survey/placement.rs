//! Where to put beacons or anchors: the positions with the least error over an area.
//!
//! The input is candidates, each with its information on a tag in every cell ([`Information`]). The output is the
//! chosen ones, the best first. The search adds the candidate that lowers the mean error most, one after the other.
//! Then it exchanges chosen positions for others while that helps. A. Linde Cerezo's thesis (Universitat Oberta de
//! Catalunya, 2024) asks for such a search before a deployment (future work 5).

use crate::survey::coverage::bound::Information;
use baliza_report::mean;

/// The information of candidates in every cell; `None` where the cell does not receive the candidate.
#[derive(Clone, Debug, Default)]
pub struct Problem {
    /// The prior information in every cell: the area, and the stations that are already installed.
    pub known: Vec<Information>,
    /// One list a candidate.
    pub candidates: Vec<Vec<Option<Information>>>,
}

/// The result of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Candidates by number, in the order in which they were added or exchanged in.
    pub chosen: Vec<usize>,
    /// The mean error without any candidate, and after each that was added, metres.
    pub added_m: Vec<f64>,
    /// The mean error at the end, metres.
    pub error_m: f64,
    /// Number of exchanges.
    pub exchanged: usize,
}

/// Least share of the error that an exchange must gain, so that the search ends.
const GAIN: f64 = 1e-6;

impl Problem {
    /// Chooses `count` candidates, or all where there are fewer; `step` is called for each mean error that is
    /// computed.
    pub fn solve(&self, count: usize, step: impl Fn()) -> Found {
        let mut found =
            Found { chosen: Vec::new(), added_m: Vec::new(), error_m: mean_error_m(&self.known), exchanged: 0 };
        found.added_m.push(found.error_m);
        let mut sum = self.known.clone();
        while found.chosen.len() < count.min(self.candidates.len()) {
            let Some((best, error_m)) = self.best(&sum, &found.chosen, &step) else { break };
            self.add(&mut sum, best);
            found.chosen.push(best);
            found.error_m = error_m;
            found.added_m.push(error_m);
        }
        // Each round tries to exchange every chosen candidate once.
        let mut improved = true;
        while improved {
            improved = false;
            for place in 0..found.chosen.len() {
                let mut others = self.known.clone();
                let rest = found.chosen.iter().enumerate().filter(|(other, _)| *other != place);
                rest.for_each(|(_, candidate)| self.add(&mut others, *candidate));
                let Some((best, error_m)) = self.best(&others, &found.chosen, &step) else { continue };
                if error_m < found.error_m * (1.0 - GAIN) {
                    found.chosen[place] = best;
                    found.error_m = error_m;
                    found.exchanged += 1;
                    improved = true;
                }
            }
        }
        found
    }

    /// The error in each cell with these candidates, metres.
    pub fn errors_m(&self, chosen: &[usize]) -> Vec<f64> {
        let mut sum = self.known.clone();
        chosen.iter().for_each(|candidate| self.add(&mut sum, *candidate));
        sum.into_iter().map(Information::error_m).collect()
    }

    fn add(&self, sum: &mut [Information], candidate: usize) {
        let told = self.candidates.get(candidate).into_iter().flatten();
        sum.iter_mut().zip(told).for_each(|(sum, told)| *sum = sum.and(told.unwrap_or_default()));
    }

    /// The candidate, not chosen yet, with which the mean error is least.
    fn best(&self, sum: &[Information], chosen: &[usize], step: &impl Fn()) -> Option<(usize, f64)> {
        let errors = self.candidates.iter().enumerate().filter(|(candidate, _)| !chosen.contains(candidate));
        let errors = errors.map(|(candidate, told)| {
            step();
            let all = sum.iter().zip(told).map(|(sum, told)| sum.and(told.unwrap_or_default()).error_m());
            (candidate, all.sum::<f64>() / sum.len() as f64)
        });
        errors.min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

fn mean_error_m(known: &[Information]) -> f64 {
    mean(known.iter().map(|known| known.error_m()))
}

#[cfg(test)]
mod tests {
    use positioning_core::ble::path_loss::PathLoss;

    use super::Problem;
    use crate::survey::coverage::Grid;
    use crate::survey::coverage::bound::{Information, Noise, Station};

    /// Anchors on the border of and within a square of 10 m, every 2.5 m; ranges of 0.1 m.
    fn square() -> Problem {
        let places = (0..25).map(|i| [2.5 * f64::from(i % 5), 2.5 * f64::from(i / 5)]);
        let grid = Grid { least_m: [0.0; 2], cell_m: 1.0, columns: 10, rows: 10 };
        let noise = Noise::Range { deviation_m: 0.1, wall_m: 0.0, reach_m: 100.0 };
        let told = |at_m| {
            let station = Station { at_m, path_loss: PathLoss::default() };
            grid.middles().map(|tag| station.information(tag, &[], noise)).collect()
        };
        Problem {
            known: grid.middles().map(|_| Information::of_area([10.0; 2])).collect(),
            candidates: places.map(told).collect(),
        }
    }

    fn mean(errors: &[f64]) -> f64 {
        errors.iter().sum::<f64>() / errors.len() as f64
    }

    #[test]
    fn the_search_finds_what_trying_all_finds() {
        let problem = square();
        let found = problem.solve(3, || ());
        let mut least = f64::INFINITY;
        for a in 0..25 {
            for b in 0..a {
                for c in 0..b {
                    least = least.min(mean(&problem.errors_m(&[a, b, c])));
                }
            }
        }
        assert!(found.error_m < 1.02 * least, "{found:?}, the least of all is {least}");
        assert!((found.error_m - mean(&problem.errors_m(&found.chosen))).abs() < 1e-12);
        // No information but the area: √(10²/12 + 10²/12).
        assert!((found.added_m[0] - (200.0_f64 / 12.0).sqrt()).abs() < 1e-9);
        assert!(found.added_m.windows(2).all(|pair| pair[1] < pair[0]), "{found:?}");
    }

    #[test]
    fn four_anchors_of_a_square_go_to_the_middles_of_its_sides() {
        let problem = square();
        let mut found = problem.solve(4, || ());
        found.chosen.sort_unstable();
        // By number 2 and 22 below and above, 10 and 14 left and right; the corners are 0, 4, 20 and 24.
        assert_eq!(found.chosen, [2, 10, 14, 22]);
        assert!(found.exchanged > 0 && found.error_m < mean(&problem.errors_m(&[0, 4, 20, 24])), "{found:?}");
        assert_eq!(problem.solve(99, || ()).chosen.len(), 25, "there are no more");
    }
}
