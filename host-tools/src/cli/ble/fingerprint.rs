//! `baliza ble fingerprint`: positions from RSSI values surveyed at known points.

use std::path::{Path, PathBuf};

use analysis::survey::fingerprint::{Average, Comparison, Making, Maps, Setup, Solver, held_out, names_of};
use anyhow::Result;
use positioning_core::ble::fingerprint::Map;
use recording::beacons::{Capture, Captured, Dwell, read_captures, read_stays};
use recording::{Solved, UserError};

use super::{Found, Names, PlanArguments, read_bytes, survey_of};
use crate::cli::progress::Progress;
use crate::cli::report::OutputArgs;

/// Positions by a survey of RSSI values: k nearest neighbours, and Gaussian processes
///
/// A capture (the rows of one `point` or `epoch`) makes one position. Captures that follow each other within 2 s are
/// one walk for `gp-walk` and for the particle filter; otherwise these begin anew. The map is made from a survey
/// (--fingerprints), or is a map of `baliza ble map` (--map).
#[derive(clap::Args)]
#[command(
    after_help = "RssiMethods:\n  knn      the K nearest points (7): w5nn, or 5nn without --weighted\n  gp       a Gaussian process of \
                  each beacon's rssi on a lattice; the posterior's mean\n  gp-walk  the same from scan to scan: the choice \
                  where captures are of one walk, and for others the same as gp\n\nExamples:\n  \
                  baliza ble fingerprint --fingerprints fingerprints.csv --targets targets.csv --kernel all\n  \
                  baliza ble fingerprint --fingerprints fingerprints.csv --targets targets.csv --k 5 --weighted --particle-filter\n  \
                  baliza ble fingerprint --fingerprints fingerprints.csv --leave-one-out --json\n  \
                  baliza ble fingerprint --fingerprints robot.csv --hold-out 5 --block 100 --kernel gp-walk\n  \
                  baliza ble fingerprint --map room.map --rssi rssi.csv --truth truth.csv --walls walls.csv"
)]
pub struct Arguments {
    /// The survey: CSV with point,x_m,y_m,beacon,rssi_dbm and, where known, t_s
    #[arg(long, value_name = "FILE", required_unless_present = "map")]
    fingerprints: Option<PathBuf>,
    /// A map for nodes instead of a survey: of a lattice for gp and gp-walk, of surveyed points for knn
    #[arg(long, value_name = "FILE", conflicts_with_all = ["fingerprints", "leave_one_out", "hold_out", "beacons"])]
    map: Option<PathBuf>,
    /// What the files call the map's beacons, in its order, with commas, where that is not their numbers in it
    #[arg(long, value_name = "NAMES", requires = "map", value_parser = Names::parse)]
    beacon_names: Option<Names>,
    #[command(flatten)]
    asked: Asked,
    /// Where the receiver truly was: CSV with epoch,t_s,x_m,y_m; gives the errors
    #[arg(long, value_name = "FILE", requires = "rssi")]
    truth: Option<PathBuf>,
    /// Points of the survey that are held out together, with --hold-out
    #[arg(long, value_name = "POINTS", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..), requires = "hold_out")]
    block: u32,
    /// How scans are compared: knn, gp, gp-walk, or all [default: knn with --k, --weighted or --particle-filter, else
    /// gp-walk]
    #[arg(long, value_name = "KERNEL")]
    kernel: Option<FingerprintMethod>,
    /// How many neighbours [default: 5; with --kernel all 3, 4 and 5]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u8).range(1..=15))]
    k: Option<u8>,
    /// Neighbours count by the inverse square of their distances
    #[arg(long)]
    weighted: bool,
    /// Send the positions of knn and gp through the particle filter (15), one a window
    #[arg(long)]
    particle_filter: bool,
    /// The particle filter's window of integration, milliseconds: 200 in a room, 500 over a floor
    #[arg(long, value_name = "MS", default_value_t = 200, value_parser = clap::value_parser!(u32).range(10..=60_000))]
    window_ms: u32,
    /// How far the receiver's RSSI values may be off from the surveyor's, all alike, before the first capture, dB
    /// (standard deviation); it is learnt from one capture to the next. 0: they are not off
    #[arg(long, value_name = "DB", allow_negative_numbers = true, default_value_t = 4.0, value_parser = super::solve::decibels, alias = "offset-db")]
    receiver_offset_db: f64,
    /// How RSSI values of one point are averaged
    #[arg(long, value_name = "HOW", default_value = "power")]
    average: Averages,
    #[command(flatten)]
    place: PlanArguments,
    #[command(flatten)]
    output: OutputArgs,
}

/// The captures whose positions are asked for.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct Asked {
    /// Dwells at known points, to be found: CSV with point,x_m,y_m,beacon,rssi_dbm and, where known, t_s
    #[arg(long, value_name = "FILE")]
    targets: Option<PathBuf>,
    /// Received RSSI values: CSV with epoch,t_s,beacon,rssi_dbm
    #[arg(long, value_name = "FILE")]
    rssi: Option<PathBuf>,
    /// Each point of the survey by all the others
    #[arg(long)]
    leave_one_out: bool,
    /// Each Nth block of the survey's points by the other blocks (--block)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..))]
    hold_out: Option<u32>,
}

/// `--kernel`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum FingerprintMethod {
    Knn,
    Gp,
    GpWalk,
    All,
}

/// `--average`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum Averages {
    /// Their powers
    Power,
    /// Their decibels between the 10th and the 90th percentile
    Trimmed,
}

impl From<Averages> for Average {
    fn from(average: Averages) -> Self {
        match average {
            Averages::Power => Self::Power,
            Averages::Trimmed => Self::Trimmed,
        }
    }
}

/// Runs `baliza ble fingerprint`.
///
/// # Errors
/// Flags cannot be combined, a file is wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let output = arguments.output.check()?;
    let comparisons = arguments.comparisons()?;
    let plan = arguments.place.read()?;
    let particles_s = arguments.particle_filter.then(|| f64::from(arguments.window_ms) / 1000.0);
    let (average, offset_db) = (arguments.average.into(), arguments.receiver_offset_db);
    let setup = Setup { average, offset_db, particles_s, walls: &plan.walls };
    let making = Making { plan: (!plan.beacons.is_empty()).then_some(&plan), ..Making::default() };

    let (comparisons, tags, solved) = match (&arguments.fingerprints, &arguments.map) {
        (Some(file), _) => {
            let stays = read_stays(file)?;
            let survey = survey_of(file, &stays, average)?;
            if let Some(tags) = arguments.captures()? {
                let maps = Maps::of(&survey, making, &comparisons, None);
                let maps = maps.map_err(|fault| UserError::line(file, 1, fault.to_string()))?;
                let solved = found(&Solver { maps: &maps, setup: &setup }, &comparisons, &tags)?;
                (comparisons, tags, solved)
            } else {
                let (captures, solved) = arguments.held(file, &stays, making, &setup, &comparisons)?;
                (comparisons, vec![Captured { tag: None, captures }], vec![solved])
            }
        }
        (None, Some(file)) => {
            let bytes = read_bytes(file)?;
            let (map, _) = Map::decode(&bytes).map_err(|fault| UserError::file(file, fault.to_string()))?;
            let tags = arguments.captures()?.unwrap_or_default();
            let names = match &arguments.beacon_names {
                Some(names) => names.of("--beacon-names", "beacons", map.beacons())?,
                None => names_of(&map, tags.iter().flat_map(|of| &of.captures)),
            };
            let maps = Maps::read(bytes, names).map_err(|fault| UserError::file(file, fault.to_string()))?;
            let comparisons = arguments.served(file, &maps, comparisons)?;
            let solved = found(&Solver { maps: &maps, setup: &setup }, &comparisons, &tags)?;
            (comparisons, tags, solved)
        }
        (None, None) => return Err(UserError::flag("--fingerprints", "a survey or --map is needed").into()),
    };
    let Asked { targets, rssi, .. } = &arguments.asked;
    Found {
        source: targets.as_deref().or(rssi.as_deref()).or(arguments.fingerprints.as_deref()),
        methods: comparisons.iter().map(|comparison| arguments.name(*comparison)).collect(),
        neighbours: Some(comparisons.iter().map(|comparison| comparison.k()).collect()),
        tags: &tags,
        solved: &solved,
        beacons: &plan.beacons,
        walls: &plan.walls,
    }
    .report(&output)
}

/// The positions of each tag's captures by maps, for each method.
fn found(solver: &Solver, comparisons: &[Comparison], tags: &[Captured]) -> Result<Vec<Vec<Vec<Solved>>>> {
    super::tell_strange(solver.maps.beacons(), tags, "the map");
    let progress = Progress::new(comparisons.len() * tags.len());
    let by = |of: &Captured, comparison: &Comparison| {
        let solved = solver.solve(*comparison, &of.captures)?;
        progress.step();
        Ok(solved)
    };
    tags.iter().map(|of| comparisons.iter().map(|comparison| by(of, comparison)).collect()).collect()
}

impl Arguments {
    /// The captures to be found; `None` where these are the points of the survey itself.
    fn captures(&self) -> Result<Option<Vec<Captured>>, UserError> {
        let Asked { targets, rssi, .. } = &self.asked;
        targets.as_ref().or(rssi.as_ref()).map(|file| read_captures(file, self.truth.as_deref())).transpose()
    }

    /// The positions of a survey's points, each found without its own block of points.
    fn held(
        &self,
        file: &Path,
        stays: &[Dwell],
        making: Making,
        setup: &Setup,
        comparisons: &[Comparison],
    ) -> Result<(Vec<Capture>, Vec<Vec<Solved>>)> {
        let block = self.block as usize;
        let fold = |stay: usize| match self.asked.hold_out {
            Some(every) => (stay / block % every as usize == every as usize - 1).then_some(0),
            None => Some(stay),
        };
        let folds = if self.asked.hold_out.is_some() { 1 } else { stays.len() };
        let held = (0..stays.len()).filter(|stay| fold(*stay).is_some()).count();
        if stays.len() < 2 || held == 0 || (folds == 1 && held == stays.len()) {
            return Err(UserError::line(file, 1, format!("{} points are too few to hold some out", stays.len())).into());
        }
        let progress = Progress::new(folds);
        let held = held_out(stays, making, setup, comparisons, fold, || progress.step())
            .map_err(|fault| UserError::line(file, 1, format!("without the points that are held out: {fault}")))?;
        Ok((held.stays.into_iter().map(|stay| Capture::from(stays[stay].clone())).collect(), held.solved))
    }

    /// The comparisons that a map from a file supports.
    fn served(&self, file: &Path, maps: &Maps, comparisons: Vec<Comparison>) -> Result<Vec<Comparison>, UserError> {
        let of_points = Comparison::Nearest { k: 5, weighted: true };
        let nobody_chose = self.kernel.is_none() && comparisons == [Comparison::Walk] && maps.serve(of_points);
        let comparisons = if nobody_chose { vec![of_points] } else { comparisons };
        let (served, others): (Vec<_>, Vec<_>) = comparisons.into_iter().partition(|wanted| maps.serve(*wanted));
        match others.first() {
            Some(other) if self.kernel != Some(FingerprintMethod::All) || served.is_empty() => {
                let other = other.name();
                Err(UserError::file(
                    file,
                    if maps.serve(of_points) {
                        format!("a map of surveyed points, for knn, where {other} wants one of a lattice")
                    } else {
                        format!(
                            "a map of a lattice, for gp and gp-walk, where {other} wants one of surveyed points (ble map --surveyed)"
                        )
                    },
                ))
            }
            Some(_) | None => Ok(served),
        }
    }

    fn comparisons(&self) -> Result<Vec<Comparison>, UserError> {
        let of_neighbours = self.k.is_some() || self.weighted;
        let usual =
            if of_neighbours || self.particle_filter { FingerprintMethod::Knn } else { FingerprintMethod::GpWalk };
        let k = usize::from(self.k.unwrap_or(5));
        Ok(match self.kernel.unwrap_or(usual) {
            FingerprintMethod::Knn => vec![Comparison::Nearest { k, weighted: self.weighted }],
            FingerprintMethod::Gp | FingerprintMethod::GpWalk if of_neighbours => {
                return Err(UserError::flag("--kernel", "--k and --weighted are for knn"));
            }
            FingerprintMethod::Gp => vec![Comparison::Process],
            FingerprintMethod::GpWalk if self.particle_filter => {
                return Err(UserError::flag("--particle-filter", "gp-walk is a filter itself"));
            }
            FingerprintMethod::GpWalk => vec![Comparison::Walk],
            FingerprintMethod::All => {
                let wanted = |comparison: &Comparison| match *comparison {
                    Comparison::Nearest { weighted, .. } => self.k.is_none() && (weighted || !self.weighted),
                    Comparison::Process | Comparison::Walk => true,
                };
                let asked = self.k.map(|_| Comparison::Nearest { k, weighted: self.weighted });
                asked.into_iter().chain(Comparison::all().into_iter().filter(wanted)).collect()
            }
        })
    }

    /// The method's name. A. Linde Cerezo's thesis (Universitat Oberta de Catalunya, 2024) puts `fp_` before the
    /// methods with the particle filter (table 4.4).
    fn name(&self, comparison: Comparison) -> String {
        let filtered = self.particle_filter && comparison != Comparison::Walk;
        format!("{}{}", if filtered { "fp_" } else { "" }, comparison.name())
    }
}
