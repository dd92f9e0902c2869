//! The measurements of one link.

use rand::Rng;

use super::{CaseConditions, CaseRange, Powers, distance, happens};
use crate::draw::{between, normal, uniform};
use crate::field::Field;

/// A blocked link loses more ranges than a direct one: this share of all.
const BLOCKED_LOSS: f64 = 0.1;
/// Least and greatest excess of a blocked link, metres.
const EXCESS_M: [f64; 2] = [0.2, 1.5];
/// The least error of a wild range, and the mean of what exceeds it, metres.
const WILD_M: [f64; 2] = [1.0, 3.0];
/// The share of wild ranges that are too long.
const WILD_TOO_LONG: f64 = 0.8;
/// No range is shorter, metres.
const LEAST_RANGE_M: f64 = 0.05;
/// Received power at one metre, dBm, which falls with the square of the distance, and its deviation, dB.
const POWER: [f64; 2] = [-65.0, 2.0];
/// What a blocked link loses of its received power, dB.
const BLOCKED_DB: [f64; 2] = [3.0, 10.0];

/// A link between the tag and an anchor.
pub(super) struct Link {
    lasting_m: f64,
    lasting: Field<3>,
    blocked: Field<3>,
    excess: Field<3>,
    /// Deviation of what a noisy blocked link adds to each range, metres; 0 for a quiet one.
    noisy_m: f64,
    blocked_db: f64,
    /// Mean difference of the powers where they are misleading, dB.
    misleading_db: f64,
}

impl Link {
    pub(super) fn draw(random: &mut impl Rng, conditions: &CaseConditions) -> Self {
        Self {
            lasting_m: between(random, 0.03, 0.12),
            lasting: Field::draw(random, conditions.lasting_length_m),
            blocked: Field::draw(random, conditions.blocked_length_m),
            excess: Field::draw(random, conditions.blocked_length_m),
            noisy_m: if happens(random, 0.5) { between(random, 0.1, 0.5) } else { 0.0 },
            blocked_db: between(random, BLOCKED_DB[0], BLOCKED_DB[1]),
            misleading_db: between(random, 0.0, 12.0),
        }
    }

    /// A range to the anchor with index 0, or `None` where it is lost.
    pub(super) fn range(
        &self,
        random: &mut impl Rng,
        conditions: &CaseConditions,
        at_m: &[f64; 3],
        anchor_m: &[f64; 3],
    ) -> Option<CaseRange> {
        let blocked = self.blocked.share_at(at_m) < conditions.blocked;
        let true_m = distance(at_m, anchor_m);
        let direct_m =
            conditions.common_m + self.lasting_m * self.lasting.at(at_m) + conditions.white_m * normal(random);
        let excess_m = if blocked { self.excess_m(at_m) + self.noisy_m * normal(random).abs() } else { 0.0 };
        let wild = happens(random, conditions.wild);
        let wild_m = if wild { wild_m(random) } else { 0.0 };
        let powers_dbm = self.powers_dbm(random, conditions.powers, true_m, blocked);
        let lost = happens(random, conditions.loss + if blocked { BLOCKED_LOSS } else { 0.0 });
        let range_m = (true_m + direct_m + excess_m + wild_m).max(LEAST_RANGE_M);
        let range_m = (range_m * 1e3).round() / 1e3;
        (!lost).then_some(CaseRange { anchor: 0, range_m, powers_dbm, blocked, wild })
    }

    /// The excess of a blocked range that lasts, metres: its logarithm is evenly distributed.
    fn excess_m(&self, at_m: &[f64; 3]) -> f64 {
        let [least, greatest] = EXCESS_M.map(f64::ln);
        (least + (greatest - least) * self.excess.share_at(at_m)).exp()
    }

    /// Received power and first-path power, dBm.
    fn powers_dbm(&self, random: &mut impl Rng, powers: Powers, true_m: f64, blocked: bool) -> Option<[f64; 2]> {
        let [at_1m, deviation] = POWER;
        let shadow = if blocked { self.blocked_db } else { 0.0 };
        let received = at_1m - 20.0 * true_m.max(0.1).log10() - shadow + deviation * normal(random);
        let white = normal(random);
        let difference = match (powers, blocked) {
            (Powers::Absent, _) => return None,
            (Powers::Informative, false) => 2.0 + 1.5 * white,
            (Powers::Informative, true) => 8.0 + 2.5 * white,
            (Powers::Weak, false) => 3.0 + 2.5 * white,
            (Powers::Weak, true) => 4.5 + 2.5 * white,
            (Powers::Misleading, _) => self.misleading_db + 1.5 * white,
            (Powers::Reversed, false) => 7.0 + 2.0 * white,
            (Powers::Reversed, true) => 3.0 + 2.0 * white,
        };
        Some([received, received - difference].map(|dbm| (dbm * 1e2).round() / 1e2))
    }
}

/// The error of a wild range, metres.
fn wild_m(random: &mut impl Rng) -> f64 {
    let size = WILD_M[0] - WILD_M[1] * uniform(random).ln();
    if happens(random, WILD_TOO_LONG) { size } else { -size }
}
