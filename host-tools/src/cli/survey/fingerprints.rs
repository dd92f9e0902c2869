//! `baliza survey fingerprints`.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Instant;

use crate::wizard::{Person, Typed, Visit, Wizard, each_advert};
use analysis::survey::campaign::{Dwell, FingerprintFile, SurveyPoint, parse_point, read_points};
use anyhow::Result;
use indicatif::ProgressBar;
use node_link::decode::Stream;
use recording::UserError;

use crate::cli::stream::{ByteInput, STOP, SourceArguments, catch_signals};
use crate::cli::{note, print_json, prompt};

/// Survey fingerprints: go from point to point with a tag, and record the RSSI values that it receives
///
/// The tag scans (its record has `scan`) and reports its sightings by probe or serial port. At each point the tool
/// records them for a while, with live counts. A dwell that would mislead (too few adverts, a beacon that falls silent,
/// RSSI values that drift or jump, a person who does not stand still) is refused and repeated. Each point is written
/// immediately, at the end of the file. Points that the file already has are not visited again, so that a survey can be
/// continued. From a recording (--file, --stdin) dwells begin at from_s of the points.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza survey fingerprints --points points.csv --out fingerprints.csv\n  \
                        baliza survey fingerprints --serial /dev/ttyACM0 --out fingerprints.csv\n  \
                        baliza survey fingerprints --file telemetry.bin --points points.csv --out fingerprints.csv")]
pub struct Arguments {
    /// The points to visit: CSV with point,x_m,y_m and, where known, room,from_s; without it points are typed, `name x
    /// y room`
    #[arg(long, value_name = "FILE", required_if_eq_any = [("stdin", "true")])]
    points: Option<PathBuf>,
    /// Where the fingerprints go: CSV with point,room,x_m,y_m,beacon,rssi_dbm,t_s
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// How long to dwell at a point, seconds
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = stay, alias = "stay-s")]
    dwell_s: f64,
    #[command(flatten)]
    source: SourceArguments,
    /// Print JSON: results has an object a point, with taken, adverts, beacons, reasons
    #[arg(long)]
    json: bool,
}

fn stay(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (2.0..=600.0).contains(&number) => Ok(number),
        Ok(_) | Err(_) => Err(format!("{text:?} is not a number of seconds, 2 to 600")),
    }
}

/// The result of a visit for `--json`.
#[derive(serde::Serialize)]
struct Row {
    point: String,
    taken: bool,
    adverts: usize,
    beacons: usize,
    reasons: Vec<String>,
}

/// Runs `baliza survey fingerprints`.
///
/// # Errors
/// Flags or a file are wrong, the source fails, or the output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let places = arguments.points.as_deref().map(read_points).transpose()?;
    let input = arguments.source.input()?;
    if input.is_none() {
        arguments.source.look()?;
    }
    let mut book = FingerprintFile::open("--out", &arguments.out)?;
    if input.is_some() && arguments.source.seconds.is_some() {
        return Err(UserError::flag("--seconds", "only with a live node").into());
    }
    let visits = match (input, places) {
        (Some(input), Some(places)) => recorded(arguments, &input, &places, &mut book)?,
        (Some(_), None) => return Err(UserError::flag("--points", "is needed with a recording").into()),
        (None, places) => live(arguments, places, &mut book)?,
    };
    let taken = visits.iter().filter(|visit| visit.taken).count();
    note(&format!("{taken} points taken, {} refused: {}\n", visits.len() - taken, arguments.out.display()));
    if arguments.json {
        let rows = visits.into_iter().map(|visit| Row {
            reasons: visit.biases.iter().map(ToString::to_string).collect(),
            point: visit.point,
            taken: visit.taken,
            adverts: visit.adverts,
            beacons: visit.beacons,
        });
        print_json(&rows.collect::<Vec<_>>())?;
    }
    Ok(())
}

/// The points that are still to be visited. Prints the points that are not.
fn missing<'p>(places: &'p [SurveyPoint], book: &FingerprintFile) -> Vec<&'p SurveyPoint> {
    let (there, missing): (Vec<_>, Vec<_>) = places.iter().partition(|place| book.has(&place.name));
    if !there.is_empty() {
        let names: Vec<_> = there.iter().map(|place| place.name.as_str()).collect();
        note(&format!("in the file already, not visited again: {}\n", names.join(", ")));
    }
    missing
}

fn recorded(
    arguments: &Arguments,
    input: &ByteInput,
    places: &[SurveyPoint],
    book: &mut FingerprintFile,
) -> Result<Vec<Visit>> {
    if let (Some(place), Some(file)) = (places.iter().find(|place| place.from_s.is_none()), &arguments.points) {
        let wrong = format!("point {:?} has no from_s: when does its stay begin in the recording?", place.name);
        return Err(UserError::file(file, wrong).into());
    }
    catch_signals()?;
    let mut stays: Vec<_> = missing(places, book)
        .into_iter()
        .map(|place| (place, Dwell::new(place.from_s, arguments.dwell_s), false))
        .collect();
    let mut stream = Stream::default();
    let progress = input.progress();
    while let Some(bytes) = input.next()? {
        each_advert(&mut stream, &bytes, &mut |t_s, sighting| {
            for (_, stay, over) in &mut stays {
                *over |= stay.at(t_s);
                if let Some((beacon, rssi_dbm)) = &sighting {
                    stay.receive(t_s, beacon, *rssi_dbm);
                }
            }
        });
        if let Some(progress) = &progress {
            progress.advance(bytes.len() as u64);
        }
    }
    drop(progress);
    let mut visits = Vec::new();
    for (place, stay, over) in stays {
        if !over {
            note(&format!("{}: the recording ends before its stay does\n", place.name));
            continue;
        }
        let visit = Visit::conclude(place, &stay, book)?;
        note(&format!("{}\n", visit.said()));
        visits.push(visit);
    }
    Ok(visits)
}

/// Reads the lines that the user types at the terminal.
struct Terminal {
    lines: Receiver<String>,
    bar: ProgressBar,
}

impl Terminal {
    fn new() -> Self {
        let (to, lines) = channel();
        // The thread lives as long as standard input, because waiting for a terminal has no timeout.
        std::thread::spawn(move || {
            for line in std::io::stdin().lines().map_while(Result::ok) {
                if to.send(line).is_err() {
                    break;
                }
            }
        });
        Self { lines, bar: ProgressBar::new_spinner() }
    }
}

impl Person for Terminal {
    fn note(&mut self, text: &str) {
        self.bar.set_message("");
        self.bar.suspend(|| prompt(&format!("{text}\n")));
    }

    fn show(&mut self, status: &str) {
        self.bar.set_message(status.to_owned());
        self.bar.tick();
    }

    fn typed(&mut self) -> Typed {
        match self.lines.try_recv() {
            Ok(line) => Typed::Line(line),
            Err(TryRecvError::Empty) => Typed::Nothing,
            Err(TryRecvError::Disconnected) => Typed::Closed,
        }
    }
}

fn live(arguments: &Arguments, places: Option<Vec<SurveyPoint>>, book: &mut FingerprintFile) -> Result<Vec<Visit>> {
    catch_signals()?;
    let mut source = arguments.source.live(None, false);
    let mut person = Terminal::new();
    let mut guide = Wizard::new(source.as_mut(), &mut person, arguments.dwell_s, &STOP);
    guide.until = arguments.source.seconds.map(|seconds| Instant::now() + seconds);
    let mut visits = Vec::new();
    if let Some(places) = places {
        for place in missing(&places, book) {
            if guide.visit(place, book, &mut visits)?.is_none() {
                break;
            }
        }
        return Ok(visits);
    }
    loop {
        guide.person.note("which point? name x y, in metres, and its room; an empty line ends");
        match guide.line()?.as_deref() {
            None | Some("") => return Ok(visits),
            Some(line) => match parse_point(line) {
                Ok(place) if book.has(&place.name) => guide.person.note("that point is in the file already"),
                Ok(place) => {
                    if guide.visit(&place, book, &mut visits)?.is_none() {
                        return Ok(visits);
                    }
                }
                Err(expected) => guide.person.note(&expected),
            },
        }
    }
}
