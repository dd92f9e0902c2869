//! What schemes of two-way ranging cost and give: the table that an example of `ranging` prints.

use anyhow::Result;

use crate::bench::Made;
use crate::{cargo, printed};

/// The table.
pub fn compared() -> Result<Option<Made>> {
    let table =
        printed(cargo().args(["run", "--quiet", "--release", "--package", "baliza-ranging", "--example", "schemes"]))?;
    Ok(Made::one("schemes", table))
}
