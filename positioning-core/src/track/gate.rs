//! Gates decide whether a measurement can belong to the track. Each source has its own gate with its own memory. A
//! gate reopens: if a source repeats the same measurement, it is accepted in the end, with an error of its own.

use crate::Real;

/// The decision of a gate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GateDecision {
    /// The measurement belongs to the track.
    Accept,
    /// The measurement does not belong to the track.
    Reject,
    /// Several measurements in a row did not belong to the track, and they were similar: the source has changed.
    Reopen,
}

/// The gate of one source.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Gate<T> {
    /// The number of similar measurements that it has refused in a row.
    alike: u8,
    /// The innovation of the last measurement that it refused.
    last: T,
}

impl<T: Real> Gate<T> {
    /// As `check`, for a range that is `excess` longer than the distance to the anchor. A range that is shorter than
    /// the distance by more than `limit` deviations never reopens the gate. Walls and detours lengthen a range; only
    /// a fault or a forgery shortens it.
    pub(crate) fn judge_range(&mut self, innovation: T, excess: T, s: T, limit: T, patience: u8) -> GateDecision {
        let is_short = excess < T::ZERO && excess.squared() > limit.squared() * s;
        match self.check(innovation, s, limit, patience) {
            GateDecision::Reopen if is_short => GateDecision::Reject,
            passage @ (GateDecision::Accept | GateDecision::Reject | GateDecision::Reopen) => passage,
        }
    }

    /// Checks an innovation of variance `s`. It is refused beyond `limit` deviations, unless it is the `patience`-th
    /// similar one.
    pub(crate) fn check(&mut self, innovation: T, s: T, limit: T, patience: u8) -> GateDecision {
        let bound = limit.squared() * s;
        if innovation.squared() <= bound {
            self.alike = 0;
            return GateDecision::Accept;
        }
        let like_last = self.alike > 0 && (innovation - self.last).squared() <= bound;
        self.alike = if like_last { self.alike.saturating_add(1) } else { 1 };
        self.last = innovation;
        if self.alike < patience {
            return GateDecision::Reject;
        }
        self.alike = 0;
        GateDecision::Reopen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Variance 0.01 m², limit 3: 0.3 m.
    fn check(gate: &mut Gate<f64>, innovation: f64) -> GateDecision {
        gate.check(innovation, 0.01, 3.0, 3)
    }

    #[test]
    fn a_source_that_insists_is_let_in_at_last() {
        let mut gate = Gate::default();
        let heard = [0.29, 1.0, 1.1, 0.9, 1.0, 0.0].map(|innovation| check(&mut gate, innovation));
        use GateDecision::{Accept, Reject, Reopen};
        assert_eq!(heard, [Accept, Reject, Reject, Reopen, Reject, Accept]);
    }

    #[test]
    fn a_range_shorter_than_the_way_never_reopens_its_gate() {
        let range = |gate: &mut Gate<f64>, innovation, excess| gate.judge_range(innovation, excess, 0.01, 3.0, 3);
        let mut gate = Gate::default();
        for _ in 0..100 {
            assert_eq!(range(&mut gate, -1.0, -1.0), GateDecision::Reject);
        }
        // A range that is too long still reopens the gate, and a range that agrees passes.
        let heard = [1.0, 1.0, 1.0, -0.1].map(|innovation| range(&mut gate, innovation, innovation));
        assert_eq!(heard, [GateDecision::Reject, GateDecision::Reject, GateDecision::Reopen, GateDecision::Accept]);
        // A wall that made the range 2 m longer, as expected, is gone: the range is shorter than expected, and equal
        // to the distance.
        let heard = [-2.0; 3].map(|innovation| range(&mut gate, innovation, 0.0));
        assert_eq!(heard, [GateDecision::Reject, GateDecision::Reject, GateDecision::Reopen]);
    }

    #[test]
    fn wild_values_never_open_it_and_a_good_one_makes_it_forget() {
        let mut gate = Gate::default();
        for wild in [5.0, -3.0, 40.0, 7.0, 90.0, 2.0] {
            assert_eq!(check(&mut gate, wild), GateDecision::Reject);
        }
        for innovation in [2.1, 0.0, 2.1, 2.1] {
            assert_ne!(check(&mut gate, innovation), GateDecision::Reopen);
        }
    }
}
