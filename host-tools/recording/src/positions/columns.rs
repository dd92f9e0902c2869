//! The columns of positions: their names, and the value of each for an epoch. Every format writes these.

use std::fmt::Write as _;

use serde_json::Value;

use super::Rows;
use crate::{Coordinates, Epoch, Height};
use crate::{Position, Solved};

/// An epoch of a tag, solved by a method.
#[derive(Clone, Copy, Debug)]
pub struct Entry<'a> {
    pub tag: Option<&'a str>,
    pub method: &'a str,
    pub epoch: Epoch<'a>,
    pub solved: &'a Solved,
    /// The tag's height, where it is given and not solved for.
    pub height: Height,
}

/// A column.
pub struct Column {
    pub name: &'static str,
    /// Whether a file with these parts has the column.
    shown: fn(&TableParts) -> bool,
    pub values: Values,
}

/// The values of a column. `None` is unknown.
#[derive(Clone, Copy)]
pub enum Values {
    /// Text.
    Text(for<'a> fn(&Entry<'a>) -> Option<&'a str>),
    /// A count.
    Count(fn(&Entry) -> Option<usize>),
    /// A number with all its digits.
    Exact(fn(&Entry) -> Option<f64>),
    /// A number that is rounded to these decimal places.
    Rounded(usize, fn(&Entry) -> Option<f64>),
}

/// A tenth of a millimetre is finer than any range.
const METRES: usize = 4;
/// A covariance may be of square millimetres.
const SQUARE_METRES: usize = 6;

/// All columns. A reader finds them by name; new ones come last but for the tag.
const COLUMNS: [Column; 23] = [
    always("epoch", Values::Text(|entry| Some(entry.epoch.name))),
    always("t_s", Values::Exact(|entry| entry.epoch.t_s)),
    always("method", Values::Text(|entry| Some(entry.method))),
    always("x_m", Values::Rounded(METRES, |entry| Some(entry.place()?.x_m))),
    always("y_m", Values::Rounded(METRES, |entry| Some(entry.place()?.y_m))),
    always("z_m", Values::Rounded(METRES, |entry| entry.place()?.z_m.or(entry.given_m()))),
    always("sigma_x_m", Values::Rounded(METRES, |entry| Some(entry.sigma()?.x_m))),
    always("sigma_y_m", Values::Rounded(METRES, |entry| Some(entry.sigma()?.y_m))),
    always("sigma_z_m", Values::Rounded(METRES, |entry| entry.sigma()?.z_m)),
    always("used", Values::Count(|entry| Some(entry.position()?.used))),
    always("reason", Values::Text(|entry| entry.solved.outcome.as_ref().err().map(|reason| reason.as_str()))),
    Column {
        name: "error_m",
        shown: |parts| parts.errors,
        values: Values::Rounded(METRES, |entry| entry.solved.error_m),
    },
    always("cov_xy_m2", Values::Rounded(SQUARE_METRES, |entry| Some(entry.position()?.covariance_xy))),
    Column {
        name: "cov_xz_m2",
        shown: |parts| parts.heights,
        values: Values::Rounded(SQUARE_METRES, |entry| Some(entry.position()?.covariance_z?[0])),
    },
    Column {
        name: "cov_yz_m2",
        shown: |parts| parts.heights,
        values: Values::Rounded(SQUARE_METRES, |entry| Some(entry.position()?.covariance_z?[1])),
    },
    Column {
        name: "vx_m_s",
        shown: |parts| parts.velocities,
        values: Values::Rounded(METRES, |entry| Some(entry.velocity()?.x_m)),
    },
    Column {
        name: "vy_m_s",
        shown: |parts| parts.velocities,
        values: Values::Rounded(METRES, |entry| Some(entry.velocity()?.y_m)),
    },
    Column {
        name: "vz_m_s",
        shown: |parts| parts.velocities && parts.heights,
        values: Values::Rounded(METRES, |entry| entry.velocity()?.z_m),
    },
    Column {
        name: "flag",
        shown: |parts| parts.flags,
        values: Values::Text(|entry| Some(entry.position()?.flag?.as_str())),
    },
    Column {
        name: "alt_x_m",
        shown: |parts| parts.flags,
        values: Values::Rounded(METRES, |entry| Some(entry.alternative()?.x_m)),
    },
    Column {
        name: "alt_y_m",
        shown: |parts| parts.flags,
        values: Values::Rounded(METRES, |entry| Some(entry.alternative()?.y_m)),
    },
    Column {
        name: "alt_z_m",
        shown: |parts| parts.flags && parts.heights,
        values: Values::Rounded(METRES, |entry| entry.alternative()?.z_m),
    },
    Column { name: "tag", shown: |parts| parts.tags, values: Values::Text(|entry| entry.tag) },
];

const fn always(name: &'static str, values: Values) -> Column {
    Column { name, shown: |_| true, values }
}

/// What the positions of a file have, on which its columns depend.
#[derive(Clone, Copy, Debug)]
pub struct TableParts {
    /// Errors, from a truth.
    pub errors: bool,
    /// Covariances with the height.
    pub heights: bool,
    /// Velocities, of a track.
    pub velocities: bool,
    /// Flags of doubtful positions, and the other of two places.
    pub flags: bool,
    /// Names of tags.
    pub tags: bool,
}

impl TableParts {
    /// What these rows have.
    pub(super) fn of<'a>(rows: impl Iterator<Item = Rows<'a>> + Clone, errors: bool) -> Self {
        let any = |has: fn(&Position) -> bool| {
            let mut solved = rows.clone().flat_map(|rows| rows.solved);
            solved.any(|solved| solved.outcome.as_ref().is_ok_and(has))
        };
        Self {
            errors,
            heights: any(|position| position.covariance_z.is_some()),
            velocities: any(|position| position.velocity_m_s.is_some()),
            flags: any(|position| position.flag.is_some()),
            tags: rows.clone().any(|rows| rows.tag.is_some()),
        }
    }

    /// The columns of a file.
    pub(super) fn columns(&self) -> Vec<&'static Column> {
        COLUMNS.iter().filter(|column| (column.shown)(self)).collect()
    }
}

impl<'a> Entry<'a> {
    fn position(&self) -> Option<&'a Position> {
        self.solved.outcome.as_ref().ok()
    }

    fn place(&self) -> Option<Coordinates> {
        Some(self.position()?.place)
    }

    fn given_m(&self) -> Option<f64> {
        match self.height {
            Height::Unknown => None,
            Height::Fixed(z_m) => Some(z_m),
            Height::FromTruth => self.epoch.truth?.z_m,
        }
    }

    fn sigma(&self) -> Option<Coordinates> {
        Some(self.position()?.sigma)
    }

    /// The other of two places.
    fn alternative(&self) -> Option<Coordinates> {
        let Position { place, alternative, .. } = self.position()?;
        let [x, y, z] = alternative.as_ref()?.apart;
        Some(Coordinates { x_m: place.x_m + x, y_m: place.y_m + y, z_m: place.z_m.map(|z_m| z_m + z) })
    }

    fn velocity(&self) -> Option<Coordinates> {
        self.position()?.velocity_m_s
    }
}

impl Values {
    /// Adds the field of CSV to the text: nothing where the value is unknown.
    pub fn write(self, entry: &Entry, text: &mut String) {
        let written = match self {
            Self::Text(of) => of(entry).map(|value| text.write_str(value)),
            Self::Count(of) => of(entry).map(|count| write!(text, "{count}")),
            Self::Exact(of) => finite(of(entry)).map(|number| write!(text, "{number}")),
            Self::Rounded(decimals, of) => finite(of(entry)).map(|number| write!(text, "{number:.decimals$}")),
        };
        // A text in memory takes everything.
        let _ = written;
    }

    /// The value in JSON: `null` where it is unknown.
    pub fn json(self, entry: &Entry) -> Value {
        match self {
            Self::Text(of) => of(entry).into(),
            Self::Count(of) => of(entry).into(),
            Self::Exact(of) => of(entry).into(),
            Self::Rounded(decimals, of) => of(entry).map(|number| round(number, decimals)).into(),
        }
    }
}

/// The number, if it is finite.
pub fn finite(number: Option<f64>) -> Option<f64> {
    number.filter(|number| number.is_finite())
}

/// The number that CSV shows with this number of decimal places.
pub fn round(number: f64, decimals: usize) -> f64 {
    format!("{number:.decimals$}").parse().unwrap_or(number)
}
