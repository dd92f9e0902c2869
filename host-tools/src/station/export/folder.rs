//! A part of the station's history as the tables of a recording.
//!
//! The output is `positions.csv` with the columns that `solve` writes, and `walls.csv` and `outlines.csv` where the
//! site has walls and rooms.

use std::fs::File;
use std::path::Path;

use anyhow::{Context, Result};
use baliza_station::Store;
use baliza_station::model::{TagPosition, Zone, ZoneKind};

use super::{Exported, Selection, seconds};
use crate::node::recorder::{is_of_recording, writer};

/// The rooms' outlines, which `classify-rooms` reads.
const OUTLINES: &str = "outlines.csv";
/// The walls, which `plot` draws.
const WALLS: &str = "walls.csv";
/// What found the positions.
const METHOD: &str = "station";

/// Whether a file belongs to an export, and is replaced with it.
pub fn is_of_export(name: &str) -> bool {
    is_of_recording(name) || [OUTLINES, WALLS].contains(&name)
}

/// Writes a selection to a folder.
///
/// # Errors
/// There are no positions; the store or the folder returns an error.
pub async fn write_folder(store: &Store, selection: &Selection, folder: &Path) -> Result<Exported> {
    let mut positions = Positions::create(folder)?;
    let exported = selection.each(store, &selection.tags, |row| Ok(positions.take(row)?)).await?;
    positions.finish()?;
    let exported = Selection::some(exported)?;
    write_walls(folder, &selection.site.walls_m)?;
    write_outlines(folder, &store.zones().await?, &selection.site.name)?;
    Ok(exported)
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
        ];
        Ok(Self { writer: writer(folder, "positions.csv", &columns)?, epoch: 0 })
    }

    fn take(&mut self, position: &TagPosition) -> csv::Result<()> {
        // The store has whole millimetres and milliseconds.
        let metres = |m: f64| format!("{m:.3}");
        let maybe = |m: Option<f64>| m.map(metres).unwrap_or_default();
        self.writer.write_record([
            &self.epoch.to_string(),
            &seconds(position.t),
            METHOD,
            &metres(position.x_m),
            &metres(position.y_m),
            &maybe(position.z_m),
            &metres(position.sigma_x_m),
            &metres(position.sigma_y_m),
            &maybe(position.sigma_z_m),
            &position.used.to_string(),
            "",
            &format!("{:.6}", position.cov_xy_m2),
            &position.tag,
            position.room.as_deref().unwrap_or_default(),
        ])?;
        self.epoch += 1;
        Ok(())
    }

    fn finish(mut self) -> Result<()> {
        self.writer.flush().context("cannot write the positions")
    }
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
