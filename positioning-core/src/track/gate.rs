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
    /// The time since the first of them, seconds.
    waited_s: T,
}

/// The least number of similar measurements that reopen a gate.
const LEAST_ALIKE: u8 = 3;

impl<T: Real> Gate<T> {
    /// Whether it has refused similar measurements in a row, and is not yet open for them.
    pub(crate) fn refuses(&self) -> bool {
        self.alike > 1
    }

    /// Checks an innovation of variance `s`, `age_s` after the former one of its source. It is refused beyond `limit`
    /// deviations, unless similar ones have been refused for `patience_s` seconds.
    pub(crate) fn check(&mut self, innovation: T, s: T, limit: T, [age_s, patience_s]: [T; 2]) -> GateDecision {
        let bound = limit.squared() * s;
        if innovation.squared() <= bound {
            self.alike = 0;
            return GateDecision::Accept;
        }
        let like_last = self.alike > 0 && (innovation - self.last).squared() <= bound;
        (self.alike, self.waited_s) =
            if like_last { (self.alike.saturating_add(1), self.waited_s + age_s) } else { (1, T::ZERO) };
        self.last = innovation;
        if self.alike < LEAST_ALIKE || self.waited_s < patience_s {
            return GateDecision::Reject;
        }
        self.alike = 0;
        GateDecision::Reopen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Variance 0.01 m², limit 3: 0.3 m. Ten measurements a second, and patience for two more of them.
    fn check(gate: &mut Gate<f64>, innovation: f64) -> GateDecision {
        gate.check(innovation, 0.01, 3.0, [0.1, 0.2])
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
