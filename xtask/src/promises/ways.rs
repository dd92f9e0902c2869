//! The tables that code of this program makes, by the names of their ways in `promises.toml`.

use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::{
    accuracy, air, beacons, ci, fingerprints, firmware, onchip, protocol, schemes, simulation, station, tour, tracks,
};

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

    /// One table with its picture, which a run has drawn into a file of its own.
    ///
    /// # Errors
    /// The drawn file cannot be read.
    pub fn drawn(name: &str, table: String, picture: &str, drawn: &PathBuf) -> Result<Self> {
        let text = std::fs::read_to_string(drawn).with_context(|| format!("cannot read {}", drawn.display()))?;
        Ok(Self { pictures: vec![(picture.into(), text)], ..Self::one(name, table) })
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
    ("schemes", schemes::compared),
    ("scenarios", simulation::scenarios),
    ("thesis", accuracy::thesis),
    ("recordings", accuracy::recorded),
    ("tracks", tracks::recorded),
    ("accuracy", protocol::made),
    ("garcia", tracks::garcia),
    ("barral", tracks::barral),
    ("fusion", tracks::fusion),
    ("sweep", tracks::sweep),
    ("nlos", accuracy::sight),
    ("linde", beacons::linde),
    ("beacons", beacons::by_path_loss),
    ("fingerprints", fingerprints::comparisons),
    ("station", station::bench::made),
    ("rooms", accuracy::rooms),
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
