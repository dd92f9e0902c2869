//! `baliza plan-anchors`: finds positions for beacons or anchors.

use baliza_report::percentile;
use std::fmt::Write as _;
use std::path::PathBuf;

use analysis::survey::coverage::bound::{Information, Noise, Station};
use analysis::survey::coverage::{Grid, USUAL_WALL_DB};
use analysis::survey::placement::{Found, Problem};
use anyhow::Result;
use clap::ValueEnum;
use pictures::{Heat, heat};
use recording::UserError;
use recording::beacons::{Beacon, Wall, read_beacons};
use recording::output;

use wire::telemetry::metres;

use super::coverage::barriers;
use super::numbers::{finite, positive};
use super::recording_values::CornersM;
use super::{PictureFile, note, print, print_json, write};
use crate::cli::progress::Progress;

/// Find positions for beacons or anchors that leave the least error over an area
///
/// The error is the least that RSSI values (of beacons) or ranges (to anchors) allow, given that the tag is within the
/// area. Positions are added one after the other, then exchanged while that reduces the error.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  baliza plan-anchors --count 5 --area 0,0,7,6.9 --candidates sockets.csv --plot places.svg\n  \
                        baliza plan-anchors --count 4 --kind anchors --area 0,0,22,7 --walls walls.csv --on-walls --height-m 2.4 --out anchors.csv\n  \
                        baliza plan-anchors --count 1 --fixed beacons.csv --area 0,0,12,15"
)]
pub struct Arguments {
    /// How many are to be placed
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    count: u32,
    /// What is placed
    #[arg(long, value_name = "KIND", default_value = "beacons")]
    kind: Kind,
    /// Possible positions: CSV with beacon,x_m,y_m and, where known, rssi_1m_dbm,path_loss_exponent [default:
    /// everywhere, by --spacing-m]
    #[arg(long, value_name = "FILE")]
    candidates: Option<PathBuf>,
    /// From one candidate to the next, metres
    #[arg(long, value_name = "M", default_value_t = 1.0, value_parser = positive, conflicts_with = "candidates")]
    spacing_m: f64,
    /// Existing beacons or anchors: CSV with the same columns
    #[arg(long, value_name = "FILE")]
    fixed: Option<PathBuf>,
    /// Walls: CSV with x1_m,y1_m,x2_m,y2_m and, where known, attenuation_db; or the corners of an outline, x_m,y_m
    #[arg(long, value_name = "FILE")]
    walls: Option<PathBuf>,
    /// The attenuation of a wall where it is not known, dB
    #[arg(long, value_name = "DB", default_value_t = USUAL_WALL_DB, value_parser = positive)]
    wall_db: f64,
    /// The area of the tags, metres [default: around walls, candidates and existing beacons or anchors]
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true, value_parser = CornersM::parse)]
    area: Option<CornersM>,
    /// The side of a cell for which the error is computed, metres
    #[arg(long, value_name = "M", default_value_t = 0.5, value_parser = positive)]
    cell_m: f64,
    /// Weaker beacons are not received, dBm
    #[arg(long, value_name = "DBM", default_value_t = -90.0, allow_negative_numbers = true, value_parser = finite)]
    sensitivity_dbm: f64,
    /// Standard deviation of a range in line of sight, metres (anchors)
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = positive)]
    range_sigma_m: f64,
    /// The increase of the standard deviation for each wall between, metres (anchors)
    #[arg(long, value_name = "M", default_value_t = 0.3, value_parser = positive)]
    wall_sigma_m: f64,
    /// Farther anchors are not received, metres
    #[arg(long, value_name = "M", default_value_t = 30.0, value_parser = positive)]
    reach_m: f64,
    /// Candidates on the walls and the outline of the area only, every --spacing-m along them
    #[arg(long, conflicts_with = "candidates")]
    on_walls: bool,
    /// The height at which they are to be mounted, metres: z_m of --out
    #[arg(long, value_name = "Z", value_parser = finite)]
    height_m: Option<f64>,
    /// Write the positions here: CSV with anchor,x_m,y_m,z_m (or beacon,…), which --fixed, `solve --anchors` and `ble
    /// solve --beacons` read; or with the ending .toml a scenario of `simulate`
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Draw the error over the area with the positions, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON: results has one object, with kind, cells, candidates, before_m, error_mean_m, error_p50_m,
    /// error_p90_m, error_worst_m, exchanged, places (name, x_m, y_m)
    #[arg(long)]
    json: bool,
}

/// `--kind`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Bluetooth beacons: their RSSI values
    Beacons,
    /// UWB anchors: ranges to them
    Anchors,
}

impl Kind {
    /// One of them, as files call it.
    fn as_str(self) -> &'static str {
        match self {
            Self::Beacons => "beacon",
            Self::Anchors => "anchor",
        }
    }
}

/// The height at which the tag of a scenario is carried, metres.
const TAG_HEIGHT_M: f64 = 1.2;

/// A selected position.
#[derive(serde::Serialize)]
struct Chosen {
    name: String,
    x_m: f64,
    y_m: f64,
}

/// The output of `--json`.
#[derive(serde::Serialize)]
struct Document {
    kind: &'static str,
    cells: usize,
    candidates: usize,
    before_m: f64,
    error_mean_m: f64,
    error_p50_m: f64,
    error_p90_m: f64,
    error_worst_m: f64,
    exchanged: usize,
    places: Vec<Chosen>,
}

/// Runs `baliza plan-anchors`.
///
/// # Errors
/// Flags or a file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let picture = PictureFile::plot(arguments.plot.as_deref())?;
    if let Some(file) = &arguments.out {
        output::check("--out", file)?;
    }
    let site = Site::read(arguments)?;
    let problem = site.problem(arguments);
    let count = arguments.count as usize;
    // Steps for adding all positions, and for one round of exchanges.
    let progress = Progress::new(2 * count * site.candidates.len());
    let found = problem.solve(count, || progress.step());
    drop(progress);

    let errors = problem.errors_m(&found.chosen);
    let chosen: Vec<&Beacon> = found.chosen.iter().filter_map(|index| site.candidates.get(*index)).collect();
    let document = document(arguments.kind, &errors, &found, &chosen, site.candidates.len());
    if arguments.json {
        print_json(&document)?;
    } else {
        print(table(&document, &found).as_bytes())?;
    }
    if let Some(file) = &arguments.out {
        let is_scenario = file.extension().is_some_and(|ending| ending == "toml");
        let text = if is_scenario { site.scenario(arguments, &chosen)? } else { site.csv(arguments, &chosen)? };
        write(file, &text)?;
        note(&format!("positions: {}\n", file.display()));
    }
    match picture {
        Some(picture) => picture.write_and_note(&heat(&[site.heat(&chosen, errors)])?),
        None => Ok(()),
    }
}

/// The data of the site from files and flags.
struct Site {
    fixed: Vec<Beacon>,
    candidates: Vec<Beacon>,
    walls: Vec<Wall>,
    barriers: Vec<positioning_core::ble::path_loss::Wall<f64>>,
    corners: [[f64; 2]; 2],
    grid: Grid,
}

impl Site {
    fn read(arguments: &Arguments) -> Result<Self, UserError> {
        let fixed = arguments.fixed.as_deref().map(read_beacons).transpose()?.unwrap_or_default();
        let listed = arguments.candidates.as_deref().map(read_beacons).transpose()?;
        let (walls, barriers) = barriers(arguments.walls.as_deref(), arguments.wall_db)?;
        let corners = match arguments.area {
            Some(CornersM(corners)) => Some(corners),
            None => {
                let places = fixed.iter().chain(listed.iter().flatten()).map(|beacon| beacon.position_m);
                Grid::about(places.chain(walls.iter().flat_map(|wall| wall.ends_m)), 0.0)
            }
        };
        let corners =
            corners.ok_or_else(|| UserError::flag("--area", "say where tags are, or give --walls or --candidates"))?;
        let grid = Grid::over("--cell-m", corners, arguments.cell_m)?;
        let candidates = match listed {
            Some(listed) => listed,
            None if arguments.on_walls => on_walls(arguments.kind, corners, &walls, arguments.spacing_m)?,
            None => lattice(arguments.kind, corners, arguments.spacing_m)?,
        };
        Ok(Self { fixed, candidates, walls, barriers, corners, grid })
    }

    /// The known information in each cell, and the information that each candidate would add.
    fn problem(&self, arguments: &Arguments) -> Problem {
        let noise = match arguments.kind {
            Kind::Beacons => Noise::Level { sensitivity_dbm: arguments.sensitivity_dbm },
            Kind::Anchors => Noise::Range {
                deviation_m: arguments.range_sigma_m,
                wall_m: arguments.wall_sigma_m,
                reach_m: arguments.reach_m,
            },
        };
        let [least, greatest] = self.corners;
        let area = Information::of_area([greatest[0] - least[0], greatest[1] - least[1]]);
        let fixed: Vec<_> = self.fixed.iter().map(Station::of).collect();
        let known = |at: [f64; 2]| {
            let informed = fixed.iter().filter_map(|station| station.information(at, &self.barriers, noise));
            informed.fold(area, Information::and)
        };
        let added = |beacon: &Beacon| {
            let station = Station::of(beacon);
            self.grid.middles().map(|at| station.information(at, &self.barriers, noise)).collect()
        };
        Problem {
            known: self.grid.middles().map(known).collect(),
            candidates: self.candidates.iter().map(added).collect(),
        }
    }

    /// The existing and the selected positions as CSV, under the heads of their kind. Beacons keep what is known of
    /// their signals.
    fn csv(&self, arguments: &Arguments, chosen: &[&Beacon]) -> Result<Vec<u8>> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let of_signal: &[&str] = match arguments.kind {
            Kind::Beacons => &["rssi_1m_dbm", "path_loss_exponent"],
            Kind::Anchors => &[],
        };
        writer.write_record([arguments.kind.as_str(), "x_m", "y_m", "z_m"].iter().chain(of_signal))?;
        let known = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        for beacon in self.fixed.iter().chain(chosen.iter().copied()) {
            let [x_m, y_m] = beacon.position_m.map(metres);
            let z_m = beacon.height_m.or(arguments.height_m).map_or_else(String::new, metres);
            let signal = [known(beacon.rssi_1m_dbm), known(beacon.path_loss_exponent)];
            let fields = [beacon.name.clone(), x_m, y_m, z_m].into_iter();
            writer.write_record(fields.chain(signal.into_iter().take(of_signal.len())))?;
        }
        writer.into_inner().map_err(|error| anyhow::Error::from(error.into_error()))
    }

    /// The same as a scenario, with the walls as brick, and a tag that walks along a quarter of the area's sides
    /// inside.
    fn scenario(&self, arguments: &Arguments, chosen: &[&Beacon]) -> Result<Vec<u8>, UserError> {
        let Some(height_m) = arguments.height_m else {
            return Err(UserError::flag("--height-m", "a scenario needs the height at which they are mounted"));
        };
        let [[x0, y0], [x1, y1]] = self.corners;
        let mut text = "# Planned by baliza plan-anchors.\n".to_owned();
        for beacon in self.fixed.iter().chain(chosen.iter().copied()) {
            let ([x, y], z) = (beacon.position_m.map(metres), metres(beacon.height_m.unwrap_or(height_m)));
            let (role, name) = (arguments.kind.as_str(), beacon.name.escape_default());
            let _ = write!(text, "\n[[node]] # {name}\nrole = \"{role}\"\nposition_m = [{x}, {y}, {z}]\n");
        }
        let inside = |part: f64| [x0 + part * (x1 - x0), y0 + part * (y1 - y0)].map(metres);
        let ([ax, ay], [bx, by]) = (inside(0.25), inside(0.75));
        let corner = |x: &str, y: &str| format!("[{x}, {y}, {TAG_HEIGHT_M}]");
        let path = [corner(&ax, &ay), corner(&bx, &ay), corner(&bx, &by), corner(&ax, &by)].join(", ");
        let scan = match arguments.kind {
            Kind::Beacons => "scan_interval_ms = 1000\n",
            Kind::Anchors => "",
        };
        let _ = write!(
            text,
            "\n[[node]]\nrole = \"tag\"\nheight_m = {TAG_HEIGHT_M}\n{scan}[node.simulation]\npath_m = [{path}]\n\
             closed = true\n"
        );
        for Wall { ends_m: [[fx, fy], [tx, ty]], .. } in &self.walls {
            let wall = format!("from_m = [{fx}, {fy}]\nto_m = [{tx}, {ty}]\nmaterial = \"brick\"");
            let _ = write!(text, "\n[[simulation.wall]]\n{wall}\n");
        }
        Ok(text.into_bytes())
    }

    /// The errors over the area.
    fn heat(&self, chosen: &[&Beacon], errors_m: Vec<f64>) -> Heat {
        let stations = self.fixed.iter().chain(chosen.iter().copied());
        Heat {
            title: "least error of a position".to_owned(),
            least_m: self.grid.least_m,
            cell_m: self.grid.cell_m,
            columns: self.grid.columns,
            values: errors_m.into_iter().map(Some).collect(),
            unit: "metres".to_owned(),
            low_is_good: true,
            walls_m: self.walls.iter().map(|wall| wall.ends_m).collect(),
            stations: stations.map(|beacon| (beacon.name.clone(), beacon.position_m)).collect(),
            points_m: Vec::new(),
        }
    }
}

/// Candidates over the whole area, including its borders.
fn lattice(kind: Kind, [least, greatest]: [[f64; 2]; 2], spacing_m: f64) -> Result<Vec<Beacon>, UserError> {
    let steps: [f64; 2] = std::array::from_fn(|axis| ((greatest[axis] - least[axis]) / spacing_m).round().max(1.0));
    if (steps[0] + 1.0) * (steps[1] + 1.0) > MOST as f64 {
        return Err(too_many());
    }
    let along = |axis: usize, step: usize| least[axis] + (greatest[axis] - least[axis]) * step as f64 / steps[axis];
    let [columns, rows] = steps.map(|steps| steps as usize);
    let places = (0..=rows).flat_map(|row| (0..=columns).map(move |column| (column, row)));
    let places = places.map(|(column, row)| [along(0, column), along(1, row)]);
    Ok(places.enumerate().map(|(index, at)| candidate(kind, index, at)).collect())
}

/// The largest number of candidates.
const MOST: usize = 1000;

fn too_many() -> UserError {
    UserError::flag("--spacing-m", format!("more than {MOST} candidates: take a greater one"))
}

/// A possible position. Its name says what is placed there.
fn candidate(kind: Kind, index: usize, position_m: [f64; 2]) -> Beacon {
    Beacon {
        name: format!("{}-{}", kind.as_str(), index + 1),
        position_m,
        height_m: None,
        rssi_1m_dbm: None,
        path_loss_exponent: None,
        deviation_db: None,
    }
}

/// Candidates along walls and along the outline of the area.
fn on_walls(
    kind: Kind,
    [[x0, y0], [x1, y1]]: [[f64; 2]; 2],
    walls: &[Wall],
    spacing_m: f64,
) -> Result<Vec<Beacon>, UserError> {
    let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    let outline = (0..4).map(|side| [corners[side], corners[(side + 1) % 4]]);
    let mut places: Vec<[f64; 2]> = Vec::new();
    for [from, to] in outline.chain(walls.iter().map(|wall| wall.ends_m)) {
        let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / spacing_m).round().max(1.0);
        if places.len() as f64 + steps > 2.0 * MOST as f64 {
            return Err(too_many());
        }
        for step in 0..=steps as usize {
            let part = step as f64 / steps;
            let at = [0, 1].map(|axis: usize| from[axis] + part * (to[axis] - from[axis]));
            // Two walls that meet share a position.
            let is_new = |known: &[f64; 2]| (known[0] - at[0]).hypot(known[1] - at[1]) > 0.25 * spacing_m;
            if places.iter().all(is_new) {
                places.push(at);
            }
        }
    }
    if places.len() > MOST {
        return Err(too_many());
    }
    Ok(places.into_iter().enumerate().map(|(index, at)| candidate(kind, index, at)).collect())
}

fn document(kind: Kind, errors: &[f64], found: &Found, chosen: &[&Beacon], candidates: usize) -> Document {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    Document {
        kind: match kind {
            Kind::Beacons => "beacons",
            Kind::Anchors => "anchors",
        },
        cells: errors.len(),
        candidates,
        before_m: found.added_m.first().copied().unwrap_or(f64::NAN),
        error_mean_m: found.error_m,
        error_p50_m: percentile(&sorted, 0.5),
        error_p90_m: percentile(&sorted, 0.9),
        error_worst_m: percentile(&sorted, 1.0),
        exchanged: found.exchanged,
        places: chosen
            .iter()
            .map(|beacon| Chosen { name: beacon.name.clone(), x_m: beacon.position_m[0], y_m: beacon.position_m[1] })
            .collect(),
    }
}

fn table(document: &Document, found: &Found) -> String {
    let mut text = format!("{:<12} {:>8} {:>8}   mean error when added\n", "place", "x_m", "y_m");
    for (place, error_m) in document.places.iter().zip(found.added_m.iter().skip(1)) {
        let _ = writeln!(text, "{:<12} {:>8.2} {:>8.2}   {error_m:.3} m", place.name, place.x_m, place.y_m);
    }
    let _ = writeln!(
        text,
        "{} candidates, {} cells: mean error {:.3} m (before {:.3} m), P50 {:.3} m, P90 {:.3} m, worst {:.3} m; {} exchanged",
        document.candidates,
        document.cells,
        document.error_mean_m,
        document.before_m,
        document.error_p50_m,
        document.error_p90_m,
        document.error_worst_m,
        document.exchanged
    );
    text
}
