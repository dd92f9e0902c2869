//! `baliza check`: questions a recording before its positions are believed.

use std::fmt::Write as _;
use std::path::PathBuf;

use analysis::Setup;
use analysis::check::{Finding, Whole, of_rows, of_whole};
use anyhow::Result;
use pictures::{Dot, Errors, Picture, PictureBuilder};
use recording::folder::RecordingSettings;
use recording::{Files, Height, Recording, Space, UserError, drop_repeats};

use super::PictureFile;
use super::folder::FolderFiles;
use super::numbers::finite;
use super::report::flat;
use super::site_names::SiteNamesArgs;

/// Question a recording: are its units, times, anchors and heights right?
///
/// The ranges of the whole recording are fitted together, and what does not fit is named with its likely cause and a
/// remedy: anchors that are exchanged or elsewhere, ranges in feet or nanoseconds, a clock that goes back. `solve` and
/// `track` ask the same. The findings go to standard output, and as warnings to standard error.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  baliza check walk\n  baliza check walk --plot walk.png\n  baliza check walk --strict --json"
)]
pub struct Arguments {
    /// A folder with anchors.csv, ranges.csv and, where there is one, recording.toml, which says --dims and --height-m
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// The coordinates that the ranges have to give, 2 or 3 [default: as recording.toml says, else 3]
    #[arg(long, value_name = "2|3", value_parser = clap::value_parser!(u8).range(2..=3))]
    dims: Option<u8>,
    /// The tag's height, metres (--dims 2)
    #[arg(long, value_name = "Z", allow_negative_numbers = true, value_parser = finite)]
    height_m: Option<f64>,
    /// Exit with 1 where there is a finding
    #[arg(long)]
    strict: bool,
    /// Print JSON: results has an object a tag with epochs, residual_m and findings (code, message, subjects, evidence)
    #[arg(long)]
    json: bool,
    /// Draw the anchors, where the ranges prefer them, the positions, and the residuals of the ranges, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    names: SiteNamesArgs,
}

/// What is said of a tag's recording.
#[derive(serde::Serialize)]
struct Row<'a> {
    tag: Option<&'a str>,
    epochs: usize,
    residual_m: Option<f64>,
    findings: &'a [Finding],
}

/// Runs `baliza check`.
///
/// # Errors
/// A flag or a file is wrong, an output cannot be written, or `--strict` is given and something was found.
pub fn run(arguments: &Arguments) -> Result<()> {
    let picture = PictureFile::plot(arguments.plot.as_deref())?;
    let folder = FolderFiles::open(Some(&arguments.folder))?;
    let settings = folder.settings();
    let dims = arguments.dims.or(settings.dims);
    if arguments.height_m.is_some() && dims != Some(2) {
        return Err(UserError::flag("--height-m", "only with --dims 2").into());
    }
    let space = RecordingSettings { dims, height_m: arguments.height_m.or(settings.height_m), ..settings }.space();
    let setup = Setup::of(space);
    let (mode, measured) = folder.measured()?;
    let mut recordings = Recording::read(&Files {
        anchors: &folder.file(&None, "anchors.csv")?,
        measured: &measured,
        mode,
        truth: None,
        anchor_heights: space != Space::Plane(Height::Unknown),
        truth_heights: false,
    })?;
    let asked: Vec<(Vec<Finding>, Whole)> = recordings.iter_mut().map(|recording| ask(recording, &setup)).collect();
    if let Some(picture) = picture {
        picture.write_and_note(&drawn(arguments, &recordings, &asked)?.draw())?;
    }
    let rows: Vec<Row> = recordings
        .iter()
        .zip(&asked)
        .map(|(recording, (findings, whole))| Row {
            tag: recording.tag.as_deref(),
            epochs: recording.epochs.len(),
            residual_m: whole.residual_m,
            findings,
        })
        .collect();
    let names = arguments.names.read(Some(&arguments.folder))?;
    let mut text = String::new();
    for row in &rows {
        let of = row.tag.map_or_else(String::new, |tag| format!("tag {}: ", names.node(tag)));
        super::warn(row.findings.iter().map(|finding| format!("{of}{}", finding.message)));
        let residual = row.residual_m.map_or_else(
            || "too few ranges for their residuals".to_owned(),
            |residual_m| format!("residuals {residual_m:.3} m"),
        );
        let _ = writeln!(text, "{of}{} epochs, {residual}, {} findings", row.epochs, row.findings.len());
        for Finding { code, message, .. } in row.findings {
            let _ = writeln!(text, "{of}{}: {message}", code.as_str());
        }
    }
    if arguments.json {
        super::print_json(&rows)?;
    } else {
        super::print(text.as_bytes())?;
    }
    if arguments.strict { refuse(rows.iter().map(|row| row.findings.len()).sum()) } else { Ok(()) }
}

/// An error where something was found, for `--strict`.
///
/// # Errors
/// Something was found.
pub fn refuse(found: usize) -> Result<()> {
    anyhow::ensure!(found == 0, "--strict: {found} warnings about the recording");
    Ok(())
}

fn ask(recording: &mut Recording, setup: &Setup) -> (Vec<Finding>, Whole) {
    let repeats = drop_repeats(&mut recording.epochs);
    let mut findings = of_rows(recording, setup.space, repeats);
    let whole = of_whole(recording, setup);
    findings.extend(whole.findings.iter().cloned());
    (findings, whole)
}

/// The anchors, the lines to where the ranges prefer them, the positions, and the distribution of the residuals.
fn drawn(
    arguments: &Arguments,
    recordings: &[Recording],
    asked: &[(Vec<Finding>, Whole)],
) -> Result<Picture, UserError> {
    let names = arguments.names.read(Some(&arguments.folder))?;
    let anchors = recordings.first().map_or(&[][..], |recording| &recording.anchors);
    let place = |anchor: usize| anchors.get(anchor).map_or([0.0; 2], |anchor| flat(&anchor.place));
    let preferred = asked.iter().flat_map(|(_, whole)| &whole.preferred_m);
    let mut builder = PictureBuilder::new(Picture {
        source: arguments.folder.display().to_string(),
        anchors: anchors.iter().map(|anchor| (names.node(&anchor.name).to_owned(), flat(&anchor.place))).collect(),
        preferred_m: preferred.map(|(anchor, at_m)| [place(*anchor), *at_m]).collect(),
        errors: Errors::Residuals,
        ..Picture::default()
    });
    for (recording, (_, whole)) in recordings.iter().zip(asked) {
        let tag = recording.tag.as_deref().map_or("", |tag| names.node(tag));
        for at_m in &whole.places_m {
            builder.position("fit", tag, Some(Dot { at_m: *at_m, ..Dot::default() }), None);
        }
        whole.residuals_m.iter().for_each(|residual_m| builder.position("fit", tag, None, Some(*residual_m)));
    }
    Ok(builder.finish())
}
