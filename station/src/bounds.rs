//! Bounds of the names and numbers that the station accepts.

/// The most bytes of a name.
pub(crate) const LONGEST_NAME: usize = 64;
/// The greatest coordinate, metres.
pub(crate) const FARTHEST_M: f64 = 1e6;
/// Path loss exponents that there are: the bounds of `positioning_core::ble::path_loss`.
pub(crate) const EXPONENTS: std::ops::RangeInclusive<f64> = 0.1..=20.0;

/// Whether a text can be a name: not empty, not long, and without control characters.
pub(crate) fn is_name(text: &str) -> bool {
    (1..=LONGEST_NAME).contains(&text.len()) && !text.chars().any(char::is_control)
}
