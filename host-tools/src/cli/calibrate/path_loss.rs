//! `baliza calibrate path-loss`: RSSI at one metre and path loss exponent of every beacon.

use baliza_report::MarkdownTable;
use std::path::{Path, PathBuf};

use analysis::survey::calibration::{
    Calibrated, Learnt, Placed, Step, WALL_STEPS, calibrate, pieces, to_csv, wall_attenuation,
};
use anyhow::Result;
use pictures as plot;
use recording::UserError;
use recording::beacons::{Capture, read_beacons, read_captures, read_stays, read_walls};
use recording::output;
use recording::positions;

use crate::cli::numbers::finite;
use crate::cli::progress::Progress;
use crate::cli::{PictureFile, note, print, print_json, write};

/// RSSI at one metre and path loss exponent of every beacon, from fingerprints or a walk: by regression, and as a node
/// learns it
///
/// A point counts once, with the mean of its RSSI values. In a walk with known positions, each metre of the way counts
/// once. --out writes the file of beacons again, with the results; `baliza ble solve` reads it. With few points the
/// exponent stays near the usual one.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  baliza calibrate path-loss --beacons beacons.csv --fingerprints fingerprints.csv \
                  --out calibrated.csv --plot path-loss.svg\n  \
                  baliza calibrate path-loss --beacons beacons.csv --rssi rssi.csv --positions uwb.csv")]
pub struct Arguments {
    /// Beacons: CSV with beacon,x_m,y_m and, where known, z_m
    #[arg(long, value_name = "FILE")]
    beacons: PathBuf,
    /// RSSI values at known points: CSV with point,x_m,y_m,beacon,rssi_dbm,t_s
    #[arg(long, value_name = "FILE", required_unless_present = "rssi")]
    fingerprints: Option<PathBuf>,
    /// RSSI values of a walk: CSV with epoch,t_s,beacon,rssi_dbm; with --truth or --positions
    #[arg(long, value_name = "FILE", conflicts_with = "fingerprints")]
    rssi: Option<PathBuf>,
    /// Where the tag truly was: CSV with epoch,x_m,y_m
    #[arg(long, value_name = "FILE", requires = "rssi", required_unless_present_any = ["fingerprints", "positions"])]
    truth: Option<PathBuf>,
    /// Positions of the tag by UWB: those of one method, as `baliza track --out` and `baliza simulate --out` write them
    #[arg(long, value_name = "FILE", requires = "rssi", conflicts_with = "truth")]
    positions: Option<PathBuf>,
    /// The height at which RSSI values were taken, metres: heights of beacons (z_m) count
    #[arg(long, value_name = "Z", allow_negative_numbers = true, value_parser = finite)]
    height_m: Option<f64>,
    /// Walls: CSV with the corners of an outline, x_m,y_m, or with x1_m,y1_m,x2_m,y2_m and, where known,
    /// attenuation_db; where it is not known, one attenuation for all these walls is estimated as well
    #[arg(long, value_name = "FILE")]
    walls: Option<PathBuf>,
    /// Write the beacons with their path loss here
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Draw RSSI values against distance, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON: results has an object a beacon, with points, rssi_1m_dbm, path_loss_exponent, deviation_db,
    /// rssi_1m_sigma_db, path_loss_exponent_sigma, the same as a node learns them as online_… (null where the beacon
    /// was never received) and, with --walls, wall_db
    #[arg(long)]
    json: bool,
}

/// The printed results of a beacon.
#[derive(Debug, serde::Serialize)]
struct Row<'a> {
    beacon: &'a str,
    points: usize,
    rssi_1m_dbm: Option<f64>,
    path_loss_exponent: Option<f64>,
    deviation_db: Option<f64>,
    rssi_1m_sigma_db: Option<f64>,
    path_loss_exponent_sigma: Option<f64>,
    online_rssi_1m_dbm: Option<f64>,
    online_path_loss_exponent: Option<f64>,
    online_deviation_db: Option<f64>,
    online_rssi_1m_sigma_db: Option<f64>,
    online_path_loss_exponent_sigma: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    wall_db: Option<f64>,
}

impl<'a> Row<'a> {
    fn of(calibrated: &'a Calibrated, wall_db: Option<f64>) -> Self {
        let found = calibrated.path_loss;
        let online = |of: fn(&Learnt) -> f64| calibrated.online.as_ref().map(of);
        Self {
            beacon: &calibrated.beacon,
            points: calibrated.points.len(),
            rssi_1m_dbm: found.map(|found| found.level_1m),
            path_loss_exponent: found.map(|found| found.exponent),
            deviation_db: found.map(|found| found.deviation),
            rssi_1m_sigma_db: found.map(|_| calibrated.sigma[0]),
            path_loss_exponent_sigma: found.map(|_| calibrated.sigma[1]),
            online_rssi_1m_dbm: online(|learnt| learnt.path_loss.level_1m),
            online_path_loss_exponent: online(|learnt| learnt.path_loss.exponent),
            online_deviation_db: online(|learnt| learnt.path_loss.deviation),
            online_rssi_1m_sigma_db: online(|learnt| learnt.sigma[0]),
            online_path_loss_exponent_sigma: online(|learnt| learnt.sigma[1]),
            wall_db,
        }
    }
}

/// Runs `baliza calibrate path-loss`.
///
/// # Errors
/// Flags or a file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(file) = &arguments.out {
        output::check("--out", file)?;
    }
    let picture = PictureFile::plot(arguments.plot.as_deref())?;
    let beacons = read_beacons(&arguments.beacons)?;
    let (stays, rssis) = points(arguments)?;
    let walls = arguments.walls.as_deref().map(read_walls).transpose()?.unwrap_or_default();
    let wall_db = walls.iter().any(|wall| wall.attenuation_db.is_none()).then(|| {
        let progress = Progress::new(WALL_STEPS as usize);
        wall_attenuation(&beacons, &stays, arguments.height_m, &walls, || progress.step())
    });
    let calibrated = calibrate(&beacons, &stays, arguments.height_m, &walls, wall_db.unwrap_or(0.0));
    if calibrated.iter().all(|beacon| beacon.points.is_empty()) {
        let wrong = format!("none of the beacons of {} was heard", arguments.beacons.display());
        return Err(UserError::file(rssis, wrong).into());
    }
    if let Some(file) = &arguments.out {
        write(file, &to_csv(&beacons, &calibrated)?)?;
    }
    let rows: Vec<Row> = calibrated.iter().map(|beacon| Row::of(beacon, wall_db)).collect();
    if arguments.json {
        print_json(&rows)?;
    } else {
        print(table(&rows, arguments.rssi.is_some()).as_bytes())?;
    }
    if let Some(wall_db) = wall_db {
        note(&format!("a wall takes {wall_db} dB (ble solve --wall-db {wall_db})\n"));
    }
    if let Some(picture) = picture {
        picture.write_and_note(&plot::path_loss(&calibrated))?;
    }
    if let Some(file) = &arguments.out {
        note(&format!("beacons: {}\n", file.display()));
    }
    Ok(())
}

/// Points with RSSI values, each with the standard deviation of its position, metres, and the file of the points.
fn points(arguments: &Arguments) -> Result<(Vec<Placed>, &Path), UserError> {
    if let Some(file) = &arguments.fingerprints {
        return Ok((read_stays(file)?.into_iter().map(|stay| (stay, 0.0)).collect(), file));
    }
    let Some(file) = &arguments.rssi else {
        return Err(UserError::flag("--rssi", "there are no levels: give this, or --fingerprints"));
    };
    let tags = read_captures(file, arguments.truth.as_deref())?;
    let tracked = arguments.positions.as_deref().map(positions::read_track).transpose()?;
    let step = |tag: &Option<String>, capture: &Capture| match &tracked {
        Some(tracked) => {
            let found = tracked.get(&(tag.clone(), capture.name.clone()));
            found.map(|&(position_m, sigma_m)| Step { position_m, sigma_m })
        }
        None => capture.truth_m.map(|position_m| Step { position_m, sigma_m: 0.0 }),
    };
    let walked: Vec<_> = tags.iter().flat_map(|of| pieces(&of.captures, |capture| step(&of.tag, capture))).collect();
    match walked.is_empty() {
        true => Err(UserError::file(file, "no epoch of it has a known position".to_owned())),
        false => Ok((walked, file)),
    }
}

/// The results as a table. If `on_line` is set, the values that a node learns are below each row.
fn table(rows: &[Row], on_line: bool) -> String {
    let titles = ["beacon", "points:", "level at 1 m, dBm:", "path loss exponent:", "deviation, dB:"];
    let mut table = MarkdownTable::new(titles);
    for row in rows {
        let figure = |value: Option<f64>, sigma: Option<f64>| match (value, sigma) {
            (Some(value), Some(sigma)) => format!("{value:.2} ± {sigma:.2}"),
            (Some(value), None) => format!("{value:.2}"),
            (None, _) => "-".to_owned(),
        };
        let rssi = figure(row.rssi_1m_dbm, row.rssi_1m_sigma_db);
        let exponent = figure(row.path_loss_exponent, row.path_loss_exponent_sigma);
        let deviation = figure(row.deviation_db, None);
        table.row(format_args!("{} | {} | {rssi} | {exponent} | {deviation}", row.beacon, row.points));
        if on_line {
            let rssi = figure(row.online_rssi_1m_dbm, row.online_rssi_1m_sigma_db);
            let exponent = figure(row.online_path_loss_exponent, row.online_path_loss_exponent_sigma);
            let deviation = figure(row.online_deviation_db, None);
            table.row(format_args!("{}, on line | {} | {rssi} | {exponent} | {deviation}", row.beacon, row.points));
        }
    }
    table.into_columns()
}
