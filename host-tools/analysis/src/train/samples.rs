//! Labelled receptions from files: `cir.csv` with impulse responses, `ranges.csv` with the receiver's diagnostics.
//!
//! A placement is a set of receptions that resemble each other because nothing moved: a `file` of `cir.csv`, an
//! anchor of `ranges.csv`. A score on placements that were used in training measures only the memory of the
//! classifier.

use std::collections::HashMap;
use std::path::Path;

use positioning_core::nlos::{BEFORE, Features, Means, Shape, WINDOW};

use recording::grouping::tag_of;
use recording::{DiagnosticColumns, Diagnostics};
use recording::{Table, UserError};

/// One reception.
#[derive(Clone, Debug)]
pub struct TrainingSample {
    /// Its index in [`Samples::placements`].
    pub placement: usize,
    /// Whether the direct path is blocked, where that is known.
    pub blocked: Option<bool>,
    /// The measured features.
    pub features: Features,
    /// Measured minus true range, metres, where the true one is known.
    pub error_m: Option<f64>,
}

/// Receptions, and the names of their placements.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// In the order of the files.
    pub all: Vec<TrainingSample>,
    /// Names of the placements.
    pub placements: Vec<String>,
    /// The index of each name in [`placements`](Self::placements).
    by_name: HashMap<String, usize>,
}

impl Samples {
    /// Adds the receptions of a `cir.csv`; `placement` names the column that identifies placements.
    ///
    /// # Errors
    /// A line is wrong; the first one is reported.
    pub fn read_cir(&mut self, file: &Path, placement: &'static str) -> Result<(), UserError> {
        let mut table = Table::open(file)?;
        let label = table.column("label")?;
        let place = if placement == DEFAULT_PLACEMENT { table.optional(placement) } else { table.column(placement)? };
        let first_path = table.column("fp_idx")?;
        let columns = WINDOW_COLUMNS.iter().map(|name| table.column(name)).collect::<Result<Vec<_>, _>>()?;
        let diagnostics = DiagnosticColumns::of_responses(&table);
        let truth = table.optional("gt_m");
        let mut links: HashMap<usize, Means> = HashMap::new();
        let before = self.all.len();
        while let Some(row) = table.next_row()? {
            let blocked = match row.text(label) {
                "" => None,
                "los" => Some(false),
                _ => Some(true),
            };
            let placement = self.placement(file, row.text(place));
            let (known, range_m) = (diagnostics.read(&row)?, row.number(diagnostics.range)?);
            let mut features = complete(known, range_m, links.entry(placement).or_default());
            let mut window = [0; WINDOW];
            for (sample, &column) in window.iter_mut().zip(&columns) {
                // A magnitude outside of the accumulator's range becomes the nearest possible one.
                *sample = row.some_number(column)?.round() as u16;
            }
            let at = row.some_number(first_path)?;
            if at < 0.0 {
                return Err(row.wrong(first_path, "is negative"));
            }
            if let Some(shape) = Shape::of(&window, BEFORE as f32 + at.fract() as f32) {
                features.set_shape(&shape);
            }
            let error_m = row.number(diagnostics.range)?.zip(row.number(truth)?).map(|(range, truth)| range - truth);
            self.all.push(TrainingSample { placement, blocked, features, error_m });
        }
        if self.all.len() == before { Err(UserError::line(file, 1, "no receptions below the header")) } else { Ok(()) }
    }

    /// Adds the receptions of a `ranges.csv`, with one placement an anchor. `true_range_m` gives the true range where
    /// it is known.
    ///
    /// # Errors
    /// A line is wrong; the first one is reported.
    pub fn read_ranges(
        &mut self,
        file: &Path,
        placement: &'static str,
        true_range_m: impl Fn(&Measurement) -> Option<f64>,
    ) -> Result<(), UserError> {
        let mut table = Table::open(file)?;
        let anchor = table.column("anchor")?;
        let place = if placement == DEFAULT_PLACEMENT { anchor } else { table.column(placement)? };
        let [sight, epoch, time, tag] = ["los", "epoch", "t_s", "tag"].map(|name| table.optional(name));
        table.column("range_m")?;
        let diagnostics = DiagnosticColumns::of_ranges(&table);
        let mut links: HashMap<(String, String), Means> = HashMap::new();
        let before = self.all.len();
        while let Some(row) = table.next_row()? {
            let blocked = row.truth_value(sight)?.map(|direct| !direct);
            let ends = (row.text(tag).to_owned(), row.some_text(anchor)?.to_owned());
            let link = links.entry(ends).or_default();
            let (known, range_m) = (diagnostics.read(&row)?, row.number(diagnostics.range)?);
            let features = complete(known, range_m, link);
            let placement = self.placement(file, row.text(place));
            let truth = true_range_m(&Measurement {
                tag: tag_of(&row, tag),
                epoch: row.text(epoch),
                t_s: row.number(time)?,
                anchor: row.text(anchor),
            });
            let error_m = range_m.zip(truth).map(|(range, truth)| range - truth);
            self.all.push(TrainingSample { placement, blocked, features, error_m });
        }
        if self.all.len() == before { Err(UserError::line(file, 1, "no ranges below the header")) } else { Ok(()) }
    }

    /// The index of a placement's name; names are new in each file.
    fn placement(&mut self, file: &Path, name: &str) -> usize {
        let name = format!("{}:{name}", file.display());
        if let Some(&place) = self.by_name.get(&name) {
            return place;
        }
        self.by_name.insert(name.clone(), self.placements.len());
        self.placements.push(name);
        self.placements.len() - 1
    }
}

/// A row of `ranges.csv`.
#[derive(Clone, Copy, Debug)]
pub struct Measurement<'a> {
    /// The tag's name, where the file has it.
    pub tag: Option<&'a str>,
    /// The epoch's name.
    pub epoch: &'a str,
    /// The time, seconds.
    pub t_s: Option<f64>,
    /// The anchor's name.
    pub anchor: &'a str,
}

/// The features of a reception whose range is known or not, metres, with the moving means of its link.
fn complete(diagnostics: Diagnostics, range_m: Option<f64>, means: &mut Means) -> Features {
    let mut features = diagnostics.features;
    means.complete(&mut features, range_m.map_or(f32::NAN, |range_m| range_m as f32), diagnostics.power_dbm);
    features
}

/// The column of `cir.csv` that identifies placements, if there is one.
pub const DEFAULT_PLACEMENT: &str = "file";

/// `c-16` to `c135`.
static WINDOW_COLUMNS: std::sync::LazyLock<Vec<&'static str>> = std::sync::LazyLock::new(|| {
    let name = |at: usize| &*format!("c{}", at as i64 - BEFORE as i64).leak();
    (0..WINDOW).map(name).collect()
});
