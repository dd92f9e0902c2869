//! `baliza classify-rooms`: finds the room of each position.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::PathBuf;

use analysis::locate::advice;
use analysis::survey::presence::{Found, Room, follow, read_outlines, room_of, settling_s};
use anyhow::Result;
use node_link::provision::SiteNames;
use positioning_core::ble::rooms::RoomEstimate;
use recording::Truths;
use recording::output;
use recording::positions::{self, PositionRow};

use super::site_names::SiteNamesArgs;
use super::{note, print, print_json, write};

/// Find the room of each position, by the rooms' outlines
///
/// A position near a wall is in both rooms, by its standard deviations. The answer is that of a tag for successive
/// positions: a room, `between` two, or `unknown`. It does not change to and fro while a tag stays in a doorway; so it
/// follows the most probable room after a while (--settle-s).
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  baliza classify-rooms --positions positions.csv --outlines rooms.csv --truth truth.csv"
)]
pub struct Arguments {
    /// Positions as solve, track or ble write them: CSV with epoch,t_s,method,x_m,y_m,sigma_x_m,sigma_y_m and, where
    /// known, tag
    #[arg(long, value_name = "FILE")]
    positions: PathBuf,
    /// The corners of each room, in their order: CSV with room,x_m,y_m
    #[arg(long, value_name = "FILE")]
    outlines: PathBuf,
    /// Where the tag truly was: CSV with epoch,t_s,x_m,y_m; gives how many are right
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// How long the answer takes to follow a tag that certainly is in another room, seconds, 0 to 60 [default: what a
    /// walk over four standard deviations takes, from 1 s for positions by UWB to 4.6 s by beacons]
    #[arg(long, value_name = "S", value_parser = settling)]
    settle_s: Option<f64>,
    #[command(flatten)]
    names: SiteNamesArgs,
    /// Write the rooms here and not to standard output: CSV with epoch,t_s,method,room,probability,answer,between
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print JSON and no rows: results has an object a method and tag, with positions, outside, in_room, between,
    /// unknown, changes, settle_s, and with truth judged, accuracy (of the most probable room), wrong (answers of
    /// another room)
    #[arg(long)]
    json: bool,
}

/// The printed summary of a method.
#[derive(Default, serde::Serialize)]
struct Summary<'a> {
    method: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    tag: Option<&'a str>,
    positions: usize,
    outside: usize,
    in_room: usize,
    between: usize,
    unknown: usize,
    changes: usize,
    settle_s: f64,
    judged: Option<usize>,
    accuracy: Option<f64>,
    wrong: Option<usize>,
}

fn settling(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=60.0).contains(&seconds) => Ok(seconds),
        Ok(_) | Err(_) => Err(format!("{text:?} is not a number of seconds, 0 to 60")),
    }
}

/// Runs `baliza classify-rooms`.
///
/// # Errors
/// A file is wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(file) = &arguments.out {
        output::check("--out", file)?;
    }
    let names = arguments.names.read(None)?;
    let rooms = read_outlines(&arguments.outlines)?;
    let rows = positions::read(&arguments.positions)?;
    super::warn(advice::of_outlines(&rooms).into_iter().chain(advice::of_positions(&rows)));
    let truths = arguments.truth.as_deref().map(|file| Truths::read(file, false)).transpose()?;
    // The room memory of each tag is its own.
    let mut walks: Vec<(&str, Option<&str>)> = Vec::new();
    let mut known = HashSet::new();
    for row in &rows {
        let walk = (row.method.as_str(), row.tag.as_deref());
        if known.insert(walk) {
            walks.push(walk);
        }
    }
    let with_tags = walks.iter().any(|(_, tag)| tag.is_some());
    let (mut writer, mut summaries) = (csv::Writer::from_writer(Vec::new()), Vec::new());
    let header = ["epoch", "t_s", "method", "room", "probability", "answer", "between"];
    writer.write_record(header.into_iter().chain(with_tags.then_some("tag")))?;
    for (method, tag) in walks {
        let of_it: Vec<PositionRow> =
            rows.iter().filter(|row| row.method == method && row.tag.as_deref() == tag).cloned().collect();
        let settle_s = arguments.settle_s.unwrap_or_else(|| settling_s(&of_it));
        let found = follow(&rooms, &of_it, settle_s);
        for (row, found) in of_it.iter().zip(&found) {
            let tag = with_tags.then(|| tag.unwrap_or_default().to_owned());
            writer.write_record(fields(&rooms, row, found).into_iter().chain(tag))?;
        }
        let truth = truths.as_ref().map(|truths| truths.of(tag)).transpose()?.flatten();
        let room_then = |row: &PositionRow| {
            let at = truth?.of_epoch(&row.epoch, row.t_s, 0.0)?;
            room_of(&rooms, [at.x_m, at.y_m])
        };
        let judged = truths.is_some().then(|| of_it.iter().map(room_then).collect());
        summaries.push(Summary { settle_s, ..summary(method, tag, &found, judged) });
    }
    let csv = writer.into_inner().map_err(|error| anyhow::Error::from(error.into_error()))?;
    match &arguments.out {
        Some(file) => write(file, &csv)?,
        None if arguments.json => {}
        None => print(&csv)?,
    }
    if arguments.json {
        return print_json(&summaries);
    }
    note(&table(&summaries, &names));
    Ok(())
}

fn fields(rooms: &[Room], row: &PositionRow, found: &Found) -> [String; 7] {
    let name = |room: usize| rooms.get(room).map_or_else(String::new, |room| room.name.clone());
    let (answer, between) = match found.answer {
        RoomEstimate::Room(room) => (name(usize::from(room)), String::new()),
        RoomEstimate::Between(one, other) => {
            ("between".to_owned(), format!("{} {}", name(usize::from(one)), name(usize::from(other))))
        }
        RoomEstimate::Unknown => ("unknown".to_owned(), String::new()),
    };
    let (room, probability) =
        found.likeliest.map_or_else(Default::default, |(room, p)| (name(room), format!("{p:.3}")));
    let time = row.t_s.map_or_else(String::new, |t_s| t_s.to_string());
    [row.epoch.clone(), time, row.method.clone(), room, probability, answer, between]
}

fn summary<'a>(
    method: &'a str,
    tag: Option<&'a str>,
    found: &[Found],
    truths: Option<Vec<Option<usize>>>,
) -> Summary<'a> {
    let mut summary = Summary { method, tag, positions: found.len(), ..Summary::default() };
    let mut before = None;
    for found in found {
        summary.outside += usize::from(found.likeliest.is_none());
        match found.answer {
            RoomEstimate::Room(room) => {
                summary.in_room += 1;
                summary.changes += usize::from(before.is_some_and(|before| before != room));
                before = Some(room);
            }
            RoomEstimate::Between(..) => summary.between += 1,
            RoomEstimate::Unknown => summary.unknown += 1,
        }
    }
    if let Some(truths) = truths {
        let judged: Vec<_> = found.iter().zip(truths).filter_map(|(found, truth)| Some((found, truth?))).collect();
        let right =
            judged.iter().filter(|(found, truth)| found.likeliest.is_some_and(|(room, _)| room == *truth)).count();
        let wrong = judged
            .iter()
            .filter(|(found, truth)| matches!(found.answer, RoomEstimate::Room(room) if usize::from(room) != *truth));
        summary.wrong = Some(wrong.count());
        summary.accuracy = (!judged.is_empty()).then(|| right as f64 / judged.len() as f64);
        summary.judged = Some(judged.len());
    }
    summary
}

fn table(summaries: &[Summary], names: &SiteNames) -> String {
    let mut text = String::new();
    for summary in summaries {
        let tag = summary.tag.map_or_else(String::new, |tag| format!(", tag {}", names.node(tag)));
        let _ = write!(
            text,
            "{}{tag}: {} positions, {} outside of all rooms; answers: {} in a room, {} between, {} unknown, {} changes of room, each after {:.1} s",
            summary.method,
            summary.positions,
            summary.outside,
            summary.in_room,
            summary.between,
            summary.unknown,
            summary.changes,
            summary.settle_s
        );
        if let (Some(accuracy), Some(wrong)) = (summary.accuracy, summary.wrong) {
            let _ = write!(
                text,
                "; the most probable room is right in {:.1} %, {wrong} answers are wrong",
                100.0 * accuracy
            );
        }
        text.push('\n');
    }
    text
}
