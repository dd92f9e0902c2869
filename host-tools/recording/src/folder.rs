//! The folder of a recording: its tables under their usual names, and `recording.toml`, which says how they were made.

use std::path::{Path, PathBuf};

use baliza_report::explain;
use serde::{Deserialize, Serialize};

use crate::read_text;
use crate::{Height, Space, Table, UserError};

/// The name of the file of settings.
pub const SETTINGS: &str = "recording.toml";

/// A height that is less certain is none, metres.
pub const MOST_HEIGHT_SIGMA_M: f64 = 1.0;

/// What the tables of a recording do not say. Commands that read the folder use it where no flag says otherwise.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingSettings {
    /// Positions in the plane (2) or in space (3).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dims: Option<u8>,
    /// The tags' height in the plane, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_m: Option<f64>,
    /// Standard deviation of that height, metres; without it, the height is exact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_sigma_m: Option<f64>,
    /// Where the tags can be at all: least and greatest x and y, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub area_m: Option<[[f64; 2]; 2]>,
    /// How the tags measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<MeasurementMode>,
    /// How the tags used the powers of receptions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nlos: Option<Weighting>,
}

/// How the powers of receptions are used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weighting {
    /// They move the prior probability that a link is blocked.
    #[default]
    Weigh,
    /// Ranges whose link is more probably blocked than not are left out, but at least four ranges are kept.
    Ignore,
    /// Not at all: all ranges have equal weight.
    Alike,
}

/// How tags measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeasurementMode {
    /// Ranges to anchors: `ranges.csv`.
    Ranges,
    /// Differences of arrivals, of tags that only listen: `differences.csv`.
    Differences,
}

/// The folder of a recording.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
    /// Its settings; without a file, nothing is known.
    pub settings: RecordingSettings,
}

impl Folder {
    /// Opens a folder.
    ///
    /// # Errors
    /// The path is no folder, or `recording.toml` is wrong.
    pub fn open(path: &Path) -> Result<Self, UserError> {
        if !path.is_dir() {
            return Err(UserError::file(
                path,
                "this is no folder; a recording is a folder with anchors.csv and ranges.csv",
            ));
        }
        let file = path.join(SETTINGS);
        let settings = if file.exists() { read(&file)? } else { RecordingSettings::default() };
        Ok(Self { path: path.to_owned(), settings })
    }

    /// The path of one of its files, if the file exists.
    pub fn find(&self, name: &str) -> Option<PathBuf> {
        Some(self.path.join(name)).filter(|file| file.is_file())
    }

    /// The path of one of its tables, if the table exists and has a row: a simulation without anchors has a header only.
    ///
    /// # Errors
    /// The table is wrong before its first row.
    pub fn find_rows(&self, name: &str) -> Result<Option<PathBuf>, UserError> {
        let Some(file) = self.find(name) else { return Ok(None) };
        let has_row = Table::open(&file)?.next_row()?.is_some();
        Ok(has_row.then_some(file))
    }

    /// Whether its tags have measured the RSSI of beacons, and neither ranges nor differences.
    ///
    /// # Errors
    /// A table is wrong before its first row.
    pub fn is_of_beacons(&self) -> Result<bool, UserError> {
        let has = |name| Ok::<_, UserError>(self.find_rows(name)?.is_some());
        Ok(has("rssi.csv")? && has("beacons.csv")? && !has("ranges.csv")? && !has("differences.csv")?)
    }

    /// How its tags measured, and the file of it: as the settings say, else by the file that is there.
    ///
    /// # Errors
    /// The folder has no such file.
    pub fn measured(&self) -> Result<(MeasurementMode, PathBuf), UserError> {
        let by_file = || {
            let listened = self.find("ranges.csv").is_none() && self.find("differences.csv").is_some();
            if listened { MeasurementMode::Differences } else { MeasurementMode::Ranges }
        };
        let mode = self.settings.mode.unwrap_or_else(by_file);
        let name = match mode {
            MeasurementMode::Ranges => "ranges.csv",
            MeasurementMode::Differences => "differences.csv",
        };
        Ok((mode, self.file(name)?))
    }

    /// The path of one of its files.
    ///
    /// # Errors
    /// The folder has no such file.
    pub fn file(&self, name: &str) -> Result<PathBuf, UserError> {
        self.find(name).ok_or_else(|| UserError::file(&self.path, format!("the folder has no {name}")))
    }
}

impl RecordingSettings {
    /// The space that they say, without a height from a truth; by default all three dimensions.
    pub fn space(&self) -> Space {
        match self.dims {
            Some(2) => Space::Plane(self.height_m.map_or(Height::Unknown, Height::Fixed)),
            Some(_) | None => Space::Full(None),
        }
    }

    /// The file's text.
    ///
    /// # Errors
    /// A value cannot be written as TOML.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        let head =
            "# How this recording was made. Commands that read the folder use it where no flag says otherwise.\n";
        Ok(format!("{head}{}", toml::to_string(self)?))
    }
}

fn read(file: &Path) -> Result<RecordingSettings, UserError> {
    let text = read_text(file)?;
    let settings: RecordingSettings = toml::from_str(&text).map_err(|error| {
        let explained = explain(&text, error.span(), error.message());
        UserError::line(file, explained.line as u64, explained.message)
    })?;
    match settings {
        RecordingSettings { dims: Some(dims), .. } if !(2..=3).contains(&dims) => {
            Err(UserError::file(file, format!("dims is {dims}; it must be 2 or 3")))
        }
        RecordingSettings { height_m: Some(height_m), .. } if !height_m.is_finite() => {
            Err(UserError::file(file, "height_m is not a number"))
        }
        RecordingSettings { height_sigma_m: Some(sigma_m), .. } if !(0.0..=MOST_HEIGHT_SIGMA_M).contains(&sigma_m) => {
            Err(UserError::file(file, format!("height_sigma_m is {sigma_m}; it must be 0 to {MOST_HEIGHT_SIGMA_M}")))
        }
        RecordingSettings { area_m: Some([[x0, y0], [x1, y1]]), .. } if !(x0 < x1 && y0 < y1) => {
            Err(UserError::file(file, "area_m must be [[x0, y0], [x1, y1]] with x0 < x1 and y0 < y1"))
        }
        settings => Ok(settings),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::{Folder, MeasurementMode, RecordingSettings, SETTINGS, Weighting};

    #[test]
    fn settings_are_read_as_they_were_written_and_wrong_ones_are_refused_with_their_line() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let settings = RecordingSettings {
            dims: Some(2),
            height_m: Some(1.2),
            height_sigma_m: Some(0.3),
            area_m: Some([[0.0, -1.0], [6.0, 4.5]]),
            mode: Some(MeasurementMode::Ranges),
            nlos: Some(Weighting::Alike),
        };
        fs::write(folder.path().join(SETTINGS), settings.to_toml().expect("text")).expect("written");
        assert_eq!(Folder::open(folder.path()).expect("read").settings, settings);
        for (text, said) in [
            ("dims = 2\nheigth_m = 1", ":2: unknown key heigth_m; height_m is near it"),
            ("dims = 4", "it must be 2 or 3"),
            ("dims = \"two\"", ":1: dims is \"two\": it must be a whole number"),
            ("height_m = [1.2]", ":1: height_m is [1.2]: it must be a number"),
            (
                "mode = \"rang\"",
                ":1: mode is \"rang\": it must be one of \"ranges\", \"differences\"; ranges is near it",
            ),
        ] {
            fs::write(folder.path().join(SETTINGS), text).expect("written");
            let error = Folder::open(folder.path()).expect_err("wrong").to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
