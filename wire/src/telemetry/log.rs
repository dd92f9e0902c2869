//! The lines of a node's log that telemetry also carries: all of them are written here.
//!
//! So a host that shows telemetry can leave out these lines of the log. It recognises them by their source file:
//! [`SOURCE`].

use crate::telemetry::Severity;

/// The end of this file's path: the source of every line of the log whose message is also in telemetry.
pub const SOURCE: &str = "wire/src/telemetry/log.rs";

/// A possible line of the log: anything that `defmt` can format, if there is `defmt`.
#[cfg(feature = "defmt")]
pub trait Line: defmt::Format {}

#[cfg(feature = "defmt")]
impl<T: defmt::Format> Line for T {}

/// A possible line of the log: anything that `defmt` can format, if there is `defmt`.
#[cfg(not(feature = "defmt"))]
pub trait Line {}

#[cfg(not(feature = "defmt"))]
impl<T> Line for T {}

/// Writes a line of the log. Without `defmt` there is no log.
#[cfg(feature = "defmt")]
#[inline]
pub fn write(severity: Severity, line: &impl Line) {
    match severity {
        Severity::Error => defmt::error!("{}", line),
        Severity::Warning => defmt::warn!("{}", line),
        Severity::Info => defmt::info!("{}", line),
        Severity::Debug => defmt::debug!("{}", line),
    }
}

/// Writes a line of the log. Without `defmt` there is no log.
#[cfg(not(feature = "defmt"))]
#[inline]
pub fn write(_: Severity, _: &impl Line) {}

#[cfg(test)]
mod tests {
    #[test]
    fn the_place_of_the_lines_is_this_file() {
        assert!(std::path::Path::new(file!()).ends_with("src/telemetry/log.rs"));
        let here = concat!(env!("CARGO_MANIFEST_DIR"), "/src/telemetry/log.rs");
        assert!(std::path::Path::new(here).ends_with(super::SOURCE));
    }
}
