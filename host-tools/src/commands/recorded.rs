//! What `solve` and `track` have in common: the recording to go over, the space, and the answers.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use clap::ValueEnum;
use host_tools::plot::{Dot, Picture, Track};
use host_tools::{Files, Half, Height, Place, Recording, Setup, Solved, Space, Statistics, Wrong, output, positions};

use super::PictureFile;

/// The arguments of a command that makes positions of a recording.
#[derive(clap::Args)]
pub struct Recorded {
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
    /// Write the positions here and not to standard output
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Draw the positions, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON and no positions: a list, an object a method, with method, epochs, fixed, rmse_m, mae_m, p50_m, p90_m
    /// (null without truth)
    #[arg(long)]
    json: bool,
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
struct CornersM([[f64; 2]; 2]);

impl CornersM {
    fn parse(text: &str) -> Result<Self, String> {
        let numbers = text.split(',').map(finite).collect::<Result<Vec<_>, _>>()?;
        match numbers[..] {
            [x0, y0, x1, y1] if x0 < x1 && y0 < y1 => Ok(Self([[x0, y0], [x1, y1]])),
            [_, _, _, _] => Err("X0 must be less than X1, and Y0 less than Y1".to_owned()),
            _ => Err("four numbers are expected: X0,Y0,X1,Y1".to_owned()),
        }
    }
}

fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(_) | Err(_) => Err(format!("{text:?} is not a number")),
    }
}

/// Positions of all epochs, by a method.
pub type ByMethod = Vec<(&'static str, Vec<Solved>)>;

impl Recorded {
    /// What the flags say of space; flags that do not go together are refused.
    fn space(&self) -> Result<Space, Wrong> {
        match self.dims {
            Dims::Two if self.side.is_some() => Err(Wrong::flag("--side", "only with --dims 3")),
            Dims::Two => Ok(Space::Plane(match self.height_m {
                Some(height_m) => Height::Fixed(height_m),
                None if self.height_from_truth => Height::FromTruth,
                None => Height::Unknown,
            })),
            Dims::Three if self.height_m.is_some() => Err(Wrong::flag("--height-m", "only with --dims 2")),
            Dims::Three if self.height_from_truth => Err(Wrong::flag("--height-from-truth", "only with --dims 2")),
            Dims::Three => Ok(Space::Full(self.side.map(|side| match side {
                Side::Below => Half::Below,
                Side::Above => Half::Above,
            }))),
        }
    }

    /// Reads the recording, has it solved, and gives the answers. With `consistency` they tell how the errors go with the
    /// uncertainties.
    pub fn run(&self, consistency: bool, solve: impl FnOnce(&Recording, Setup) -> ByMethod) -> Result<()> {
        let setup = Setup { space: self.space()?, area_m: self.area.map(|CornersM(corners)| corners) };
        if let Some(file) = &self.out {
            output::check("--out", file)?;
        }
        let picture = PictureFile::plot(self.plot.as_deref())?;
        let recording = Recording::read(&Files {
            anchors: &self.anchors,
            ranges: &self.ranges,
            truth: self.truth.as_deref(),
            anchor_heights: setup.space != Space::Plane(Height::Unknown),
            truth_heights: setup.space == Space::Plane(Height::FromTruth),
        })?;

        let solved = solve(&recording, setup);
        let summaries: Vec<_> = solved
            .iter()
            .map(|(method, solved)| Summary::of(method, solved, consistency.then_some(&recording)))
            .collect();
        let picture = match picture {
            Some(PictureFile { file, format }) => Some((file, format.encode(draw(&recording, &solved).to_svg()?)?)),
            None => None,
        };

        if self.out.is_some() || !self.json {
            let by_method = solved.iter().map(|(method, solved)| (*method, solved.as_slice()));
            let csv = positions::to_csv(&recording.epochs, by_method, self.truth.is_some())?;
            match &self.out {
                Some(file) => super::write(file, &csv)?,
                None => super::print(&csv)?,
            }
        }
        if let Some((file, bytes)) = &picture {
            super::write(file, bytes)?;
        }
        if self.json {
            return super::print_json(&summaries);
        }
        let mut said = table(&summaries, &solved);
        for (what, file) in [("positions", &self.out), ("picture", &self.plot)] {
            if let Some(file) = file {
                let _ = writeln!(said, "{what}: {}", file.display());
            }
        }
        super::tell(&said);
        Ok(())
    }
}

fn draw(recording: &Recording, solved: &[(&'static str, Vec<Solved>)]) -> Picture {
    let flat = |place: &Place| [place.x_m, place.y_m];
    Picture {
        anchors: recording.anchors.iter().map(|anchor| (anchor.name.clone(), flat(&anchor.place))).collect(),
        walls_m: Vec::new(),
        truth_m: vec![recording.epochs.iter().filter_map(|epoch| epoch.truth.as_ref().map(flat)).collect()],
        tracks: solved
            .iter()
            .map(|(method, solved)| Track {
                method: (*method).to_owned(),
                dots: solved
                    .iter()
                    .filter_map(|solved| solved.outcome.as_ref().ok())
                    .map(|position| Dot { at_m: flat(&position.place), sigma_m: Some(flat(&position.sigma)) })
                    .collect(),
                errors_m: solved.iter().filter_map(|solved| solved.error_m).collect(),
            })
            .collect(),
    }
}

/// What `--json` prints of a method.
#[derive(Debug, serde::Serialize)]
struct Summary {
    method: &'static str,
    epochs: usize,
    fixed: usize,
    rmse_m: Option<f64>,
    mae_m: Option<f64>,
    p50_m: Option<f64>,
    p90_m: Option<f64>,
    #[serde(flatten)]
    consistency: Option<Consistency>,
}

/// How the horizontal errors go with the uncertainties.
#[derive(Debug, serde::Serialize)]
struct Consistency {
    /// The share of the errors inside the 1σ ellipse: 0.39 where the covariance is right.
    inside_1_sigma: f64,
    /// The mean of the squared errors in units of their covariance: 2 where the covariance is right.
    nees: f64,
}

impl Consistency {
    fn of(solved: &[Solved], recording: &Recording) -> Option<Self> {
        let positions = solved.iter().zip(&recording.epochs);
        let squares: Vec<f64> = positions
            .filter_map(|(solved, epoch)| Some(solved.outcome.as_ref().ok()?.normalised_square(epoch.truth.as_ref()?)))
            .filter(|square| square.is_finite())
            .collect();
        let count = squares.len() as f64;
        let inside = squares.iter().filter(|square| **square <= 1.0).count() as f64;
        (!squares.is_empty())
            .then(|| Self { inside_1_sigma: inside / count, nees: squares.iter().sum::<f64>() / count })
    }
}

impl Summary {
    fn of(method: &'static str, solved: &[Solved], recording: Option<&Recording>) -> Self {
        let errors: Vec<f64> = solved.iter().filter_map(|solved| solved.error_m).collect();
        let figures = Statistics::of(&errors);
        let rounded = |figure: fn(&Statistics) -> f64| figures.as_ref().map(figure).map(super::rounded);
        Self {
            method,
            epochs: solved.len(),
            fixed: solved.iter().filter(|solved| solved.outcome.is_ok()).count(),
            rmse_m: rounded(|figures| figures.rmse),
            mae_m: rounded(|figures| figures.mae),
            p50_m: rounded(|figures| figures.p50),
            p90_m: rounded(|figures| figures.p90),
            consistency: recording.and_then(|recording| Consistency::of(solved, recording)),
        }
    }
}

/// The summaries for reading, with the reasons of what was not fixed.
fn table(summaries: &[Summary], solved: &[(&'static str, Vec<Solved>)]) -> String {
    let mut text = format!(
        "{:<13} {:>7} {:>7} {:>8} {:>8} {:>8} {:>8}\n",
        "method", "epochs", "fixed", "rmse_m", "mae_m", "p50_m", "p90_m"
    );
    for (summary, (_, solved)) in summaries.iter().zip(solved) {
        let _ = write!(text, "{:<13} {:>7} {:>7}", summary.method, summary.epochs, summary.fixed);
        for figure in [summary.rmse_m, summary.mae_m, summary.p50_m, summary.p90_m] {
            let _ = write!(text, " {:>8}", figure.map_or_else(|| "-".to_owned(), |metres| format!("{metres:.3}")));
        }
        if let Some(Consistency { inside_1_sigma, nees }) = summary.consistency {
            let _ = write!(text, "  {:.0} % inside 1 sigma, NEES {nees:.2}", 100.0 * inside_1_sigma);
        }
        let mut reasons = BTreeMap::new();
        for reason in solved.iter().filter_map(|solved| solved.outcome.as_ref().err()) {
            *reasons.entry(reason.as_str()).or_insert(0_usize) += 1;
        }
        for (reason, count) in reasons {
            let _ = write!(text, "  {count} {reason}");
        }
        text.push('\n');
    }
    text
}
