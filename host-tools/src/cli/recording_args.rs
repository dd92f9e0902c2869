//! The common arguments of `solve` and `track`: the recording to read, and the space.

use std::path::PathBuf;

use anyhow::Result;
use clap::ValueEnum;
use host_tools::{Files, Half, Height, Recording, Setup, Space, UserError};

use super::report::{ByMethod, Output, OutputArgs, Report, flat};

/// The arguments of a command that computes positions from a recording.
#[derive(clap::Args)]
pub struct RecordingArgs {
    /// Surveyed anchors: CSV with anchor,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    anchors: PathBuf,
    /// Measured ranges: CSV with epoch,t_s,anchor,range_m and, where known, rx_power_dbm,fp_power_dbm,los
    #[arg(long, value_name = "FILE")]
    ranges: PathBuf,
    /// Where the tag truly was: CSV with epoch,t_s,x_m,y_m,z_m; gives the errors
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
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
    pub fn read(&self) -> Result<Input<'_>, UserError> {
        let setup = Setup { space: self.space()?, area_m: self.area.map(|CornersM(corners)| corners) };
        let output = self.output.check()?;
        let recording = Recording::read(&Files {
            anchors: &self.anchors,
            ranges: &self.ranges,
            truth: self.truth.as_deref(),
            anchor_heights: setup.space != Space::Plane(Height::Unknown),
            truth_heights: setup.space == Space::Plane(Height::FromTruth),
        })?;
        Ok(Input { recording, setup, with_errors: self.truth.is_some(), output })
    }
}

/// A recording, the settings for solving it, and the destination of the report.
pub struct Input<'a> {
    pub recording: Recording,
    pub setup: Setup,
    with_errors: bool,
    output: Output<'a>,
}

impl Input<'_> {
    /// Reports positions of the recording's epochs. With `consistency`, their errors are compared with their
    /// uncertainties.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn report(&self, solved: &ByMethod, consistency: bool) -> Result<()> {
        let Self { recording: Recording { anchors, epochs }, with_errors, .. } = self;
        let anchors = anchors.iter().map(|anchor| (anchor.name.clone(), flat(&anchor.place))).collect();
        let (walls_m, neighbours, with_errors) = (Vec::new(), None, *with_errors);
        Report { epochs, anchors, walls_m, with_errors, consistency, neighbours, solved }.write(&self.output)
    }
}
