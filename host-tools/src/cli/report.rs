//! The report of a command that computes positions: a file of positions, a picture, and a summary.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use host_tools::files::output;
use host_tools::files::positions;
use host_tools::locate::residuals::AnchorResiduals;
use host_tools::plot::{Dot, Picture, Track};
use host_tools::{Coordinates, Epoch, Solved, UserError};

use super::PictureFile;
use super::residuals::Row;
use super::summary::{ByBeacons, Summary, table};

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
    /// (null without truth); with truth also the same figures of x and y (_xy_m), of z (_z_m), inside_1_sigma (0.39 is
    /// right), nees (2 is right; nees_z: 1) and time_offset_s
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

impl Output<'_> {
    /// Whether JSON is printed and no table.
    pub fn is_json(&self) -> bool {
        self.arguments.json
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
    /// The seconds that were added to the times of the truth, where it was joined by time.
    pub time_offset_s: Option<f64>,
    /// The residuals by method and anchor, where they are asked for.
    pub residuals: Option<&'a [Vec<AnchorResiduals>]>,
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

    fn summaries(&self) -> Vec<Summary<'_>> {
        let mut summaries = Vec::new();
        for (at, (method, solved)) in self.solved.iter().enumerate() {
            let k = self.neighbours.as_ref().map(|neighbours| neighbours.get(at).copied().flatten());
            let by_beacons = k.map(|k| ByBeacons { k, points: solved.len() });
            let anchors = self.residuals.and_then(|residuals| residuals.get(at));
            let anchors = anchors.map(|anchors| anchors.iter().map(Row::of).collect());
            let summary = Summary::of(method, solved, self.epochs, by_beacons);
            summaries.push(summary.with(self.time_offset_s, anchors));
        }
        summaries
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

/// An error with the reason why there is no position at all, where there is such a reason.
///
/// # Errors
/// There is a reason.
pub fn some_position(nothing: Option<String>) -> Result<()> {
    nothing.map_or(Ok(()), |why| Err(anyhow::Error::msg(why)))
}

/// The horizontal coordinates of a position, metres.
pub fn flat(place: &Coordinates) -> [f64; 2] {
    [place.x_m, place.y_m]
}
