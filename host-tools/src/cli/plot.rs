//! `baliza plot`: draws a file of positions, or a folder.

use std::path::{Path, PathBuf};

use analysis::Setup;
use analysis::locate::advice;
use anyhow::Result;
use pictures::{Dot, Errors, Picture, PictureBuilder};
use recording::beacons::read_beacons;
use recording::folder::RecordingSettings;
use recording::positions::{self, PositionRow};
use recording::{Coordinates, Files, Height, MeasurementMode, Recording, Space, Truths, read_anchors};

use super::PictureFile;
use super::floor_plan::FloorPlanArgs;
use super::folder::FolderFiles;
use super::numbers::finite;
use super::progress::Progress;
use super::report::flat;
use super::site_names::SiteNamesArgs;

/// Draw positions: a map with error ellipses, and how large the errors are
///
/// With a folder, as `simulate --out` makes it, the files in it are drawn: positions.csv, truth.csv, anchors.csv,
/// beacons.csv, walls.csv; without positions.csv, the track of ranges.csv. Each tag (column `tag`) has a colour of its
/// own, with one tag each method. Errors come from the column error_m of the positions, or else from the truth: at
/// their time where both have times, else of the same epoch. A truth without times is of dwells: crosses.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza plot walk\n  \
                        baliza plot --positions positions.csv --truth truth.csv --anchors anchors.csv --out room.png\n  \
                        baliza plot walk --plan floor.png --plan-scale 0.02 --plan-corner=-1.5,0 --out walk.svg")]
pub struct Arguments {
    /// A folder of a recording; flags replace its files
    #[arg(value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Positions, as solve writes them
    #[arg(long, value_name = "FILE", required_unless_present = "folder")]
    positions: Option<PathBuf>,
    /// Where the tags truly were: CSV with epoch,t_s,x_m,y_m and, with several tags, tag
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Added to the times of the truth, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    time_offset_s: f64,
    /// Surveyed anchors: CSV with anchor,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    anchors: Option<PathBuf>,
    /// Beacons: CSV with beacon,x_m,y_m
    #[arg(long, value_name = "FILE")]
    beacons: Option<PathBuf>,
    #[command(flatten)]
    names: SiteNamesArgs,
    #[command(flatten)]
    floor_plan: FloorPlanArgs,
    /// The picture, as .svg or .png [default: picture.png in the folder]
    #[arg(long, value_name = "FILE", required_unless_present = "folder")]
    out: Option<PathBuf>,
}

/// The picture's name in a folder.
const IN_FOLDER: &str = "picture.png";

/// Runs `baliza plot`.
///
/// # Errors
/// A file is wrong, or the picture cannot be drawn or written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let in_folder = || arguments.folder.as_ref().map(|folder| folder.join(IN_FOLDER));
    let files = FolderFiles::open(arguments.folder.as_deref())?;
    let out = arguments.out.clone().or_else(in_folder).unwrap_or_default();
    let file = PictureFile::of("--out", &out)?;
    file.write_and_note(&arguments.picture(&files)?.draw())
}

impl Arguments {
    fn picture(&self, files: &FolderFiles) -> Result<Picture> {
        let names = self.names.read(self.folder.as_deref())?;
        let (rows, source) = self.rows(files)?;
        super::warn(advice::of_positions(&rows));
        let truth_file = files.find(&self.truth, "truth.csv");
        let truths = truth_file.as_deref().map(|file| Truths::read(file, false)).transpose()?;
        let anchors_file = files.find_rows(&self.anchors, "anchors.csv")?;
        let anchors = anchors_file.as_deref().map(read_anchors).transpose()?.unwrap_or_default();
        let beacons_file = files.find_rows(&self.beacons, "beacons.csv")?;
        let beacons = beacons_file.as_deref().map(read_beacons).transpose()?.unwrap_or_default();
        let floor_plan = self.floor_plan.read(files.find(&None, "walls.csv").as_deref())?;

        let mut builder = PictureBuilder::new(Picture {
            source,
            anchors: anchors
                .into_iter()
                .map(|anchor| (names.node(&anchor.name).to_owned(), flat(&anchor.place)))
                .collect(),
            beacons: beacons
                .into_iter()
                .map(|beacon| (names.beacon(&beacon.name).to_owned(), beacon.position_m))
                .collect(),
            walls_m: floor_plan.walls_m,
            plan: floor_plan.plan,
            errors: errors(&rows, truths.as_ref()),
            ..Picture::default()
        });
        let name = |tag: Option<&str>| tag.map_or_else(String::new, |tag| names.node(tag).to_owned());
        for (tag, truth) in truths.iter().flat_map(Truths::by_tag) {
            let name = name(tag);
            truth.places().for_each(|place| builder.truth(&name, flat(place), !truth.has_times()));
        }
        for row in &rows {
            let truth = truths.as_ref().map(|truths| truths.of(row.tag.as_deref())).transpose()?.flatten();
            let truth = truth.and_then(|truth| truth.of_epoch(&row.epoch, row.t_s, self.time_offset_s));
            let dot = row.place.map(|place| Dot {
                at_m: flat(&place),
                truth_m: truth.as_ref().map(flat),
                covariance_m2: row.covariance_m2(),
            });
            let distance_m = |place: Coordinates| {
                let truth = truth.as_ref()?;
                Some(if was_given(row) { place.horizontal_m(truth) } else { place.distance_m(truth) })
            };
            let error_m = row.place.and_then(|place| row.error_m.or_else(|| distance_m(place)));
            builder.position(&row.method, &name(row.tag.as_deref()), dot, error_m);
            row.t_s.into_iter().for_each(|t_s| builder.time(t_s));
        }
        Ok(builder.finish())
    }

    /// The positions, and where they come from: without a file of them, the track of the folder's recording.
    fn rows(&self, files: &FolderFiles) -> Result<(Vec<PositionRow>, String)> {
        if let Some(file) = files.find(&self.positions, "positions.csv") {
            return Ok((positions::read(&file)?, file.display().to_string()));
        }
        let (anchors, (mode, measured)) = (files.file(&self.anchors, "anchors.csv")?, files.measured()?);
        let rows = track(&files.settings(), &anchors, mode, &measured)?;
        Ok((rows, format!("track of {}", measured.display())))
    }
}

/// Whether the height of a position was given: it has no deviation, where the other coordinates have one.
fn was_given(row: &PositionRow) -> bool {
    row.sigma_m.is_some() && row.sigma_z_m.unwrap_or(0.0) == 0.0
}

/// The space of the errors: without truth that of the positions, as far as it is known.
fn errors(rows: &[PositionRow], truths: Option<&Truths>) -> Errors {
    let has_height = |row: &PositionRow| row.place.is_some_and(|place| place.z_m.is_some());
    let heights = rows.iter().any(|row| has_height(row) && !was_given(row));
    let mut of_truth = truths.into_iter().flat_map(Truths::by_tag).flat_map(|(_, truth)| truth.places());
    match truths {
        None if heights => Errors::Unknown,
        Some(_) | None => Errors::between(heights, of_truth.any(|place| place.z_m.is_some())),
    }
}

/// The track of each tag of a recording with these settings.
fn track(
    settings: &RecordingSettings,
    anchors: &Path,
    mode: MeasurementMode,
    measured: &Path,
) -> Result<Vec<PositionRow>> {
    let (space, weighting) = (settings.space(), settings.nlos.unwrap_or_default());
    let anchor_heights = space != Space::Plane(Height::Unknown);
    let files = Files { anchors, measured, mode, truth: None, anchor_heights, truth_heights: false };
    let recordings = Recording::read(&files)?;
    let setup = Setup::of(space);
    let progress = Progress::new(recordings.iter().map(|recording| recording.epochs.len()).sum());
    let mut rows = Vec::new();
    for recording in &recordings {
        let mut tracker = super::track::tracker(recording, setup, weighting, None);
        let solved = tracker.follow_all(&recording.epochs, || progress.step());
        rows.extend(recording.epochs.iter().zip(solved).map(|(epoch, solved)| {
            let position = solved.outcome.ok();
            PositionRow {
                epoch: epoch.name.to_owned(),
                tag: recording.tag.clone(),
                method: "track".to_owned(),
                t_s: epoch.t_s,
                place: position.map(|position| position.place),
                sigma_m: position.map(|position| flat(&position.sigma)),
                sigma_z_m: position.and_then(|position| position.sigma.z_m),
                cov_xy_m2: position.map(|position| position.covariance_xy),
                reason: solved.outcome.err().map_or_else(String::new, |reason| reason.as_str().to_owned()),
                error_m: None,
            }
        }));
    }
    Ok(rows)
}
