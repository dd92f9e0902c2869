//! A part of the station's history as the tables of a recording.
//!
//! The output is `positions.csv` with the columns that `solve` writes; the measurements, where the station has kept
//! them; and `walls.csv` and `outlines.csv` where the site has walls and rooms.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::Path;

use anyhow::{Context, Result};
use station_core::Store;
use station_core::Utc;
use station_core::model::{Doubt, NodeMeasurement, TagPosition, Zone, ZoneKind};
use station_core::store::Span;

use super::measurements::Measurements;
use super::{Exported, Parts, Selection, seconds};
use node_link::recorder::{is_of_recording, writer};

/// The rooms' outlines, which `classify-rooms` reads.
const OUTLINES: &str = "outlines.csv";
/// The walls, which `plot` draws.
const WALLS: &str = "walls.csv";
/// What found the positions.
const METHOD: &str = "station";
/// The reason of a round without a position: the store does not have it.
const NO_POSITION: &str = "unknown";

/// Whether a file belongs to an export, and is replaced with it.
pub fn is_of_export(name: &str) -> bool {
    is_of_recording(name) || [OUTLINES, WALLS].contains(&name)
}

/// Writes a selection to a folder.
///
/// # Errors
/// There are no positions; the store or the folder returns an error.
pub async fn write_folder(store: &Store, selection: &Selection, folder: &Path) -> Result<Exported> {
    let Selection { site, span, .. } = selection;
    let mut exported = Exported::nothing_of(site);
    let mut positions = Positions::create(folder)?;
    let mut measurements = Measurements::new(folder, store.peers(&site.name).await?);
    let mut with_positions = BTreeSet::new();
    let mut parts = Parts::of(*span);
    while let Some(part) = parts.next() {
        let rounds = Rounds::read(store, selection, part, &mut with_positions).await?;
        parts.adapt_to(rounds.rows);
        for ((t, tag), round) in &rounds.by_end {
            positions.take(*t, tag, round.position.as_ref())?;
            measurements.take(positions.epoch, &round.measurements)?;
            exported.positions += usize::from(round.position.is_some());
            positions.epoch += 1;
        }
    }
    positions.finish()?;
    exported.tags = with_positions.len();
    (exported.measurements, exported.left_out) = measurements.finish()?;
    let exported = exported.some()?;
    write_walls(folder, &selection.site.walls_m)?;
    write_outlines(folder, &store.zones().await?, &selection.site.name)?;
    Ok(exported)
}

/// The end of a round of a tag.
#[derive(Default)]
struct Round {
    position: Option<TagPosition>,
    measurements: Vec<NodeMeasurement>,
}

/// The rounds of a part.
struct Rounds {
    /// By their end and tag.
    by_end: BTreeMap<(Utc, String), Round>,
    rows: usize,
}

impl Rounds {
    async fn read<'t>(
        store: &Store,
        selection: &'t Selection,
        part: Span,
        with_positions: &mut BTreeSet<&'t str>,
    ) -> Result<Self> {
        let Selection { site, tags, .. } = selection;
        let positions = selection.positions(store, tags, part, with_positions).await?;
        let names: BTreeSet<_> = tags.iter().map(|tag| tag.tag.as_str()).collect();
        let mut measurements = store.measurements(&site.name, part).await?;
        measurements.retain(|measurement| names.contains(measurement.tag.as_str()));
        let rows = positions.len() + measurements.len();
        let mut by_end = BTreeMap::new();
        for position in positions {
            let round: &mut Round = by_end.entry((position.t, position.tag.clone())).or_default();
            round.position = Some(position);
        }
        for measurement in measurements {
            by_end.entry((measurement.round, measurement.tag.clone())).or_default().measurements.push(measurement);
        }
        Ok(Self { by_end, rows })
    }
}

/// The table of positions.
struct Positions {
    writer: csv::Writer<File>,
    epoch: usize,
}

impl Positions {
    fn create(folder: &Path) -> Result<Self> {
        let columns = [
            "epoch",
            "t_s",
            "method",
            "x_m",
            "y_m",
            "z_m",
            "sigma_x_m",
            "sigma_y_m",
            "sigma_z_m",
            "used",
            "reason",
            "cov_xy_m2",
            "tag",
            "room",
            "flag",
            "alt_x_m",
            "alt_y_m",
            "alt_z_m",
        ];
        Ok(Self { writer: writer(folder, "positions.csv", &columns)?, epoch: 0 })
    }

    /// The row of a round.
    fn take(&mut self, t: Utc, tag: &str, position: Option<&TagPosition>) -> csv::Result<()> {
        let of = |value: fn(&TagPosition) -> Option<f64>| metres(position.and_then(value));
        let alternative_m = position.and_then(|position| position.doubt?.alternative_m());
        let [alt_x, alt_y, alt_z] = [0, 1, 2].map(|axis| metres(alternative_m.map(|place| place[axis])));
        self.writer.write_record([
            self.epoch.to_string().as_str(),
            &seconds(t),
            METHOD,
            &of(|position| Some(position.x_m)),
            &of(|position| Some(position.y_m)),
            &of(|position| position.z_m),
            &of(|position| Some(position.sigma_x_m)),
            &of(|position| Some(position.sigma_y_m)),
            &of(|position| position.sigma_z_m),
            &position.map_or(0, |position| position.used).to_string(),
            position.map_or(NO_POSITION, |_| ""),
            &position.map(|position| format!("{:.6}", position.cov_xy_m2)).unwrap_or_default(),
            tag,
            position.and_then(|position| position.room.as_deref()).unwrap_or_default(),
            position.and_then(|position| position.doubt.as_ref()).map_or("", Doubt::flag),
            &alt_x,
            &alt_y,
            &alt_z,
        ])
    }

    fn finish(mut self) -> Result<()> {
        self.writer.flush().context("cannot write the positions")
    }
}

/// The store has whole millimetres.
pub(super) fn metres(m: Option<f64>) -> String {
    m.map(|m| format!("{m:.3}")).unwrap_or_default()
}

fn write_walls(folder: &Path, walls_m: &[[[f64; 2]; 2]]) -> Result<()> {
    if walls_m.is_empty() {
        return Ok(());
    }
    let mut walls = writer(folder, WALLS, &["x1_m", "y1_m", "x2_m", "y2_m"])?;
    for [[x1, y1], [x2, y2]] in walls_m {
        walls.write_record([x1, y1, x2, y2].map(ToString::to_string))?;
    }
    Ok(walls.flush()?)
}

fn write_outlines(folder: &Path, zones: &[Zone], site: &str) -> Result<()> {
    let rooms: Vec<_> = zones.iter().filter(|zone| zone.site == site && zone.kind == ZoneKind::Room).collect();
    if rooms.is_empty() {
        return Ok(());
    }
    let mut outlines = writer(folder, OUTLINES, &["room", "x_m", "y_m"])?;
    for room in rooms {
        for [x, y] in &room.corners_m {
            outlines.write_record([&room.name, &x.to_string(), &y.to_string()])?;
        }
    }
    Ok(outlines.flush()?)
}
