//! `baliza ble solve`: positions from beacons whose positions and path losses are known.

use std::path::PathBuf;

use analysis::locate::advice;
use analysis::locate::ble::{BeaconSetup, RssiMethod, Solver};
use anyhow::Result;
use positioning_core::ble::beacon_monitor::{BeaconHealth, HealthChange};
use recording::UserError;
use recording::beacons::{Captured, read_beacons, read_captures, read_walls};

use super::Found;
use crate::cli::folder::FolderFiles;
use crate::cli::note;
use crate::cli::numbers::finite;
use crate::cli::recording_values::CornersM;
use crate::cli::report::{OutputArgs, some_position};

/// Positions by path loss: least squares, the posterior mean, a particle filter, the tag's engine
///
/// The rows of one `epoch` make one position. In a file of dwells (`point,x_m,y_m,…`), all rows of one point make one
/// position, and the point is its truth. Positions are in the plane. Where beacons.csv does not give a beacon's path
/// loss, the usual values are assumed; `baliza calibrate path-loss` finds the path loss. The engine names a beacon
/// whose RSSI values contradict the others, for example because it was moved.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  baliza ble solve run/\n  baliza ble solve --beacons beacons.csv --rssi rssi.csv --truth truth.csv\n  \
                        baliza ble solve --beacons beacons.csv --rssi targets.csv --plot room.png --json"
)]
pub struct Arguments {
    /// A recording: a folder with beacons.csv, rssi.csv and, where there are, truth.csv and walls.csv
    #[arg(value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Beacons: CSV with beacon,x_m,y_m and, where known, z_m,rssi_1m_dbm,path_loss_exponent,deviation_db
    #[arg(long, value_name = "FILE", required_unless_present = "folder")]
    beacons: Option<PathBuf>,
    /// Received RSSI values: CSV with epoch,t_s,beacon,rssi_dbm and, where known, tag; or a file of dwells at known
    /// points
    #[arg(long, value_name = "FILE", required_unless_present = "folder")]
    rssi: Option<PathBuf>,
    /// Where the tag truly was: CSV with epoch,t_s,x_m,y_m; gives the errors
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Walls, which are drawn, and barriers for particles: CSV with the corners of an outline, x_m,y_m, or with
    /// x1_m,y1_m,x2_m,y2_m
    #[arg(long, value_name = "FILE")]
    walls: Option<PathBuf>,
    /// The attenuation of a wall, dB, where the file of walls does not give it; for posterior and particle-filter
    #[arg(long, value_name = "DB", default_value_t = 0.0, value_parser = decibels)]
    wall_db: f64,
    /// How RSSI values become a position: a name, several with commas, or all
    #[arg(long, value_name = "METHOD", default_value = "all", value_parser = RssiMethods::parse)]
    method: RssiMethods,
    /// The window of integration, milliseconds: 200 in a room, 500 over a floor
    #[arg(long, value_name = "MS", default_value_t = 500, value_parser = clap::value_parser!(u32).range(10..=60_000))]
    window_ms: u32,
    /// The tag's height, metres: heights of beacons (z_m) count
    #[arg(long, value_name = "Z", allow_negative_numbers = true, value_parser = finite)]
    height_m: Option<f64>,
    /// Where the tag can be at all, metres: all but weighted-linear stay inside [default: of posterior and
    /// particle-filter, the box around the beacons]
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true, value_parser = CornersM::parse)]
    area: Option<CornersM>,
    /// How far the receiver's RSSI values may be off from those of the calibration, all alike, dB (standard deviation)
    #[arg(long, value_name = "DB", allow_negative_numbers = true, default_value_t = 2.0, value_parser = decibels, alias = "offset-db")]
    receiver_offset_db: f64,
    /// Seed of the particles: equal seeds give equal positions
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    output: OutputArgs,
}

/// The selected methods.
#[derive(Clone, Debug)]
struct RssiMethods(Vec<RssiMethod>);

impl RssiMethods {
    fn parse(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self(RssiMethod::ALL.to_vec()));
        }
        let known = || RssiMethod::ALL.map(RssiMethod::as_str).join(", ");
        let find = |name: &str| {
            let found = RssiMethod::ALL.into_iter().find(|kernel| kernel.as_str() == name.trim());
            found.ok_or_else(|| format!("there is no method {name:?}; there are {}", known()))
        };
        text.split(',').map(find).collect::<Result<_, _>>().map(Self)
    }
}

/// Runs `baliza ble solve`.
///
/// # Errors
/// Flags or a file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let folder = FolderFiles::open(arguments.folder.as_deref())?;
    let flags = [&arguments.beacons, &arguments.rssi, &arguments.truth, &arguments.walls];
    let sources = Sources::of(&folder, flags)?;
    let setup = BeaconSetup {
        window_s: f64::from(arguments.window_ms) / 1000.0,
        height_m: arguments.height_m,
        area_m: arguments.area.map(|CornersM(corners)| corners),
        offset_db: arguments.receiver_offset_db,
        wall_db: arguments.wall_db,
        seed: arguments.seed,
    };
    let methods = &arguments.method.0;
    locate(&sources, setup, methods, Some(vec![None; methods.len()]), &arguments.output)
}

/// `solve` and `track` of a folder whose tags only received beacons: the posterior of each epoch, or the tag's engine.
///
/// # Errors
/// A file is wrong, or an output cannot be written.
pub fn of_folder(
    folder: &FolderFiles,
    method: RssiMethod,
    height_m: Option<f64>,
    area_m: Option<[[f64; 2]; 2]>,
    output: &OutputArgs,
) -> Result<()> {
    let sources = Sources::of(folder, [&None; 4])?;
    let height_m = height_m.or(folder.settings().height_m);
    note(&format!(
        "there are no ranges; positions are by beacons, as those of ble solve --method {}\n",
        method.as_str()
    ));
    locate(&sources, BeaconSetup { height_m, area_m, ..BeaconSetup::default() }, &[method], None, output)
}

/// The files of a recording by beacons.
struct Sources {
    beacons: PathBuf,
    rssi: PathBuf,
    truth: Option<PathBuf>,
    walls: Option<PathBuf>,
}

impl Sources {
    fn of(folder: &FolderFiles, [beacons, rssi, truth, walls]: [&Option<PathBuf>; 4]) -> Result<Self, UserError> {
        let [beacons, rssi] = [folder.file(beacons, "beacons.csv")?, folder.file(rssi, "rssi.csv")?];
        let [truth, walls] = [folder.find(truth, "truth.csv"), folder.find(walls, "walls.csv")];
        Ok(Self { beacons, rssi, truth, walls })
    }
}

/// Locates tags by these methods, and reports their positions. `neighbours` is as in [`Found`].
fn locate(
    sources: &Sources,
    setup: BeaconSetup,
    methods: &[RssiMethod],
    neighbours: Option<Vec<Option<usize>>>,
    output: &OutputArgs,
) -> Result<()> {
    let output = output.check()?;
    let beacons = read_beacons(&sources.beacons)?;
    let tags = read_captures(&sources.rssi, sources.truth.as_deref())?;
    let walls = sources.walls.as_deref().map(read_walls).transpose()?.unwrap_or_default();
    super::tell_unknown(&beacons, &tags);
    let solver = Solver::new(&beacons, &walls, setup);
    let mut news = Vec::new();
    let mut solve = |of: &Captured, kernel: &RssiMethod| {
        let (positions, told) = solver.solve(*kernel, &of.captures);
        news.extend(told);
        positions
    };
    let solved: Vec<Vec<_>> = tags.iter().map(|of| methods.iter().map(|kernel| solve(of, kernel)).collect()).collect();
    Found {
        source: Some(&sources.rssi),
        methods: methods.iter().map(|kernel| kernel.as_str().to_owned()).collect(),
        neighbours,
        tags: &tags,
        solved: &solved,
        beacons: &beacons,
        walls: &walls,
    }
    .report(&output)?;
    for HealthChange { beacon, health, seconds } in news {
        let name = beacons.get(beacon).map_or("?", |beacon| &beacon.name);
        let found = match health {
            BeaconHealth::Agrees => "is believed again",
            BeaconHealth::Elsewhere => {
                "contradicts the others and is left out: it stands elsewhere, or sends at another power"
            }
            BeaconHealth::TwoPlaces => "is left out: two senders have its identity",
        };
        note(&format!("engine: after {seconds} s beacon {name} {found}\n"));
    }
    some_position(advice::nothing_solved(solved.iter().flatten().flatten(), "beacons", false))
}

/// Parses a number of decibels.
///
/// # Errors
/// The text is not a number from 0 to 100.
pub fn decibels(text: &str) -> Result<f64, String> {
    let decibels = finite(text)?;
    if (0.0..=100.0).contains(&decibels) { Ok(decibels) } else { Err("it must be from 0 to 100".to_owned()) }
}
