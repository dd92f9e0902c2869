//! The file of positions: what `solve` writes and `plot` reads.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use crate::files::recording::{Coordinates, Epoch};
use crate::{Solved, Table, UserError};

/// The largest number of methods in a file: a picture gives each one a line of its legend.
const MOST_METHODS: usize = 64;
pub(crate) const COLUMNS: [&str; 11] =
    ["epoch", "t_s", "method", "x_m", "y_m", "z_m", "sigma_x_m", "sigma_y_m", "sigma_z_m", "used", "reason"];

/// The file as text: for every method its epochs in their order. `with_errors` adds a column of errors.
///
/// # Errors
/// The CSV writer returns an error.
pub fn to_csv<'a>(
    epochs: &[Epoch],
    solved: impl IntoIterator<Item = (&'a str, &'a [Solved])>,
    with_errors: bool,
) -> csv::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(COLUMNS.into_iter().chain(with_errors.then_some("error_m")))?;
    for (method, solved) in solved {
        for (epoch, solved) in epochs.iter().zip(solved) {
            let time = epoch.t_s.map_or_else(String::new, |t_s| t_s.to_string());
            let (position, reason) = match &solved.outcome {
                Ok(position) => (Some(position), ""),
                Err(reason) => (None, reason.as_str()),
            };
            let used = position.map_or_else(String::new, |position| position.used.to_string());
            let place = coordinates(position.map(|position| position.place));
            let sigma = coordinates(position.map(|position| position.sigma));
            writer.write_field(&epoch.name)?;
            writer.write_field(time)?;
            writer.write_field(method)?;
            for field in place.iter().chain(&sigma) {
                writer.write_field(field)?;
            }
            writer.write_field(used)?;
            writer.write_field(reason)?;
            if with_errors {
                writer.write_field(metres(solved.error_m))?;
            }
            writer.write_record(None::<&[u8]>)?;
        }
    }
    writer.into_inner().map_err(|error| error.into_error().into())
}

/// Reads the positions of one method by epoch: the position and the standard deviation of an axis, both in metres. Rows
/// without a position are left out.
///
/// # Errors
/// The first line that is wrong. An epoch that is listed twice belongs to a second method, which is an error.
pub fn read_track(file: &Path) -> Result<HashMap<String, ([f64; 2], f64)>, UserError> {
    let mut table = Table::open(file)?;
    let [epoch, x, y] = [table.column("epoch")?, table.column("x_m")?, table.column("y_m")?];
    let sigmas = [table.optional("sigma_x_m"), table.optional("sigma_y_m")];
    let mut track = HashMap::new();
    while let Some(row) = table.next_row()? {
        let name = row.some_text(epoch)?.to_owned();
        let (Some(x_m), Some(y_m)) = (row.number(x)?, row.number(y)?) else { continue };
        let [sigma_x, sigma_y] = [row.number(sigmas[0])?, row.number(sigmas[1])?].map(|sigma| sigma.unwrap_or(0.0));
        if track.insert(name, ([x_m, y_m], (sigma_x.powi(2) + sigma_y.powi(2)).sqrt() / 2.0_f64.sqrt())).is_some() {
            return Err(row.wrong(epoch, "stands twice: give the positions of one method"));
        }
    }
    Ok(track)
}

fn coordinates(place: Option<Coordinates>) -> [String; 3] {
    [place.map(|place| place.x_m), place.map(|place| place.y_m), place.and_then(|place| place.z_m)].map(metres)
}

/// A tenth of a millimetre is finer than any range.
fn metres(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| format!("{value:.4}"))
}

/// One row of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionRow {
    /// The epoch's name.
    pub epoch: String,
    /// The method that found the position.
    pub method: String,
    /// The time, seconds.
    pub t_s: Option<f64>,
    /// The position; `None` where none was found.
    pub place: Option<Coordinates>,
    /// Standard deviation of x and y, metres.
    pub sigma_m: Option<[f64; 2]>,
    /// Distance from the truth, metres.
    pub error_m: Option<f64>,
}

/// Reads a file of positions.
///
/// # Errors
/// The first line that is wrong.
pub fn read(file: &Path) -> Result<Vec<PositionRow>, UserError> {
    let mut table = Table::open(file)?;
    let (epoch, x, y) = (table.column("epoch")?, table.column("x_m")?, table.column("y_m")?);
    let [method, time, z, sigma_x, sigma_y, error] =
        ["method", "t_s", "z_m", "sigma_x_m", "sigma_y_m", "error_m"].map(|name| table.optional(name));
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
            method: row.text(method).to_owned(),
            t_s: row.number(time)?,
            place: row.number(x)?.zip(row.number(y)?).map(|(x_m, y_m)| Coordinates { x_m, y_m, z_m }),
            sigma_m: row.number(sigma_x)?.zip(row.number(sigma_y)?).map(|(x, y)| [x, y]),
            error_m: row.number(error)?,
        });
    }
    if rows.is_empty() { Err(UserError::line(file, 1, "no positions below the header")) } else { Ok(rows) }
}
