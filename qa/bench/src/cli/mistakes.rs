//! `baliza bench mistakes`: how often the check of a recording names what is wrong, and how often it is wrong itself.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use accuracy::mistakes::{DrawnRecording, Extent, Mistake, drawn};
use analysis::Setup;
use analysis::check::{Finding, FindingCode, of_rows, of_whole};
use anyhow::Result;
use baliza_report::MarkdownTable;
use recording::folder::RecordingSettings;
use recording::{Anchor, Coordinates, Diagnostics, Epochs, Measured, Recording};

/// The numbers of anchors that are drawn.
const ANCHORS: [usize; 3] = [4, 6, 8];
/// Epochs of a recording that is scored, and of one of the examples.
const EPOCHS: usize = 600;
const EPOCHS_OF_EXAMPLE: usize = 60;

/// Name twelve kinds of mistakes in drawn recordings, and none in those without a mistake
///
/// A mistake is named where a sentence has its word and all the anchors that it is about.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  baliza bench mistakes\n  baliza bench mistakes --recordings 2 --sound 20 --json\n  \
                        baliza bench mistakes --write examples/mistakes"
)]
pub struct Arguments {
    /// How many recordings to draw of each mistake and number of anchors
    #[arg(long, default_value_t = 20)]
    recordings: u64,
    /// How many recordings to draw without a mistake
    #[arg(long, default_value_t = 500)]
    sound: u64,
    /// Seed of the random numbers: equal seeds give equal figures
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only this mistake, or `none`
    #[arg(long, value_name = "NAME")]
    mistake: Option<String>,
    /// Print JSON: results has an object a mistake (`none`: without one, where named counts false alarms), and `all`
    #[arg(long)]
    json: bool,
    /// Write a small recording of each mistake into this folder, and do nothing else
    #[arg(long, value_name = "FOLDER")]
    write: Option<PathBuf>,
}

/// The figures of a mistake.
#[derive(serde::Serialize)]
struct Row {
    mistake: &'static str,
    drawn: u64,
    named: u64,
    named_share: f64,
    /// By number of anchors.
    #[serde(skip)]
    by_anchors: [u64; ANCHORS.len()],
    /// What was said instead.
    other: BTreeMap<&'static str, u64>,
}

/// Runs `baliza bench mistakes`.
///
/// # Errors
/// A file cannot be written, or the output cannot be printed.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(folder) = &arguments.write {
        return Mistake::ALL.into_iter().try_for_each(|mistake| {
            let extent = Extent { anchors: 6, epochs: EPOCHS_OF_EXAMPLE, is_plane: true, rests: false };
            write(&folder.join(mistake.as_str()), &drawn(Some(mistake), extent, arguments.seed))
        });
    }
    let is_asked = |name: &str| arguments.mistake.as_ref().is_none_or(|asked| asked == name);
    let asked = Mistake::ALL.into_iter().filter(|mistake| is_asked(mistake.as_str()));
    let mut rows: Vec<Row> =
        asked.map(|mistake| row(Some(mistake), ANCHORS.len() as u64 * arguments.recordings, arguments.seed)).collect();
    let count = |of: fn(&Row) -> u64| rows.iter().map(of).sum::<u64>();
    let all = Row::new("all", count(|row| row.drawn), count(|row| row.named));
    if is_asked("none") && arguments.sound > 0 {
        rows.push(row(None, arguments.sound, arguments.seed));
    }
    rows.push(all);
    if arguments.json { host_tools::cli::print_json(&rows) } else { host_tools::cli::print(table(&rows).as_bytes()) }
}

impl Row {
    fn new(mistake: &'static str, drawn: u64, named: u64) -> Self {
        let named_share = named as f64 / drawn.max(1) as f64;
        Self { mistake, drawn, named, named_share, by_anchors: [0; 3], other: BTreeMap::new() }
    }
}

/// Draws recordings, with 4, 6 and 8 anchors in turn, and counts those whose mistake is named. Without a mistake, it
/// counts those of which anything is said.
fn row(mistake: Option<Mistake>, count: u64, seed: u64) -> Row {
    let (mut named, mut by_anchors, mut other) = (0, [0; ANCHORS.len()], BTreeMap::new());
    for number in 0..count {
        let turn = (number % ANCHORS.len() as u64) as usize;
        let part = number / ANCHORS.len() as u64;
        let extent = Extent {
            anchors: ANCHORS[turn],
            epochs: EPOCHS,
            is_plane: part.is_multiple_of(2) || mistake == Some(Mistake::Height),
            rests: mistake.is_none() && part % 4 == 3,
        };
        let drawn = drawn(mistake, extent, seed.wrapping_mul(1_000_003).wrapping_add(number));
        let findings = findings(&drawn);
        let is_named =
            mistake.map_or(!findings.is_empty(), |mistake| findings.iter().any(|of| names(of, mistake, &drawn)));
        if is_named {
            named += 1;
            by_anchors[turn] += 1;
        }
        if is_named == mistake.is_none() {
            findings.iter().for_each(|finding| *other.entry(finding.code.as_str()).or_default() += 1);
        }
    }
    Row { by_anchors, other, ..Row::new(mistake.map_or("none", Mistake::as_str), count, named) }
}

fn names(finding: &Finding, mistake: Mistake, drawn: &DrawnRecording) -> bool {
    let is_about = |subject: &usize| finding.subjects.contains(&subject.to_string());
    finding.message.contains(mistake.word()) && drawn.subjects.iter().all(is_about)
}

/// What is said of a recording. That its geometry is poor is no mistake.
fn findings(drawn: &DrawnRecording) -> Vec<Finding> {
    let place = |[x_m, y_m, z_m]: [f64; 3]| Coordinates { x_m, y_m, z_m: Some(z_m) };
    let anchors = drawn.anchors_m.iter().enumerate();
    let anchors = anchors.map(|(name, at_m)| Anchor { name: name.to_string(), place: place(*at_m) }).collect();
    let mut epochs = Epochs::default();
    for (number, (t_s, ranges)) in drawn.epochs.iter().enumerate() {
        epochs.push(&number.to_string(), Some(*t_s), None);
        for &(anchor, range_m) in ranges {
            let diagnostics = Diagnostics::default();
            epochs.push_range(&Measured { anchor, range_m, t_s: Some(*t_s), line_of_sight: None, diagnostics });
        }
    }
    let recording = Recording { tag: None, anchors, epochs };
    let setup = Setup::of(settings(drawn).space());
    let mut findings = of_rows(&recording, setup.space, 0);
    findings.extend(of_whole(&recording, &setup).findings);
    findings.retain(|finding| finding.code != FindingCode::AmbiguousGeometry);
    findings
}

fn settings(drawn: &DrawnRecording) -> RecordingSettings {
    let dims = Some(if drawn.height_m.is_some() { 2 } else { 3 });
    RecordingSettings { dims, height_m: drawn.height_m, ..RecordingSettings::default() }
}

fn write(folder: &std::path::Path, drawn: &DrawnRecording) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut anchors = "anchor,x_m,y_m,z_m\n".to_owned();
    for (name, [x, y, z]) in drawn.anchors_m.iter().enumerate() {
        let _ = writeln!(anchors, "{name},{x:.3},{y:.3},{z:.3}");
    }
    let mut ranges = "epoch,t_s,anchor,range_m\n".to_owned();
    for (number, (t_s, of_epoch)) in drawn.epochs.iter().enumerate() {
        for (anchor, range_m) in of_epoch {
            let _ = writeln!(ranges, "{number},{t_s:.4},{anchor},{range_m:.3}");
        }
    }
    host_tools::cli::write(&folder.join("anchors.csv"), anchors.as_bytes())?;
    host_tools::cli::write(&folder.join("ranges.csv"), ranges.as_bytes())?;
    host_tools::cli::write(&folder.join("recording.toml"), settings(drawn).to_toml()?.as_bytes())
}

fn table(rows: &[Row]) -> String {
    let mut table = MarkdownTable::new(["mistake", "drawn:", "named:", "share:", "4, 6, 8 anchors:", "said instead"]);
    for Row { mistake, drawn, named, named_share, by_anchors: [four, six, eight], other } in rows {
        let other: Vec<String> = other.iter().map(|(code, count)| format!("{count} {code}")).collect();
        table.row(format_args!(
            "{} | {drawn} | {named} | {:.1} % | {four}, {six}, {eight} | {}",
            mistake,
            100.0 * named_share,
            other.join(", ")
        ));
    }
    table.into_columns()
}
