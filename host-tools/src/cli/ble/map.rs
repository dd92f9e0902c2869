//! `baliza ble map`: makes an RSSI map for nodes.

use std::path::PathBuf;

use analysis::survey::fingerprint::{Comparison, Grid, Making, Maps, Setup, held_out, spread};
use anyhow::Result;
use baliza_report::{MarkdownTable, Statistics};
use positioning_core::ble::fingerprint::{MAX_NODE_POINTS, Map, MapError};
use recording::UserError;
use recording::beacons::read_stays;
use recording::output;

use super::fingerprint::Averages;
use super::{PlanArguments, survey_of};
use crate::cli::progress::Progress;
use crate::cli::{note, print_json, write};

/// With more points than this, a survey's points are found in blocks and not one by one.
const MOST_FOLDS: usize = 64;

/// Make a map of RSSI values for nodes, and say how good it is
///
/// From a survey, a lattice of RSSI values between its points. With --beacons and --walls, the map is predicted where
/// the survey has few points, by path loss along rays through walls, corrected by the surveyed points. --survey-points
/// takes only N points, spread evenly, and reports how well the others are found. Without it, each point is found by
/// the other points. If there are more than 64 points, each block of points is found by the other blocks.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza ble map --fingerprints fingerprints.csv --out room.map\n  \
                        baliza ble map --fingerprints fingerprints.csv --out room.map --survey-points 8 --beacons beacons.csv --walls walls.csv")]
pub struct Arguments {
    /// The survey: CSV with point,x_m,y_m,beacon,rssi_dbm
    #[arg(long, value_name = "FILE")]
    fingerprints: PathBuf,
    /// Where the map goes
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The surveyed points themselves, for the k nearest, and no lattice
    #[arg(long, conflicts_with_all = ["points", "step_m", "beacons"])]
    surveyed: bool,
    /// The most points of the lattice
    #[arg(long, value_name = "N", default_value_t = MAX_NODE_POINTS as u16, value_parser = clap::value_parser!(u16).range(1..=1000))]
    points: u16,
    /// The step of the lattice, metres, 0.05 to 10 [default: as small as the number of points allows]
    #[arg(long, value_name = "M", value_parser = clap::value_parser!(f64))]
    step_m: Option<f64>,
    /// Take only N points of the survey
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    survey_points: Option<u16>,
    /// How RSSI values of one point are averaged
    #[arg(long, value_name = "HOW", default_value = "power")]
    average: Averages,
    #[command(flatten)]
    place: PlanArguments,
    /// Print JSON: results has one object, with beacons, points, bytes, step_m, survey_points, found_points, mae_m,
    /// rmse_m (null where no point was left to be found)
    #[arg(long)]
    json: bool,
}

/// The printed summary.
#[derive(serde::Serialize)]
struct Summary {
    beacons: Vec<String>,
    points: usize,
    bytes: usize,
    step_m: Option<f64>,
    survey_points: usize,
    found_points: usize,
    mae_m: Option<f64>,
    rmse_m: Option<f64>,
}

/// Runs `baliza ble map`.
///
/// # Errors
/// Flags or a file are wrong, the survey makes no map, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    output::check("--out", &arguments.out)?;
    if arguments.step_m.is_some_and(|step_m| !(0.05..=10.0).contains(&step_m)) {
        return Err(UserError::flag("--step-m", "must be from 0.05 to 10").into());
    }
    let stays = read_stays(&arguments.fingerprints)?;
    let average = arguments.average.into();
    let survey = survey_of(&arguments.fingerprints, &stays, average)?;
    let plan = arguments.place.read()?;
    let plan = (!plan.beacons.is_empty()).then_some(&plan);
    let grid = Grid { most: Some(arguments.points.into()), step_m: arguments.step_m };

    let kept = arguments.survey_points.map(|count| spread(&survey, count.into()));
    let is_kept = |point: usize| kept.as_ref().is_none_or(|kept| kept.contains(&point));
    let thin = survey.only(is_kept);
    let comparison =
        if arguments.surveyed { Comparison::Nearest { k: 5, weighted: true } } else { Comparison::Process };
    let (making, setup) = (Making { grid, plan }, Setup { average, ..Setup::default() });
    let wrong = |fault: MapError| UserError::line(&arguments.fingerprints, 1, fault.to_string());
    let maps = Maps::of(&thin, making, &[comparison], None).map_err(wrong)?;
    let bytes = maps.bytes(comparison).unwrap_or_default();
    let (map, _) = Map::decode(bytes)?;

    let folds = stays.len().min(MOST_FOLDS);
    let fold = |point: usize| match kept {
        Some(_) => (!is_kept(point)).then_some(0),
        None => Some(point * folds / stays.len()),
    };
    let progress = Progress::new(if kept.is_some() { 1 } else { folds });
    let errors: Vec<f64> = if stays.len() > 1 {
        let held = held_out(&stays, making, &setup, &[comparison], fold, || progress.step()).map_err(wrong)?;
        held.solved.into_iter().flatten().filter_map(|solved| solved.error_m).collect()
    } else {
        Vec::new()
    };
    drop(progress);
    let figures = Statistics::of(&errors);
    write(&arguments.out, bytes)?;
    let summary = Summary {
        points: map.points(),
        bytes: bytes.len(),
        step_m: map.has_deviations().then(|| map.unit()),
        survey_points: thin.spots.len(),
        found_points: errors.len(),
        mae_m: figures.as_ref().map(|figures| figures.mae),
        rmse_m: figures.as_ref().map(|figures| figures.rmse),
        beacons: survey.beacons,
    };
    if arguments.json {
        return print_json(&summary);
    }
    note(&summary.text(arguments));
    Ok(())
}

impl Summary {
    fn text(&self, arguments: &Arguments) -> String {
        let which = match arguments.survey_points {
            Some(_) => "the other points",
            None if self.found_points <= MOST_FOLDS => "each, by the others",
            None => "each block, by the others",
        };
        let metres = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |metres| format!("{metres:.2}"));
        let step_m = self.step_m.map_or_else(|| "-".to_owned(), |step_m| format!("{step_m:.3}"));
        let mut table = MarkdownTable::new([
            "surveyed:",
            "points of the map:",
            "step, m:",
            "bytes:",
            "found",
            "points:",
            "MAE, m:",
            "RMSE, m:",
        ]);
        let (found, mae_m, rmse_m) = (self.found_points, metres(self.mae_m), metres(self.rmse_m));
        table.row(format_args!(
            "{} | {} | {step_m} | {} | {which} | {found} | {mae_m} | {rmse_m}",
            self.survey_points, self.points, self.bytes
        ));
        let beacons = self.beacons.join(", ");
        format!("{}map: {}, with the beacons {beacons}\n", table.into_columns(), arguments.out.display())
    }
}
