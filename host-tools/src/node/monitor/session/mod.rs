//! One listening: events of a source in, what the node says in the order of its arrival out, with counts and sentences for the user.
//!
//! Time is an argument. The log is read with the table of an ELF file only while nothing says that the node runs another build:
//! its `Hello` says which it runs, a few seconds after the first word at the latest, and until then all waits behind the log's first line.

#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::time::Duration;

use wire::telemetry::{Condition, Message, State};

use super::image::{Build, Image};
use super::log::{self, Frames, LogLine};
use super::source::{Channel, Event};
use crate::UserError;
use crate::node::decode::{Stamp, Stream};
use crate::node::recorder::Recorder;

/// A node says who it is every two seconds. Who has not heard it by now need not wait for it any longer.
const HELLO_WITHIN: Duration = Duration::from_secs(3);
/// What waits meanwhile at most.
const MOST_WAITING: usize = 1 << 14;

/// What a node said.
#[derive(Clone, Debug, PartialEq)]
pub enum Said {
    /// A line of its log.
    Log(LogLine),
    /// A telemetry message.
    Message(Stamp, Message),
    /// A line of its boot loader.
    Text(String),
    /// The log says something that cannot be read from here on; said once for each reason.
    Unreadable,
}

/// What was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Positions.
    pub fixes: u64,
    /// Rounds without one.
    pub no_fixes: u64,
    /// Other messages.
    pub others: u64,
    /// Lines of the log.
    pub log_lines: u64,
    /// Frames of the log that are no frames.
    pub log_malformed: u64,
    /// Frames of the log for which there was no table, or the wrong one.
    pub log_unreadable: u64,
    /// Restarts of the node.
    pub restarts: u64,
    /// Connections that were lost.
    pub lost: u64,
    /// Telemetry frames that the node dropped because the channel was full, as it last said.
    pub node_dropped: u64,
    /// What came of the telemetry's bytes.
    pub telemetry: wire::telemetry::Counts,
}

impl Counts {
    /// Frames that did not arrive as the node sent them.
    pub fn lost_frames(&self) -> u64 {
        self.telemetry.malformed() + self.log_malformed
    }
}

/// Rereads an ELF file that may have been built anew since.
pub type Reload = Box<dyn FnMut(&Image) -> Option<Result<Image, UserError>>>;

/// What came, in its order.
enum Waiting {
    Said(Said),
    /// A frame of the log that came then, not read yet.
    Log(Duration, Vec<u8>),
}

/// Whether the ELF file is the node's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ImageMatch {
    /// Not known yet; with what was seen in the chip's flash.
    Unknown { flash: Option<bool> },
    /// It is.
    Same,
    /// It is another's; whether the user has seen a word of it.
    Other { is_shown: bool },
}

/// One listening to a node.
pub struct Session {
    image: Option<Image>,
    reload: Reload,
    /// The node speaks now: there is no end to wait for.
    live: bool,
    image_match: ImageMatch,
    frames: Frames,
    stream: Stream,
    recorder: Option<Recorder>,
    waiting: VecDeque<Waiting>,
    ended: bool,
    connected_before: bool,
    /// The node's build that the user has been told of.
    reported: Option<Build>,
    hinted: bool,
    silent_reported: bool,
    notes: VecDeque<String>,
    counts: Counts,
    state: Option<Condition>,
}

impl Session {
    /// Reads the log with `image`, where there is one.
    pub fn new(image: Option<Image>, reload: Reload, live: bool) -> Self {
        let mut session = Self {
            image,
            reload,
            live,
            image_match: ImageMatch::Unknown { flash: None },
            frames: Frames::default(),
            stream: Stream::default(),
            recorder: None,
            waiting: VecDeque::new(),
            ended: false,
            connected_before: false,
            reported: None,
            hinted: false,
            silent_reported: false,
            notes: VecDeque::new(),
            counts: Counts::default(),
            state: None,
        };
        if let Some(image) = &session.image
            && image.build.is_none()
        {
            session.image_match = ImageMatch::Same;
            session.notes.push_back(format!(
                "{} has no build of ours (no section .baliza.build): whether it is the node's cannot be told",
                image.file.display()
            ));
        }
        session
    }

    /// Records the telemetry that comes from now on.
    pub fn record(&mut self, recorder: Recorder) {
        self.recorder = Some(recorder);
    }

    /// Gives the recorder back.
    pub fn recorded(&mut self) -> Option<Recorder> {
        self.recorder.take()
    }

    /// Takes an event.
    ///
    /// # Errors
    /// It cannot be recorded.
    pub fn accept(&mut self, now: Duration, event: Event) -> csv::Result<()> {
        match event {
            Event::Bytes(Channel::Telemetry, bytes) => self.telemetry(&bytes)?,
            Event::Bytes(Channel::Log, bytes) => {
                for frame in self.frames.feed(&bytes) {
                    self.log_frame(now, frame);
                }
            }
            Event::Text(line) => self.waiting.push_back(Waiting::Said(Said::Text(line))),
            Event::Connected(to) => {
                let again = if self.connected_before { "again " } else { "" };
                self.connected_before = true;
                self.notes.push_back(format!("connected {again}to {to}"));
                // Another image may run from here on.
                if self.image.as_ref().is_some_and(|image| image.build.is_some()) {
                    self.image_match = ImageMatch::Unknown { flash: None };
                }
            }
            Event::Lost(why) => {
                self.counts.lost += 1;
                self.stream.interrupted();
                self.frames.cut();
                self.notes.push_back(format!("connection lost ({why}); it is sought again until Ctrl-C"));
            }
            Event::Restarted => {
                self.stream.restarted();
                self.frames.cut();
            }
            Event::Silent => {
                if !std::mem::replace(&mut self.silent_reported, true) {
                    self.notes.push_back(
                        "no RTT control block in the chip's RAM: is a baliza image flashed and running? --reset starts it anew; \
                         it is sought on"
                            .into(),
                    );
                }
            }
            Event::Flashed { same } => {
                if let ImageMatch::Unknown { flash } = &mut self.image_match {
                    *flash = Some(same);
                }
            }
            Event::End => {
                self.stream.interrupted();
                self.frames.cut();
                self.ended = true;
            }
        }
        while self.counts.restarts < self.stream.restarts() {
            self.counts.restarts += 1;
            self.notes.push_back("the node has restarted".into());
        }
        Ok(())
    }

    /// What the node said next, as far as it can be read at `now`; `None`: for now nothing.
    pub fn next(&mut self, now: Duration) -> Option<Said> {
        loop {
            let (came, frame) = match self.waiting.pop_front()? {
                Waiting::Said(said) => return Some(said),
                Waiting::Log(came, frame) => (came, frame),
            };
            if let ImageMatch::Unknown { flash } = self.image_match {
                let is_late = self.live && now.saturating_sub(came) >= HELLO_WITHIN;
                if flash != Some(true) && !self.ended && !is_late && self.waiting.len() < MOST_WAITING {
                    self.waiting.push_front(Waiting::Log(came, frame));
                    return None;
                }
                self.decide(flash);
            }
            if let Some(said) = self.log_line(&frame) {
                return Some(said);
            }
        }
    }

    /// Sentences for the user, beside the data.
    pub fn note(&mut self) -> Option<String> {
        self.notes.pop_front()
    }

    /// What was counted so far.
    pub fn counts(&self) -> Counts {
        Counts {
            log_malformed: self.counts.log_malformed + self.frames.malformed(),
            telemetry: *self.stream.counts(),
            ..self.counts
        }
    }

    /// The node's state, as it last said.
    pub fn state(&self) -> Option<String> {
        self.state.map(|is| is.to_string())
    }

    fn telemetry(&mut self, bytes: &[u8]) -> csv::Result<()> {
        if let Some(recorder) = &mut self.recorder {
            recorder.bytes(bytes)?;
        }
        for byte in bytes {
            let Some((stamp, message)) = self.stream.feed(*byte) else { continue };
            if let Some(recorder) = &mut self.recorder {
                recorder.message(stamp, &message)?;
            }
            self.message(&message);
            self.waiting.push_back(Waiting::Said(Said::Message(stamp, message)));
        }
        Ok(())
    }

    fn message(&mut self, message: &Message) {
        let counts = &mut self.counts;
        if let Message::Fix(fix) = message {
            *(if fix.reason().is_none() { &mut counts.fixes } else { &mut counts.no_fixes }) += 1;
        } else {
            counts.others += 1;
        }
        if let Message::Counters(of) = message {
            counts.node_dropped = of.telemetry_dropped.into();
        }
        if let Message::State(State { is, .. }) = message
            && is.is_of_node()
        {
            self.state = Some(*is);
        }
        if let Message::Hello(hello) = message {
            self.compare(Build(hello.build));
        }
    }

    fn log_frame(&mut self, now: Duration, frame: Vec<u8>) {
        if self.image.is_some() {
            self.waiting.push_back(Waiting::Log(now, frame));
            return;
        }
        self.counts.log_unreadable += 1;
        if !std::mem::replace(&mut self.hinted, true) {
            self.notes
                .push_back("the node writes a log as well: --elf FILE, the ELF file that was flashed, shows it".into());
        }
    }

    /// What a frame of the log says; `None`: nothing that can be read, which is counted.
    fn log_line(&mut self, frame: &[u8]) -> Option<Said> {
        if let ImageMatch::Other { is_shown } = &mut self.image_match {
            self.counts.log_unreadable += 1;
            return (!std::mem::replace(is_shown, true)).then_some(Said::Unreadable);
        }
        let Some(mut line) = self.image.as_ref().and_then(|image| log::read(image, frame)) else {
            self.counts.log_malformed += 1;
            return None;
        };
        self.counts.log_lines += 1;
        // Where there is telemetry.
        line.is_in_telemetry &= self.stream.counts().frames > 0;
        Some(Said::Log(line))
    }

    /// The node says which build it runs.
    fn compare(&mut self, node: Build) {
        let Some(image) = &self.image else { return };
        let Some(build) = image.build else { return };
        if node == build {
            return self.is_same();
        }
        if self.reported != Some(node) {
            // Whoever flashes while we listen has built before.
            if let Some(Ok(newer)) = (self.reload)(image)
                && newer.build == Some(node)
            {
                self.notes.push_back(format!("{} has been built anew, and is the node's again", newer.file.display()));
                self.image = Some(newer);
                self.is_same();
                return;
            }
            self.reported = Some(node);
            self.notes.push_back(format!(
                "the node runs build {node}, the ELF file {} is {build}: flash it, or give the ELF that was flashed",
                image.file.display()
            ));
        }
        self.is_other();
    }

    fn is_same(&mut self) {
        self.reported = None;
        self.image_match = ImageMatch::Same;
    }

    fn is_other(&mut self) {
        if !matches!(self.image_match, ImageMatch::Other { .. }) {
            self.image_match = ImageMatch::Other { is_shown: false };
        }
    }

    /// No word of the node says which build it runs: what was seen of its flash decides, else the user is believed.
    fn decide(&mut self, flash: Option<bool>) {
        if flash != Some(false) {
            return self.is_same();
        }
        if let Some(image) = &self.image {
            let build = image.build.map_or_else(String::new, |build| format!(" (build {build})"));
            self.notes.push_back(format!(
                "the chip's flash does not hold the ELF file {}{build}: flash it, or give the ELF that was flashed",
                image.file.display()
            ));
        }
        self.is_other();
    }
}
