//! Cross-validation of a survey: positions of dwells by a map of the other dwells.

use std::collections::{BTreeMap, BTreeSet};

use positioning_core::ble::fingerprint::MapError;

use super::comparison::Comparison;
use super::maps::{Making, Maps, kernel};
use super::solve::{Setup, Solver};
use super::survey::Survey;
use recording::Solved;
use recording::beacons::{Capture, Dwell};

/// Positions of dwells that their solver has not seen, in the survey's order: the dwells of each fold by a map of the
/// others. `fold_of` gives the fold of a dwell; a dwell with `None` is in every map and is never solved. `done` is
/// called after each fold.
///
/// # Errors
/// The remaining dwells of a fold make no map.
pub fn held_out(
    stays: &[Dwell],
    making: Making,
    setup: &Setup,
    comparisons: &[Comparison],
    fold_of: impl Fn(usize) -> Option<usize>,
    done: impl Fn(),
) -> Result<HeldOut, MapError> {
    let survey = Survey::of(stays, setup.average);
    let folds: BTreeSet<usize> = (0..stays.len()).filter_map(&fold_of).collect();
    // The kernels of the folds are nearly equal, so that one is a guess for all.
    let guess = if folds.len() > 1 { kernel(&survey, making, comparisons)? } else { None };
    let mut solved: Vec<BTreeMap<usize, Solved>> = vec![BTreeMap::new(); comparisons.len()];
    for fold in folds {
        let maps = Maps::of(&survey.only(|stay| fold_of(stay) != Some(fold)), making, comparisons, guess)?;
        let solver = Solver { maps: &maps, setup };
        let held: Vec<usize> = (0..stays.len()).filter(|&stay| fold_of(stay) == Some(fold)).collect();
        let captures: Vec<Capture> = held.iter().map(|&stay| Capture::from(stays[stay].clone())).collect();
        for (&comparison, solved) in comparisons.iter().zip(&mut solved) {
            solved.extend(held.iter().copied().zip(solver.solve(comparison, &captures)?));
        }
        done();
    }
    let stays = (0..stays.len()).filter(|&stay| fold_of(stay).is_some()).collect();
    Ok(HeldOut { stays, solved: solved.into_iter().map(|solved| solved.into_values().collect()).collect() })
}

/// The result of [`held_out`].
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// The dwells, in their order.
    pub stays: Vec<usize>,
    /// Their positions, by each comparison.
    pub solved: Vec<Vec<Solved>>,
}
