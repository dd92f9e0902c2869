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
