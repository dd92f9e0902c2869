//! One listening: events of a source in, what the node says in its own order out, with counts and sentences for the user.
//!
//! Time is an argument. The log is read with the table of an ELF file only while nothing says that the node runs another build:
//! its `Hello` says which it runs, a few seconds after the first word at the latest, and until then lines of the log are kept
//! (`trust`).

#[cfg(test)]
mod tests;
mod trust;

use std::collections::VecDeque;
use std::time::Duration;

use firmware_common::lines::StateLine;
use wire::telemetry::{Condition, Decoder, Message, State};

use super::image::{Build, Image};
use super::log::{self, Frames, LogLine};
use super::merge::{Merger, Patience};
use super::source::{Channel, Event};
use crate::UserError;
use trust::{OPEN, Trust};

/// A node says who it is every two seconds. Who has not heard it by now need not wait for it any longer.
const HELLO_WITHIN: Duration = Duration::from_secs(3);
/// Frames of the log that are kept meanwhile, bytes.
const MOST_KEPT: usize = 1 << 18;

/// What a node said.
#[derive(Clone, Debug, PartialEq)]
pub enum Said {
    /// A line of its log.
    Log(LogLine),
    /// A telemetry message.
    Message(Message),
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

/// One listening to a node.
pub struct Session {
    image: Option<Image>,
    reload: Reload,
    live: bool,
    trust: Trust,
    frames: Frames,
    /// Frames of the log that wait for [`Trust`].
    kept: Vec<(Duration, Vec<u8>)>,
    kept_bytes: usize,
    decoder: Decoder,
    merger: Merger<Said>,
    ended: bool,
    connected_before: bool,
    /// The node's build that the user has been told of.
    told: Option<Build>,
    hinted: bool,
    silent_told: bool,
    notes: VecDeque<String>,
    counts: Counts,
    state: Option<Condition>,
}

impl Session {
    /// Reads the log with `image`, where there is one.
    pub fn new(image: Option<Image>, reload: Reload, patience: Patience) -> Self {
        let mut session = Self {
            image,
            reload,
            live: patience.host.is_some(),
            trust: OPEN,
            frames: Frames::default(),
            kept: Vec::new(),
            kept_bytes: 0,
            decoder: Decoder::new(),
            merger: Merger::new(patience),
            ended: false,
            connected_before: false,
            told: None,
            hinted: false,
            silent_told: false,
            notes: VecDeque::new(),
            counts: Counts::default(),
            state: None,
        };
        if let Some(image) = &session.image
            && image.build.is_none()
        {
            session.trust = Trust::Same;
            session.notes.push_back(format!(
                "{} has no build of ours (no section .baliza.build): whether it is the node's cannot be told",
                image.file.display()
            ));
        }
        session
    }

    /// Takes an event that came at `now`, by the host's clock.
    pub fn accept(&mut self, now: Duration, event: Event) {
        match event {
            Event::Bytes(Channel::Telemetry, bytes) => {
                for byte in bytes {
                    if let Some(Ok(message)) = self.decoder.feed(byte) {
                        self.message(now, message);
                    }
                }
            }
            Event::Bytes(Channel::Log, bytes) => {
                for frame in self.frames.feed(&bytes) {
                    self.log_frame(now, frame);
                }
            }
            Event::Text(line) => _ = self.merger.push(Channel::Telemetry, None, false, now, Said::Text(line)),
            Event::Connected(to) => {
                let again = if self.connected_before { "again " } else { "" };
                self.connected_before = true;
                self.notes.push_back(format!("connected {again}to {to}"));
                self.doubt();
            }
            Event::Lost(why) => {
                self.counts.lost += 1;
                self.interrupted();
                self.notes.push_back(format!("connection lost ({why}); it is sought again until Ctrl-C"));
            }
            Event::Restarted => {
                self.interrupted();
                self.merger.restart();
                self.restarted();
            }
            Event::Silent => {
                if !std::mem::replace(&mut self.silent_told, true) {
                    self.notes.push_back(
                        "no RTT control block in the chip's RAM: is a baliza image flashed and running? --reset starts it anew; \
                         it is sought on"
                            .into(),
                    );
                }
            }
            Event::Flashed { same } => match &mut self.trust {
                Trust::Open { flash, .. } => *flash = Some(same),
                Trust::Same | Trust::Other => {}
            },
            Event::End => {
                self.settle(now);
                self.interrupted();
                self.ended = true;
            }
        }
        if let Trust::Open { flash: Some(true), .. } = self.trust {
            self.trust_it(now);
        }
    }

    /// What the node said next, in its own order, as far as is certain at `now`; `None`: for now nothing.
    pub fn next(&mut self, now: Duration) -> Option<Said> {
        if self.ended {
            return self.merger.finish();
        }
        if let Trust::Open { since: Some(since), .. } = self.trust {
            let late = self.live && now.saturating_sub(since) >= HELLO_WITHIN;
            if !late && self.kept_bytes < MOST_KEPT {
                return None;
            }
            self.settle(now);
        }
        self.merger.pop(now)
    }

    /// Sentences for the user, beside the data.
    pub fn note(&mut self) -> Option<String> {
        self.notes.pop_front()
    }

    /// What was counted so far.
    pub fn counts(&self) -> Counts {
        Counts {
            log_malformed: self.counts.log_malformed + self.frames.malformed(),
            telemetry: *self.decoder.counts(),
            ..self.counts
        }
    }

    /// The node's state, as it last said.
    pub fn state(&self) -> Option<String> {
        self.state.map(|is| StateLine(is).to_string())
    }

    fn message(&mut self, now: Duration, message: Message) {
        let begins = match &message {
            Message::Hello(hello) => {
                self.compare(now, Build(hello.build));
                true
            }
            Message::Reset(_) => true,
            Message::Fix(fix) => {
                *(if fix.position_m().is_some() { &mut self.counts.fixes } else { &mut self.counts.no_fixes }) += 1;
                false
            }
            Message::Counters(counters) => {
                self.counts.node_dropped = counters.telemetry_dropped.into();
                false
            }
            Message::State(State {
                is:
                    Condition::BeaconMoved(_)
                    | Condition::BeaconDuplicated(_)
                    | Condition::BeaconRestored(_)
                    | Condition::MotionSensor(_),
                ..
            }) => false,
            Message::State(state) => {
                self.state = Some(state.is);
                false
            }
            Message::Range(_) | Message::Difference(_) | Message::Sighting(_) | Message::Room(_) => false,
        };
        if !matches!(message, Message::Fix(_)) {
            self.counts.others += 1;
        }
        if self.merger.push(Channel::Telemetry, Some(message.t_us()), begins, now, Said::Message(message)) {
            self.restarted();
        }
    }

    fn log_frame(&mut self, now: Duration, frame: Vec<u8>) {
        let Some(image) = &self.image else {
            self.counts.log_unreadable += 1;
            if !std::mem::replace(&mut self.hinted, true) {
                self.notes.push_back(
                    "the node writes a log as well: --elf FILE, the ELF file that was flashed, shows it".into(),
                );
            }
            return;
        };
        match &mut self.trust {
            Trust::Open { since, .. } => {
                since.get_or_insert(now);
                self.kept_bytes += frame.len();
                self.kept.push((now, frame));
            }
            Trust::Other => self.counts.log_unreadable += 1,
            Trust::Same => match log::read(image, &frame) {
                Some(line) => {
                    self.counts.log_lines += 1;
                    if self.merger.push(Channel::Log, line.t_us, false, now, Said::Log(line)) {
                        self.restarted();
                    }
                }
                None => self.counts.log_malformed += 1,
            },
        }
    }

    fn interrupted(&mut self) {
        self.decoder.interrupted();
        self.frames.cut();
    }

    fn restarted(&mut self) {
        self.counts.restarts += 1;
        self.notes.push_back("the node has restarted".into());
    }
}
