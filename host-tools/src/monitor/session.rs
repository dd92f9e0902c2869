//! One listening: events of a source in, what the node says in its own order out, with counts and sentences for the user.
//!
//! Time is an argument. The log is read with the table of an ELF file only while nothing says that the node runs another build:
//! its `Hello` says which it runs, a few seconds after the first word at the latest, and until then lines of the log are kept.

use std::collections::VecDeque;
use std::time::Duration;

use firmware_common::lines::StateLine;
use telemetry::{Condition, Decoder, Message};

use super::image::{Build, Image};
use super::log::{self, Frames, LogLine};
use super::merge::{Merger, Patience};
use super::source::{Channel, Event};
use crate::Wrong;

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
    pub telemetry: telemetry::Counts,
}

impl Counts {
    /// Frames that did not arrive as the node sent them.
    pub fn lost_frames(&self) -> u64 {
        self.telemetry.malformed() + self.log_malformed
    }
}

/// Whether the ELF file is the node's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trust {
    /// Not known yet: the log is kept since then, if any came. `flash`: what was seen in the chip.
    Open {
        since: Option<Duration>,
        flash: Option<bool>,
    },
    Same,
    Other,
}

const OPEN: Trust = Trust::Open { since: None, flash: None };

/// Rereads an ELF file that may have been built anew since.
pub type Reload = Box<dyn FnMut(&Image) -> Option<Result<Image, Wrong>>>;

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
            Message::State(state) => {
                self.state = Some(state.is);
                false
            }
            Message::Range(_) | Message::Sighting(_) => false,
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

    /// The node says which build it runs.
    fn compare(&mut self, now: Duration, node: Build) {
        let Some(image) = &self.image else { return };
        let Some(build) = image.build else { return };
        if node == build {
            return self.trust_it(now);
        }
        // Whoever flashes while we listen has built before.
        if self.told != Some(node)
            && let Some(Ok(newer)) = (self.reload)(image)
            && newer.build == Some(node)
        {
            self.notes.push_back(format!("{} has been built anew, and is the node's again", newer.file.display()));
            self.image = Some(newer);
            return self.trust_it(now);
        }
        if self.told != Some(node) {
            self.told = Some(node);
            self.notes.push_back(format!(
                "the node runs build {node}, the ELF file {} is {build}: flash it, or give the ELF that was flashed",
                image.file.display()
            ));
        }
        self.distrust(now);
    }

    fn trust_it(&mut self, now: Duration) {
        self.told = None;
        if self.trust == Trust::Same {
            return;
        }
        self.trust = Trust::Same;
        self.kept_bytes = 0;
        for (came, frame) in std::mem::take(&mut self.kept) {
            self.log_frame(came.min(now), frame);
        }
    }

    fn distrust(&mut self, now: Duration) {
        if self.trust == Trust::Other {
            return;
        }
        self.trust = Trust::Other;
        self.kept_bytes = 0;
        self.counts.log_unreadable += std::mem::take(&mut self.kept).len() as u64;
        self.merger.push(Channel::Log, None, false, now, Said::Unreadable);
    }

    /// No word of the node says which build it runs: what was seen of its flash decides, else the user is believed.
    fn settle(&mut self, now: Duration) {
        match self.trust {
            Trust::Open { flash: Some(false), .. } => {
                if let Some(image) = &self.image {
                    let build = image.build.map_or_else(String::new, |build| format!(" (build {build})"));
                    self.notes.push_back(format!(
                        "the chip's flash does not hold the ELF file {}{build}: flash it, or give the ELF that was flashed",
                        image.file.display()
                    ));
                }
                self.distrust(now);
            }
            Trust::Open { .. } => self.trust_it(now),
            Trust::Same | Trust::Other => {}
        }
    }

    /// Another image may run from here on.
    fn doubt(&mut self) {
        if self.image.as_ref().is_some_and(|image| image.build.is_some()) && self.kept.is_empty() {
            self.trust = OPEN;
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

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::time::Duration;

    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;
    use telemetry::Message;

    use super::super::image::Image;
    use super::super::merge::Patience;
    use super::super::source::{Channel, Event};
    use super::super::testing::{BUILD, OTHER_BUILD, elf, fix, frame, hello, told};
    use super::{Said, Session};

    const fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    fn image(build: Option<[u8; 8]>) -> Image {
        Image::parse(Path::new("image.elf"), &elf(build)).expect("an image")
    }

    fn session(image: Option<Image>, patience: Patience) -> Session {
        Session::new(image, Box::new(|_| None), patience)
    }

    fn log(session: &mut Session, now: Duration, t_us: u64, argument: u8) {
        session.accept(now, Event::Bytes(Channel::Log, frame(1, t_us, &[argument])));
    }

    fn tell(session: &mut Session, now: Duration, message: &Message) {
        session.accept(now, Event::Bytes(Channel::Telemetry, told(message)));
    }

    /// What is said, in short.
    fn said(session: &mut Session, now: Duration) -> Vec<String> {
        let short = |said| match said {
            Said::Log(line) => line.text,
            Said::Message(message) => format!("{} {}", message.kind(), message.t_us()),
            Said::Text(text) => text,
            Said::Unreadable => "unreadable".into(),
        };
        std::iter::from_fn(|| session.next(now)).map(short).collect()
    }

    fn notes(session: &mut Session) -> Vec<String> {
        std::iter::from_fn(|| session.note()).collect()
    }

    #[test]
    fn the_log_waits_for_the_nodes_word_and_comes_in_its_order() {
        let mut session = session(Some(image(Some(BUILD))), Patience::LIVE);
        log(&mut session, ms(0), 100, 1);
        tell(&mut session, ms(1), &fix(150, 1.0));
        assert!(said(&mut session, ms(1000)).is_empty());
        tell(&mut session, ms(1500), &hello(200, BUILD));
        log(&mut session, ms(1501), 180, 2);
        assert_eq!(said(&mut session, ms(1501)), ["hello 1", "fix 150", "hello 2"]);
        assert_eq!(said(&mut session, ms(1701)), ["hello 200"]);
        assert!(notes(&mut session).is_empty());
    }

    #[test]
    fn a_wrong_elf_file_is_said_in_one_sentence_and_telemetry_goes_on() {
        let mut session = session(Some(image(Some(BUILD))), Patience::LIVE);
        log(&mut session, ms(0), 100, 1);
        for round in 0..3 {
            tell(&mut session, ms(1), &hello(200 + round, OTHER_BUILD));
            log(&mut session, ms(2), 300, 2);
        }
        tell(&mut session, ms(3), &fix(400, 1.0));
        assert_eq!(said(&mut session, ms(500)), ["unreadable", "hello 200", "hello 201", "hello 202", "fix 400"]);
        assert_eq!(
            notes(&mut session),
            [
                "the node runs build 3c4d000000000001, the ELF file image.elf is 1a2b3c4d5e6f7081: flash it, or give the ELF that \
              was flashed"
            ]
        );
        assert_eq!((session.counts().log_unreadable, session.counts().log_lines, session.counts().fixes), (4, 0, 1));

        // It is flashed.
        session.accept(ms(600), Event::Restarted);
        tell(&mut session, ms(601), &hello(1, BUILD));
        log(&mut session, ms(602), 2, 3);
        assert_eq!(said(&mut session, ms(900)), ["hello 1", "hello 3"]);
        assert_eq!(notes(&mut session), ["the node has restarted"]);
    }

    #[test]
    fn an_elf_file_that_was_built_anew_is_read_again() {
        let newer = || Some(Ok(image(Some(OTHER_BUILD))));
        let mut session = Session::new(Some(image(Some(BUILD))), Box::new(move |_| newer()), Patience::LIVE);
        tell(&mut session, ms(0), &hello(1, OTHER_BUILD));
        log(&mut session, ms(0), 2, 1);
        assert_eq!(said(&mut session, ms(300)), ["hello 1", "hello 1"]);
        assert_eq!(notes(&mut session), ["image.elf has been built anew, and is the node's again"]);
    }

    #[test]
    fn a_node_that_does_not_say_who_it_is_is_believed_to_be_the_elf_files() {
        let mut live = session(Some(image(Some(BUILD))), Patience::LIVE);
        log(&mut live, ms(0), 1, 1);
        assert!(said(&mut live, ms(2999)).is_empty());
        assert_eq!(said(&mut live, ms(3000)), ["hello 1"]);

        let mut files = session(Some(image(Some(BUILD))), Patience::FILES);
        log(&mut files, ms(0), 1, 1);
        assert!(said(&mut files, ms(60_000)).is_empty());
        files.accept(ms(60_000), Event::End);
        assert_eq!(said(&mut files, ms(60_000)), ["hello 1"]);
    }

    #[test]
    fn flash_tells_before_the_node_does() {
        let mut same = session(Some(image(Some(BUILD))), Patience::LIVE);
        same.accept(ms(0), Event::Connected("chip".into()));
        same.accept(ms(0), Event::Flashed { same: true });
        log(&mut same, ms(0), 1, 1);
        assert_eq!(said(&mut same, ms(200)), ["hello 1"]);

        let mut other = session(Some(image(Some(BUILD))), Patience::LIVE);
        other.accept(ms(0), Event::Flashed { same: false });
        log(&mut other, ms(0), 1, 1);
        assert!(said(&mut other, ms(200)).is_empty());
        assert_eq!(said(&mut other, ms(3200)), Vec::<String>::new());
        assert_eq!(said(&mut other, ms(3400)), ["unreadable"]);
        assert_eq!(
            notes(&mut other),
            [
                "the chip's flash does not hold the ELF file image.elf (build 1a2b3c4d5e6f7081): flash it, or give the ELF that was \
              flashed"
            ]
        );
    }

    #[test]
    fn without_an_elf_file_there_is_a_hint_and_telemetry() {
        let mut session = session(None, Patience::LIVE);
        tell(&mut session, ms(0), &hello(1, BUILD));
        log(&mut session, ms(0), 2, 1);
        log(&mut session, ms(0), 3, 1);
        assert_eq!(said(&mut session, ms(200)), ["hello 1"]);
        assert_eq!(
            notes(&mut session),
            ["the node writes a log as well: --elf FILE, the ELF file that was flashed, shows it"]
        );
        assert_eq!(session.counts().log_unreadable, 2);
    }

    #[test]
    fn an_image_that_is_none_of_ours_is_read_with_a_word_of_warning() {
        let mut session = session(Some(image(None)), Patience::LIVE);
        log(&mut session, ms(0), 2, 1);
        assert_eq!(said(&mut session, ms(200)), ["hello 1"]);
        assert_eq!(
            notes(&mut session),
            ["image.elf has no build of ours (no section .baliza.build): whether it is the node's cannot be told"]
        );
    }

    #[test]
    fn what_a_lost_connection_cuts_is_counted_and_spoils_nothing_after_it() {
        let mut session = session(Some(image(Some(BUILD))), Patience::LIVE);
        session.accept(ms(0), Event::Connected("port".into()));
        tell(&mut session, ms(0), &hello(1, BUILD));
        let (line, place) = (frame(1, 5, &[1]), told(&fix(6, 1.0)));
        session.accept(ms(1), Event::Bytes(Channel::Log, line[..4].to_vec()));
        session.accept(ms(1), Event::Bytes(Channel::Telemetry, place[..9].to_vec()));
        session.accept(ms(2), Event::Lost("the cable is gone".into()));
        session.accept(ms(3), Event::Connected("port".into()));
        tell(&mut session, ms(4), &hello(7, BUILD));
        session.accept(ms(5), Event::Bytes(Channel::Log, frame(1, 8, &[2])));
        session.accept(ms(5), Event::Bytes(Channel::Telemetry, place));
        assert_eq!(said(&mut session, ms(300)), ["hello 1", "fix 6", "hello 7", "hello 2"]);
        let counts = session.counts();
        assert_eq!((counts.log_malformed, counts.telemetry.lost_bytes, counts.lost, counts.restarts), (1, 9, 1, 0));
        assert_eq!(
            notes(&mut session),
            [
                "connected to port",
                "connection lost (the cable is gone); it is sought again until Ctrl-C",
                "connected again to port"
            ]
        );
    }

    #[test]
    fn a_clock_that_falls_back_is_a_restart() {
        let mut session = session(Some(image(Some(BUILD))), Patience::FILES);
        for life in 0..3 {
            tell(&mut session, ms(0), &hello(1000, BUILD));
            log(&mut session, ms(0), 2000, life);
            tell(&mut session, ms(0), &fix(9_000_000, 1.0));
            log(&mut session, ms(0), 9_000_001, life);
        }
        session.accept(ms(0), Event::End);
        let life =
            |life: u8| ["hello 1000".into(), format!("hello {life}"), "fix 9000000".into(), format!("hello {life}")];
        assert_eq!(said(&mut session, ms(0)), [life(0), life(1), life(2)].concat());
        assert_eq!((session.counts().restarts, notes(&mut session).len()), (2, 2));
    }

    #[test]
    fn random_bytes_on_both_channels_are_counted_and_do_no_harm() {
        let mut random = Pcg64::seed_from_u64(3);
        let mut session = session(Some(image(Some(BUILD))), Patience::LIVE);
        tell(&mut session, ms(0), &hello(1, BUILD));
        for now in 0..500 {
            for channel in [Channel::Log, Channel::Telemetry] {
                let bytes = (0..200).map(|_| random.random()).collect();
                session.accept(ms(now), Event::Bytes(channel, bytes));
            }
            while session.next(ms(now)).is_some() {}
        }
        let counts = session.counts();
        // One byte in 256 ends a frame: of 100 000, some 390 on each channel.
        assert!((300..500).contains(&(counts.log_malformed + counts.log_lines)), "{counts:?}");
        assert!(counts.telemetry.lost_bytes > 90_000 && counts.lost_frames() > 600, "{counts:?}");
        assert_eq!(counts.fixes, 0);
    }
}
