//! A session: takes the events of a source, and returns the node's output in the order of its arrival, with counts and
//! with messages for the user.
//!
//! Time is an argument. The log is decoded with the table of an ELF file unless it is known that the node runs another
//! build. The node's `Hello` gives its build, a few seconds after the first bytes at the latest. Until then, everything
//! from the log's first line on waits.

#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::time::Duration;

use anyhow::Result;
use wire::telemetry::{Condition, Message, State};

use super::elf::{Build, Image};
use super::log_frames::{self, Frames, LogLine};
use super::source::{Event, NodeChannel};
use crate::decode::{Stamp, Stream};
use crate::recorder::Recorder;

/// A node sends `Hello` every two seconds. After this time without `Hello`, the session does not wait for it any
/// longer.
const HELLO_WITHIN: Duration = Duration::from_secs(3);
/// The maximum number of waiting items.
const MOST_WAITING: usize = 1 << 14;

/// An item of a node's output.
#[derive(Clone, Debug, PartialEq)]
pub enum NodeOutput {
    /// A line of its log.
    Log(LogLine),
    /// A telemetry message.
    Message(Stamp, Message),
    /// A line of its boot loader.
    Text(String),
    /// A line of the log that cannot be decoded, and the same holds for the following lines. It is reported once for
    /// each reason.
    Unreadable,
}

/// The counts of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SessionCounts {
    /// Positions.
    pub fixes: u64,
    /// Rounds without a position.
    pub no_fixes: u64,
    /// Other messages.
    pub others: u64,
    /// Lines of the log.
    pub log_lines: u64,
    /// Malformed frames of the log.
    pub log_malformed: u64,
    /// Frames of the log without a table, or with the table of another build.
    pub log_unreadable: u64,
    /// Restarts of the node.
    pub restarts: u64,
    /// Connections that were lost.
    pub lost: u64,
    /// Telemetry frames that the node dropped because the channel was full, as last reported.
    pub node_dropped: u64,
    /// The decoder's counts of the telemetry bytes.
    pub telemetry: wire::telemetry::Counts,
}

impl SessionCounts {
    /// Frames that did not arrive as the node sent them.
    pub fn lost_frames(&self) -> u64 {
        self.telemetry.malformed() + self.log_malformed
    }
}

/// Looks for the image of a build, as [`ImageFiles::find`](super::ImageFiles::find) does. A node may get a new image while
/// the session runs.
pub type FindImage = Box<dyn FnMut(Build) -> Result<Image, String>>;

/// An item of a session, in the order of its arrival.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// The node's output.
    Node(NodeOutput),
    /// A message for the user that belongs between two items of the node's output: a restart.
    Note(String),
}

/// A received item, in the order of arrival.
enum Waiting {
    Decoded(Item),
    /// A frame of the log with its time of arrival, not decoded yet.
    Log(Duration, Vec<u8>),
}

/// Whether the ELF file is that of the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ImageMatch {
    /// Not known yet; with the result of the comparison with the chip's flash.
    Unknown { flash: Option<bool> },
    /// The ELF file is that of the node.
    Same,
    /// The ELF file is that of another build; whether an unreadable line was reported to the user.
    Other { is_shown: bool },
}

/// A session of listening to a node.
pub struct Session {
    image: Option<Image>,
    find: Option<FindImage>,
    /// The source is live: it has no end to wait for.
    live: bool,
    image_match: ImageMatch,
    frames: Frames,
    stream: Stream,
    recorder: Option<Recorder>,
    waiting: VecDeque<Waiting>,
    ended: bool,
    connected_before: bool,
    /// The node's build, as it last reported it.
    node: Option<Build>,
    /// The node's build that was reported to the user.
    reported: Option<Build>,
    hinted: bool,
    silent_reported: bool,
    notes: VecDeque<String>,
    counts: SessionCounts,
    state: Option<Condition>,
}

impl Session {
    /// A session that decodes the log with `image`, or else with the one that `find` has for the node's build.
    pub fn new(image: Option<Image>, find: Option<FindImage>, live: bool) -> Self {
        let mut session = Self {
            image,
            find,
            live,
            image_match: ImageMatch::Unknown { flash: None },
            frames: Frames::default(),
            stream: Stream::default(),
            recorder: None,
            waiting: VecDeque::new(),
            ended: false,
            connected_before: false,
            node: None,
            reported: None,
            hinted: false,
            silent_reported: false,
            notes: VecDeque::new(),
            counts: SessionCounts::default(),
            state: None,
        };
        if let Some(image) = &session.image
            && image.build.is_none()
        {
            session.image_match = ImageMatch::Same;
            session.notes.push_back(format!(
                "{} has no build of ours (no section .baliza.build): it cannot be compared with the node's",
                image.file.display()
            ));
        }
        session
    }

    /// Records the telemetry that is received from now on.
    pub fn record(&mut self, recorder: Recorder) {
        self.recorder = Some(recorder);
    }

    /// Lets the recording write the rows of the last second, where no bytes come.
    ///
    /// # Errors
    /// The recording cannot be written.
    pub fn tick(&mut self) -> Result<()> {
        self.recorder.as_mut().map_or(Ok(()), Recorder::tick)
    }

    /// Returns the recorder.
    pub fn recorded(&mut self) -> Option<Recorder> {
        self.recorder.take()
    }

    /// Processes an event.
    ///
    /// # Errors
    /// The event cannot be recorded.
    pub fn accept(&mut self, now: Duration, event: Event) -> Result<()> {
        match event {
            Event::Bytes(NodeChannel::Telemetry, bytes) => self.telemetry(&bytes)?,
            Event::Bytes(NodeChannel::Log, bytes) => {
                for frame in self.frames.feed(&bytes) {
                    self.log_frame(now, frame);
                }
            }
            Event::Text(line) => self.waiting.push_back(Waiting::Decoded(Item::Node(NodeOutput::Text(line)))),
            Event::Connected(to) => {
                let again = if self.connected_before { "again " } else { "" };
                self.connected_before = true;
                self.notes.push_back(format!("connected {again}to {to}"));
                // Another image may run after a new connection.
                self.node = None;
                if self.image.as_ref().map_or(self.find.is_some(), |image| image.build.is_some()) {
                    self.image_match = ImageMatch::Unknown { flash: None };
                }
            }
            Event::Lost(why) => {
                self.counts.lost += 1;
                self.interrupted();
                self.frames.cut();
                self.notes.push_back(format!("connection lost ({why}); trying to connect again until Ctrl-C"));
            }
            Event::Restarted => {
                self.stream.restarted();
                if let Some(recorder) = &mut self.recorder {
                    recorder.restarted();
                }
                self.frames.cut();
            }
            Event::Silent => {
                if !std::mem::replace(&mut self.silent_reported, true) {
                    self.notes.push_back(
                        "no RTT control block in the chip's RAM: is a baliza image flashed and running? --reset restarts it; \
                         still searching"
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
                self.interrupted();
                self.frames.cut();
                self.ended = true;
            }
        }
        self.note_restarts();
        Ok(())
    }

    /// Bytes are missing from here on.
    fn interrupted(&mut self) {
        self.stream.interrupted();
        if let Some(recorder) = &mut self.recorder {
            recorder.interrupted();
        }
    }

    /// The next item of the node's output that can be decoded at `now`; `None`: no item at present.
    pub fn next(&mut self, now: Duration) -> Option<Item> {
        loop {
            let (came, frame) = match self.waiting.pop_front()? {
                Waiting::Decoded(item) => return Some(item),
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
            if let Some(output) = self.log_line(&frame) {
                return Some(Item::Node(output));
            }
        }
    }

    /// The next message for the user that has no place among the node's output.
    pub fn note(&mut self) -> Option<String> {
        self.notes.pop_front()
    }

    /// The counts so far.
    pub fn counts(&self) -> SessionCounts {
        SessionCounts {
            log_malformed: self.counts.log_malformed + self.frames.malformed(),
            telemetry: *self.stream.counts(),
            ..self.counts
        }
    }

    /// The node's state, as last reported.
    pub fn state(&self) -> Option<String> {
        self.state.map(|is| is.to_string())
    }

    fn telemetry(&mut self, bytes: &[u8]) -> Result<()> {
        if let Some(recorder) = &mut self.recorder {
            recorder.take(bytes)?;
        }
        for byte in bytes {
            let Some((stamp, message)) = self.stream.feed(*byte) else { continue };
            self.note_restarts();
            self.message(&message);
            self.waiting.push_back(Waiting::Decoded(Item::Node(NodeOutput::Message(stamp, message))));
        }
        Ok(())
    }

    /// Notes the restarts of the node before what it has sent since.
    fn note_restarts(&mut self) {
        while self.counts.restarts < self.stream.restarts() {
            self.counts.restarts += 1;
            self.waiting.push_back(Waiting::Decoded(Item::Note("the node has restarted".into())));
        }
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
        if self.image.is_some() || self.find.is_some() {
            self.waiting.push_back(Waiting::Log(now, frame));
            if let (None, Some(node)) = (&self.image, self.node) {
                self.look_for(node);
            }
            return;
        }
        self.counts.log_unreadable += 1;
        if !std::mem::replace(&mut self.hinted, true) {
            self.notes
                .push_back("the node writes a log as well: --elf FILE, the ELF file that was flashed, shows it".into());
        }
    }

    /// The log line of a frame; `None`: the frame cannot be decoded, and is counted.
    fn log_line(&mut self, frame: &[u8]) -> Option<NodeOutput> {
        if let ImageMatch::Other { is_shown } = &mut self.image_match {
            self.counts.log_unreadable += 1;
            return (!std::mem::replace(is_shown, true)).then_some(NodeOutput::Unreadable);
        }
        let Some(mut line) = self.image.as_ref().and_then(|image| log_frames::read(image, frame)) else {
            self.counts.log_malformed += 1;
            return None;
        };
        self.counts.log_lines += 1;
        // Only if there is telemetry.
        line.is_in_telemetry &= self.stream.counts().frames > 0;
        Some(NodeOutput::Log(line))
    }

    /// Compares the build that the node reports with the ELF file.
    fn compare(&mut self, node: Build) {
        self.node = Some(node);
        match self.image.as_ref().map(|image| image.build) {
            Some(Some(build)) if build == node => self.is_same(),
            Some(Some(_)) => self.look_for(node),
            // An image of somebody else's cannot be compared.
            Some(None) => {}
            // Nodes without a log need none.
            None if self.waiting.iter().any(|waiting| matches!(waiting, Waiting::Log(..))) => self.look_for(node),
            None => {}
        }
    }

    /// Looks for the ELF file of the node's build, where that is not the one that is used.
    fn look_for(&mut self, node: Build) {
        if self.reported != Some(node) {
            let before = self.image.as_ref().map(|image| image.file.clone());
            match self.find.as_mut().map_or_else(|| Err("and there is no ELF file".to_owned()), |find| find(node)) {
                Ok(found) => {
                    let file = found.file.display();
                    self.notes.push_back(match before {
                        Some(before) if before == found.file => format!("{file} was rebuilt, and is the node's again"),
                        Some(_) | None => format!("the node runs build {node}, which is {file}"),
                    });
                    self.image = Some(found);
                    return self.is_same();
                }
                Err(what) => self.notes.push_back(format!("the node runs build {node}, {what}")),
            }
            self.reported = Some(node);
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

    /// Decides without a build reported by the node: by the comparison with its flash, else the ELF file is accepted as
    /// the user gave it.
    fn decide(&mut self, flash: Option<bool>) {
        if flash != Some(false) && self.image.is_some() {
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
