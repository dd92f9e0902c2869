//! Blocks of successive epochs, and the ratio of two errors by them.

use super::{ScoredEpoch, begins_anew};

/// A block ends when it is this long, seconds …
const BLOCK_S: f64 = 5.0;
/// … or, where epochs have no time, when it has this number of epochs.
const BLOCK_EPOCHS: usize = 50;
/// From this number of recordings on, their scatter counts as an uncertainty.
const SCATTER_OF: usize = 3;

/// The sums of successive epochs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Block {
    /// Epochs whose true position is known.
    pub epochs: usize,
    /// Those with a position.
    pub fixed: usize,
    /// The sum of the errors, metres.
    pub sum_m: f64,
    /// The sum of the squared errors, m².
    pub sum_m2: f64,
}

/// The error that is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// The root mean square error.
    Rmse,
    /// The mean error.
    Mean,
}

/// The logarithm of a ratio of two errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogRatio {
    /// The logarithm; below 0 the first error is less.
    pub value: f64,
    /// Its standard error; infinite where it is not known.
    pub deviation: f64,
}

/// The blocks of epochs in the order of time. They depend on the times of all epochs, and not on their results.
pub fn blocks(scored: &[ScoredEpoch]) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let (mut begun_s, mut before_s) = (None, None);
    for epoch in scored {
        let is_full = match epoch.t_s.zip(begun_s) {
            Some((t_s, begun_s)) => t_s >= begun_s + BLOCK_S,
            None => blocks.last().is_some_and(|block| block.epochs >= BLOCK_EPOCHS),
        };
        if blocks.is_empty() || is_full || begins_anew(before_s, epoch.t_s) {
            blocks.push(Block::default());
            begun_s = epoch.t_s;
        }
        before_s = epoch.t_s;
        if let Some(block) = blocks.last_mut() {
            let error_m = epoch.error_m.unwrap_or_default();
            block.epochs += 1;
            block.fixed += usize::from(epoch.error_m.is_some());
            block.sum_m += error_m;
            block.sum_m2 += error_m * error_m;
        }
    }
    blocks
}

impl Block {
    /// The sum of several blocks.
    pub fn sum<'b>(blocks: impl IntoIterator<Item = &'b Self>) -> Self {
        blocks.into_iter().fold(Self::default(), |a, b| Self {
            epochs: a.epochs + b.epochs,
            fixed: a.fixed + b.fixed,
            sum_m: a.sum_m + b.sum_m,
            sum_m2: a.sum_m2 + b.sum_m2,
        })
    }

    /// Its error, metres; `None` without a position.
    pub fn error_m(&self, measure: Measure) -> Option<f64> {
        (self.fixed > 0).then(|| match measure {
            Measure::Rmse => (self.sum_m2 / self.fixed as f64).sqrt(),
            Measure::Mean => self.sum_m / self.fixed as f64,
        })
    }

    fn without(&self, other: &Self) -> Self {
        Self {
            epochs: self.epochs - other.epochs,
            fixed: self.fixed - other.fixed,
            sum_m: self.sum_m - other.sum_m,
            sum_m2: self.sum_m2 - other.sum_m2,
        }
    }
}

/// The ratio of two methods' errors on one recording, whose blocks are pairs. The standard error is that of the
/// jackknife (B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982, chapter 3), which leaves out one
/// pair at a time: √((k − 1) ⁄ k · Σ(θᵢ − θ̄)²). `None` where a method has no position or no error.
pub fn ratio(measure: Measure, new: &[Block], old: &[Block]) -> Option<LogRatio> {
    let pairs: Vec<(&Block, &Block)> = new.iter().zip(old).collect();
    let sums = [Block::sum(pairs.iter().map(|pair| pair.0)), Block::sum(pairs.iter().map(|pair| pair.1))];
    let log = |new: &Block, old: &Block| {
        let log = (new.error_m(measure)? / old.error_m(measure)?).ln();
        log.is_finite().then_some(log)
    };
    let value = log(&sums[0], &sums[1])?;
    let without = |(new, old): &(&Block, &Block)| log(&sums[0].without(new), &sums[1].without(old));
    let left: Vec<f64> = pairs.iter().filter_map(without).collect();
    let deviation = if left.len() < 2 {
        f64::INFINITY
    } else {
        let (count, mean) = (left.len() as f64, baliza_report::mean(left.iter().copied()));
        ((count - 1.0) / count * left.iter().map(|log| (log - mean).powi(2)).sum::<f64>()).sqrt()
    };
    Some(LogRatio { value, deviation })
}

/// The ratio at a site: the mean of its recordings' logarithms, so that no recording counts for its size. Its standard
/// error is that of the blocks; where there are at least three recordings, it is at least that of the recordings'
/// scatter. `None` without recordings.
pub fn over_recordings(ratios: &[LogRatio]) -> Option<LogRatio> {
    let count = ratios.len() as f64;
    let value = baliza_report::mean(ratios.iter().map(|ratio| ratio.value));
    let of_blocks = ratios.iter().map(|ratio| ratio.deviation.powi(2)).sum::<f64>().sqrt() / count;
    let squares = ratios.iter().map(|ratio| (ratio.value - value).powi(2)).sum::<f64>();
    let scatter = (squares / (count - 1.0) / count).sqrt();
    let deviation = match (ratios.len() >= SCATTER_OF, of_blocks.is_finite()) {
        (true, true) => of_blocks.max(scatter),
        (true, false) => scatter,
        (false, _) => of_blocks,
    };
    (!ratios.is_empty()).then_some(LogRatio { value, deviation })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scored(t_s: Option<f64>, error_m: f64) -> ScoredEpoch {
        ScoredEpoch { t_s, error_m: Some(error_m), normalised_square: None }
    }

    fn block(fixed: usize, sum_m2: f64) -> Block {
        Block { epochs: fixed, fixed, sum_m: 0.0, sum_m2 }
    }

    #[test]
    fn a_block_ends_after_five_seconds_fifty_epochs_or_a_silence() {
        let sizes = |epochs: &[ScoredEpoch]| blocks(epochs).iter().map(|block| block.epochs).collect::<Vec<_>>();
        let timed: Vec<_> = (0..25).map(|at| scored(Some(f64::from(at) * 0.5), 1.0)).collect();
        assert_eq!(sizes(&timed), [10, 10, 5]);
        let untimed = vec![scored(None, 1.0); 120];
        assert_eq!(sizes(&untimed), [50, 50, 20]);
        let stays = [0.0, 1.0, 30.0, 31.0, 31.0].map(|t_s| scored(Some(t_s), 2.0));
        assert_eq!(sizes(&stays), [2, 2, 1]);
        assert_eq!(blocks(&stays)[0], Block { epochs: 2, fixed: 2, sum_m: 4.0, sum_m2: 8.0 });
    }

    #[test]
    fn the_standard_error_of_a_ratio_is_that_of_a_hand_calculation() {
        // New: mean squares 1, 4 and 1 in blocks of one; old: 4, 4 and 4. ½ ln((6 ⁄ 3) ⁄ 4) = −0.346574.
        // Left out one by one: ½ ln(2.5 ⁄ 4) = −0.235002, ½ ln(1 ⁄ 4) = −0.693147, −0.235002; their mean is −0.387717.
        // Σ of squares: 2 · 0.152715² + 0.305430² = 0.139931; √(2 ⁄ 3 · 0.139931) = 0.305430.
        let new = [block(1, 1.0), block(1, 4.0), block(1, 1.0)];
        let old = [block(1, 4.0); 3];
        let found = ratio(Measure::Rmse, &new, &old).expect("a ratio");
        assert!((found.value + 0.346_574).abs() < 1e-6 && (found.deviation - 0.305_430).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn blocks_that_err_alike_leave_no_uncertainty() {
        // The errors differ from block to block by far, but the ratio is always 2: pairs.
        let old = [block(10, 1.0), block(10, 100.0), block(10, 9.0)];
        let new = old.map(|Block { fixed, sum_m2, .. }| block(fixed, 4.0 * sum_m2));
        let found = ratio(Measure::Rmse, &new, &old).expect("a ratio");
        assert!((found.value - 2.0_f64.ln()).abs() < 1e-12 && found.deviation < 1e-12, "{found:?}");
        assert_eq!(ratio(Measure::Rmse, &new, &[]), None);
        assert_eq!(ratio(Measure::Rmse, &new[..1], &old[..1]).map(|found| found.deviation), Some(f64::INFINITY));
    }

    #[test]
    fn recordings_of_a_site_count_alike_and_their_scatter_is_an_uncertainty() {
        let of = |value, deviation| LogRatio { value, deviation };
        // Two: √(0.3² + 0.4²) ⁄ 2 = 0.25. Three: the scatter is √((0.2² + 0 + 0.2²) ⁄ 2 ⁄ 3) = 0.115470.
        let two = over_recordings(&[of(0.1, 0.3), of(0.3, 0.4)]).expect("a ratio");
        assert!((two.value - 0.2).abs() < 1e-12 && (two.deviation - 0.25).abs() < 1e-12, "{two:?}");
        let three = over_recordings(&[of(0.0, 0.01), of(0.2, 0.01), of(0.4, 0.01)]).expect("a ratio");
        assert!((three.deviation - 0.115_470).abs() < 1e-5, "{three:?}");
        assert_eq!(over_recordings(&[]), None);
    }
}
