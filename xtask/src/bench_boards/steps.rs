//! The steps of `docs/use/hardware.md`, by their numbers there: which commands, and what they must print.

use std::fmt;

use anyhow::{Context, Result, bail, ensure};

use super::Commands;
use super::dut::{BoardUnderTest, Desk};
use super::heard::Heard;

/// A step.
pub struct BenchStep {
    /// Its number in the document.
    pub number: u8,
    pub what: &'static str,
    pub expect: &'static str,
    kind: Kind,
}

/// How a step is checked.
enum Kind {
    /// By commands, and a look at what they print.
    Commands { words: fn(&Desk) -> Result<Vec<Vec<String>>>, check: Check },
    /// By a person.
    Hand,
}

/// Looks at the outputs, in the order of the commands: the figures, or what is wrong.
type Check = fn(&[String]) -> Result<String>;

/// The outcome of a step.
#[derive(Clone, Debug, PartialEq)]
pub enum StepVerdict {
    /// With its figures.
    Passed(String),
    Failed(String),
    /// A board for it is missing.
    LeftOut(String),
    /// A person does it.
    Hand,
}

impl fmt::Display for StepVerdict {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Passed(figures) => write!(out, "passed: {figures}"),
            Self::Failed(why) => write!(out, "FAILED: {why}"),
            Self::LeftOut(why) => write!(out, "left out: {why}"),
            Self::Hand => write!(out, "by hand: see docs/use/hardware.md"),
        }
    }
}

/// Positions a second of a tag with two anchors at least: what the simulation gives at half the processor's speed.
const LEAST_ROUNDS_PER_S: f64 = 350.0;
/// Late starts a round at most.
const MOST_LATE: f64 = 0.01;
/// The distance at which ranges are checked, metres, and how far their mean and their deviation may be off.
const DISTANCE_M: f64 = 5.0;
const MEAN_WITHIN_M: f64 = 0.3;
const DEVIATION_M: f64 = 0.04;
/// Ranges for that.
const RANGES: usize = 1000;
/// Anchors of the network, and the share of rounds in which all answer.
const NETWORK: usize = 4;
const WHOLE_ROUNDS: f64 = 0.95;
/// When a lone anchor coordinates, and a second one follows, seconds since their start.
const COORDINATES_S: f64 = 0.6;
const SYNCHRONISED_S: f64 = 1.0;

/// A step by hand.
const fn hand(number: u8, what: &'static str, expect: &'static str) -> BenchStep {
    BenchStep { number, what, expect, kind: Kind::Hand }
}

/// A step by commands.
const fn commands(
    number: u8,
    what: &'static str,
    expect: &'static str,
    words: fn(&Desk) -> Result<Vec<Vec<String>>>,
    check: Check,
) -> BenchStep {
    BenchStep { number, what, expect, kind: Kind::Commands { words, check } }
}

/// All steps, in the order of the document.
pub const STEPS: [BenchStep; 20] = [
    commands(1, "flashing, RTT, supervisor", "hello of every board", flash_all, every_hello),
    commands(2, "record", "records are read back", read_all, every_record),
    hand(3, "instruction cache", "bit 0 is 1"),
    commands(4, "SPI, PLL, OTP", "coordinating in 0.6 s, no radio-failed", start_first, coordinates),
    hand(5, "calibration", "neither 0 nor all ones"),
    commands(6, "transmission", "a second anchor is synchronised in 1 s", start_second, synchronises),
    commands(7, "speed", "350 rounds a second", |desk| tag_for(desk, 2, 10), is_fast),
    commands(8, "late starts", "late below 1 % of rounds", |desk| tag_for(desk, 2, 60), is_in_time),
    commands(
        9,
        "timestamps, bias, at 5.00 m",
        "mean within 30 cm, deviation 4 cm",
        |desk| tag_for(desk, 1, 30),
        is_exact,
    ),
    commands(10, "network", "all anchors in 95 % of rounds", |desk| tag_for(desk, NETWORK, 60), is_whole),
    hand(11, "coordinator reset", "another coordinates in a second"),
    hand(12, "sleep", "the simulated current"),
    hand(13, "32 kHz crystal", "late below 1 %, no searching"),
    hand(14, "motion sensor", "full rate within a second"),
    hand(15, "its limits", "3 µA at rest"),
    hand(16, "Bluetooth beside ranging", "5 % fewer rounds at most"),
    hand(17, "ESP32-C3", "steps 4 to 10 at its rates"),
    hand(18, "EVK1000 stock software", "paired in three blinks, within 10 cm"),
    hand(19, "warm chips", "mean back within 2 cm"),
    hand(20, "power cuts", "old or new record"),
];

impl BenchStep {
    /// The commands.
    ///
    /// # Errors
    /// A board is missing, or the step is one for a person.
    pub fn commands(&self, desk: &Desk) -> Result<Vec<Vec<String>>> {
        match &self.kind {
            Kind::Commands { words, .. } => words(desk),
            Kind::Hand => bail!("by hand"),
        }
    }

    /// Does it.
    pub fn check(&self, desk: &Desk, commands: &mut dyn Commands) -> StepVerdict {
        let Kind::Commands { words, check } = &self.kind else { return StepVerdict::Hand };
        let words = match words(desk) {
            Ok(words) => words,
            Err(missing) => return StepVerdict::LeftOut(format!("{missing:#}")),
        };
        let outputs = words.iter().map(|words| commands.run(words)).collect::<Result<Vec<_>>>();
        match outputs.and_then(|outputs| check(&outputs)) {
            Ok(figures) => StepVerdict::Passed(figures),
            Err(error) => StepVerdict::Failed(format!("{error:#}")),
        }
    }
}

/// Flashes each board, with its record, and listens to its start.
fn flash_all(desk: &Desk) -> Result<Vec<Vec<String>>> {
    Ok(desk.boards.iter().flat_map(|board| [board.flash(&desk.site), board.listen(3, true)]).collect())
}

fn every_hello(outputs: &[String]) -> Result<String> {
    let listened = outputs.iter().skip(1).step_by(2);
    for (at, output) in (1..).zip(listened) {
        if !Heard::parse(output)?.has_hello() {
            bail!("board {at} says nothing: no hello in 3 s");
        }
    }
    Ok(format!("{} boards", outputs.len() / 2))
}

/// A probe can read the flash of all but an ESP.
fn read_all(desk: &Desk) -> Result<Vec<Vec<String>>> {
    let readable = desk.boards.iter().filter(|board| board.port.is_none() && !board.board.starts_with("esp"));
    let commands: Vec<_> = readable.map(BoardUnderTest::read_record).collect();
    ensure!(!commands.is_empty(), "no board whose record a probe can read");
    Ok(commands)
}

fn every_record(outputs: &[String]) -> Result<String> {
    for (at, output) in (1..).zip(outputs) {
        let printed: serde_json::Value = serde_json::from_str(output).with_context(|| format!("board {at}"))?;
        if printed["results"].as_array().is_none_or(Vec::is_empty) {
            bail!("board {at} has no record: {}", printed["error"]["message"]);
        }
    }
    Ok(format!("{} records", outputs.len()))
}

fn start_first(desk: &Desk) -> Result<Vec<Vec<String>>> {
    Ok(desk.anchors(1)?.iter().map(|anchor| anchor.listen(5, true)).collect())
}

fn coordinates(outputs: &[String]) -> Result<String> {
    let heard = only(outputs)?;
    if let Some(t_s) = heard.state_s("radio-failed") {
        bail!("radio-failed after {t_s:.2} s: wiring, reset or interrupt line, supply");
    }
    state_within(&heard, "coordinating", COORDINATES_S)
}

fn start_second(desk: &Desk) -> Result<Vec<Vec<String>>> {
    Ok(desk.anchors(2)?.iter().skip(1).map(|anchor| anchor.listen(5, true)).collect())
}

fn synchronises(outputs: &[String]) -> Result<String> {
    state_within(&only(outputs)?, "synchronised", SYNCHRONISED_S)
}

fn state_within(heard: &Heard, state: &str, limit_s: f64) -> Result<String> {
    let t_s = heard.state_s(state).with_context(|| format!("never {state}"))?;
    if t_s > limit_s {
        bail!("{state} after {t_s:.2} s, not {limit_s} s");
    }
    Ok(format!("{state} after {t_s:.2} s"))
}

/// Listens to the tag, with this number of anchors on the desk.
fn tag_for(desk: &Desk, anchors: usize, seconds: u32) -> Result<Vec<Vec<String>>> {
    desk.anchors(anchors)?;
    Ok(vec![desk.tag()?.listen(seconds, false)])
}

fn is_fast(outputs: &[String]) -> Result<String> {
    let rate = only(outputs)?.rounds_per_s().context("no rounds")?;
    if rate < LEAST_ROUNDS_PER_S {
        bail!("{rate:.0} rounds a second, not {LEAST_ROUNDS_PER_S}: is rate_hz in the tag's record?");
    }
    Ok(format!("{rate:.0} rounds a second"))
}

fn is_in_time(outputs: &[String]) -> Result<String> {
    let share = only(outputs)?.late_share().context("no counters, or no rounds")?;
    if share > MOST_LATE {
        bail!("{:.2} % of rounds late", 100.0 * share);
    }
    Ok(format!("{:.2} % late", 100.0 * share))
}

fn is_exact(outputs: &[String]) -> Result<String> {
    let (count, mean, deviation) = only(outputs)?.ranges().context("no ranges: report_ranges = true?")?;
    let figures = format!("{count} ranges, mean {mean:.3} m, deviation {:.1} cm", 100.0 * deviation);
    if count < RANGES {
        bail!("{figures}: fewer than {RANGES}");
    }
    if (mean - DISTANCE_M).abs() > MEAN_WITHIN_M {
        bail!("{figures}: the mean is off by more than {MEAN_WITHIN_M} m; calibrate antenna delays");
    }
    if deviation > DEVIATION_M {
        bail!("{figures}: more than {DEVIATION_M} m; is the tag at rest in the open?");
    }
    Ok(figures)
}

fn is_whole(outputs: &[String]) -> Result<String> {
    let heard = only(outputs)?;
    let share = heard.share_with(NETWORK as u64).context("no rounds")?;
    let rate = heard.rounds_per_s().unwrap_or_default();
    let figures = format!("all {NETWORK} anchors in {:.1} % of rounds, {rate:.0} rounds a second", 100.0 * share);
    if share < WHOLE_ROUNDS {
        bail!("{figures}");
    }
    Ok(figures)
}

/// The only output.
fn only(outputs: &[String]) -> Result<Heard> {
    Heard::parse(outputs.first().context("no command was run")?)
}
