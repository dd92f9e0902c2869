//! The report of a command that computes positions: a file of positions, a picture, and a summary.

use std::fmt::Write as _;
use std::io::IsTerminal;
use std::path::PathBuf;

use analysis::check::Finding;
use analysis::locate::residuals::AnchorResiduals;
use anyhow::Result;
use baliza_report::MarkdownTable;
use node_link::provision::SiteNames;
use pictures::{Dot, Errors, Picture, PictureBuilder};
use recording::output;
use recording::positions::{Format, Rows};
use recording::{Coordinates, Epochs, Height, Position, Solved, UserError};

use super::PictureFile;
use super::floor_plan::FloorPlan;
use super::residuals::Row;
use super::summary::{Of, Summary, table};

/// The destinations of a report.
#[derive(clap::Args)]
pub struct OutputArgs {
    /// Write the positions here and not to standard output (-)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The format of the positions [default: by the ending of --out, else csv]
    #[arg(long, value_name = "FORMAT")]
    format: Option<Format>,
    /// Draw the positions, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON and no positions: results has an object a method and tag (null: all of them), with epochs, fixed,
    /// rmse_m, mae_m, p50_m, p90_m (null without truth); with truth also the same figures of x and y (_xy_m), of z
    /// (_z_m), inside_1_sigma (0.39 is right), nees (2 is right; nees_z: 1) and time_offset_s
    #[arg(long)]
    json: bool,
}

/// At most this number of positions is printed on a terminal.
const PREVIEW: usize = 15;

/// Outputs that can be written.
pub struct Output<'a> {
    arguments: &'a OutputArgs,
    picture: Option<PictureFile<'a>>,
}

impl OutputArgs {
    /// Whether CSV, or else JSON lines, is all that is written, and goes to standard output.
    pub fn is_csv_of_stdout(&self) -> Option<bool> {
        let is_stdout = self.out.as_ref().is_none_or(|file| file.as_os_str() == output::STANDARD);
        match self.format.unwrap_or(Format::Csv) {
            Format::Csv | Format::Jsonl if !is_stdout || self.json || self.plot.is_some() => None,
            Format::Csv => Some(true),
            Format::Jsonl => Some(false),
            Format::Parquet => None,
        }
    }

    /// Refuses files that cannot be written, before any work is done for them.
    ///
    /// # Errors
    /// A file cannot be written, its picture format is not supported, or Parquet has no
    /// file, or is not part of this program.
    pub fn check(&self) -> Result<Output<'_>, UserError> {
        if let Some(file) = &self.out {
            output::check("--out", file)?;
        }
        let to_file = self.out.as_ref().is_some_and(|file| file.as_os_str() != output::STANDARD);
        if self.format == Some(Format::Parquet) && !to_file {
            return Err(UserError::flag("--format", "parquet is binary: say with --out to which file it goes"));
        }
        let by_name = || self.out.as_deref().and_then(Format::of);
        if self.format.or_else(by_name).is_some_and(|format| !format.is_available()) {
            return Err(super::without(if self.format.is_some() { "--format" } else { "--out" }, "parquet"));
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

/// What a picture shows beside the positions.
#[derive(Clone, Debug, Default)]
pub struct Site {
    /// The file that the positions come from.
    pub source: String,
    /// The names that the picture and the tables on a terminal show.
    pub names: SiteNames,
    /// Names and positions of the anchors, metres.
    pub anchors: Vec<(String, [f64; 2])>,
    /// Names and positions of the beacons, metres.
    pub beacons: Vec<(String, [f64; 2])>,
    /// Walls, and the image of the plan.
    pub floor_plan: FloorPlan,
    /// Whether the epochs are dwells at separate points.
    pub are_dwells: bool,
}

/// The content of a report.
pub struct Report<'a> {
    /// The names of the methods.
    pub methods: Vec<String>,
    /// What the picture shows beside the positions.
    pub site: Site,
    /// Whether the true positions are known.
    pub with_errors: bool,
    /// The tags' height, where it is given.
    pub height: Height,
    /// For positions by beacons: the number of neighbours of each method, where the method has neighbours.
    pub neighbours: Option<Vec<Option<usize>>>,
    /// The positions, one a tag.
    pub tags: Vec<TagReport<'a>>,
}

/// The positions of a tag.
pub struct TagReport<'a> {
    /// The tag's name, where it is known.
    pub tag: Option<&'a str>,
    /// The epochs.
    pub epochs: &'a Epochs,
    /// By method: the position of each epoch.
    pub solved: &'a [Vec<Solved>],
    /// The seconds that were added to the times of the truth, where it was joined by time.
    pub time_offset_s: Option<f64>,
    /// The residuals by method and anchor, where they are asked for.
    pub residuals: Option<Vec<Vec<AnchorResiduals>>>,
    /// What is odd about the recording, where it was asked.
    pub findings: Option<&'a [Finding]>,
}

impl Report<'_> {
    /// Writes the positions and the picture, and prints the summary.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, output: &Output) -> Result<()> {
        let OutputArgs { out, format, plot, json } = output.arguments;
        // The picture is drawn before any file is written, so that an error in drawing leaves no file.
        let picture = match output.picture {
            Some(PictureFile { file, format }) => Some((file, format.encode(&self.picture().draw())?)),
            None => None,
        };
        if out.is_some() || !json {
            let by_name = || out.as_deref().and_then(Format::of);
            let format_of_file = format.or_else(by_name).unwrap_or(Format::Csv);
            match out {
                None if format.is_none() && std::io::stdout().is_terminal() => {
                    super::print(self.preview().as_bytes())?;
                }
                Some(_) | None => {
                    let maker = [super::VERSION, &super::json::arguments()];
                    super::write_with(out.as_deref(), |file| {
                        format_of_file.write(self.rows(), self.with_errors, maker, file)
                    })?;
                }
            }
        }
        if let Some((file, bytes)) = &picture {
            super::write(file, bytes)?;
        }
        let summaries = self.summaries();
        if *json {
            return super::print_json(&summaries);
        }
        let mut said = table(&summaries, &self.site.names);
        for (what, file) in [("positions", out), ("picture", plot)] {
            if let Some(file) = file.as_deref().filter(|file| file.as_os_str() != output::STANDARD) {
                let _ = writeln!(said, "{what}: {}", file.display());
            }
        }
        super::note(&said);
        Ok(())
    }

    /// A few positions for reading, at equal intervals.
    fn preview(&self) -> String {
        let mut table = MarkdownTable::new(["t_s:", "tag", "method", "x_m:", "y_m:", "z_m:", "sigma_m:", "error_m:"]);
        let rows: usize = self.rows().map(|rows| rows.solved.len()).sum();
        let each = rows.div_ceil(PREVIEW).max(1);
        let all = self.rows().flat_map(|Rows { tag, method, epochs, solved, .. }| {
            epochs.iter().zip(solved).map(move |(epoch, solved)| (tag, method, epoch, solved))
        });
        let figure = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.2}"));
        for (tag, method, epoch, solved) in all.step_by(each) {
            let (time, tag) = (
                epoch.t_s.map_or_else(|| epoch.name.to_owned(), |t_s| format!("{t_s:.3}")),
                tag.map_or("", |tag| self.site.names.node(tag)),
            );
            let [x, y, z, sigma] = match &solved.outcome {
                Ok(Position { place, sigma, .. }) => {
                    let joint = (sigma.x_m.powi(2) + sigma.y_m.powi(2) + sigma.z_m.unwrap_or(0.0).powi(2)).sqrt();
                    [figure(Some(place.x_m)), figure(Some(place.y_m)), figure(place.z_m), figure(Some(joint))]
                }
                Err(reason) => ["-", "-", reason.as_str(), ""].map(str::to_owned),
            };
            table.row(format_args!(
                "{time} | {tag} | {method} | {x} | {y} | {z} | {sigma} | {}",
                figure(solved.error_m)
            ));
        }
        let rest = if each > 1 {
            format!("every {each}th of {rows} positions; --out FILE writes all\n\n")
        } else {
            "\n".to_owned()
        };
        table.into_columns() + &rest
    }

    /// The positions by method, and of each method by tag.
    fn rows(&self) -> impl Iterator<Item = Rows<'_>> + Clone {
        self.methods.iter().enumerate().flat_map(move |(at, method)| {
            self.tags.iter().filter_map(move |of| {
                let (epochs, solved) = (of.epochs, of.solved.get(at)?);
                Some(Rows { tag: of.tag, method, epochs, solved, height: self.height })
            })
        })
    }

    /// A summary a method: of each tag, and of all of them where there are several.
    fn summaries(&self) -> Vec<Summary<'_>> {
        let mut summaries = Vec::new();
        for (at, method) in self.methods.iter().enumerate() {
            let k = self.neighbours.as_ref().map(|neighbours| neighbours.get(at).copied().flatten());
            let parts: Vec<_> = self.tags.iter().filter_map(|of| Some((of, of.solved.get(at)?))).collect();
            for (of, solved) in &parts {
                let anchors = of.residuals.as_ref().and_then(|residuals| residuals.get(at));
                let anchors = anchors.map(|anchors| anchors.iter().map(Row::of).collect());
                let tag = of.tag.map(Of::Tag);
                let summary = Summary::of(method, tag, &[(of.epochs, solved.as_slice())], k);
                summaries.push(summary.with(of.time_offset_s, anchors, of.findings));
            }
            if parts.len() > 1 {
                let all: Vec<_> = parts.iter().map(|(of, solved)| (of.epochs, solved.as_slice())).collect();
                summaries.push(Summary::of(method, Some(Of::All), &all, k));
            }
        }
        summaries
    }

    fn picture(&self) -> Picture {
        let Site { source, names, anchors, beacons, floor_plan, are_dwells } = self.site.clone();
        let anchors = anchors.into_iter().map(|(key, at_m)| (names.node(&key).to_owned(), at_m)).collect();
        let name = |tag: Option<&str>| tag.map_or_else(String::new, |tag| names.node(tag).to_owned());
        let has_height = |place: &Coordinates| place.z_m.is_some();
        let mut found = self.rows().flat_map(|rows| rows.solved).filter_map(|solved| solved.outcome.as_ref().ok());
        let mut truths = self.tags.iter().flat_map(|of| of.epochs.iter()).filter_map(|epoch| epoch.truth);
        let errors =
            Errors::between(found.any(|position| has_height(&position.place)), truths.any(|truth| has_height(&truth)));
        let FloorPlan { walls_m, plan } = floor_plan;
        let picture = Picture { source, anchors, beacons, walls_m, plan, errors, ..Picture::default() };
        let mut builder = PictureBuilder::new(picture);
        for TagReport { tag, epochs, .. } in &self.tags {
            let name = name(*tag);
            for epoch in epochs.iter() {
                epoch.truth.iter().for_each(|truth| builder.truth(&name, flat(truth), are_dwells));
                // Each dwell may have a clock of its own.
                epoch.t_s.filter(|_| !are_dwells).into_iter().for_each(|t_s| builder.time(t_s));
            }
        }
        for Rows { tag, method, epochs, solved, .. } in self.rows() {
            let name = name(tag);
            for (epoch, solved) in epochs.iter().zip(solved) {
                let dot = solved.outcome.as_ref().ok().map(|position| Dot {
                    at_m: flat(&position.place),
                    truth_m: epoch.truth.as_ref().map(flat),
                    covariance_m2: Some(position.covariance_m2()),
                });
                builder.position(method, &name, dot, solved.error_m);
            }
        }
        builder.finish()
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
