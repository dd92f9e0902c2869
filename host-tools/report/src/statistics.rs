//! Statistics of the errors of many positions: a struct of four figures, and a function for each.

/// Statistics of a set of errors, in their unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean.
    pub mae: f64,
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
}

impl Statistics {
    /// The statistics of errors that are not negative, in any order; `None` without errors.
    pub fn of(errors: &[f64]) -> Option<Self> {
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        (!errors.is_empty()).then(|| Self {
            rmse: rms(errors.iter().copied()),
            mae: mean(errors.iter().copied()),
            p50: percentile(&sorted, 0.5),
            p90: percentile(&sorted, 0.9),
        })
    }
}

/// The arithmetic mean; NaN without values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// Root of the mean square; NaN without values.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    mean(values.into_iter().map(|value| value * value)).sqrt()
}

/// The value below which `share` of a sorted set lies, linearly interpolated between two neighbours (Hyndman and Fan,
/// The American Statistician 50(4), 1996, definition 7; NumPy's default); NaN without values.
pub fn percentile(sorted: &[f64], share: f64) -> f64 {
    let index = share * sorted.len().saturating_sub(1) as f64;
    match (sorted.get(index.floor() as usize), sorted.get(index.ceil() as usize)) {
        (Some(below), Some(above)) => below + index.fract() * (above - below),
        (None, _) | (_, None) => f64::NAN,
    }
}

/// The median of a set in any order; NaN without values.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    percentile(&values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::{Statistics, mean, median, percentile, rms};

    #[test]
    fn figures_are_those_of_a_hand_calculation() {
        // Mean 20 ⁄ 5; squares 1 + 4 + 9 + 16 + 100 = 130, √26 = 5.09902; the third of five; 0.9 · 4 = 3.6: 4 + 0.6 ·
        // (10 − 4).
        let figures = Statistics::of(&[10.0, 2.0, 3.0, 1.0, 4.0]).expect("five errors");
        assert_eq!((figures.mae, figures.p50), (4.0, 3.0));
        assert!((figures.rmse - 5.099_02).abs() < 1e-5 && (figures.p90 - 7.6).abs() < 1e-12, "{figures:?}");
    }

    #[test]
    fn the_median_of_an_even_number_is_between_the_two_in_the_middle() {
        assert_eq!((median(vec![9.0, 1.0, 2.0, 4.0]), median(vec![9.0, 1.0, 2.0])), (3.0, 2.0));
    }

    #[test]
    fn one_error_is_all_four_figures_and_none_is_nothing() {
        assert_eq!(Statistics::of(&[0.5]), Some(Statistics { rmse: 0.5, mae: 0.5, p50: 0.5, p90: 0.5 }));
        assert_eq!(Statistics::of(&[]), None);
    }
    #[test]
    fn figures_of_nothing_are_no_numbers() {
        assert!(mean([]).is_nan() && median(Vec::new()).is_nan() && rms([]).is_nan() && percentile(&[], 0.5).is_nan());
    }
}
