//! Positions of recorded ranges, as `baliza solve` and `baliza track` compute them, and their errors.

use accuracy::ScoredEpoch;
use analysis::Solver;
use analysis::locate::time_offset::clocks;
use analysis::locate::track::{Tracker, Weighting, settings};
use positioning_core::Method;
use positioning_core::engine::Settings;
use recording::{Epoch, Epochs, Solved, by_time};
use recording::{round_s, rounds};

use super::sites::Ranged;

/// Joins epochs and true positions by time. Returns the seconds that are added to the times of the truth: the known
/// ones, or an estimate by solved positions.
pub fn join_truth(ranged: &mut Ranged, known_s: Option<f64>) -> f64 {
    let Some(truth) = ranged.truth.take() else { return 0.0 };
    let offset_s = known_s.unwrap_or_else(|| clocks(&ranged.recording, ranged.setup, &truth).offset_s());
    truth.join(&mut ranged.recording.epochs, offset_s);
    offset_s
}

/// The position of each round by itself, and its error: as `baliza solve`, which makes rounds of single ranges.
pub fn solve(ranged: &Ranged) -> Vec<ScoredEpoch> {
    let solver = Solver::new(&ranged.recording.anchors, ranged.setup);
    let rounds = round_s(&ranged.recording.epochs).map(|longest_s| rounds(&ranged.recording.epochs, longest_s));
    let epochs = rounds.as_ref().unwrap_or(&ranged.recording.epochs);
    scored(epochs, &solver.solve_all(Method::Robust, epochs, |_| ()))
}

/// The positions by the engine with settings that `change` changes, and their errors.
pub fn track(ranged: &Ranged, change: impl FnOnce(&mut Settings<f32>)) -> Vec<ScoredEpoch> {
    let mut settings = settings(&ranged.setup, Weighting::Weigh);
    change(&mut settings);
    let epochs = &ranged.recording.epochs;
    let mut tracker = Tracker::new(&ranged.recording.anchors, ranged.setup, settings, None);
    let solved = tracker.follow_all(epochs, || ());
    scored(epochs, &solved)
}

/// The horizontal errors of the epochs with a known true position, in the order of time.
fn scored(epochs: &Epochs, solved: &[Solved]) -> Vec<ScoredEpoch> {
    let order = by_time(epochs.times_s()).into_iter();
    let score = |(epoch, solved): (Epoch, &Solved)| {
        let (truth, position) = (epoch.truth?, solved.outcome.ok());
        Some(ScoredEpoch {
            t_s: epoch.t_s,
            error_m: position.map(|position| position.place.horizontal_m(&truth)),
            normalised_square: position.map(|position| position.normalised_square(&truth)).filter(|s| s.is_finite()),
        })
    };
    order.filter_map(|at| score((epochs.get(at)?, solved.get(at)?))).collect()
}
