//! `baliza plot`: draws a file of positions.

use std::collections::HashMap;
use std::path::PathBuf;

use anyhow::Result;
use host_tools::files::positions::{self, PositionRow};
use host_tools::plot::{Dot, Picture, Track};
use host_tools::{Coordinates, read_anchors, read_truth};

use super::PictureFile;

/// Draw positions: a map with error ellipses, and how large the errors are
///
/// Errors come from the column error_m of the positions, or else from the truth of the same epoch.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  baliza plot --positions positions.csv --truth truth.csv --anchors anchors.csv --out room.png"
)]
pub struct Arguments {
    /// Positions, as solve writes them
    #[arg(long, value_name = "FILE")]
    positions: PathBuf,
    /// Where the tag truly was: CSV with epoch,t_s,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Surveyed anchors: CSV with anchor,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    anchors: Option<PathBuf>,
    /// The picture, as .svg or .png
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Runs `baliza plot`.
///
/// # Errors
/// A file is wrong, or the picture cannot be drawn or written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let file = PictureFile::of("--out", &arguments.out)?;
    let flat = |place: &Coordinates| [place.x_m, place.y_m];
    let rows = positions::read(&arguments.positions)?;
    let truth = match &arguments.truth {
        Some(file) => read_truth(file)?,
        None => Vec::new(),
    };
    let anchors = match &arguments.anchors {
        Some(file) => read_anchors(file)?,
        None => Vec::new(),
    };
    let picture = Picture {
        anchors: anchors.into_iter().map(|anchor| (anchor.name, flat(&anchor.place))).collect(),
        beacons: Vec::new(),
        walls_m: Vec::new(),
        truth_m: vec![truth.iter().map(|(_, place)| flat(place)).collect()],
        tracks: tracks(&rows, &truth.into_iter().collect()),
    };
    file.write_and_note(picture.to_svg()?)
}

/// The rows by method, in the order in which the methods first appear.
fn tracks(rows: &[PositionRow], truth: &HashMap<String, Coordinates>) -> Vec<Track> {
    let mut tracks: Vec<Track> = Vec::new();
    for row in rows {
        let at = tracks.iter().position(|track| track.method == row.method).unwrap_or_else(|| {
            tracks.push(Track { method: row.method.clone(), ..Track::default() });
            tracks.len() - 1
        });
        let Some(place) = row.place else { continue };
        tracks[at].dots.push(Dot { at_m: [place.x_m, place.y_m], sigma_m: row.sigma_m });
        let error_m = row.error_m.or_else(|| Some(place.distance_m(truth.get(&row.epoch)?)));
        tracks[at].errors_m.extend(error_m);
    }
    tracks
}
