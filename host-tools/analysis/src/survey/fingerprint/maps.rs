//! The maps that comparisons read: made of a survey, only those that are needed, or read from a file.

use std::collections::BTreeSet;

use positioning_core::ble::fingerprint::{Map, MapError};

use super::chart::{Grid, chart};
use super::comparison::Comparison;
use super::process::{Kernel, Process};
use super::survey::{Survey, minor};
use super::trend::{Plan, Trend};
use recording::beacons::Capture;

/// How maps are made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Making<'a> {
    /// The lattice of the process.
    pub grid: Grid,
    /// Where nothing was measured nearby, RSSI values are expected to follow path loss from these beacons through
    /// these walls, where that makes the survey likelier; without a plan, to be the same everywhere.
    pub plan: Option<&'a Plan>,
}

/// Maps of one site, as a node reads them.
#[derive(Clone, Debug)]
pub struct Maps {
    /// The names of the beacons, in the maps' order.
    beacons: Vec<String>,
    /// Surveyed points.
    points: Option<Vec<u8>>,
    /// A process on a lattice, …
    lattice: Option<Vec<u8>>,
    /// … and by how much the covariances of its positions are greater than the posterior has them, by the survey; 1 where
    /// the map was read from a file.
    excess: f64,
}

impl Maps {
    /// The maps of a survey that these comparisons read; the search for the process' kernel begins at `guess`.
    ///
    /// # Errors
    /// The survey makes no map.
    pub fn of(
        survey: &Survey,
        making: Making,
        comparisons: &[Comparison],
        guess: Option<Kernel>,
    ) -> Result<Self, MapError> {
        let wants_lattice = |comparison: &Comparison| comparison.wants_lattice();
        let points = (!comparisons.iter().all(wants_lattice)).then(|| survey.map()).transpose()?;
        let lattice = || chart(survey, &fitted(survey, making, guess)?, making.grid);
        let lattice = comparisons.iter().any(wants_lattice).then(lattice).transpose()?;
        let (lattice, excess) = lattice.unzip();
        Ok(Self { beacons: survey.beacons.clone(), points, lattice, excess: excess.unwrap_or(1.0) })
    }

    /// The map in a file's bytes; `beacons` are the names of its beacons, in its order.
    ///
    /// # Errors
    /// The bytes are no map, or more than one.
    pub fn read(bytes: Vec<u8>, beacons: Vec<String>) -> Result<Self, MapError> {
        let (map, rest) = Map::decode(&bytes)?;
        if !rest.is_empty() {
            return Err(MapError::Corrupt);
        }
        Ok(if map.has_deviations() {
            Self { beacons, points: None, lattice: Some(bytes), excess: 1.0 }
        } else {
            Self { beacons, points: Some(bytes), lattice: None, excess: 1.0 }
        })
    }

    /// The factor of the covariances of a comparison.
    pub(super) fn excess(&self, comparison: Comparison) -> f64 {
        if comparison.wants_lattice() { self.excess } else { 1.0 }
    }

    /// The names of the beacons, in the maps' order.
    pub fn beacons(&self) -> &[String] {
        &self.beacons
    }

    /// Whether the map that a comparison reads is there.
    pub fn serve(&self, comparison: Comparison) -> bool {
        self.bytes(comparison).is_some()
    }

    /// The map that a comparison reads.
    ///
    /// # Errors
    /// The map was not made, or not read.
    pub(super) fn map(&self, comparison: Comparison) -> Result<Map<'_>, MapError> {
        Map::decode(self.bytes(comparison).ok_or(MapError::Missing)?).map(|(map, _)| map)
    }

    /// The bytes of the map that a comparison reads, where it is there.
    pub fn bytes(&self, comparison: Comparison) -> Option<&[u8]> {
        if comparison.wants_lattice() { self.lattice.as_deref() } else { self.points.as_deref() }
    }
}

/// The names of a map's beacons, of which the map has only numbers: the names in captures with these minors, or else
/// the numbers.
pub fn names_of<'a>(map: &Map, captures: impl Iterator<Item = &'a Capture>) -> Vec<String> {
    let heard: BTreeSet<&String> = captures.flat_map(|capture| &capture.samples).map(|sample| &sample.beacon).collect();
    let name = |identity: u16| {
        let spelt = heard.iter().find(|name| minor(name) == Some(identity));
        spelt.map_or_else(|| identity.to_string(), |name| (*name).clone())
    };
    map.identities().map(name).collect()
}

/// The kernel of a survey's process, if any of these comparisons reads it.
///
/// # Errors
/// No point receives a beacon.
pub(super) fn kernel(survey: &Survey, making: Making, comparisons: &[Comparison]) -> Result<Option<Kernel>, MapError> {
    let wanted = comparisons.iter().any(|comparison| comparison.wants_lattice());
    wanted.then(|| fitted(survey, making, None).map(|process| process.kernel())).transpose()
}

/// The process of a survey, about the trend that its plan gives.
fn fitted(survey: &Survey, making: Making, guess: Option<Kernel>) -> Result<Process, MapError> {
    let levels = Trend::rssis(survey);
    let process = match making.plan {
        Some(plan) => Process::fit_likelier(survey, Trend::rays(survey, plan), levels, guess),
        None => Process::fit(survey, levels, guess),
    };
    process.ok_or(MapError::Invalid)
}
