//! What tags told for hosts, on its way from anchor to anchor to one that has a host.

use heapless::Vec;

use super::{OWNED_SYNC_SLOTS, PolledPosition, RELAY, UserData};
use crate::uwb::{FrameBuffer, FrameError, Reader};

/// The most entries in a sync frame.
pub const MAX_RELAYED: usize = 2;
/// The most entries in a relay frame: as many positions as fit.
pub const MAX_IN_RELAY_FRAME: usize = 4;

/// What a sync frame says of the way to a gateway: an anchor with a host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Relay {
    /// How far the nearest gateway is: [`Relay::HOP`] for each hop without losses; 0 is a gateway itself.
    pub cost: u8,
    /// The sync slot of the anchor for which the entries are: the next one on the way. That of a gateway is its own.
    pub next: u8,
    /// Sync slots (bit i: slot i) whose entries the sender has taken. Those of the slots up to the second before its own
    /// came in this superframe, the others in the one before. The bit of its own slot says that it takes none now.
    pub taken: u16,
    /// Sync slots whose owners' relay frames of the superframe before the sender has taken. Only in a network that has relay
    /// slots.
    pub taken_frames: u16,
    /// Round slots (bit i: slot i) of the superframe before in which a gateway has received a poll itself: it needs no other
    /// anchor for what these polls carried.
    pub heard: u64,
    /// The entries.
    pub entries: Vec<Relayed, MAX_RELAYED>,
}

/// Further entries, for the next anchor on the way alone, in a relay slot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RelayFrame {
    /// The entries, at least one.
    pub entries: Vec<Relayed, MAX_IN_RELAY_FRAME>,
}

/// What a tag told in a poll, as an anchor passes it on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Relayed {
    /// Short address of the tag.
    pub tag: u16,
    /// Number of the poll's round, as the tag counts it.
    pub round: u16,
    /// When the poll came, in 1⁄256 of a superframe: the low byte of the superframe's number, and the part of it.
    pub at: u16,
    /// Anchors that the poll asked, at most 15.
    pub asked: u8,
    /// What it carried.
    pub content: Carried,
}

/// What a poll carries for hosts, one that carries both makes two entries; or what a host tells a tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Carried {
    /// The tag's position.
    Position(PolledPosition),
    /// Data of the tag's user.
    Data(UserData),
    /// A message to the tag: [`Relayed::downlink`]. The number of the round is the gateway's address, the time is for how
    /// many superframes it is kept, and the anchors asked are its kind.
    Downlink(UserData),
}

impl Relay {
    /// The cost of a hop without losses.
    pub const HOP: u8 = 8;
    /// Its length on the air without entries; two bytes more in a network that has relay slots, and these of a gateway.
    const BYTES: usize = 4;
    const HEARD_BYTES: usize = 8;

    #[inline]
    pub(super) fn parse(reader: &mut Reader<'_>, count: u8, has_relay_slots: bool) -> Result<Self, FrameError> {
        let ([cost, next], taken) = (reader.take()?, reader.u16()?);
        let taken_frames = if has_relay_slots { reader.u16()? } else { 0 };
        if usize::from(next) >= OWNED_SYNC_SLOTS {
            return Err(FrameError::Field);
        }
        let heard = if cost == 0 { u64::from_le_bytes(reader.take()?) } else { 0 };
        let mut entries = Vec::new();
        for _ in 0..count {
            entries.push(Relayed::parse(reader)?).map_err(|_| FrameError::Field)?;
        }
        Ok(Self { cost, next, taken, taken_frames, heard, entries })
    }

    #[inline]
    pub(super) fn emit(&self, out: &mut FrameBuffer, has_relay_slots: bool) {
        out.put(&[self.cost, self.next]);
        out.put(&self.taken.to_le_bytes());
        if has_relay_slots {
            out.put(&self.taken_frames.to_le_bytes());
        }
        if self.cost == 0 {
            out.put(&self.heard.to_le_bytes());
        }
        self.entries.iter().for_each(|entry| entry.emit(out));
    }

    pub(super) fn bytes(&self, has_relay_slots: bool) -> usize {
        let heard = if self.cost == 0 { Self::HEARD_BYTES } else { 0 };
        Self::BYTES
            + if has_relay_slots { 2 } else { 0 }
            + heard
            + self.entries.iter().map(Relayed::bytes).sum::<usize>()
    }
}

impl RelayFrame {
    #[inline]
    pub(super) fn parse(mut reader: Reader<'_>) -> Result<Self, FrameError> {
        let mut entries = Vec::new();
        while entries.is_empty() || !reader.0.is_empty() {
            entries.push(Relayed::parse(&mut reader)?).map_err(|_| FrameError::Field)?;
        }
        Ok(Self { entries })
    }

    #[inline]
    pub(super) fn emit(&self, out: &mut FrameBuffer) {
        out.put(&[RELAY]);
        self.entries.iter().for_each(|entry| entry.emit(out));
    }

    /// Bytes that are left.
    pub fn room(&self) -> usize {
        let used = self.entries.iter().map(Relayed::bytes).sum();
        (MAX_IN_RELAY_FRAME * Relayed::POSITION_BYTES).saturating_sub(used)
    }
}

impl Relayed {
    /// The length of a position's entry on the air.
    pub(super) const POSITION_BYTES: usize = Self::HEAD + PolledPosition::BYTES;
    const HEAD: usize = 7;
    const IS_DATA: u8 = 0x80;
    const IS_DOWNLINK: u8 = 0x40;
    const ASKED: u8 = 0x0F;

    #[inline]
    fn parse(reader: &mut Reader<'_>) -> Result<Self, FrameError> {
        let (tag, round, at, what) = (reader.u16()?, reader.u16()?, reader.u16()?, reader.u8()?);
        let content = match what & !Self::ASKED {
            0 => Carried::Position(PolledPosition(reader.take()?)),
            Self::IS_DATA => Carried::Data(UserData::parse(reader)?),
            Self::IS_DOWNLINK => Carried::Downlink(UserData::parse(reader)?),
            _ => return Err(FrameError::Field),
        };
        Ok(Self { tag, round, at, asked: what & Self::ASKED, content })
    }

    #[inline]
    fn emit(&self, out: &mut FrameBuffer) {
        out.put(&self.tag.to_le_bytes());
        out.put(&self.round.to_le_bytes());
        out.put(&self.at.to_le_bytes());
        let asked = self.asked.min(Self::ASKED);
        let (is, data) = match &self.content {
            Carried::Position(position) => {
                out.put(&[asked]);
                return out.put(&position.0);
            }
            Carried::Data(data) => (Self::IS_DATA, data),
            Carried::Downlink(data) => (Self::IS_DOWNLINK, data),
        };
        out.put(&[asked | is]);
        data.emit(out);
    }

    /// Its length on the air.
    pub fn bytes(&self) -> usize {
        let content = match &self.content {
            Carried::Position(_) => PolledPosition::BYTES,
            Carried::Data(data) | Carried::Downlink(data) => 2 + data.bytes().len(),
        };
        Self::HEAD + content
    }
}
