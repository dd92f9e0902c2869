//! What a tag does with messages of hosts.

use embassy_sync::blocking_mutex::raw::RawMutex;
use ranging::exchange::ReceivedMessage;
use wire::config::MAX_RATE_CHZ;
use wire::uwb::native::{Answer, Command};

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
            Some(Command::Data(_)) => channels.put_message(message.data),
            Some(Command::Identify(seconds)) => {
                sink.identify(sink.now_us() + u64::from(seconds) * 1_000_000);
                Answer::Taken
            }
            // Anybody could make a battery empty.
            Some(Command::Rate(_)) if !is_trusted => Answer::NeedsKey,
            Some(Command::Rate(chz)) if chz <= MAX_RATE_CHZ => {
                channels.ask_rate(chz);
                Answer::Taken
            }
            Some(Command::Rate(_)) | None => Answer::Unknown,
        };
        if answer == Answer::Taken && !self.known.contains(&id) {
            self.known.rotate_right(1);
            self.known[0] = id;
        }
        channels.answer(message.data.number(), answer);
    }
}
