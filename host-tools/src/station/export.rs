//! A part of the station's history as the tables of a recording.
//!
//! The input is the store, a site and a span; the output is `positions.csv` with the columns that `solve` writes, and
//! `walls.csv` and `outlines.csv` where the site has walls and rooms. The memory that it takes does not depend on the
//! span: positions are read a part after the other.

use std::fs::File;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};
use baliza_station::model::{Tag, TagPosition, Zone, ZoneKind};
use baliza_station::store::Span;
use baliza_station::{Store, Utc};

use crate::UserError;
use crate::node::recorder::{is_of_recording, writer};

/// The rooms' outlines, which `classify-rooms` reads.
const OUTLINES: &str = "outlines.csv";
/// The walls, which `plot` draws.
const WALLS: &str = "walls.csv";
/// What found the positions.
const METHOD: &str = "station";
/// The parts of the span that are read together: the shortest and the longest.
const PARTS: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(86_400)];
/// With more positions, a part is too long.
const MANY: usize = 50_000;

/// Whether a file belongs to an export, and is replaced with it.
pub fn is_of_export(name: &str) -> bool {
    is_of_recording(name) || [OUTLINES, WALLS].contains(&name)
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// The site.
    pub site: String,
    /// The number of tags that have positions.
    pub tags: usize,
    /// The number of positions.
    pub positions: usize,
}

impl Exported {
    /// Writes the positions of a site, or of one tag, to a folder: without a site, those of the only one with tags.
    ///
    /// # Errors
    /// The store has no such positions, or there are several sites; the store or the folder returns an error.
    pub async fn write(
        store: &Store,
        site: Option<&str>,
        tag: Option<&str>,
        span: Span,
        folder: &Path,
    ) -> Result<Self> {
        let mut tags = store.tags().await?;
        let site = site_of(&tags, site)?;
        tags.retain(|known| known.site == site && tag.is_none_or(|tag| known.tag == tag));
        if let (Some(tag), true) = (tag, tags.is_empty()) {
            return Err(UserError::flag("--tag", format!("the site {site} has no tag {tag}")).into());
        }
        let mut positions = Positions::create(folder)?;
        let span = Span {
            from: tags.iter().map(|tag| tag.first_seen).min().unwrap_or_default().max(span.from),
            to: tags.iter().map(|tag| tag.last_seen + Duration::from_millis(1)).max().unwrap_or_default().min(span.to),
        };
        let mut with_positions = vec![false; tags.len()];
        let (mut from, mut part) = (span.from, PARTS[0]);
        while from < span.to {
            let until = (from + part).min(span.to);
            let mut rows = Vec::new();
            for (tag, has) in tags.iter().zip(&mut with_positions) {
                // A tag that was not there need not be searched for.
                if tag.first_seen < until && tag.last_seen >= from {
                    let of_tag = store.positions(&site, &tag.tag, Span { from, to: until }, u32::MAX).await?;
                    *has |= !of_tag.is_empty();
                    rows.extend(of_tag);
                }
            }
            rows.sort_by(|a, b| (a.t, &a.tag).cmp(&(b.t, &b.tag)));
            rows.iter().try_for_each(|row| positions.take(row))?;
            // The next part has about as many positions as fit in memory.
            part = if rows.len() > MANY {
                part / 4
            } else if rows.len() < MANY / 8 {
                part * 4
            } else {
                part
            };
            part = part.clamp(PARTS[0], PARTS[1]);
            from = until;
        }
        let count = positions.finish()?;
        if count == 0 {
            return Err(UserError::flag("--from", format!("the site {site} has no positions in this time")).into());
        }
        let sites = store.sites().await?;
        let walls = sites.iter().find(|known| known.name == site).map(|known| known.walls_m.as_slice());
        write_walls(folder, walls.unwrap_or_default())?;
        write_outlines(folder, &store.zones().await?, &site)?;
        Ok(Self { site, tags: with_positions.iter().filter(|has| **has).count(), positions: count })
    }
}

/// The site that a person names, or the only one.
fn site_of(tags: &[Tag], site: Option<&str>) -> Result<String, UserError> {
    let mut sites: Vec<_> = tags.iter().map(|tag| tag.site.as_str()).collect();
    sites.sort_unstable();
    sites.dedup();
    let is_known = |site: &&str| sites.contains(site);
    match (site, sites.as_slice()) {
        (None, [only]) => Ok((*only).to_owned()),
        (Some(site), _) if is_known(&site) => Ok(site.to_owned()),
        (_, []) => Err(UserError::flag("--store", "it has no positions")),
        (None, several) => Err(UserError::flag("--site", format!("which one of {}?", several.join(", ")))),
        (Some(site), known) => Err(UserError::flag("--site", format!("{site:?} is none of {}", known.join(", ")))),
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

    /// The number of rows.
    fn finish(mut self) -> Result<usize> {
        self.writer.flush().context("cannot write the positions")?;
        Ok(self.epoch)
    }
}

/// Seconds since 1970, to a millisecond.
fn seconds(t: Utc) -> String {
    let ms = t.us() / 1000;
    format!("{}.{:03}", ms / 1000, ms % 1000)
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
