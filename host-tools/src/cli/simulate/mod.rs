//! `baliza simulate`: whole nodes over simulated chips and air.

mod show;

use std::fmt::Write as _;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::simulate::{Attempts, Capture, SimulatedRecording, is_of_simulation, picture, read_scenario, survey_csv};
use analysis::survey::presence::read_outlines;
use analysis::train::Chosen;
use anyhow::{Context, Result};
use clap::ValueEnum;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use positioning_core::Method;
use recording::UserError;
use recording::output::{self, OutputFolder};
use sim::BoardProfile;
use sim::scenario::{AirModel, Fidelity, LISTENING, Record, Scenario, Simulation, What};
use wire::config::{Mode, Scheme, Solver};
use wire::telemetry::Address;

use super::PictureFile;
use super::report::some_position;
use super::stream::{catch_signals, refuse_interrupted};
use crate::cli::progress::Progress;
use show::{Show, summary_text};

/// Simulate whole nodes: tags that range to anchors and find their positions
///
/// The firmware's own apps run, each over the driver on a simulated DW1000 behind SPI, with drifting clocks, walls,
/// losses and collisions in between; beacons advertise beside them. Without --site, tags walk in a furnished room
/// of 12 m by 8 m. Equal arguments print equal bytes. Positions go to standard output (on a terminal a table of some of
/// them) or with --out into files, a summary to standard error.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The site to simulate: the file that `baliza provision` reads, alone or with a table [simulation], as
    /// docs/use/scenarios.md describes it. Tags without a path walk among the anchors
    #[arg(long, value_name = "FILE", visible_alias = "scenario")]
    site: Option<PathBuf>,
    /// Anchors on the room's walls
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = count(), conflicts_with = "site")]
    anchors: u16,
    /// Walking tags; more than sixteen (at a --rate of up to 10, more than 250 rounds a second of all tags) fill more
    /// rooms, each with its share of the anchors and a network of its own
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = count(), conflicts_with = "site")]
    tags: u16,
    /// Simulated time, seconds [default: the site's, or 10]
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    /// Seed of everything random [default: the site's, or 1]
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Probability that a reception is lost, whatever its power
    #[arg(long, value_name = "P", value_parser = probability)]
    loss: Option<f64>,
    /// How deep radios are simulated [default: the site's, or spi]
    #[arg(long, alias = "level", value_name = "FIDELITY")]
    fidelity: Option<FidelityName>,
    /// How the air treats ranges [default: the site's, or recorded]
    #[arg(long, value_name = "AIR")]
    air: Option<AirName>,
    /// What the nodes run on that the site gives no board of their own: what code, bus and interrupts take, and
    /// what current (instant: nothing but the bus) [default: the site's, or dwm1001]
    #[arg(long, value_name = "BOARD", value_parser = board())]
    board: Option<BoardProfile>,
    /// How many times longer everything on the nodes takes than estimated, but the bytes on their buses [default: 1]
    #[arg(long, value_name = "F", value_parser = slowdown)]
    cpu_slowdown: Option<f64>,
    /// Positions a second that each tag wants [default: as many as it can get]
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate: Option<f64>,
    /// Solve each round by itself, by any method of `baliza solve` [default: the site's, or as the tag does: by a
    /// track]
    #[arg(long, value_name = "METHOD")]
    method: Option<Method>,
    /// How tags make their rounds: one poll and a response of each anchor; or also with a final message, whose time of
    /// arrival anchors report in their next responses [default: the site's, or single-sided]
    #[arg(long, value_name = "SCHEME", value_parser = schemes())]
    scheme: Option<Scheme>,
    /// Give networks a key that have none: their frames have integrity codes, and the nodes take no others
    #[arg(long)]
    key: bool,
    /// What the tags' records say that they make their positions by [default: the site's method, or track]
    #[arg(long, value_name = "SOLVER", value_parser = solvers(), conflicts_with = "method")]
    solver: Option<Solver>,
    /// Give all ranges the same weight, whatever their powers show about the line of sight
    #[arg(long, alias = "ignore-powers")]
    no_power_weighting: bool,
    /// A trained classifier that detects links without line of sight, in the tags: a file of `nlos train`. Where it
    /// needs impulse responses, tags read them, and --out has their features
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Which of the file's classifiers, where it has several; of several with one name, NAME:1, NAME:2
    #[arg(long, value_name = "NAME", requires = "model")]
    classifier: Option<String>,
    /// How tags find themselves [default: the site's, or native]
    #[arg(long, value_name = "MODE")]
    mode: Option<ModeName>,
    /// Solve in the plane at the tags' height (2) or in space (3) [default: the site's, or 2]
    #[arg(long, value_name = "2|3", value_parser = clap::value_parser!(u8).range(2..=3))]
    dims: Option<u8>,
    /// The tags' height, metres (--dims 2) [default: the site's, or 1.2]
    #[arg(long, value_name = "Z", allow_negative_numbers = true, value_parser = height)]
    height_m: Option<f32>,
    /// A folder for anchors.csv, ranges.csv, truth.csv and positions.csv, as `baliza solve` reads and writes them, with
    /// beacons also beacons.csv and rssi.csv, with walls walls.csv; and for what nodes report, as `baliza decode`,
    /// `monitor` and `replay` read it: telemetry.bin of the first tag, telemetry-ADDRESS.bin of each other node
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Replace the recording that is in --out
    #[arg(long, requires = "out")]
    force: bool,
    /// Capture every frame on the air, for Wireshark
    #[arg(long, value_name = "FILE")]
    pcap: Option<PathBuf>,
    /// Draw the tracks on the floor plan, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Survey the beacons instead, and write the dwells (fingerprints.csv), from which `baliza ble map` and `baliza ble
    /// rooms` make the map and the rooms that the site names
    #[arg(long, value_name = "FILE", requires = "site", conflicts_with_all = ["out", "pcap", "plot", "json"])]
    survey: Option<PathBuf>,
    /// From one point of the survey to the next, metres, 0.1 to 100
    #[arg(long, value_name = "M", default_value_t = 1.0, value_parser = step)]
    survey_step_m: f64,
    /// How long the tag dwells at each point, seconds
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = seconds, alias = "survey-stay-s")]
    survey_dwell_s: f64,
    /// The rooms' outlines: CSV with room,x_m,y_m; points outside of all are left out
    #[arg(long, value_name = "FILE", requires = "survey")]
    survey_rooms: Option<PathBuf>,
    /// Print JSON and no positions: results has one object, with tags, anchors, seconds, fixes, fixes_per_s, rmse_m,
    /// p50_m, p90_m, mae_m, inside_1_sigma, nees (in x and y), frames_sent, frames_lost, collisions, airtime_share (of
    /// a network, the mean), airtime_share_max (of the busiest network), tags_joined, joined_s (when the last of them
    /// had slots for the first time), slots_with_fix (of tags with a fixed rate, since each joined), uplink_share (of the
    /// positions told in polls, those that an anchor with a cable reported), uplink_p99_s (how long 99 % of them took
    /// from the tag's report at most), data_share (of the data that tags' users sent), message_share (of
    /// hosts' messages to tags, those that their tags took), message_p99_s (how long 99 % of them took, with the tag's
    /// answer), forged_frames (of attackers), forged_accepted (how often a node believed one), tag_mean_current_ma,
    /// charge_per_fix_uc and tag_currents_ma (board and DW1000, from the first position on; none with --fidelity air); with
    /// beacons also bluetooth
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  baliza simulate
  baliza simulate --site site.toml --plot site.png
  baliza simulate --solver b-wls --json
  baliza simulate --tags 15 --anchors 16 --loss 0.1 --plot room.png
  baliza simulate --tags 1 --anchors 4 --board esp32c3 --cpu-slowdown 2
  baliza simulate --site examples/walls.toml --out run --pcap run.pcap
  baliza simulate --site examples/walls.toml --model nlos.model --classifier logistic
  baliza simulate --site examples/leaving.toml --plot leaving.png
  baliza simulate --site examples/battery.toml --rate 0.1 --json
  baliza simulate --site examples/fingerprints.toml --survey fingerprints.csv
  baliza simulate --mode tdoa --tags 100 --anchors 8 --fidelity air
  baliza simulate --fidelity air --tags 1000 --anchors 200 --rate 10 --json";

/// The height of tags in the plane where none is configured, metres.
const HEIGHT_M: f32 = 1.2;
/// The key of `--key`. Simulated frames do not leave the simulation.
const SIMULATED_KEY: [u8; 16] = *b"simulated frames";
/// The interval between two updates of the output, simulated seconds.
const STEP_S: f64 = 0.1;

/// `--fidelity`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum FidelityName {
    /// The driver on register-level chips behind SPI
    Spi,
    /// Radios straight on the air: for many nodes
    Air,
}

/// `--air`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum AirName {
    /// Links err as in recordings in line of sight: by as much at each visit of a position, some by decimetres
    Recorded,
    /// White noise and the bias by power only, and anchors exactly where they are said to be
    Ideal,
}

/// `--mode`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeName {
    /// They ask anchors, and range to all that answer
    Native,
    /// They only receive the messages between anchors: by differences of arrival, any number of tags in one room. In
    /// records this mode is called listening
    #[value(alias = "listening")]
    Tdoa,
}

fn schemes() -> impl TypedValueParser<Value = Scheme> {
    PossibleValuesParser::new(Scheme::ALL.map(Scheme::name))
        .try_map(|name| Scheme::from_name(&name).ok_or("there is no such scheme"))
}

fn solvers() -> impl TypedValueParser<Value = Solver> {
    PossibleValuesParser::new(Solver::ALL.map(Solver::name))
        .try_map(|name| Solver::from_name(&name).ok_or("there is no such solver"))
}

/// The range of the number of nodes. Addresses begin at 0x0001 and at 0x1001, which limits the number.
fn count() -> clap::builder::RangedI64ValueParser<u16> {
    clap::value_parser!(u16).range(1..=4000)
}

fn number(text: &str, least: f64, greatest: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (least..=greatest).contains(&number) => Ok(number),
        Ok(_) | Err(_) => Err(format!("{text:?} is not a number from {least} to {greatest}")),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, 0.001, 1e6)
}

fn step(text: &str) -> Result<f64, String> {
    number(text, 0.1, 100.0)
}

fn probability(text: &str) -> Result<f64, String> {
    number(text, 0.0, 1.0)
}

fn rate(text: &str) -> Result<f64, String> {
    number(text, 0.01, 1000.0)
}

fn board() -> impl TypedValueParser<Value = BoardProfile> {
    PossibleValuesParser::new(BoardProfile::ALL.map(|board| board.name)).map(|name| {
        // The parser accepts only the name of one of the boards.
        BoardProfile::named(&name).unwrap_or(BoardProfile::DWM1001)
    })
}

fn slowdown(text: &str) -> Result<f64, String> {
    number(text, 0.001, 1000.0)
}

fn height(text: &str) -> Result<f32, String> {
    number(text, -1e4, 1e4).map(|metres| metres as f32)
}

impl Arguments {
    /// Begins the recording in a folder.
    fn recording(&self, folder: &Path, scenario: &Scenario) -> Result<SimulatedRecording> {
        let output = OutputFolder::begin("--out", folder, is_of_simulation, self.force)?;
        SimulatedRecording::create(output, scenario).context("cannot write the recording")
    }

    fn scenario(&self) -> Result<Scenario, UserError> {
        let mut scenario = match &self.site {
            Some(file) => read_scenario(file, self.survey.is_none())?,
            None => match self.mode {
                Some(ModeName::Native) | None => {
                    let rate_hz = self.rate.unwrap_or(f64::INFINITY);
                    Scenario::rooms_at(self.anchors.into(), self.tags.into(), rate_hz)
                }
                Some(ModeName::Tdoa) => Scenario::listening(self.anchors.into(), self.tags.into()),
            },
        };
        self.change(&mut scenario);
        self.change_tags(&mut scenario)?;
        if let Err((node, invalid)) = scenario.validate() {
            let flag = match invalid.field {
                "tag.rate_hz" => "--rate",
                "tag.height_m" => "--height-m",
                "network.key" if self.key => "--key",
                _ => "--site",
            };
            return Err(UserError::flag(flag, format!("node {}: {invalid}", Address(node))));
        }
        Ok(scenario)
    }

    /// Changes what the flags say of the simulation and its networks.
    fn change(&self, scenario: &mut Scenario) {
        if let (Some(_), Some(mode)) = (&self.site, self.mode) {
            for network in &mut scenario.networks {
                network.mode = match (mode, network.mode) {
                    (ModeName::Native, _) => Mode::Native,
                    (ModeName::Tdoa, mode @ Mode::Listening { .. }) => mode,
                    (ModeName::Tdoa, Mode::Native | Mode::Blink | Mode::DecaRanging { .. }) => LISTENING,
                };
            }
        }
        scenario.seconds = self.seconds.unwrap_or(scenario.seconds);
        scenario.seed = self.seed.unwrap_or(scenario.seed);
        scenario.loss = self.loss.unwrap_or(scenario.loss);
        scenario.fidelity = match self.fidelity {
            Some(FidelityName::Spi) => Fidelity::Spi,
            Some(FidelityName::Air) => Fidelity::Air,
            None => scenario.fidelity,
        };
        scenario.air = match self.air {
            Some(AirName::Recorded) => AirModel::Recorded,
            Some(AirName::Ideal) => AirModel::Ideal,
            None => scenario.air,
        };
        if let Some(board) = self.board {
            scenario.board = board.slowed(scenario.board.slowdown);
        }
        if let Some(times) = self.cpu_slowdown {
            scenario.slow_down(times);
        }
        scenario.method = match self.solver {
            Some(_) => None,
            None => self.method.or(scenario.method),
        };
        scenario.weigh_nlos &= !self.no_power_weighting;
        for network in scenario.networks.iter_mut().filter(|_| self.key) {
            network.key.get_or_insert(SIMULATED_KEY);
        }
    }

    /// Changes what the flags say of the tags.
    fn change_tags(&self, scenario: &mut Scenario) -> Result<(), UserError> {
        let only_listen = scenario.networks.iter().any(|network| matches!(network.mode, Mode::Listening { .. }));
        if self.solver.is_some_and(|solver| solver != Solver::Track) && only_listen {
            return Err(UserError::flag("--solver", "tags that only listen have no ranges to solve: only track"));
        }
        if let (Some(3), Some(_)) = (self.dims, self.height_m) {
            return Err(UserError::flag("--height-m", "only with --dims 2"));
        }
        scenario.change_tags(|tag| {
            // Config records count rounds in 100 s.
            tag.rate_chz = self.rate.map(|hz| (100.0 * hz).round() as u32).or(tag.rate_chz);
            tag.solver = self.solver.unwrap_or(tag.solver);
            tag.scheme = self.scheme.or(tag.scheme);
            tag.height_m = match (self.dims, self.height_m) {
                (Some(3), _) => None,
                (_, Some(height_m)) => Some(height_m),
                (Some(_), None) => tag.height_m.or(Some(HEIGHT_M)),
                (None, None) => tag.height_m,
            };
        });
        if let Some(file) = &self.model {
            let model: Arc<[u8]> = Chosen::read(file, self.classifier.as_deref())?.bytes().into();
            scenario.tags.iter_mut().for_each(|tag| tag.settings.model = Some(Arc::clone(&model)));
        }
        Ok(())
    }
}

/// Runs `baliza simulate`.
///
/// # Errors
/// Flags, the scenario or another file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let scenario = arguments.scenario()?;
    if let Some(file) = &arguments.survey {
        output::check("--survey", file)?;
        let rooms = arguments.survey_rooms.as_deref().map(read_outlines).transpose()?;
        let survey = survey_csv(&scenario, arguments.survey_step_m, arguments.survey_dwell_s, rooms.as_deref())?;
        super::write(file, &survey)?;
        super::note(&format!("survey: {}\n", file.display()));
        return Ok(());
    }
    let drawing = PictureFile::plot(arguments.plot.as_deref())?;
    if let Some(file) = &arguments.pcap {
        output::check("--pcap", file)?;
    }
    let mut recording = arguments.out.as_ref().map(|folder| arguments.recording(folder, &scenario)).transpose()?;
    let mut drawn = Vec::new();
    let mut attempts = Attempts::default();
    // With --out, the positions are in the folder.
    let is_silent = arguments.json || arguments.out.is_some() && !std::io::stdout().is_terminal();
    let mut show = Show::new(is_silent, &scenario);
    show.begin()?;

    // Before a file is begun: a signal leaves nothing of it.
    catch_signals()?;
    let mut simulation = Simulation::new(scenario);
    let capture = arguments.pcap.as_ref().map(|file| Capture::begin(&simulation, file)).transpose()?;
    let seconds = simulation.scenario().seconds;
    let steps = (seconds / STEP_S).ceil() as usize;
    let progress = Progress::new(steps);
    for step in 1..=steps {
        refuse_interrupted()?;
        let records = simulation.run_until(seconds.min(step as f64 * STEP_S));
        for record in &records {
            attempts.take(record);
            if let Some(recording) = &mut recording {
                recording.take(record).context("cannot write the recording")?;
            }
        }
        show.take(&records)?;
        if drawing.is_some() {
            drawn.extend(records.into_iter().filter_map(drawable));
        }
        progress.step();
    }
    drop(progress);

    if let Some(recording) = recording {
        recording.finish().context("cannot write the recording")?;
    }
    if let Some(capture) = capture {
        capture.finish()?;
    }
    if let Some(drawing) = drawing {
        let source = arguments.site.as_ref().map_or("simulation".into(), |file| file.display().to_string());
        drawing.write(&picture(source, simulation.scenario(), &drawn).draw())?;
    }
    let summary = simulation.summary();
    super::warn(attempts.refused());
    let none = (summary.fixes == 0).then(|| format!("no positions: {}", attempts.why_none(simulation.scenario())));
    // A site's file may mean it: a tag out of reach, ranges for a calibration.
    let (meant, wrong) = if arguments.site.is_some() { (none, None) } else { (None, none) };
    super::warn(meant);
    if arguments.json {
        super::print_json(&summary)?;
        return some_position(wrong);
    }
    let mut said = summary_text(&summary);
    for (what, file) in [("files", &arguments.out), ("capture", &arguments.pcap), ("picture", &arguments.plot)] {
        if let Some(file) = file {
            let _ = writeln!(said, "{what}: {}", file.display());
        }
    }
    super::note(&said);
    some_position(wrong)
}

/// What a picture needs of a record.
fn drawable(mut record: Record) -> Option<Record> {
    let What::Epoch(epoch) = &mut record.what else { return None };
    (epoch.ranges, epoch.differences) = (Vec::new(), Vec::new());
    Some(record)
}
