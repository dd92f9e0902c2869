//! The report of a command that computes positions: a file of positions, a picture, and a summary.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use baliza_report::{Statistics, mean};
use host_tools::files::output;
use host_tools::files::positions;
use host_tools::plot::{Dot, Picture, Track};
use host_tools::{Coordinates, Epoch, Solved, UserError};

use super::PictureFile;

/// The destinations of a report.
#[derive(clap::Args)]
pub struct OutputArgs {
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

/// Outputs that can be written.
pub struct Output<'a> {
    arguments: &'a OutputArgs,
    picture: Option<PictureFile<'a>>,
}

impl OutputArgs {
    /// Refuses files that cannot be written, before any work is done for them.
    ///
    /// # Errors
    /// A file cannot be written, or its picture format is not supported.
    pub fn check(&self) -> Result<Output<'_>, UserError> {
        if let Some(file) = &self.out {
            output::check("--out", file)?;
        }
        Ok(Output { arguments: self, picture: PictureFile::plot(self.plot.as_deref())? })
    }
}

/// Positions of all epochs, by method.
pub type ByMethod = Vec<(String, Vec<Solved>)>;

/// The content of a report.
pub struct Report<'a> {
    /// The epochs, with one position each.
    pub epochs: &'a [Epoch],
    /// Names and positions of the anchors or beacons on the map.
    pub anchors: Vec<(String, [f64; 2])>,
    /// Both ends of every wall, metres.
    pub walls_m: Vec<[[f64; 2]; 2]>,
    /// Whether the true positions are known.
    pub with_errors: bool,
    /// Whether to compare the errors with the uncertainties.
    pub consistency: bool,
    /// For positions by beacons: the number of neighbours of each method, where the method has neighbours.
    pub neighbours: Option<Vec<Option<usize>>>,
    /// The positions.
    pub solved: &'a ByMethod,
}

impl Report<'_> {
    /// Writes the positions and the picture, and prints the summary.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, output: &Output) -> Result<()> {
        let OutputArgs { out, plot, json } = output.arguments;
        let summaries = self.summaries();
        // The picture is drawn before any file is written, so that an error in drawing leaves no file.
        let picture = match output.picture {
            Some(PictureFile { file, format }) => Some((file, format.encode(self.picture().to_svg()?)?)),
            None => None,
        };
        if out.is_some() || !json {
            let by_method = self.solved.iter().map(|(method, solved)| (method.as_str(), solved.as_slice()));
            let csv = positions::to_csv(self.epochs, by_method, self.with_errors)?;
            match out {
                Some(file) => super::write(file, &csv)?,
                None => super::print(&csv)?,
            }
        }
        if let Some((file, bytes)) = &picture {
            super::write(file, bytes)?;
        }
        if *json {
            return super::print_json(&summaries);
        }
        let mut said = table(&summaries, self.solved);
        for (what, file) in [("positions", out), ("picture", plot)] {
            if let Some(file) = file {
                let _ = writeln!(said, "{what}: {}", file.display());
            }
        }
        super::note(&said);
        Ok(())
    }

    fn summaries(&self) -> Vec<Summary> {
        let epochs = self.consistency.then_some(self.epochs);
        let neighbours = self.neighbours.iter().flatten().copied().map(Some).chain(std::iter::repeat(None));
        let by_method = self.solved.iter().zip(neighbours);
        by_method.map(|((method, solved), neighbours)| Summary::of(method, solved, epochs, neighbours)).collect()
    }

    fn picture(&self) -> Picture {
        let tracks = self.solved.iter().map(|(method, solved)| Track {
            method: method.clone(),
            dots: solved
                .iter()
                .filter_map(|solved| solved.outcome.as_ref().ok())
                .map(|position| Dot { at_m: flat(&position.place), sigma_m: Some(flat(&position.sigma)) })
                .collect(),
            errors_m: solved.iter().filter_map(|solved| solved.error_m).collect(),
        });
        Picture {
            anchors: self.anchors.clone(),
            beacons: Vec::new(),
            walls_m: self.walls_m.clone(),
            truth_m: vec![self.epochs.iter().filter_map(|epoch| epoch.truth.as_ref().map(flat)).collect()],
            tracks: tracks.collect(),
        }
    }
}

/// The horizontal coordinates of a position, metres.
pub fn flat(place: &Coordinates) -> [f64; 2] {
    [place.x_m, place.y_m]
}

/// The summary of a method for `--json`.
#[derive(Debug, serde::Serialize)]
struct Summary {
    method: String,
    #[serde(flatten)]
    by_beacons: Option<ByBeacons>,
    epochs: usize,
    fixed: usize,
    rmse_m: Option<f64>,
    mae_m: Option<f64>,
    p50_m: Option<f64>,
    p90_m: Option<f64>,
    #[serde(flatten)]
    consistency: Option<Consistency>,
}

/// The part of a summary that only positions by beacons have.
#[derive(Debug, serde::Serialize)]
struct ByBeacons {
    k: Option<usize>,
    points: usize,
}

/// The comparison of the horizontal errors with the uncertainties.
#[derive(Debug, serde::Serialize)]
struct Consistency {
    /// The share of the errors inside the 1σ ellipse: 0.39 where the covariance is right.
    inside_1_sigma: f64,
    /// The mean of the squared errors in units of their covariance: 2 where the covariance is right.
    nees: f64,
}

impl Consistency {
    fn of(solved: &[Solved], epochs: &[Epoch]) -> Option<Self> {
        let positions = solved.iter().zip(epochs);
        let squares: Vec<f64> = positions
            .filter_map(|(solved, epoch)| Some(solved.outcome.as_ref().ok()?.normalised_square(epoch.truth.as_ref()?)))
            .filter(|square| square.is_finite())
            .collect();
        let count = squares.len() as f64;
        let inside = squares.iter().filter(|square| **square <= 1.0).count() as f64;
        (!squares.is_empty()).then(|| Self { inside_1_sigma: inside / count, nees: mean(squares.iter().copied()) })
    }
}

impl Summary {
    fn of(method: &str, solved: &[Solved], epochs: Option<&[Epoch]>, neighbours: Option<Option<usize>>) -> Self {
        let errors: Vec<f64> = solved.iter().filter_map(|solved| solved.error_m).collect();
        let figures = Statistics::of(&errors);
        let of = |figure: fn(&Statistics) -> f64| figures.as_ref().map(figure);
        Self {
            method: method.to_owned(),
            by_beacons: neighbours.map(|k| ByBeacons { k, points: solved.len() }),
            epochs: solved.len(),
            fixed: solved.iter().filter(|solved| solved.outcome.is_ok()).count(),
            rmse_m: of(|figures| figures.rmse),
            mae_m: of(|figures| figures.mae),
            p50_m: of(|figures| figures.p50),
            p90_m: of(|figures| figures.p90),
            consistency: epochs.and_then(|epochs| Consistency::of(solved, epochs)),
        }
    }
}

/// The summaries as text, with the reasons for epochs without a position.
fn table(summaries: &[Summary], solved: &[(String, Vec<Solved>)]) -> String {
    let mut text = format!(
        "{:<16} {:>7} {:>7} {:>8} {:>8} {:>8} {:>8}\n",
        "method", "epochs", "fixed", "rmse_m", "mae_m", "p50_m", "p90_m"
    );
    for (summary, (_, solved)) in summaries.iter().zip(solved) {
        let _ = write!(text, "{:<16} {:>7} {:>7}", summary.method, summary.epochs, summary.fixed);
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
