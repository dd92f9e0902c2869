//! Positions of recorded ranges, as `baliza solve` and `baliza track` compute them, and their errors.

use baliza_research::accuracy::Scored;
use host_tools::locate::track::{Tracker, Weighting, settings};
use host_tools::{Epoch, Solved, Solver, by_time};
use positioning_core::Method;
use positioning_core::engine::Settings;

use super::clock::horizontal_m;
use super::sites::Ranged;

/// Joins epochs and true positions by time. Returns the offset of the truth's clock, seconds: the known one, or an
/// estimate by solved positions.
pub fn join_truth(ranged: &mut Ranged, known_s: Option<f64>) -> f64 {
    let Some(truth) = ranged.truth.take() else { return 0.0 };
    let offset_s = known_s.unwrap_or_else(|| truth.offset_s(&ranged.recording.epochs, &solve(ranged)));
    truth.join(&mut ranged.recording.epochs, offset_s);
    offset_s
}

/// The position of each epoch by itself, in the order of the epochs.
pub fn solve(ranged: &Ranged) -> Vec<Solved> {
    let solver = Solver::new(&ranged.recording.anchors, ranged.setup);
    ranged.recording.epochs.iter().map(|epoch| solver.solve(Method::Robust, epoch)).collect()
}

/// The positions by the engine with settings that `change` changes, in the order of the epochs.
pub fn track(ranged: &Ranged, change: impl FnOnce(&mut Settings<f32>)) -> Vec<Solved> {
    let mut settings = settings(&ranged.setup, Weighting::Weigh, false);
    change(&mut settings);
    let epochs = &ranged.recording.epochs;
    let mut tracker = Tracker::new(&ranged.recording.anchors, ranged.setup, settings, None);
    let mut solved = vec![None; epochs.len()];
    for at in by_time(epochs.iter().map(|epoch| epoch.t_s)) {
        solved[at] = Some(tracker.follow(&epochs[at]));
    }
    solved.into_iter().flatten().collect()
}

/// The horizontal errors of the epochs with a known true position, in the order of time.
pub fn scored(epochs: &[Epoch], solved: &[Solved]) -> Vec<Scored> {
    let order = by_time(epochs.iter().map(|epoch| epoch.t_s)).into_iter();
    let score = |(epoch, solved): (&Epoch, &Solved)| {
        let (truth, position) = (epoch.truth?, solved.outcome.ok());
        Some(Scored {
            t_s: epoch.t_s,
            error_m: position.map(|position| horizontal_m(&position.place, &truth)),
            normalised_square: position.map(|position| position.normalised_square(&truth)).filter(|s| s.is_finite()),
        })
    };
    order.filter_map(|at| score((epochs.get(at)?, solved.get(at)?))).collect()
}
