//! `baliza calibrate antenna-delay`: the antenna delay of every node, from ranges over known distances.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use analysis::survey::antenna_delay::{Calibration, Delay, KnownRange, calibrate};
use anyhow::Result;
use baliza_report::MarkdownTable;
use recording::spelled;
use recording::{Coordinates, Table, Truths, UserError, read_anchors};

use crate::cli::folder::FolderFiles;
use crate::cli::numbers::finite;
use crate::cli::{note, print, print_json};

/// The antenna delay of every node, from ranges over known distances
///
/// From recordings of two boards at a known distance, or of more boards, each of which was the tag once. A range is too
/// long by the delays of both nodes: two boards give the sum of their delays, three or more give each, by least squares
/// over all pairs (Decawave, APS014). Where only sums can be observed, as with one tag and its anchors, they are shared
/// among both sides, and the table says so. Write the results as antenna_delay_ticks into the nodes' records.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Recordings: folders with ranges.csv and, without --distance-m, with anchors.csv and truth.csv
    #[arg(value_name = "FOLDER", required = true)]
    folders: Vec<PathBuf>,
    /// The distance of all pairs, metres, 0.1 to 1000, between antennas
    #[arg(long, value_name = "M", value_parser = distance, conflicts_with = "places")]
    distance_m: Option<f64>,
    /// Where all boards are: CSV with anchor,x_m,y_m,z_m, with a row for each tag too; instead of anchors.csv and
    /// truth.csv
    #[arg(long, value_name = "FILE")]
    places: Option<PathBuf>,
    /// The tags of the folders, in their order, where ranges.csv has no column tag
    #[arg(long = "tag", value_name = "NAME")]
    tags: Vec<String>,
    /// Nodes whose delay is right already
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    known: Vec<String>,
    /// The antenna delay with which all boards ranged, ticks in each direction
    #[arg(long, value_name = "TICKS", default_value_t = 16_436)]
    delay_ticks: u16,
    /// Print JSON: results has an object a node, with node, antenna_delay_ticks, correction_ticks, sigma_ticks (null
    /// where only sums can be observed), pairs, ranges
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  baliza calibrate antenna-delay run --distance-m 5
  baliza calibrate antenna-delay a-is-tag b-is-tag --tag 0x0101 --tag 0x0102 --distance-m 5
  baliza calibrate antenna-delay a-is-tag b-is-tag --places boards.csv --json";

fn distance(text: &str) -> Result<f64, String> {
    match finite(text)? {
        metres if (0.1..=1000.0).contains(&metres) => Ok(metres),
        _ => Err("it must be from 0.1 to 1000".to_owned()),
    }
}

/// The printed result of a node.
#[derive(Debug, serde::Serialize)]
struct Row<'a> {
    node: &'a str,
    antenna_delay_ticks: u16,
    correction_ticks: f64,
    sigma_ticks: Option<f64>,
    pairs: usize,
    ranges: usize,
}

/// Runs `baliza calibrate antenna-delay`.
///
/// # Errors
/// Flags or a file are wrong, or a delay does not fit into a record.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut ranges = Vec::new();
    let of_flag = arguments.places.as_deref().map(places).transpose()?;
    for (index, folder) in arguments.folders.iter().enumerate() {
        let tag = arguments.tags.get(index).map(String::as_str);
        ranges.extend(arguments.read(folder, tag, of_flag.as_ref())?);
    }
    let known: Vec<String> = arguments.known.iter().map(|name| spelled(name).into_owned()).collect();
    let has = |name: &&String| ranges.iter().any(|range| range.nodes.contains(name));
    if let Some(unknown) = known.iter().find(|name| !has(name)) {
        return Err(UserError::flag("--known", format!("there is no range of {unknown}")).into());
    }
    let found = calibrate(&ranges, &known);
    let rows = found.delays.iter().map(|delay| arguments.row(delay)).collect::<Result<Vec<_>, _>>()?;
    if arguments.json {
        return print_json(&rows);
    }
    print(table(&rows).as_bytes())?;
    note(&pairs(&found));
    if rows.iter().any(|row| row.sigma_ticks.is_none()) {
        note(
            "only the sums of delays can be observed where no uncertainty is given: they are shared among both sides, and \
             ranges between them become right. For each delay, let every board be the tag once, or name one that is right \
             (--known)\n",
        );
    }
    Ok(())
}

impl Arguments {
    /// The ranges of a recording, with the true distances.
    fn read(
        &self,
        folder: &Path,
        named: Option<&str>,
        of_flag: Option<&HashMap<String, Coordinates>>,
    ) -> Result<Vec<KnownRange>, UserError> {
        let files = FolderFiles::open(Some(folder))?;
        let file = files.file(&None, "ranges.csv")?;
        let from_folder = self.distance_m.is_none() && of_flag.is_none();
        let of_folder = from_folder.then(|| places(&files.file(&None, "anchors.csv")?)).transpose()?;
        let truths = from_folder.then(|| Truths::read(&files.file(&None, "truth.csv")?, true)).transpose()?;
        let known = of_flag.or(of_folder.as_ref());

        let mut table = Table::open(&file)?;
        let [epoch, anchor, range] = ["epoch", "anchor", "range_m"].map(|name| table.column(name));
        let (epoch, anchor, range) = (epoch?, anchor?, range?);
        let (time, tag) = (table.optional("t_s"), table.optional("tag"));
        let mut found = Vec::new();
        while let Some(row) = table.next_row()? {
            let (name, anchor_name) = (row.text(tag), row.some_text(anchor)?);
            let tag_name = if name.is_empty() { named } else { Some(name) };
            let Some(tag_name) = tag_name else {
                let what = format!("{} has no column tag: name the tag of each folder", file.display());
                return Err(UserError::flag("--tag", what));
            };
            let nodes = [spelled(tag_name).into_owned(), spelled(anchor_name).into_owned()];
            if nodes[0] == nodes[1] {
                return Err(row.wrong(anchor, &format!("{anchor_name} is the tag itself")));
            }
            let place = |node: &String| known.and_then(|known| known.get(node)).copied();
            let truth = truths.as_ref().map(|truths| truths.of(Some(tag_name))).transpose()?.flatten();
            let distance_m = match (self.distance_m, truth) {
                (Some(distance_m), _) => distance_m,
                (None, Some(truth)) => {
                    let at = truth.of_epoch(row.some_text(epoch)?, row.number(time)?, 0.0);
                    let Some(metres) = at.zip(place(&nodes[1])).and_then(|(tag, anchor)| between(tag, anchor)) else {
                        continue;
                    };
                    metres
                }
                (None, None) => {
                    let both = place(&nodes[0]).zip(place(&nodes[1]));
                    let metres = both.and_then(|(tag, anchor)| between(tag, anchor));
                    metres
                        .ok_or_else(|| row.wrong(anchor, &format!("{anchor_name} or {tag_name} has no known place")))?
                }
            };
            found.push(KnownRange { nodes, distance_m, range_m: row.some_number(range)? });
        }
        match found.is_empty() {
            true => Err(UserError::file(&file, "no range over a known distance")),
            false => Ok(found),
        }
    }

    fn row<'a>(&self, delay: &'a Delay) -> Result<Row<'a>, UserError> {
        let ticks = f64::from(self.delay_ticks) + delay.correction_ticks;
        if !(0.0..=f64::from(u16::MAX)).contains(&ticks.round()) {
            let what = format!("{} would have {ticks:.0} ticks: is the distance right?", delay.node);
            return Err(UserError::flag("--distance-m", what));
        }
        Ok(Row {
            node: &delay.node,
            antenna_delay_ticks: ticks.round() as u16,
            correction_ticks: delay.correction_ticks,
            sigma_ticks: delay.sigma_ticks,
            pairs: delay.pairs,
            ranges: delay.ranges,
        })
    }
}

/// The places of nodes by their names.
fn places(file: &Path) -> Result<HashMap<String, Coordinates>, UserError> {
    let anchors = read_anchors(file)?;
    if let Some(flat) = anchors.iter().find(|anchor| anchor.place.z_m.is_none()) {
        return Err(UserError::file(file, format!("{} has no z_m", flat.name)));
    }
    Ok(anchors.into_iter().map(|anchor| (spelled(&anchor.name).into_owned(), anchor.place)).collect())
}

/// The distance in space, metres; `None` without heights.
fn between(one: Coordinates, other: Coordinates) -> Option<f64> {
    let up_m = one.z_m? - other.z_m?;
    Some((one.x_m - other.x_m).hypot(one.y_m - other.y_m).hypot(up_m))
}

fn table(rows: &[Row]) -> String {
    let titles = ["node", "antenna_delay_ticks:", "correction, ticks:", "pairs:", "ranges:"];
    let mut table = MarkdownTable::new(titles);
    for Row { node, antenna_delay_ticks, correction_ticks, sigma_ticks, pairs, ranges } in rows {
        let correction = match sigma_ticks {
            Some(sigma_ticks) => format!("{correction_ticks:+.1} ± {sigma_ticks:.1}"),
            None => format!("{correction_ticks:+.1}, in sums only"),
        };
        table.row(format_args!("{node} | {antenna_delay_ticks} | {correction} | {pairs} | {ranges}"));
    }
    table.into_columns()
}

/// The pairs, with what the delays leave of their errors.
fn pairs(found: &Calibration) -> String {
    let mut table = MarkdownTable::new(["pair", "ranges:", "too long by, m:", "after calibration, m:"]);
    for pair in &found.pairs {
        let [one, other] = &pair.nodes;
        table.row(format_args!(
            "{one} to {other} | {} | {:.3} ± {:.3} | {:.3}",
            pair.ranges, pair.error_m, pair.sigma_m, pair.residual_m
        ));
    }
    format!("\n{}", table.into_columns())
}
