//! Messages of hosts to this tag.

use crate::exchange::ReceivedMessage;
use wire::serial_number::SerialNumber;
use wire::uwb::native::{Downlink, Relayed, SyncFrame};

/// A message that comes again within this many superframes was repeated by other anchors, which have not received the tag's
/// answer yet.
const REPEATED_WITHIN: u16 = 20;

/// The message that the tag received last.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Inbox {
    /// As long as the node does not know it.
    pub(super) waiting: Option<ReceivedMessage>,
    /// The one that the node knows.
    pub(super) reported: Option<ReceivedMessage>,
    /// The superframe in which the last one came.
    received: u16,
}

impl Inbox {
    /// A sync frame of the followed network, with or without a code, may have a message to the tag with this address.
    #[inline(never)]
    pub(super) fn receive(&mut self, address: u16, has_code: bool, sync_frame: &SyncFrame) {
        let Some(relay) = &sync_frame.relay else { return };
        for message in relay.entries.iter().filter(|entry| entry.tag == address).filter_map(Relayed::downlink) {
            let since = SerialNumber(sync_frame.superframe).steps_from(self.received);
            let is_the_same = |known: &ReceivedMessage| known.message.id() == message.id();
            if since >= REPEATED_WITHIN || !self.waiting.iter().chain(&self.reported).any(is_the_same) {
                self.received = sync_frame.superframe;
                self.put(message, has_code);
            }
        }
    }

    /// A message has come.
    pub(super) fn put(&mut self, message: Downlink, is_trusted: bool) {
        self.waiting = Some(ReceivedMessage { message, is_trusted });
    }
}
