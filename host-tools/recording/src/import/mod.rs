//! Recordings of other systems: from their text to the folder that `solve` and `track` read.
//!
//! Each system has a file here that makes [`Imported`] of its lines. A line that is none of its measurements is left
//! out and counted. [`Imported::files`] makes the tables.

pub mod crazyflie;
pub mod pans;

use std::collections::BTreeMap;
use std::path::Path;

use crate::UserError;

/// The measurements of another system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Imported {
    /// The anchors' positions, metres, by their names.
    pub anchors: BTreeMap<String, [f64; 3]>,
    /// The rounds, in the order of the file.
    pub rounds: Vec<Round>,
    /// What is left out.
    pub left_out: LeftOut,
}

/// The measurements of one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Round {
    /// Seconds.
    pub t_s: f64,
    /// Metres, with the anchors' names.
    pub ranges_m: Vec<(String, f64)>,
    /// The position that the other system has found, metres.
    pub position_m: Option<[f64; 3]>,
}

/// The lines that are left out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// How many.
    pub lines: u64,
    /// The first one's number, from 1, and what is wrong with it.
    pub first: Option<(u64, String)>,
}

impl LeftOut {
    /// Counts a line.
    fn count(&mut self, line: u64, what: impl Into<String>) {
        self.lines += 1;
        if self.first.as_ref().is_none_or(|(first, _)| line < *first) {
            self.first = Some((line, what.into()));
        }
    }
}

impl Imported {
    /// The same, if there is any range.
    ///
    /// # Errors
    /// There is none; the error has the first line that is left out.
    fn with_ranges(self, file: &Path) -> Result<Self, UserError> {
        if self.rounds.iter().any(|round| !round.ranges_m.is_empty()) {
            return Ok(self);
        }
        Err(match self.left_out.first {
            Some((line, what)) => UserError::line(file, line, format!("{what}; no line of the file has a range")),
            None => UserError::line(file, 1, "no line has a range"),
        })
    }

    /// The number of ranges.
    pub fn ranges(&self) -> usize {
        self.rounds.iter().map(|round| round.ranges_m.len()).sum()
    }

    /// The files of the recording, by their names: `positions.csv` only where the other system has found positions,
    /// whose method is called `method`.
    ///
    /// # Errors
    /// The CSV writer returns an error.
    pub fn files(&self, method: &str) -> csv::Result<Vec<(&'static str, Vec<u8>)>> {
        let mut anchors = csv::Writer::from_writer(Vec::new());
        anchors.write_record(["anchor", "x_m", "y_m", "z_m"])?;
        for (name, place_m) in &self.anchors {
            let [x, y, z] = place_m.map(|at| at.to_string());
            anchors.write_record([name, &x, &y, &z])?;
        }
        let mut ranges = csv::Writer::from_writer(Vec::new());
        ranges.write_record(["epoch", "t_s", "anchor", "range_m"])?;
        let mut positions = csv::Writer::from_writer(Vec::new());
        positions.write_record(["epoch", "t_s", "method", "x_m", "y_m", "z_m"])?;
        for (epoch, round) in self.rounds.iter().enumerate() {
            let (epoch, time) = (epoch.to_string(), round.t_s.to_string());
            for (anchor, range_m) in &round.ranges_m {
                ranges.write_record([&epoch, &time, anchor, &range_m.to_string()])?;
            }
            if let Some(position_m) = round.position_m {
                let [x, y, z] = position_m.map(|at| at.to_string());
                positions.write_record([&epoch, &time, method, &x, &y, &z])?;
            }
        }
        let bytes = |writer: csv::Writer<Vec<u8>>| writer.into_inner().map_err(|error| error.into_error());
        let mut files = vec![("anchors.csv", bytes(anchors)?), ("ranges.csv", bytes(ranges)?)];
        if self.rounds.iter().any(|round| round.position_m.is_some()) {
            files.push(("positions.csv", bytes(positions)?));
        }
        Ok(files)
    }
}

/// A finite number.
fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

/// Three finite numbers.
fn numbers<'a>(texts: impl Iterator<Item = &'a str>) -> Option<[f64; 3]> {
    let numbers: Vec<f64> = texts.map(number).collect::<Option<_>>()?;
    numbers.try_into().ok()
}
