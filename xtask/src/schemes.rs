//! Costs and accuracy of schemes of two-way ranging: the table that an example of `ranging` prints.

use anyhow::Result;

use crate::promises::Made;
use crate::{cargo, printed};

/// The table.
///
/// # Errors
/// The example cannot be built, or fails.
pub fn compared() -> Result<Made> {
    let table =
        printed(cargo().args(["run", "--quiet", "--release", "--package", "baliza-ranging", "--example", "schemes"]))?;
    Ok(Made::one("schemes", table))
}
