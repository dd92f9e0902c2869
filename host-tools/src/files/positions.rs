//! The file of positions: what `solve` writes and `plot` reads.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use crate::files::recording::{Coordinates, Epoch};
use crate::files::tags::tag_of;
use crate::{Position, Solved, Table, UserError};

/// The largest number of methods in a file: a picture gives each one a line of its legend.
const MOST_METHODS: usize = 64;
pub(crate) const COLUMNS: [&str; 11] =
    ["epoch", "t_s", "method", "x_m", "y_m", "z_m", "sigma_x_m", "sigma_y_m", "sigma_z_m", "used", "reason"];

/// The positions of one tag by one method.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// The tag's name, where it is known.
    pub tag: Option<&'a str>,
    /// The method's name.
    pub method: &'a str,
    /// The epochs.
    pub epochs: &'a [Epoch],
    /// What was found for each of them.
    pub solved: &'a [Solved],
}

/// The columns of a file, beside those that every file has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct More {
    /// `error_m`.
    pub errors: bool,
    /// `cov_xz_m2,cov_yz_m2` and the velocity's vertical part.
    pub heights: bool,
    /// `vx_m_s,vy_m_s` and, with heights, `vz_m_s`.
    pub velocities: bool,
    /// `tag`.
    pub tags: bool,
}

impl More {
    /// What these rows have.
    pub fn of<'a>(rows: impl Iterator<Item = Rows<'a>> + Clone, errors: bool) -> Self {
        let any = |has: fn(&Position) -> bool| {
            let mut solved = rows.clone().flat_map(|rows| rows.solved);
            solved.any(|solved| solved.outcome.as_ref().is_ok_and(has))
        };
        Self {
            errors,
            heights: any(|position| position.covariance_z.is_some()),
            velocities: any(|position| position.velocity_m_s.is_some()),
            tags: rows.clone().any(|rows| rows.tag.is_some()),
        }
    }

    /// The names of all columns.
    pub fn header(&self) -> Vec<&'static str> {
        let more: [(bool, &[&str]); 6] = [
            (self.errors, &["error_m"]),
            (true, &["cov_xy_m2"]),
            (self.heights, &["cov_xz_m2", "cov_yz_m2"]),
            (self.velocities, &["vx_m_s", "vy_m_s"]),
            (self.velocities && self.heights, &["vz_m_s"]),
            (self.tags, &["tag"]),
        ];
        COLUMNS
            .into_iter()
            .chain(more.into_iter().filter(|(has, _)| *has).flat_map(|(_, names)| names.iter().copied()))
            .collect()
    }
}

/// The file as text: row after row in the order given.
///
/// # Errors
/// The CSV writer returns an error.
pub fn to_csv<'a>(rows: impl Iterator<Item = Rows<'a>> + Clone, with_errors: bool) -> csv::Result<Vec<u8>> {
    let more = More::of(rows.clone(), with_errors);
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(more.header())?;
    for Rows { tag, method, epochs, solved } in rows {
        for (epoch, solved) in epochs.iter().zip(solved) {
            writer.write_record(fields(tag, method, epoch, solved, &more))?;
        }
    }
    writer.into_inner().map_err(|error| error.into_error().into())
}

/// The fields of a row.
fn fields(tag: Option<&str>, method: &str, epoch: &Epoch, solved: &Solved, more: &More) -> Vec<String> {
    let (position, reason) = match &solved.outcome {
        Ok(position) => (Some(position), ""),
        Err(reason) => (None, reason.as_str()),
    };
    let time = epoch.t_s.map_or_else(String::new, |t_s| t_s.to_string());
    let mut fields = vec![epoch.name.clone(), time, method.to_owned()];
    fields.extend(coordinates(position.map(|position| position.place)));
    fields.extend(coordinates(position.map(|position| position.sigma)));
    fields.push(position.map_or_else(String::new, |position| position.used.to_string()));
    fields.push(reason.to_owned());
    if more.errors {
        fields.push(metres(solved.error_m));
    }
    let across = position.and_then(|position| position.covariance_z).map_or([None; 2], |both| both.map(Some));
    fields.push(square_metres(position.map(|position| position.covariance_xy)));
    if more.heights {
        fields.extend(across.map(square_metres));
    }
    if more.velocities {
        let [x, y, z] = coordinates(position.and_then(|position| position.velocity_m_s));
        fields.extend([x, y]);
        fields.extend(more.heights.then_some(z));
    }
    fields.extend(more.tags.then(|| tag.unwrap_or_default().to_owned()));
    fields
}

/// The positions of one method by tag and epoch: the position and the standard deviation of an axis, metres.
pub type Positions = HashMap<(Option<String>, String), ([f64; 2], f64)>;

/// Reads the positions of one method by tag and epoch: the position and the standard deviation of an axis, both in metres. Rows
/// without a position are left out.
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

fn coordinates(place: Option<Coordinates>) -> [String; 3] {
    [place.map(|place| place.x_m), place.map(|place| place.y_m), place.and_then(|place| place.z_m)].map(metres)
}

/// Six digits beyond the point: a covariance may be of square millimetres.
fn square_metres(value: Option<f64>) -> String {
    value.filter(|value| value.is_finite()).map_or_else(String::new, |value| format!("{value:.6}"))
}

/// A tenth of a millimetre is finer than any range.
fn metres(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| format!("{value:.4}"))
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
