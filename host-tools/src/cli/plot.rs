//! `baliza plot`: draws a file of positions.

use std::path::PathBuf;

use anyhow::Result;
use host_tools::files::positions::{self, PositionRow};
use host_tools::locate::advice;
use host_tools::plot::{Dot, Picture, Track};
use host_tools::{Coordinates, Truth, read_anchors};

use super::PictureFile;
use super::recording_args::finite;

/// Draw positions: a map with error ellipses, and how large the errors are
///
/// Errors come from the column error_m of the positions, or else from the truth: at their time where both have times,
/// else of the same epoch.
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
    /// Added to the times of the truth, seconds
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        value_parser = finite,
        requires = "truth"
    )]
    time_offset_s: f64,
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
    super::warn(advice::of_positions(&rows));
    let truth = arguments.truth.as_deref().map(|file| Truth::read(file, false)).transpose()?.unwrap_or_default();
    let named = rows.iter().map(|row| (row.epoch.as_str(), row.t_s));
    let (places, _) = truth.of_epochs(named, arguments.time_offset_s);
    let anchors = match &arguments.anchors {
        Some(file) => read_anchors(file)?,
        None => Vec::new(),
    };
    let picture = Picture {
        anchors: anchors.into_iter().map(|anchor| (anchor.name, flat(&anchor.place))).collect(),
        beacons: Vec::new(),
        walls_m: Vec::new(),
        truth_m: vec![truth.places().map(flat).collect()],
        tracks: tracks(&rows, &places),
    };
    file.write_and_note(picture.to_svg()?)
}

/// The rows by method, in the order in which the methods first appear, with their true positions.
fn tracks(rows: &[PositionRow], truth: &[Option<Coordinates>]) -> Vec<Track> {
    let mut tracks: Vec<Track> = Vec::new();
    for (row, truth) in rows.iter().zip(truth) {
        let at = tracks.iter().position(|track| track.method == row.method).unwrap_or_else(|| {
            tracks.push(Track { method: row.method.clone(), ..Track::default() });
            tracks.len() - 1
        });
        let Some(place) = row.place else { continue };
        tracks[at].dots.push(Dot { at_m: [place.x_m, place.y_m], sigma_m: row.sigma_m });
        let error_m = row.error_m.or_else(|| Some(place.distance_m(truth.as_ref()?)));
        tracks[at].errors_m.extend(error_m);
    }
    tracks
}
