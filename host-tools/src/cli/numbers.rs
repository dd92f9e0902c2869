//! Numbers as values of arguments.

/// Parses a finite number.
///
/// # Errors
/// The text is not a finite number.
pub fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(_) | Err(_) => Err(format!("{text:?} is not a number")),
    }
}

/// Parses a number above 0.
///
/// # Errors
/// The text is no such number.
pub fn positive(text: &str) -> Result<f64, String> {
    match finite(text)? {
        number if number > 0.0 => Ok(number),
        _ => Err(format!("{text:?} is not above 0")),
    }
}
