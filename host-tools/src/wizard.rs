//! Guides a person through a survey from point to point, until each point is measured or left out.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use wire::telemetry::Message;

use analysis::survey::campaign::{Bias, Dwell, FingerprintFile, SurveyPoint, biases};
use node_link::decode::Stream;
use node_link::monitor::{Event, NodeChannel, Source};

/// Longest wait for a source at a time, so that a typed line is read soon.
const PATIENCE: Duration = Duration::from_millis(50);
/// After this number of empty reads in a row, which is ten seconds, a note warns the person.
const SILENT: u32 = 200;

/// The person who carries the node.
pub trait Person {
    /// Shows a message.
    fn note(&mut self, text: &str);
    /// Shows the progress, several times a second.
    fn show(&mut self, status: &str);
    /// The line typed since the last call; returns [`Typed::Nothing`] at once, if there is none.
    fn typed(&mut self) -> Typed;
}

/// Takes a message's time, seconds, and for an advert the beacon's name and its RSSI, dBm.
pub type Take<'t> = dyn FnMut(f64, Option<(String, f64)>) + 't;

/// What was typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Typed {
    /// Nothing yet.
    Nothing,
    /// A line.
    Line(String),
    /// The input has ended.
    Closed,
}

/// The result of a visit to a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Visit {
    /// The point.
    pub point: String,
    /// Whether the point is in the file now.
    pub taken: bool,
    /// Number of received adverts.
    pub adverts: usize,
    /// Number of received beacons.
    pub beacons: usize,
    /// Why the dwell was refused.
    pub biases: Vec<Bias>,
}

impl Visit {
    /// Checks a dwell, and adds it to the file if no check fails.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn conclude(place: &SurveyPoint, stay: &Dwell, book: &mut FingerprintFile) -> Result<Self> {
        let biases = biases(stay);
        if biases.is_empty() {
            book.add(place, stay)?;
        }
        Ok(Self {
            point: place.name.clone(),
            taken: biases.is_empty(),
            adverts: stay.adverts.len(),
            beacons: stay.by_beacon().len(),
            biases,
        })
    }

    /// The result as text.
    pub fn said(&self) -> String {
        let reasons: Vec<_> = self.biases.iter().map(ToString::to_string).collect();
        let heard = format!("{} adverts of {} beacons", self.adverts, self.beacons);
        match self.taken {
            true => format!("{}: taken, {heard}", self.point),
            false => format!("{}: refused, {heard}: {}", self.point, reasons.join("; ")),
        }
    }
}

/// Why a visit ended without a dwell.
enum Left {
    Skipped,
    Ended,
}

/// Guides a person.
pub struct Wizard<'a> {
    /// The node's messages.
    pub source: &'a mut dyn Source,
    /// The person who carries the node.
    pub person: &'a mut dyn Person,
    /// Length of a dwell, seconds.
    pub stay_s: f64,
    /// Whether Ctrl-C was pressed.
    pub stop: &'a AtomicBool,
    /// The latest end of the survey.
    pub until: Option<Instant>,
    stream: Stream,
    /// Number of reads in a row without a message.
    silent: u32,
}

impl<'a> Wizard<'a> {
    /// A guide that has not begun.
    pub fn new(source: &'a mut dyn Source, person: &'a mut dyn Person, stay_s: f64, stop: &'a AtomicBool) -> Self {
        Self { source, person, stay_s, stop, until: None, stream: Stream::default(), silent: 0 }
    }

    /// Visits a point until it is measured or left out; `None` where the survey ends.
    ///
    /// # Errors
    /// The source cannot be read, or the file cannot be written.
    pub fn visit(
        &mut self,
        place: &SurveyPoint,
        book: &mut FingerprintFile,
        visits: &mut Vec<Visit>,
    ) -> Result<Option<()>> {
        let [x_m, y_m] = place.position_m;
        let room = place.room.as_ref().map_or_else(String::new, |room| format!("{room}, "));
        self.person.note(&format!(
            "go to {} ({room}x {x_m}, y {y_m}) and stand still; Enter begins, s skips, q ends",
            place.name
        ));
        loop {
            match self.wait_for_key()? {
                Ok(()) => {}
                Err(Left::Skipped) => return Ok(Some(())),
                Err(Left::Ended) => return Ok(None),
            }
            let Some(stay) = self.stay()? else { return Ok(None) };
            let visit = Visit::conclude(place, &stay, book)?;
            self.person.note(&visit.said());
            let taken = visit.taken;
            visits.push(visit);
            if taken {
                return Ok(Some(()));
            }
            self.person.note("Enter tries again, s skips, q ends");
        }
    }

    /// Waits for a typed line and discards the node's messages meanwhile; `None` where the input has ended.
    ///
    /// # Errors
    /// The source cannot be read.
    pub fn line(&mut self) -> Result<Option<String>> {
        loop {
            match self.person.typed() {
                Typed::Line(line) => return Ok(Some(line.trim().to_owned())),
                Typed::Closed => return Ok(None),
                Typed::Nothing => {}
            }
            if self.next(&mut |_, _| ())?.is_none() {
                return Ok(None);
            }
        }
    }

    fn wait_for_key(&mut self) -> Result<Result<(), Left>> {
        Ok(match self.line()?.as_deref() {
            None | Some("q") => Err(Left::Ended),
            Some("s") => Err(Left::Skipped),
            Some(_) => Ok(()),
        })
    }

    /// Receives until the dwell is over; `None` where the source ended before.
    fn stay(&mut self) -> Result<Option<Dwell>> {
        let mut stay = Dwell::new(None, self.stay_s);
        let mut over = false;
        while !over {
            let heard = self.next(&mut |t_s, sighting| {
                over |= stay.at(t_s);
                if let Some((beacon, rssi_dbm)) = sighting {
                    stay.receive(t_s, &beacon, rssi_dbm);
                }
            })?;
            if heard.is_none() && !over {
                return Ok(None);
            }
            self.person.show(&stay.status());
        }
        Ok(Some(stay))
    }

    /// Takes the node's next message; `None` where the source has ended. Adverts get their beacon's name.
    fn next(&mut self, take: &mut Take<'_>) -> Result<Option<()>> {
        if self.stop.load(Ordering::Relaxed) || self.until.is_some_and(|until| Instant::now() >= until) {
            return Ok(None);
        }
        let event = self.source.next(PATIENCE)?;
        self.silent = if event.is_none() { self.silent.saturating_add(1) } else { 0 };
        if self.silent == SILENT {
            self.person.note("nothing comes from the node: is it connected, and does its record have it scan?");
        }
        match event {
            Some(Event::Bytes(NodeChannel::Telemetry, bytes)) => each_advert(&mut self.stream, &bytes, take),
            Some(Event::Lost(why)) => {
                self.stream.interrupted();
                self.person.note(&format!("connection lost ({why}); trying to connect again"));
            }
            Some(Event::Connected(to)) => self.person.note(&format!("connected to {to}")),
            Some(Event::Silent) => self.person.note("the node runs, but says nothing: is a baliza image flashed?"),
            Some(Event::End) => return Ok(None),
            Some(Event::Bytes(NodeChannel::Log, _) | Event::Text(_) | Event::Restarted | Event::Flashed { .. })
            | None => {}
        }
        Ok(Some(()))
    }
}

/// Calls `take` for each message of a stream.
pub fn each_advert(stream: &mut Stream, bytes: &[u8], take: &mut Take<'_>) {
    for byte in bytes {
        if let Some((stamp, message)) = stream.feed(*byte) {
            let sighting = if let Message::Sighting(sighting) = message {
                Some((sighting.beacon.to_string(), f64::from(sighting.rssi_dbm)))
            } else {
                None
            };
            take(stamp.t_s, sighting);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::sync::atomic::AtomicBool;
    use std::time::Duration;

    use anyhow::Result;
    use wire::telemetry::{BeaconId, MAX_FRAME, Message, Sighting, encode};

    use super::{Person, Typed, Wizard};
    use analysis::survey::campaign::{FingerprintFile, parse_point};
    use node_link::monitor::{Event, NodeChannel, Source};

    /// A node that receives one beacon ten times a second; it is silent while its clock is in the gap.
    struct Node {
        t_us: u64,
        gap_us: std::ops::Range<u64>,
    }

    impl Source for Node {
        fn next(&mut self, _patience: Duration) -> Result<Option<Event>> {
            self.t_us += 100_000;
            let beacon =
                BeaconId { network: 0xB0, major: 1, minor: if self.gap_us.contains(&self.t_us) { 9 } else { 2 } };
            let rssi_dbm = -60 - (self.t_us / 100_000 % 2) as i8;
            let message = Message::Sighting(Sighting { t_us: self.t_us, beacon, rssi_dbm, measured_power_dbm: -59 });
            let mut buffer = [0; MAX_FRAME];
            let frame = encode(&message, &mut buffer);
            Ok(Some(Event::Bytes(NodeChannel::Telemetry, frame.to_vec())))
        }
    }

    /// Types lines one after the other, each at the second request.
    struct Script {
        lines: VecDeque<&'static str>,
        asked: bool,
        told: Vec<String>,
    }

    impl Person for Script {
        fn note(&mut self, text: &str) {
            self.told.push(text.to_owned());
        }
        fn show(&mut self, _status: &str) {}
        fn typed(&mut self) -> Typed {
            self.asked = !self.asked;
            match self.asked {
                true => Typed::Nothing,
                false => self.lines.pop_front().map_or(Typed::Closed, |line| Typed::Line(line.to_owned())),
            }
        }
    }

    #[test]
    fn a_refused_stay_is_tried_again_and_a_skipped_point_is_not_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut book = FingerprintFile::open("--out", &folder.path().join("f.csv")).expect("none yet");
        // The beacon is silent from 4 s to 9 s of the node's clock: in the first dwell.
        let mut node = Node { t_us: 0, gap_us: 4_000_000..9_000_000 };
        let mut person = Script { lines: ["", "", "s", "q"].into(), asked: false, told: Vec::new() };
        let (stop, mut visits) = (AtomicBool::new(false), Vec::new());
        let mut guide = Wizard::new(&mut node, &mut person, 10.0, &stop);
        let mut visit =
            |point| guide.visit(&parse_point(point).expect("a point"), &mut book, &mut visits).expect("no failure");
        assert_eq!(visit("p 1 2 hall"), Some(()));
        assert_eq!(visit("q 3 2 hall"), Some(()));
        assert_eq!(visit("r 5 2 hall"), None);
        assert_eq!(visits.iter().map(|visit| visit.taken).collect::<Vec<_>>(), [false, true]);
        assert!(visits[0].said().contains("silent for 5.1 s"), "{}", visits[0].said());
        assert!(book.has("p") && !book.has("q") && !book.has("r"));
        assert!(person.told.iter().any(|told| told.starts_with("go to r")), "{:?}", person.told);
    }
}
