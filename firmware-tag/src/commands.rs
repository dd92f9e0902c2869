//! What a tag does with messages of hosts.

use embassy_sync::blocking_mutex::raw::RawMutex;
use ranging::exchange::ReceivedMessage;
use wire::config::MAX_RATE_CHZ;
use wire::uwb::native::{Answer, TagCommand};

use crate::{Sink, TaskChannels};

/// Messages that are known when they come again: another anchor has not received the answer.
const KNOWN: usize = 4;

/// The messages that were done last, by what tells them from others.
#[derive(Default)]
pub(crate) struct Commands {
    known: [Option<(u8, u8)>; KNOWN],
}

impl Commands {
    /// Does what a message says, unless it was done before, and answers it.
    #[cold]
    #[inline(never)]
    pub(crate) fn obey<M: RawMutex>(
        &mut self,
        received: &ReceivedMessage,
        channels: &TaskChannels<M>,
        sink: &impl Sink,
    ) {
        let ReceivedMessage { message, is_trusted } = received;
        let id = Some(message.id());
        let answer = match message.command() {
            _ if self.known.contains(&id) => Answer::Taken,
            Some(TagCommand::Data(_)) => channels.put_message(message.data),
            Some(TagCommand::Identify(seconds)) => {
                sink.identify(sink.now_us() + u64::from(seconds) * 1_000_000);
                Answer::Taken
            }
            // Anybody could make a battery empty.
            Some(TagCommand::Rate(_)) if !is_trusted => Answer::NeedsKey,
            Some(TagCommand::Rate(chz)) if chz <= MAX_RATE_CHZ => {
                channels.ask_rate(chz);
                Answer::Taken
            }
            Some(TagCommand::Rate(_)) | None => Answer::Unknown,
        };
        if answer == Answer::Taken && !self.known.contains(&id) {
            self.known.rotate_right(1);
            self.known[0] = id;
        }
        channels.answer(message.data.number(), answer);
        // For a host at the tag's own cable.
        sink.answered(message, answer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TelemetrySink;
    use embassy_sync::blocking_mutex::raw::NoopRawMutex;
    use firmware_common::Reporter;
    use std::vec::Vec;
    use wire::telemetry::TagAnswer;
    use wire::uwb::native::Downlink;

    /// A tag five seconds after its start.
    struct Node {
        channels: TaskChannels<NoopRawMutex>,
        reporter: Reporter<NoopRawMutex, 512>,
        commands: Commands,
    }

    impl Node {
        fn new() -> Self {
            Self { channels: TaskChannels::new(), reporter: Reporter::new(|| 5_000_000), commands: Commands::default() }
        }

        /// Gives the tag a message. Returns its answer, which two polls carry.
        fn tell(&mut self, number: u8, command: TagCommand<'_>, is_trusted: bool) -> Answer {
            self.receive(Downlink::new(7, number, command).expect("it fits"), is_trusted)
        }

        fn receive(&mut self, message: Downlink, is_trusted: bool) -> Answer {
            let sink = TelemetrySink::new(&self.reporter, false);
            self.commands.obey(&ReceivedMessage { message, is_trusted }, &self.channels, &sink);
            let polls: Vec<_> = (0..2)
                .map(|poll| self.channels.data((poll > 0).then_some((true, message.data.number()))).expect("an answer"))
                .collect();
            assert!(polls.iter().all(|data| data.number() == message.data.number()));
            assert_eq!(self.channels.data(Some(polls[1].id())), None, "it was carried twice");
            let answer = polls[1].answer().expect("an answer");
            let mut told = Vec::new();
            self.reporter.event_log.drain(|frame| {
                told.push(wire::telemetry::decode(frame).expect("a frame"));
                true
            });
            let (tag, number, code) = (message.tag, message.data.number(), answer as u8);
            assert_eq!(told, [TagAnswer { t_us: 5_000_000, tag, number, age_us: 0, code }.into()]);
            answer
        }
    }

    #[test]
    fn the_light_shows_where_the_tag_is_for_as_long_as_asked() {
        let mut node = Node::new();
        assert_eq!(node.tell(1, TagCommand::Identify(30), false), Answer::Taken);
        let flashes = |t_us: u64| {
            (0..20).any(|look| !node.reporter.event_log.lit(t_us + 50_000 * look).state)
                && (0..20).filter(|look| node.reporter.event_log.lit(t_us + 50_000 * look).state).count() == 10
        };
        assert!(flashes(5_000_000) && flashes(33_000_000) && !flashes(35_000_000));
    }

    #[test]
    fn a_rate_is_taken_only_from_who_cannot_be_forged_and_once() {
        let mut node = Node::new();
        assert_eq!(node.tell(1, TagCommand::Rate(1_000), false), Answer::NeedsKey);
        assert_eq!(node.channels.asked_rate(), None);
        assert_eq!(node.tell(2, TagCommand::Rate(1_000), true), Answer::Taken);
        assert_eq!(node.channels.asked_rate(), Some(1_000));
        assert_eq!(node.tell(2, TagCommand::Rate(1_000), true), Answer::Taken, "by another anchor");
        assert_eq!(node.channels.asked_rate(), None, "it was done");
        assert_eq!(node.tell(3, TagCommand::Rate(MAX_RATE_CHZ + 1), true), Answer::Unknown);
        let newer = Downlink { kind: 9, ..Downlink::new(7, 4, TagCommand::Identify(1)).expect("it fits") };
        assert_eq!(node.receive(newer, true), Answer::Unknown);
    }

    #[test]
    fn data_wait_for_a_program_that_has_asked_for_some() {
        let mut node = Node::new();
        let program = |node: &Node| embassy_futures::poll_once(node.channels.next_message());
        assert_eq!(node.tell(1, TagCommand::Data(b"one"), false), Answer::Unknown, "nobody asks");
        assert!(program(&node).is_pending());
        assert_eq!(node.tell(2, TagCommand::Data(b"two"), false), Answer::Taken);
        assert_eq!(node.tell(3, TagCommand::Data(b"three"), false), Answer::Taken);
        assert_eq!(node.tell(4, TagCommand::Data(b"four"), false), Answer::Full);
        let received = |node: &Node| match program(node) {
            core::task::Poll::Ready(data) => Some(data.bytes().to_vec()),
            core::task::Poll::Pending => None,
        };
        assert_eq!(received(&node).as_deref(), Some(&b"two"[..]));
        // What was refused is taken when it comes again.
        assert_eq!(node.tell(4, TagCommand::Data(b"four"), false), Answer::Taken);
        assert_eq!(node.tell(4, TagCommand::Data(b"four"), false), Answer::Taken);
        assert_eq!([received(&node), received(&node)].map(Option::unwrap), [b"three".to_vec(), b"four".to_vec()]);
        assert_eq!(received(&node), None, "once");
    }
}
