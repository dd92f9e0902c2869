//! The error of work that the user has stopped.

/// The user has stopped the work (Ctrl-C, or another signal that ends a program) before its end. The binary exits with
/// code 130.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;
