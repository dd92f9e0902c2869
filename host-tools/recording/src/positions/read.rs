//! Reads positions from CSV.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use crate::grouping::tag_of;
use crate::recording::Coordinates;
use crate::{Table, UserError};

/// The largest number of methods in a file: a picture gives each one a line of its legend.
const MOST_METHODS: usize = 64;

/// The positions of one method by tag and epoch: the position and the standard deviation of an axis, metres.
pub type Positions = HashMap<(Option<String>, String), ([f64; 2], f64)>;

/// Reads the positions of one method. Rows without a position are left out.
///
/// # Errors
/// The first line that is wrong. An epoch that is listed twice belongs to a second method, which is an error.
pub fn read_track(file: &Path) -> Result<Positions, UserError> {
    let mut table = Table::open(file)?;
    let [epoch, x, y] = [table.column("epoch")?, table.column("x_m")?, table.column("y_m")?];
    let sigmas = [table.optional("sigma_x_m"), table.optional("sigma_y_m")];
    let tag = table.optional("tag");
    let mut track = HashMap::new();
    while let Some(row) = table.next_row()? {
        let name = (tag_of(&row, tag).map(str::to_owned), row.some_text(epoch)?.to_owned());
        let (Some(x_m), Some(y_m)) = (row.number(x)?, row.number(y)?) else { continue };
        let [sigma_x, sigma_y] = [row.number(sigmas[0])?, row.number(sigmas[1])?].map(|sigma| sigma.unwrap_or(0.0));
        if track.insert(name, ([x_m, y_m], (sigma_x.powi(2) + sigma_y.powi(2)).sqrt() / 2.0_f64.sqrt())).is_some() {
            return Err(row.wrong(epoch, "stands twice: give the positions of one method"));
        }
    }
    Ok(track)
}

/// One row of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PositionRow {
    /// The epoch's name.
    pub epoch: String,
    /// The tag's name, where the file has it.
    pub tag: Option<String>,
    /// The method that found the position.
    pub method: String,
    /// The time, seconds.
    pub t_s: Option<f64>,
    /// The position; `None` where none was found.
    pub place: Option<Coordinates>,
    /// Standard deviation of x and y, metres.
    pub sigma_m: Option<[f64; 2]>,
    /// Standard deviation of z, metres; none where the height was given.
    pub sigma_z_m: Option<f64>,
    /// Covariance of x and y, m².
    pub cov_xy_m2: Option<f64>,
    /// Why no position was found.
    pub reason: String,
    /// Distance from the truth, metres.
    pub error_m: Option<f64>,
}

impl PositionRow {
    /// The variance of x, the covariance of x and y (0 where it is not known), and the variance of y, m².
    pub fn covariance_m2(&self) -> Option<[f64; 3]> {
        let [x, y] = self.sigma_m?;
        Some([x * x, self.cov_xy_m2.unwrap_or(0.0), y * y])
    }
}

/// Reads a file of positions.
///
/// # Errors
/// The first line that is wrong.
pub fn read(file: &Path) -> Result<Vec<PositionRow>, UserError> {
    let mut table = Table::open(file)?;
    let (epoch, x, y) = (table.column("epoch")?, table.column("x_m")?, table.column("y_m")?);
    let [method, time, z, sigma_x, sigma_y, error, tag, reason] =
        ["method", "t_s", "z_m", "sigma_x_m", "sigma_y_m", "error_m", "tag", "reason"].map(|name| table.optional(name));
    let (sigma_z, cov_xy) = (table.optional("sigma_z_m"), table.optional("cov_xy_m2"));
    let mut rows = Vec::new();
    let mut methods: HashSet<String> = HashSet::new();
    while let Some(row) = table.next_row()? {
        if !methods.contains(row.text(method)) {
            methods.insert(row.text(method).to_owned());
            if methods.len() > MOST_METHODS {
                return Err(row.wrong(method, &format!("has more than {MOST_METHODS} names in this file")));
            }
        }
        let z_m = row.number(z)?;
        rows.push(PositionRow {
            epoch: row.some_text(epoch)?.to_owned(),
            tag: tag_of(&row, tag).map(str::to_owned),
            method: row.text(method).to_owned(),
            t_s: row.number(time)?,
            place: row.number(x)?.zip(row.number(y)?).map(|(x_m, y_m)| Coordinates { x_m, y_m, z_m }),
            sigma_m: row.number(sigma_x)?.zip(row.number(sigma_y)?).map(|(x, y)| [x, y]),
            sigma_z_m: row.number(sigma_z)?,
            cov_xy_m2: row.number(cov_xy)?,
            reason: row.text(reason).to_owned(),
            error_m: row.number(error)?,
        });
    }
    if rows.is_empty() { Err(UserError::line(file, 1, "no positions below the header")) } else { Ok(rows) }
}
