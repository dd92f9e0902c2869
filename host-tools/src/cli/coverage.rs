//! `baliza coverage`: maps the reception of beacons.

use baliza_report::{mean, percentile};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use analysis::survey::coverage::bound::{Noise, Station};
use analysis::survey::coverage::{CoverageMap, Fitted, Grid, USUAL_WALL_DB, errors_m, fitted, walls_of};
use analysis::survey::fingerprint::{Average, Survey};
use anyhow::Result;
use pictures::{Heat, heat};
use recording::UserError;
use recording::beacons::{Beacon, Dwell, Wall, read_beacons, read_stays, read_walls};
use recording::output;

use super::numbers::{finite, positive};
use super::recording_values::CornersM;
use super::{PictureFile, note, print, print_json, write};

/// Map the reception of beacons: measured from fingerprints, simulated from beacons and walls, or both side by side
///
/// Simulated maps also have the least possible error of a position (the Cramér-Rao bound).
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza coverage --fingerprints fingerprints.csv --plot measured.svg\n  \
                        baliza coverage --beacons calibrated.csv --walls walls.csv --of error --plot error.svg\n  \
                        baliza coverage --fingerprints fingerprints.csv --beacons calibrated.csv --of 3 --plot both.png")]
pub struct Arguments {
    /// RSSI values at known points: CSV with point,x_m,y_m,beacon,rssi_dbm
    #[arg(long, value_name = "FILE", required_unless_present = "beacons")]
    fingerprints: Option<PathBuf>,
    /// Beacons to simulate: CSV with beacon,x_m,y_m and, where known, rssi_1m_dbm,path_loss_exponent
    #[arg(long, value_name = "FILE")]
    beacons: Option<PathBuf>,
    /// Walls: CSV with x1_m,y1_m,x2_m,y2_m and, where known, attenuation_db; or the corners of an outline, x_m,y_m
    #[arg(long, value_name = "FILE")]
    walls: Option<PathBuf>,
    /// The attenuation of a wall where it is not known, dB
    #[arg(long, value_name = "DB", default_value_t = USUAL_WALL_DB, value_parser = positive)]
    wall_db: f64,
    /// Weaker signals are not received, dBm
    #[arg(long, value_name = "DBM", default_value_t = -90.0, allow_negative_numbers = true, value_parser = finite)]
    sensitivity_dbm: f64,
    /// The side of a cell, metres
    #[arg(long, value_name = "M", default_value_t = 0.25, value_parser = positive)]
    cell_m: f64,
    /// The mapped area, metres [default: that of the files, and a metre around]
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true, value_parser = CornersM::parse)]
    area: Option<CornersM>,
    /// What is drawn: `mean` (of all beacons' RSSI values), `heard` (how many), `error` (least error of a position), or
    /// a beacon by name
    #[arg(long, value_name = "WHAT", default_value = "mean")]
    of: String,
    /// Draw the map, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Write the cells: CSV with source,x_m,y_m,heard,error_m and a column a beacon with its RSSI, dBm
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print JSON: results has an object a source, with cells, heard_mean, heard_least, three_heard, error_p50_m,
    /// error_p90_m, beacons (beacon, heard, mean_dbm, bias_db, rms_db: simulated less measured)
    #[arg(long)]
    json: bool,
}

/// The printed summary of a map.
#[derive(serde::Serialize)]
struct Summary {
    source: &'static str,
    cells: usize,
    heard_mean: f64,
    heard_least: f64,
    three_heard: f64,
    error_p50_m: Option<f64>,
    error_p90_m: Option<f64>,
    beacons: Vec<Row>,
}

/// The printed summary of a beacon.
#[derive(serde::Serialize)]
struct Row {
    beacon: String,
    heard: f64,
    mean_dbm: Option<f64>,
    bias_db: Option<f64>,
    rms_db: Option<f64>,
}

/// A map with the name of its source, and the errors of its cells where they are known.
struct Source {
    name: &'static str,
    map: CoverageMap,
    errors_m: Option<Vec<f64>>,
}

/// Runs `baliza coverage`.
///
/// # Errors
/// Flags or a file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let picture = PictureFile::plot(arguments.plot.as_deref())?;
    if let Some(file) = &arguments.out {
        output::check("--out", file)?;
    }
    let stays = arguments.fingerprints.as_deref().map(read_stays).transpose()?;
    let placed = arguments.beacons.as_deref().map(read_beacons).transpose()?;
    let walls = arguments.walls.as_deref().map(read_walls).transpose()?.unwrap_or_default();
    let heard = stays.as_deref().map(heard_beacons).unwrap_or_default();
    let beacons = placed.clone().unwrap_or(heard);
    if !["mean", "heard", "error"].contains(&arguments.of.as_str()) && !beacons.iter().any(|b| b.name == arguments.of) {
        let names: Vec<_> = beacons.iter().map(|beacon| beacon.name.as_str()).collect();
        let what = format!("{:?} is neither mean, heard, error nor a beacon: {}", arguments.of, names.join(", "));
        return Err(UserError::flag("--of", what).into());
    }
    if arguments.of == "error" && placed.is_none() {
        return Err(UserError::flag("--of", "the least error needs the beacons' places: --beacons").into());
    }
    let grid = grid(arguments, stays.as_deref(), placed.as_deref(), &walls)?;
    let barriers = walls_of(&walls, arguments.wall_db);

    let mut sources = Vec::new();
    if let Some(stays) = &stays {
        sources.push(Source { name: "measured", map: CoverageMap::measured(grid, &beacons, stays), errors_m: None });
    }
    let mut fits = Vec::new();
    if let Some(placed) = &placed {
        let stations: Vec<_> = placed.iter().map(Station::of).collect();
        let noise = Noise::Level { sensitivity_dbm: arguments.sensitivity_dbm };
        let errors_m = Some(errors_m(grid, &stations, &barriers, noise));
        let map = CoverageMap::simulated(grid, placed, &barriers, arguments.sensitivity_dbm);
        sources.push(Source { name: "simulated", map, errors_m });
        fits = stays.as_deref().map(|stays| fitted(placed, &barriers, stays)).unwrap_or_default();
    }
    if let Some(file) = &arguments.out {
        write(file, &cells(&sources)?)?;
        note(&format!("cells: {}\n", file.display()));
    }
    let summaries: Vec<_> = sources.iter().map(|source| summary(source, &fits)).collect();
    if arguments.json {
        print_json(&summaries)?;
    } else {
        print(table(&summaries).as_bytes())?;
    }
    if let Some(picture) = picture {
        let points_m: Vec<_> = stays.iter().flatten().map(|stay| stay.position_m).collect();
        let stations: Vec<_> = placed.iter().flatten().map(|beacon| (beacon.name.clone(), beacon.position_m)).collect();
        let walls_m: Vec<_> = walls.iter().map(|wall| wall.ends_m).collect();
        let maps = sources.iter().filter_map(|source| draw(arguments, source, &walls_m, &stations, &points_m));
        picture.write_and_note(&heat(&maps.collect::<Vec<_>>())?)?;
    }
    Ok(())
}

/// The beacons of a survey without a file of beacons. Their positions are not known.
fn heard_beacons(stays: &[Dwell]) -> Vec<Beacon> {
    let beacon = |name| Beacon {
        name,
        position_m: [0.0; 2],
        height_m: None,
        rssi_1m_dbm: None,
        path_loss_exponent: None,
        deviation_db: None,
    };
    Survey::of(stays, Average::Power).beacons.into_iter().map(beacon).collect()
}

fn grid(
    arguments: &Arguments,
    stays: Option<&[Dwell]>,
    beacons: Option<&[Beacon]>,
    walls: &[Wall],
) -> Result<Grid, UserError> {
    let corners = match arguments.area {
        Some(CornersM(corners)) => Some(corners),
        None => {
            let points = stays.unwrap_or_default().iter().map(|stay| stay.position_m);
            let places = beacons.unwrap_or_default().iter().map(|beacon| beacon.position_m);
            let ends = walls.iter().flat_map(|wall| wall.ends_m);
            Grid::about(points.chain(places).chain(ends), 1.0)
        }
    };
    let corners = corners.ok_or_else(|| UserError::flag("--area", "the files have no place to map"))?;
    Grid::over("--cell-m", corners, arguments.cell_m)
}

fn summary(source: &Source, fits: &[Fitted]) -> Summary {
    let heard: Vec<f64> = source.map.heard().into_iter().flatten().collect();
    let count = heard.len().max(1) as f64;
    let mut errors: Vec<f64> = source.errors_m.clone().unwrap_or_default();
    errors.sort_by(f64::total_cmp);
    let percentile = |share: f64| (!errors.is_empty()).then(|| percentile(&errors, share));
    let beacons = source.map.beacons.iter().enumerate().map(|(index, beacon)| {
        let rssis: Vec<f64> =
            source.map.values(|rssis| rssis.get(index).copied().flatten()).into_iter().flatten().collect();
        let mean = mean(rssis.iter().copied());
        let fit = fits.iter().find(|fit| fit.beacon == *beacon && source.name == "simulated");
        Row {
            beacon: beacon.clone(),
            heard: rssis.len() as f64 / count,
            mean_dbm: (!rssis.is_empty()).then_some(mean),
            bias_db: fit.map(|fit| fit.bias_db),
            rms_db: fit.map(|fit| fit.rms_db),
        }
    });
    Summary {
        source: source.name,
        cells: heard.len(),
        heard_mean: heard.iter().sum::<f64>() / count,
        heard_least: heard.iter().copied().reduce(f64::min).unwrap_or(0.0),
        three_heard: heard.iter().filter(|heard| **heard >= 3.0).count() as f64 / count,
        error_p50_m: percentile(0.5),
        error_p90_m: percentile(0.9),
        beacons: beacons.collect(),
    }
}

fn table(summaries: &[Summary]) -> String {
    let mut text = String::new();
    for summary in summaries {
        let _ = write!(
            text,
            "{}: {} cells, {:.1} beacons heard on average, {:.0} at least, three or more in {:.0} %",
            summary.source,
            summary.cells,
            summary.heard_mean,
            summary.heard_least,
            100.0 * summary.three_heard
        );
        if let (Some(p50), Some(p90)) = (summary.error_p50_m, summary.error_p90_m) {
            let _ = write!(text, "; least error of a position {p50:.2} m (P50), {p90:.2} m (P90)");
        }
        text += "\n  beacon        heard  mean dBm  simulated less measured, dB (mean, RMS)\n";
        for row in &summary.beacons {
            let number = |number: Option<f64>| number.map_or("-".to_owned(), |number| format!("{number:.1}"));
            let _ = writeln!(
                text,
                "  {:<12} {:>4.0} %  {:>8}  {:>6} {:>6}",
                row.beacon,
                100.0 * row.heard,
                number(row.mean_dbm),
                number(row.bias_db),
                number(row.rms_db)
            );
        }
    }
    text
}

fn cells(sources: &[Source]) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let names = sources.first().map(|source| source.map.beacons.clone()).unwrap_or_default();
    writer.write_record(
        ["source", "x_m", "y_m", "heard", "error_m"].into_iter().chain(names.iter().map(String::as_str)),
    )?;
    let number = |number: Option<f64>| number.map_or_else(String::new, |number| format!("{number:.3}"));
    for source in sources {
        for (index, (at, rssis)) in source.map.grid.middles().zip(&source.map.rssis).enumerate() {
            let Some(rssis) = rssis else { continue };
            let heard = rssis.iter().flatten().count().to_string();
            let error = source.errors_m.as_ref().and_then(|errors| errors.get(index).copied());
            let mut fields =
                vec![source.name.to_owned(), number(Some(at[0])), number(Some(at[1])), heard, number(error)];
            fields.extend(rssis.iter().map(|rssi| number(*rssi)));
            writer.write_record(fields)?;
        }
    }
    writer.into_inner().map_err(|error| anyhow::Error::from(error.into_error()))
}

/// Draws the selected map. Errors are drawn only where they are known.
fn draw(
    arguments: &Arguments,
    source: &Source,
    walls_m: &[[[f64; 2]; 2]],
    stations: &[(String, [f64; 2])],
    points_m: &[[f64; 2]],
) -> Option<Heat> {
    let map = &source.map;
    let (values, what, unit) = match arguments.of.as_str() {
        "mean" => (map.mean(arguments.sensitivity_dbm), "mean level of all beacons".to_owned(), "dBm"),
        "heard" => (map.heard(), "beacons heard".to_owned(), "beacons"),
        "error" => (
            source.errors_m.as_ref()?.iter().copied().map(Some).collect(),
            "least error of a position".to_owned(),
            "metres",
        ),
        name => {
            let index = map.beacons.iter().position(|beacon| beacon == name)?;
            (map.values(|rssis| rssis.get(index).copied().flatten()), format!("level of beacon {name}"), "dBm")
        }
    };
    Some(Heat {
        title: format!("{}: {what}", source.name),
        least_m: map.grid.least_m,
        cell_m: map.grid.cell_m,
        columns: map.grid.columns,
        values,
        unit: unit.to_owned(),
        low_is_good: arguments.of == "error",
        walls_m: walls_m.to_vec(),
        stations: stations.to_vec(),
        points_m: if source.name == "measured" { points_m.to_vec() } else { Vec::new() },
    })
}

/// The walls of a file for signals and for pictures. Walls without an attenuation get `wall_db`.
pub(super) fn barriers(
    file: Option<&Path>,
    wall_db: f64,
) -> Result<(Vec<Wall>, Vec<positioning_core::ble::path_loss::Wall<f64>>), UserError> {
    let walls = file.map(read_walls).transpose()?.unwrap_or_default();
    let barriers = walls_of(&walls, wall_db);
    Ok((walls, barriers))
}
