//! Surveys that judge themselves: positions of stays by the others.

use std::collections::{BTreeMap, BTreeSet};

use positioning_core::ble::fingerprint::MapError;

use super::comparison::Comparison;
use super::maps::{Making, Maps, kernel};
use super::solve::{Setup, Solver};
use super::survey::Survey;
use crate::Solved;
use crate::files::beacons::{Capture, Dwell};

/// Positions of stays that their solver has not seen, in the survey's order: every fold's stays by a survey of the others.
/// `fold_of` tells which fold a stay is in, `None`: it is in every survey and never solved. `done` hears of each fold.
///
/// # Errors
/// What is left of the survey makes no map.
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
    // The kernels of many folds are alike.
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

/// What [`held_out`] solved.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// Which stays, in their order.
    pub stays: Vec<usize>,
    /// Their positions, by each comparison.
    pub solved: Vec<Vec<Solved>>,
}
