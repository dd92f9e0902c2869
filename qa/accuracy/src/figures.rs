//! The figures of one method on one recording.

use baliza_report::{Statistics, mean};

use super::{ScoredEpoch, begins_anew};

/// An error beyond this is an excursion, metres …
const FAR_M: f64 = 2.0;
/// … if it lasts for more than this number of epochs.
const FEW: usize = 3;
/// Consistency is also judged without the first epochs after a start, seconds.
const SETTLING_S: f64 = 1.0;

/// The figures of one method on one recording.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Figures {
    /// Epochs whose true position is known.
    pub epochs: usize,
    /// Those with a position.
    pub fixed: usize,
    /// Root mean square error, metres.
    pub rmse_m: Option<f64>,
    /// Mean error, metres.
    pub mae_m: Option<f64>,
    /// 90th percentile of the errors, metres.
    pub p90_m: Option<f64>,
    /// The share of errors inside the 1σ ellipse: 0.39 where the covariance is right.
    pub inside_1_sigma: Option<f64>,
    /// The mean squared error in units of its covariance: 2 where the covariance is right.
    pub nees: Option<f64>,
    /// The same without the first second of the recording and after each silence.
    pub nees_settled: Option<f64>,
    /// The longest excursion.
    pub excursion: Option<Excursion>,
}

/// Successive positions that are more than 2 m wrong; at least four of them.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Excursion {
    /// Number of positions.
    pub epochs: usize,
    /// The greatest error, metres.
    pub worst_m: f64,
}

impl Figures {
    /// The figures of epochs in the order of time.
    pub fn of(scored: &[ScoredEpoch]) -> Self {
        let errors: Vec<f64> = scored.iter().filter_map(|epoch| epoch.error_m).collect();
        let statistics = Statistics::of(&errors);
        let squares: Vec<f64> = scored.iter().filter_map(|epoch| epoch.normalised_square).collect();
        let inside = squares.iter().filter(|square| **square <= 1.0).count();
        let some_mean = |values: &[f64]| (!values.is_empty()).then(|| mean(values.iter().copied()));
        Self {
            epochs: scored.len(),
            fixed: errors.len(),
            rmse_m: statistics.map(|of| of.rmse),
            mae_m: statistics.map(|of| of.mae),
            p90_m: statistics.map(|of| of.p90),
            inside_1_sigma: (!squares.is_empty()).then(|| inside as f64 / squares.len() as f64),
            nees: some_mean(&squares),
            nees_settled: some_mean(&settled(scored)),
            excursion: longest_excursion(scored),
        }
    }
}

/// The normalised squares without the first second after each start.
fn settled(scored: &[ScoredEpoch]) -> Vec<f64> {
    let (mut begun_s, mut before_s) = (None, None);
    let mut squares = Vec::new();
    for epoch in scored {
        if begins_anew(before_s, epoch.t_s) {
            begun_s = None;
        }
        before_s = epoch.t_s;
        let begun_s = *begun_s.get_or_insert(epoch.t_s);
        if epoch.t_s.zip(begun_s).is_none_or(|(t_s, begun_s)| t_s >= begun_s + SETTLING_S) {
            squares.extend(epoch.normalised_square);
        }
    }
    squares
}

fn longest_excursion(scored: &[ScoredEpoch]) -> Option<Excursion> {
    let (mut longest, mut run): (Option<Excursion>, Option<Excursion>) = (None, None);
    // An epoch without a position neither continues nor ends an excursion.
    for error_m in scored.iter().filter_map(|epoch| epoch.error_m) {
        run = (error_m > FAR_M).then(|| match run {
            Some(Excursion { epochs, worst_m }) => Excursion { epochs: epochs + 1, worst_m: worst_m.max(error_m) },
            None => Excursion { epochs: 1, worst_m: error_m },
        });
        if run.map(|run| run.epochs) > longest.map(|longest| longest.epochs) {
            longest = run;
        }
    }
    longest.filter(|longest| longest.epochs > FEW)
}

#[cfg(test)]
mod tests {
    use super::{Excursion, Figures};
    use crate::ScoredEpoch;

    fn epochs(rows: &[(f64, Option<f64>, f64)]) -> Vec<ScoredEpoch> {
        let of = |&(t_s, error_m, square): &(f64, Option<f64>, f64)| ScoredEpoch {
            t_s: Some(t_s),
            error_m,
            normalised_square: error_m.map(|_| square),
        };
        rows.iter().map(of).collect()
    }

    #[test]
    fn consistency_is_judged_with_and_without_the_second_after_each_start() {
        // A silence of 20 s: the epochs at 0, 0.5, 21.5 and 22 s are within a second of a start.
        let rows = [
            (0.0, Some(1.0), 9.0),
            (0.5, None, 0.0),
            (1.0, Some(1.0), 1.0),
            (1.5, Some(1.0), 0.5),
            (21.5, Some(2.0), 7.0),
            (22.0, Some(2.0), 7.0),
            (22.5, Some(1.0), 3.0),
        ];
        let figures = Figures::of(&epochs(&rows));
        assert_eq!((figures.epochs, figures.fixed), (7, 6));
        // 12 ⁄ 6 for the squares 1 + 1 + 1 + 4 + 4 + 1; 27.5 ⁄ 6; 4.5 ⁄ 3; two of six inside.
        assert!(figures.rmse_m.is_some_and(|rmse| (rmse - 2.0_f64.sqrt()).abs() < 1e-12));
        assert!(figures.nees.is_some_and(|nees| (nees - 27.5 / 6.0).abs() < 1e-12));
        assert!(figures.nees_settled.is_some_and(|nees| (nees - 1.5).abs() < 1e-12));
        assert!(figures.inside_1_sigma.is_some_and(|share| (share - 2.0 / 6.0).abs() < 1e-12));
    }

    #[test]
    fn an_excursion_lasts_for_more_than_three_positions() {
        let of = |errors: &[Option<f64>]| {
            let rows: Vec<_> = errors.iter().enumerate().map(|(at, error)| (at as f64, *error, 1.0)).collect();
            Figures::of(&epochs(&rows)).excursion
        };
        let [near, far, farther] = [Some(0.1), Some(3.0), Some(5.0)];
        assert_eq!(of(&[near, far, far, farther, near, far]), None);
        assert_eq!(of(&[far, near, far, None, farther, far, far]), Some(Excursion { epochs: 4, worst_m: 5.0 }));
    }
}
