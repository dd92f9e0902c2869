//! The common arguments of `solve` and `track`: the recording to read, and the space.

use std::path::PathBuf;

use anyhow::Result;
use clap::ValueEnum;
use host_tools::files::{Joined, drop_repeats, round_s, rounds};
use host_tools::locate::advice;
use host_tools::locate::residuals::{AnchorResiduals, Reference, residuals};
use host_tools::locate::time_offset::{Clocks, REACH_S, time_offset, timed_positions};
use host_tools::{Files, Half, Height, Recording, Setup, Solved, Solver, Space, Truth, UserError};
use positioning_core::Method;

use super::report::{ByMethod, Output, OutputArgs, Report, flat};
use super::residuals::table;

/// The arguments of a command that computes positions from a recording.
#[derive(clap::Args)]
pub struct RecordingArgs {
    /// Surveyed anchors: CSV with anchor,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    anchors: PathBuf,
    /// Measured ranges: CSV with epoch,t_s,anchor,range_m and, where known, rx_power_dbm,fp_power_dbm,los
    #[arg(long, value_name = "FILE")]
    ranges: PathBuf,
    /// Where the tag truly was: CSV with epoch,t_s,x_m,y_m,z_m; gives the errors. It may have its own rate and epochs: a
    /// position is interpolated in time; without times it is that of the same epoch
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Added to the times of the truth, whose clock may differ from that of the ranges: seconds, or `auto`, which
    /// estimates them (at most 2 s) from the positions of each epoch by itself and gives 0 where the tag moves too little
    #[arg(long, value_name = "SECONDS|auto", default_value = "0", allow_hyphen_values = true, requires = "truth")]
    time_offset_s: TimeOffset,
    /// Make rounds of single ranges: a round ends where an anchor repeats, or after these seconds; 0: as in the file
    /// [default: where nearly all epochs have one range, `solve` makes rounds of .1 to .35 s, `track` none]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    group_s: Option<f64>,
    /// Also print the residuals of the ranges by anchor, against the truth, or else against the positions (in JSON:
    /// anchors)
    #[arg(long)]
    residuals: bool,
    /// The consistency of errors and uncertainties is always printed.
    #[arg(long, hide = true)]
    consistency: bool,
    /// Solve in the plane (2) or in space (3)
    #[arg(long, value_name = "2|3", default_value = "3")]
    dims: Dims,
    /// The tag's height, metres: ranges are flattened to the plane (--dims 2)
    #[arg(long, value_name = "Z", allow_negative_numbers = true, value_parser = finite, conflicts_with = "height_from_truth")]
    height_m: Option<f64>,
    /// Take the tag's height of each epoch from the truth (--dims 2)
    #[arg(long, requires = "truth")]
    height_from_truth: bool,
    /// On which side of the anchors the tag is, where they all lie on one plane (--dims 3) [default: below, with an
    /// uncertainty that reaches to the mirror image]
    #[arg(long, value_name = "SIDE")]
    side: Option<Side>,
    /// Where the tag can be at all, metres; the iterated methods stay inside
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true, value_parser = CornersM::parse)]
    area: Option<CornersM>,
    #[command(flatten)]
    output: OutputArgs,
}

/// `--time-offset-s`.
#[derive(Clone, Copy, Debug)]
enum TimeOffset {
    Seconds(f64),
    Auto,
}

impl std::str::FromStr for TimeOffset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            seconds => finite(seconds).map(Self::Seconds),
        }
    }
}

/// What to do with a recording whose epochs have single ranges, without `--group-s`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingleRanges {
    /// Make rounds of them.
    Group,
    /// Keep them as they are.
    Keep,
}

/// `--dims`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Dims {
    /// The plane.
    #[value(name = "2")]
    Two,
    /// Space.
    #[value(name = "3")]
    Three,
}

/// `--side`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Side {
    /// Lower than the anchors
    Below,
    /// Higher than the anchors
    Above,
}

/// `--area`: least and greatest x and y.
#[derive(Clone, Copy, Debug)]
pub struct CornersM(pub [[f64; 2]; 2]);

impl CornersM {
    /// Parses the argument of `--area`.
    ///
    /// # Errors
    /// The text is not four numbers, or the least values are not below the greatest ones.
    pub fn parse(text: &str) -> Result<Self, String> {
        let numbers = text.split(',').map(finite).collect::<Result<Vec<_>, _>>()?;
        match numbers[..] {
            [x0, y0, x1, y1] if x0 < x1 && y0 < y1 => Ok(Self([[x0, y0], [x1, y1]])),
            [_, _, _, _] => Err("X0 must be less than X1, and Y0 less than Y1".to_owned()),
            _ => Err("four numbers are expected: X0,Y0,X1,Y1".to_owned()),
        }
    }
}

/// Parses a finite number.
///
/// # Errors
/// The text is not a finite number.
pub fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(_) | Err(_) => Err(format!("{text:?} is not a number")),
    }
}

/// Parses a duration.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds = finite(text)?;
    if seconds >= 0.0 { Ok(seconds) } else { Err("it must not be below 0".to_owned()) }
}

impl RecordingArgs {
    /// The space that the flags select. Flags that cannot be combined are refused.
    fn space(&self) -> Result<Space, UserError> {
        match self.dims {
            Dims::Two if self.side.is_some() => Err(UserError::flag("--side", "only with --dims 3")),
            Dims::Two => Ok(Space::Plane(match self.height_m {
                Some(height_m) => Height::Fixed(height_m),
                None if self.height_from_truth => Height::FromTruth,
                None => Height::Unknown,
            })),
            Dims::Three if self.height_m.is_some() => Err(UserError::flag("--height-m", "only with --dims 2")),
            Dims::Three if self.height_from_truth => Err(UserError::flag("--height-from-truth", "only with --dims 2")),
            Dims::Three => Ok(Space::Full(self.side.map(|side| match side {
                Side::Below => Half::Below,
                Side::Above => Half::Above,
            }))),
        }
    }

    /// Checks the destinations of the report, and reads the recording.
    ///
    /// # Errors
    /// Flags cannot be combined, an output cannot be written, or a file is wrong; the error names the first wrong line.
    pub fn read(&self, singles: SingleRanges) -> Result<Input<'_>, UserError> {
        let setup = Setup { space: self.space()?, area_m: self.area.map(|CornersM(corners)| corners) };
        let output = self.output.check()?;
        let mut recording = Recording::read(&Files {
            anchors: &self.anchors,
            ranges: &self.ranges,
            truth: None,
            anchor_heights: setup.space != Space::Plane(Height::Unknown),
            truth_heights: false,
        })?;
        let repeats = drop_repeats(&mut recording.epochs);
        let warnings = advice::of_recording(&recording, setup.space).into_iter().chain(advice::of_repeats(repeats));
        let mut notes: Vec<String> = warnings.map(|warning| format!("warning: {warning}")).collect();
        let heights = setup.space == Space::Plane(Height::FromTruth);
        let truth = self.truth.as_deref().map(|file| Truth::read(file, heights)).transpose()?;
        let usual_s = round_s(&recording.epochs);
        let longest_s = match self.group_s {
            Some(longest_s) => Some(longest_s).filter(|longest_s| *longest_s > 0.0),
            None => usual_s.filter(|_| singles == SingleRanges::Group),
        };
        let of_rounds = |recording: &Recording, longest_s| Recording {
            epochs: rounds(recording.epochs.clone(), longest_s),
            anchors: recording.anchors.clone(),
        };
        if let Some(longest_s) = longest_s {
            recording = of_rounds(&recording, longest_s);
            if self.group_s.is_none() {
                notes.push(format!("single ranges are made into rounds of at most {longest_s:.3} s (see --group-s)"));
            }
        }
        let truth = truth.map(|truth| {
            let offset_s = match (self.time_offset_s, longest_s, usual_s) {
                (TimeOffset::Seconds(offset_s), _, _) => offset_s,
                // The offset comes from fixes, which single ranges do not make.
                (TimeOffset::Auto, None, Some(usual_s)) => {
                    offset_s(of_rounds(&recording, usual_s), setup, &truth, &mut notes)
                }
                (TimeOffset::Auto, _, _) => offset_s(recording.clone(), setup, &truth, &mut notes),
            };
            let joined = match longest_s {
                // Epochs that are no more are not lost.
                Some(_) => truth.join_heard(&mut recording.epochs, offset_s),
                None => truth.join(&mut recording.epochs, offset_s),
            };
            if joined == Joined::ByEpochDespiteTimes {
                notes.push("the truth has no time in common with the ranges: joined by epoch".to_owned());
            }
            JoinedTruth { truth, offset_s: (joined == Joined::ByTime).then_some(offset_s) }
        });
        Ok(Input { recording, setup, truth, residuals: self.residuals, notes, output })
    }
}

/// The offset of the truth's clock, by positions of single epochs. Adds a line about it to the notes.
fn offset_s(mut recording: Recording, setup: Setup, truth: &Truth, notes: &mut Vec<String>) -> f64 {
    // Heights change slowly, so those of the unshifted truth are good enough here.
    truth.join_heard(&mut recording.epochs, 0.0);
    let solver = Solver::new(&recording.anchors, setup);
    let solved: Vec<_> = recording.epochs.iter().map(|epoch| solver.solve(Method::Robust, epoch)).collect();
    let (offset_s, found) = match time_offset(&timed_positions(&recording.epochs, &solved), truth) {
        Clocks::Differ { offset_s, deviation_s } => {
            (offset_s, format!("{offset_s:.3} ± {deviation_s:.3} s is added to the times of the truth"))
        }
        Clocks::Agree { deviation_s } => (0.0, format!("0 s: the clocks agree, ± {deviation_s:.3} s")),
        Clocks::Vague { offset_s, deviation_s } => {
            (0.0, format!("0 s: the tag moves too little to be sure of {offset_s:.2} ± {deviation_s:.2} s"))
        }
        Clocks::Unknown => (0.0, "0 s: the tag rests, or too few positions have a time and a truth".to_owned()),
        Clocks::NoneFits => (0.0, format!("0 s: none within {REACH_S} s fits")),
    };
    notes.push(format!("time offset: {found}"));
    offset_s
}

/// A recording, the settings for solving it, and the destination of the report.
pub struct Input<'a> {
    pub recording: Recording,
    pub setup: Setup,
    truth: Option<JoinedTruth>,
    residuals: bool,
    /// Lines for the user.
    notes: Vec<String>,
    output: Output<'a>,
}

/// The truth, after it was joined to the epochs.
struct JoinedTruth {
    truth: Truth,
    /// What was added to its times, seconds; `None` where it was joined by the epochs' names.
    offset_s: Option<f64>,
}

impl Input<'_> {
    /// Reports positions of the recording's epochs.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn report(&self, solved: &ByMethod) -> Result<()> {
        let epochs = &self.recording.epochs;
        let residuals = self.residuals.then(|| self.residuals(solved));
        let places = self.recording.anchors.iter().map(|anchor| (anchor.name.clone(), flat(&anchor.place)));
        Report {
            epochs,
            anchors: places.collect(),
            walls_m: Vec::new(),
            with_errors: self.truth.is_some(),
            time_offset_s: self.truth.as_ref().and_then(|truth| truth.offset_s),
            residuals: residuals.as_deref(),
            neighbours: None,
            solved,
        }
        .write(&self.output)?;
        // Residuals against the truth are the same for all methods.
        let tables = residuals.iter().flatten().take(if self.truth.is_some() { 1 } else { solved.len() });
        if !self.output.is_json() {
            for (anchors, (method, _)) in tables.zip(solved) {
                let against = if self.truth.is_some() { "the truth" } else { method };
                super::note(&format!("\nresiduals of the ranges against {against}:\n{}", table(anchors)));
            }
        }
        for line in &self.notes {
            super::note(&format!("{line}\n"));
        }
        let all: Vec<Solved> = solved.iter().flat_map(|(_, solved)| solved).copied().collect();
        let in_space = matches!(self.setup.space, Space::Full(_));
        super::report::some_position(advice::nothing_solved(&all, "anchors", in_space))
    }

    /// The residuals by method and anchor.
    fn residuals(&self, solved: &ByMethod) -> Vec<Vec<AnchorResiduals>> {
        let Recording { anchors, epochs } = &self.recording;
        let against = |reference| residuals(anchors, epochs, &self.setup, reference);
        match &self.truth {
            Some(JoinedTruth { truth, offset_s }) => {
                vec![against(Reference::Truth(truth, offset_s.unwrap_or(0.0))); solved.len()]
            }
            None => solved.iter().map(|(_, solved)| against(Reference::Solved(solved))).collect(),
        }
    }
}
