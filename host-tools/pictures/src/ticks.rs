//! Round numbers along an axis: 1, 2 or 5 times a power of ten.

use std::ops::Range;

/// A number on an axis: its place, and its text.
pub type Tick = (f64, String);

/// Round numbers in a range, at most `most` of them.
pub fn linear(range: &Range<f64>, most: usize) -> Vec<Tick> {
    let most = most.max(2);
    let span = range.end - range.start;
    if !span.is_finite() || span <= 0.0 {
        return Vec::new();
    }
    let decade = 10_f64.powf((span / most as f64).log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * decade);
    let step = steps.into_iter().find(|step| span / step < most as f64).unwrap_or(steps[3]);
    let first = (range.start / step - 1e-6).ceil();
    let values = (0..=most).map(|index| (first + index as f64) * step);
    values.filter(|value| *value <= range.end + 1e-6 * step).map(|value| (value, text(value, step))).collect()
}

/// Round numbers for a range of common logarithms, at most `most` of them.
pub fn logarithmic(range: &Range<f64>, most: usize) -> Vec<Tick> {
    const MANTISSAS: [&[f64]; 3] = [&[1.0, 2.0, 5.0], &[1.0, 3.0], &[1.0]];
    let (first, last) = (range.start.floor() as i32, range.end.ceil() as i32);
    let of = |mantissas: &[f64], every: i32| -> Vec<Tick> {
        let decades = (first..=last).filter(|decade| decade.rem_euclid(every) == 0);
        let ticks = decades.flat_map(|decade| mantissas.iter().map(move |m| (m * 10_f64.powi(decade), decade)));
        let ticks = ticks.map(|(value, decade)| (value.log10(), text(value, 10_f64.powi(decade))));
        ticks.filter(|(place, _)| (range.start - 1e-9..=range.end + 1e-9).contains(place)).collect()
    };
    let fine = MANTISSAS.iter().map(|mantissas| of(mantissas, 1)).find(|ticks| ticks.len() <= most);
    fine.unwrap_or_else(|| of(&[1.0], (last - first) / most.max(1) as i32 + 1))
}

/// A number with the decimals that its step needs.
pub fn text(value: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let text = if value.abs() < 1e7 { format!("{value:.decimals$}") } else { format!("{value:e}") };
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|digit| matches!(digit, '0' | '.')) => digits.to_owned(),
        Some(_) | None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::{linear, logarithmic, text};

    fn texts(ticks: &[(f64, String)]) -> Vec<&str> {
        ticks.iter().map(|(_, text)| text.as_str()).collect()
    }

    #[test]
    fn ticks_are_round_numbers_inside_the_range() {
        assert_eq!(texts(&linear(&(-55.14..-49.55), 6)), ["-55", "-54", "-53", "-52", "-51", "-50"]);
        assert_eq!(texts(&linear(&(-0.3..0.75), 6)), ["-0.2", "0.0", "0.2", "0.4", "0.6"]);
        assert_eq!(texts(&linear(&(4.5e6..4.5e6 + 30.0), 4)), ["4500000", "4500010", "4500020", "4500030"]);
    }

    #[test]
    fn a_logarithmic_axis_has_ticks_at_1_2_5_or_at_decades() {
        assert_eq!(texts(&logarithmic(&(-2.0..0.0), 7)), ["0.01", "0.02", "0.05", "0.1", "0.2", "0.5", "1"]);
        assert_eq!(texts(&logarithmic(&(-3.0..4.0), 8)), ["0.001", "0.01", "0.1", "1", "10", "100", "1000", "10000"]);
        assert_eq!(
            texts(&logarithmic(&(-9.0..9.0), 7)),
            ["0.000000001", "0.000001", "0.001", "1", "1000", "1000000", "1e9"]
        );
    }

    #[test]
    fn no_range_makes_a_loop_without_end() {
        let ranges = [0.0..0.0, 1.0..0.0, 0.0..f64::NAN, -1e308..1e308, 0.0..f64::INFINITY, 0.0..5e-324];
        for range in ranges {
            assert!(linear(&range, 7).len() <= 8 && logarithmic(&(-308.0..308.0), 7).len() <= 8, "{range:?}");
        }
        assert_eq!((text(-0.0001, 0.01), text(-0.25, 0.05)), ("0.00".to_owned(), "-0.25".to_owned()));
    }
}
