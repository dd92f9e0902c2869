//! `baliza ble rooms --rssi`: the rooms of a walk.

use std::path::Path;

use analysis::survey::rooms::{Interval, MOST_WINDOWS, Method, Names, Survey, Trained, follow};
use anyhow::Result;
use positioning_core::ble::rooms::RoomEstimate;
use recording::UserError;
use recording::beacons::{Sample, in_order, read_captures, read_stays};

use super::{Arguments, model_of, read_model};
use crate::cli::{print, print_json};

/// A row of the walk.
#[derive(serde::Serialize)]
struct Row {
    t_s: f64,
    windows: usize,
    classified: usize,
    room: Option<String>,
    share: Option<f64>,
    answer: String,
    between: Vec<String>,
}

/// The walk of a tag.
#[derive(serde::Serialize)]
struct Walk {
    #[serde(skip_serializing_if = "Option::is_none")]
    tag: Option<String>,
    method: &'static str,
    window_s: f64,
    every_s: f64,
    intervals: Vec<Row>,
}

/// Prints the rooms of a walk.
pub(super) fn run(arguments: &Arguments, rssi: &Path) -> Result<()> {
    let (method, trained, names) = match (&arguments.model, &arguments.fingerprints) {
        (Some(file), _) => read_model(file)?,
        (None, Some(file)) => learn(arguments, file)?,
        (None, None) => return Err(UserError::flag("--fingerprints", "a survey or --model is needed").into()),
    };
    let mut walks = Vec::new();
    for tag in read_captures(rssi, None)? {
        let captures = in_order(&tag.captures).into_iter().filter_map(|index| tag.captures.get(index));
        let samples: Vec<Sample> = captures.flat_map(|capture| capture.samples.iter().cloned()).collect();
        refuse_times(rssi, &samples, arguments.window_s)?;
        let intervals = follow(&trained, &names.beacons, &samples, arguments.window_s, arguments.every_s)?;
        let intervals = intervals.iter().map(|interval| row(interval, &names)).collect();
        let (window_s, every_s) = (arguments.window_s, arguments.every_s);
        walks.push(Walk { tag: tag.tag, method: method.as_str(), window_s, every_s, intervals });
    }
    if arguments.json { print_json(&walks) } else { print(&csv(&walks)?) }
}

/// The selected classifier, trained on all fingerprints.
fn learn(arguments: &Arguments, file: &Path) -> Result<(Method, Trained, Names)> {
    let method = Method::from(arguments.method);
    let survey = Survey::of_fingerprints(file, &read_stays(file)?, arguments.window_s)?;
    arguments.write(method, &survey)?;
    let (trained, names) = model_of(method, &survey)?;
    // The numbers of the model's rooms are those of its names.
    let rooms = (0..names.rooms.len()).collect();
    Ok((method, Trained { rooms, ..trained }, names))
}

/// Refuses a walk whose times do not make windows.
fn refuse_times(file: &Path, samples: &[Sample], window_s: f64) -> Result<(), UserError> {
    let times = || samples.iter().map(|sample| sample.t_s);
    let lasts_s = times().fold(f64::NEG_INFINITY, f64::max) - times().fold(f64::INFINITY, f64::min);
    let what = match lasts_s / window_s {
        windows if windows < 1.0 => format!("it lasts less than a window of {window_s} s: has it the column t_s?"),
        windows if windows > MOST_WINDOWS => {
            format!("it lasts for more than {MOST_WINDOWS} windows of {window_s} s: are the times seconds?")
        }
        _ => return Ok(()),
    };
    Err(UserError::file(file, what))
}

fn row(interval: &Interval, names: &Names) -> Row {
    let name = |room: usize| names.rooms.get(room).cloned().unwrap_or_default();
    let (answer, between) = match interval.answer {
        RoomEstimate::Room(room) => (name(room.into()), Vec::new()),
        RoomEstimate::Between(one, other) => ("between".to_owned(), vec![name(one.into()), name(other.into())]),
        RoomEstimate::Unknown => ("unknown".to_owned(), Vec::new()),
    };
    Row {
        t_s: interval.t_s,
        windows: interval.windows,
        classified: interval.classified,
        room: interval.room.map(|(room, _)| name(room)),
        share: interval.room.map(|(_, count)| count as f64 / interval.classified as f64),
        answer,
        between,
    }
}

fn csv(walks: &[Walk]) -> Result<Vec<u8>> {
    let with_tags = walks.iter().any(|walk| walk.tag.is_some());
    let mut writer = csv::Writer::from_writer(Vec::new());
    let header = ["t_s", "windows", "classified", "room", "share", "answer", "between"];
    writer.write_record(header.into_iter().chain(with_tags.then_some("tag")))?;
    for walk in walks {
        for row in &walk.intervals {
            let share = row.share.map_or_else(String::new, |share| format!("{share:.3}"));
            let room = row.room.clone().unwrap_or_default();
            let numbers = [row.windows, row.classified].map(|count| count.to_string());
            let [windows, classified] = numbers;
            let fields = [
                format!("{:.3}", row.t_s),
                windows,
                classified,
                room,
                share,
                row.answer.clone(),
                row.between.join(" "),
            ];
            let tag = with_tags.then(|| walk.tag.clone().unwrap_or_default());
            writer.write_record(fields.into_iter().chain(tag))?;
        }
    }
    writer.into_inner().map_err(|error| anyhow::Error::from(error.into_error()))
}
