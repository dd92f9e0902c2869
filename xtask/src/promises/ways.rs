//! The tables that code of this program makes, by the names of their ways in `promises.toml`.

use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::tables::{beacons, fingerprints, recordings, scenarios, schemes};
use crate::{air, ci, firmware, onchip, station, tour};

/// What a way has made.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// The tables, each with the name of its place in the document.
    pub tables: Vec<(String, String)>,
    /// Whole files, by their paths in the repository: equal runs make equal ones.
    pub files: Vec<(PathBuf, String)>,
    /// Pictures of the tables, which are written with them and not compared.
    pub pictures: Vec<(PathBuf, String)>,
    /// A complaint about the figures.
    pub complaint: Option<&'static str>,
}

impl Made {
    /// One table.
    pub fn one(name: &str, table: String) -> Self {
        Self::of(vec![(name, table)], None)
    }

    /// Several tables, and a complaint about their figures.
    pub fn of(tables: Vec<(&str, String)>, complaint: Option<&'static str>) -> Self {
        let tables = tables.into_iter().map(|(name, table)| (name.to_owned(), table)).collect();
        Self { tables, complaint, ..Self::default() }
    }

    /// One whole file.
    pub fn file(path: &str, text: String) -> Self {
        Self { files: vec![(path.into(), text)], ..Self::default() }
    }
}

/// A way: its name, and what makes the tables.
type Way = (&'static str, fn() -> Result<Made>);

const WAYS: &[Way] = &[
    ("checks", ci::made),
    ("tour", tour::made),
    ("firmware", firmware::made),
    ("chip", onchip::made),
    ("costs", onchip::costs),
    ("air", air::compared),
    ("schemes", schemes),
    ("scenarios", scenarios::made),
    ("recordings", recordings::solved),
    ("tracks", recordings::tracked),
    ("beacons", beacons::by_path_loss),
    ("fingerprints", fingerprints::comparisons),
    ("station", station::bench::made),
    ("walls", fingerprints::barriers),
    ("maps", fingerprints::maps),
    ("page", station::bench::page),
];

/// Makes the tables of a way.
///
/// # Errors
/// There is no such way, or it fails.
pub fn make(name: &str) -> Result<Made> {
    let (_, make) = WAYS.iter().find(|(way, _)| *way == name).with_context(|| format!("no way {name}"))?;
    make()
}

/// Whether there is such a way.
#[cfg(test)]
pub fn is_there(name: &str) -> bool {
    WAYS.iter().any(|(way, _)| *way == name)
}
