//! What a tag does with received frames.

use super::schedule::Followed;
use super::{State, Tag};
use crate::RxFrame;
use crate::exchange::Link;
use crate::native::search::Search;
use crate::native::superframes::Superframes;
use crate::native::sync::{Sync, SyncUpdate};
use crate::native::timing::SYNC_SLOTS;
use wire::uwb::BROADCAST;
use wire::uwb::native::{Frame, Message, SyncFrame};

impl Tag {
    pub(super) fn receive(&mut self, frame: &RxFrame<'_>) {
        // By reference: a message takes hundreds of bytes, and each copy as many instructions.
        let parsed = Frame::parse(frame.bytes);
        let Some(told) = parsed.as_ref().ok().filter(|told| told.pan == self.config.network.pan) else { return };
        match &told.message {
            Message::SyncFrame(sync_frame) if told.destination == BROADCAST => {
                if self.anchors.believe(self.config.network.open_sync_frame(frame.bytes, sync_frame)).is_some() {
                    self.on_sync_frame(told.source, sync_frame, frame);
                }
            }
            Message::Response(response)
                if told.destination == self.config.address && self.state == State::Collecting =>
            {
                let opened = self.config.network.open_response(frame.bytes, self.round.sealed());
                if self.anchors.believe(opened).is_none() {
                    return;
                }
                let Some(network) = &mut self.network else { return };
                let Superframes { timing, phase, .. } = &network.sync.course;
                let range = self.round.receive(timing, &self.bias, &mut self.anchors, told.source, *response, frame);
                if range.is_some() {
                    if response.has_message {
                        self.watch.expect(told.source);
                    }
                    if response.passes_nothing_on
                        && let Some(anchor) = self.anchors.get_mut(told.source)
                    {
                        anchor.passes_nothing_on();
                    }
                    network.lease.answered(response.lease, phase.number);
                    network.sync.prove();
                }
            }
            // Messages for other tags, or not addressed to this tag.
            Message::SyncFrame(_)
            | Message::Response(_)
            | Message::Poll(_)
            | Message::Request(_)
            | Message::Final { .. }
            | Message::Challenge(_)
            | Message::RelayFrame(_) => {}
        }
    }

    fn on_sync_frame(&mut self, source: u16, sync_frame: &SyncFrame, frame: &RxFrame<'_>) {
        if usize::from(sync_frame.slot) >= SYNC_SLOTS {
            return;
        }
        let followed = &self.config.network;
        let slept = core::mem::take(&mut self.slept);
        let assumed = self.network.as_mut().filter(|_| !slept.is_none()).map(|network| {
            network.sync.advance(frame.rx_time);
            network.sync.course.phase
        });
        let heard = match &mut self.network {
            None => match Sync::new(followed, sync_frame, frame.rx_time) {
                Some(sync) => {
                    self.network = Some(Followed::begin(sync));
                    self.search = Search::default();
                    SyncUpdate::Anew
                }
                None => SyncUpdate::Ignored,
            },
            Some(network) => {
                if network.lease.turn().is_some() {
                    network.sync.wait_for_proof();
                }
                match network.sync.receive(followed, sync_frame, frame.rx_time) {
                    SyncUpdate::Anew => {
                        *network = Followed::begin(network.sync.clone());
                        SyncUpdate::Anew
                    }
                    heard => heard,
                }
            }
        };
        if !self.anchors.follows(heard) {
            self.slept = slept;
            return;
        }
        if heard.is_another() {
            self.link = Some(Link::Synchronised(sync_frame.coordinator));
        }
        self.aim = None;
        self.learn_leases(sync_frame);
        self.inbox.receive(self.config.address, self.config.network.key.is_some(), sync_frame);
        let phase = self.network.as_ref().map(|network| network.sync.course.phase);
        if let (Some(assumed), Some(phase)) = (assumed, phase)
            && assumed.number == phase.number
        {
            self.wakes.learn(slept, assumed.start.since(phase.start));
        }
        self.watch.receive(source, sync_frame.slot);
        self.anchors.on_sync_frame(source, sync_frame, frame.diagnostics.rx_power_dbm);
    }
}
