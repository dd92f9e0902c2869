//! How well probabilities separate blocked from direct: area under the curve, accuracy, calibration.

/// Figures of one classifier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// The share of receptions on the right side of ½.
    pub accuracy: f64,
    /// The probability that a blocked reception has a higher score than a direct one (area under the receiver operating
    /// characteristic), a tie counting half. `None` where there is only one class.
    pub auc: Option<f64>,
    /// Mean square of probability minus truth (Brier).
    pub brier: f64,
    /// Number of receptions.
    pub count: usize,
}

impl Score {
    /// The score of pairs of a probability and whether the path was blocked; `None` without pairs.
    pub fn of(scored: &[(f32, bool)]) -> Option<Self> {
        let count = scored.len();
        if count == 0 {
            return None;
        }
        let right = scored.iter().filter(|(p, blocked)| (*p >= 0.5) == *blocked).count();
        let squares = scored.iter().map(|(p, blocked)| (f64::from(*p) - f64::from(u8::from(*blocked))).powi(2));
        Some(Self {
            accuracy: right as f64 / count as f64,
            auc: area(scored),
            brier: squares.sum::<f64>() / count as f64,
            count,
        })
    }
}

/// By ranks (Mann and Whitney): (Σ ranks of blocked − n(n + 1)/2)/(n·m), equal scores sharing their mean rank.
fn area(scored: &[(f32, bool)]) -> Option<f64> {
    let mut sorted = scored.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let blocked = scored.iter().filter(|(_, blocked)| *blocked).count();
    let direct = scored.len() - blocked;
    if blocked == 0 || direct == 0 {
        return None;
    }
    let mut below = 0;
    let mut ranks = 0.0;
    for equal in sorted.chunk_by(|a, b| a.0 == b.0) {
        let mean_rank = below as f64 + (equal.len() as f64 + 1.0) / 2.0;
        ranks += mean_rank * equal.iter().filter(|(_, blocked)| *blocked).count() as f64;
        below += equal.len();
    }
    let n = blocked as f64;
    Some((ranks - n * (n + 1.0) / 2.0) / (n * direct as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_of_a_hand_calculation() {
        // Blocked 0.9, 0.4, 0.4; direct 0.4, 0.1. Of six pairs, 0.9 wins two, each 0.4 wins one and ties one: 2 + 1.5 +
        // 1.5 = 5 of 6.
        let scored = [(0.9, true), (0.4, true), (0.4, true), (0.4, false), (0.1, false)];
        let score = Score::of(&scored).expect("some");
        assert!((score.auc.expect("two classes") - 5.0 / 6.0).abs() < 1e-12);
        // Right: 0.9, 0.4 direct, 0.1. Brier: (0.01 + 0.36 + 0.36 + 0.16 + 0.01)/5 = 0.18.
        assert!((score.accuracy - 0.6).abs() < 1e-12 && (score.brier - 0.18).abs() < 1e-6);
        assert_eq!(score.count, 5);
    }

    #[test]
    fn area_is_that_of_scikit_learn() {
        // sklearn 1.9: roc_auc_score([i % 3 == 0 for i in range(40)], [(i * 7919 % 101) / 101 for i in range(40)]).
        let scored: Vec<_> = (0..40_u32).map(|i| ((i * 7919 % 101) as f32 / 101.0, i % 3 == 0)).collect();
        let auc = Score::of(&scored).and_then(|score| score.auc).expect("two classes");
        assert!((auc - 0.494_505_494_505_494_5).abs() < 1e-9, "{auc}");
    }

    #[test]
    fn one_class_has_no_area_and_none_no_score() {
        assert_eq!(Score::of(&[(0.3, true)]).and_then(|score| score.auc), None);
        assert_eq!(Score::of(&[]), None);
    }
}
