//! The chip maker's rule: if the received power minus that of the first path is below 6 dB, the path is probably
//! direct. Above 10 dB it is probably blocked (DW1000 user manual, 4.7).

use super::{Classifier, Feature, Features, sigmoid};

/// A sigmoid over the difference of powers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PowerDifference {
    /// The difference at which direct and blocked are equally likely, dB.
    pub middle_db: f32,
    /// The growth of the logarithm of the odds, 1/dB.
    pub slope: f32,
}

impl Default for PowerDifference {
    /// "Probably" is taken as nine in ten: ln 9 at 10 dB, −ln 9 at 6 dB.
    fn default() -> Self {
        Self { middle_db: 8.0, slope: 1.098_612_3 }
    }
}

impl Classifier for PowerDifference {
    fn name(&self) -> &'static str {
        "power-difference"
    }

    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        visit(Feature::PowerDifference);
    }

    fn nlos_probability(&self, features: &Features) -> Option<f32> {
        Some(sigmoid(self.slope * (features.get(Feature::PowerDifference)? - self.middle_db)))
    }

    fn is_sane(&self) -> bool {
        self.middle_db.is_finite() && self.slope.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rule_says_probably_where_the_manual_does() {
        let rule = PowerDifference::default();
        let p = |db: f32| {
            let mut features = Features::default();
            features.set(Feature::PowerDifference, db);
            rule.nlos_probability(&features)
        };
        for (db, expected) in [(6.0, 0.1), (8.0, 0.5), (10.0, 0.9)] {
            assert!((p(db).expect("known") - expected).abs() < 1.0e-5, "{db}");
        }
        assert_eq!(p(f32::NAN), None);
        assert_eq!([p(-1.0e30), p(1.0e30)].map(|p| p.map(|p| (p * 1000.0) as u32)), [Some(0), Some(1000)]);
    }
}
