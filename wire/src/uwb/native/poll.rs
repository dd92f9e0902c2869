//! Polls: a tag asks anchors to answer, and says what hosts want to know. A poll that asks nobody, or one anchor for a word
//! on its lease, is a blink: anchors measure when it arrives.

use heapless::Vec;

use super::{Distance, MAX_BLINKS, POLL, PolledPosition, UserData};
use crate::uwb::layout::Layout;
use crate::uwb::{FrameBuffer, FrameError, MAX_ROUND, Reader};

/// Options of a poll. Not distances and a position: it would be longer than the slots have room for.
const WITH_DISTANCES: u8 = 1;
const WITH_POSITION: u8 = 2;
const WITH_DATA: u8 = 4;
const IS_BLINK: u8 = 8;

/// A tag asks anchors to answer, each in its slot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Poll {
    /// Number of the round: responses repeat it.
    pub round: u16,
    /// The tag's request for the network's layout.
    pub wish: Layout,
    /// The anchors that are to answer, in the order of the slots.
    pub anchors: Vec<Asked, MAX_ROUND>,
    /// The tag's last position, for anchors that report it to their hosts. A poll with distances carries none.
    pub position: Option<PolledPosition>,
    /// Data of the tag's user, for the hosts of anchors.
    pub data: Option<UserData>,
    /// Of a blink, which of its slot's blinks it is, from 1 on. One anchor may be asked, in the place of a round's last
    /// response.
    pub part: Option<u8>,
}

/// An anchor that a poll names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asked {
    /// Its short address.
    pub address: u16,
    /// The distance to it: a tag's last distance, for anchors that use it, or an anchor's mean, for tags that listen. A
    /// poll carries all distances or none.
    pub distance: Distance,
}

impl Poll {
    /// Parses what follows the code.
    #[inline]
    pub(super) fn parse(mut reader: Reader<'_>) -> Result<Self, FrameError> {
        let round = reader.u16()?;
        let [count, options] = reader.u8().map(|byte| [byte >> 4, byte & 0x0F])?;
        let exclusive = WITH_DISTANCES | WITH_POSITION;
        let is_blink = options & IS_BLINK != 0;
        if options & exclusive == exclusive || is_blink && options & exclusive != 0 {
            return Err(FrameError::Field);
        }
        let wish = Layout::from_tag_byte(reader.u8()?);
        let part = if is_blink { Some(reader.u8()?) } else { None };
        let mut anchors = Vec::new();
        for _ in 0..count {
            anchors
                .push(Asked { address: reader.u16()?, distance: Distance::Unsent })
                .map_err(|_| FrameError::Field)?;
        }
        if options & WITH_DISTANCES != 0 {
            for asked in &mut anchors {
                asked.distance = match reader.u16()? as i16 {
                    i16::MIN => Distance::Unknown,
                    units => Distance::Quarters(units),
                };
            }
        }
        let position = if options & WITH_POSITION != 0 { Some(PolledPosition(reader.take()?)) } else { None };
        let data = if options & WITH_DATA != 0 { Some(UserData::parse(&mut reader)?) } else { None };
        reader.end()?;
        let poll = Self { round, wish, anchors, position, data, part };
        let is_right = match part {
            Some(part) => (1..=MAX_BLINKS).contains(&part) && poll.anchors.len() <= 1,
            None => (1..=MAX_ROUND - poll.first_slot()).contains(&poll.anchors.len()),
        };
        if is_right { Ok(poll) } else { Err(FrameError::Field) }
    }

    /// The slot in which the first anchor answers. A poll with data is longer, by less than the time from one response
    /// to the next: the first slot stays free. Blinks come at the distance of responses: the later one is, the sooner comes
    /// the place of the last response.
    #[inline]
    pub fn first_slot(&self) -> usize {
        match self.part {
            Some(part) => MAX_ROUND - usize::from(part),
            None => self.data.is_some().into(),
        }
    }

    #[inline]
    pub(super) fn emit(&self, out: &mut FrameBuffer) {
        let with_distances = self.anchors.iter().any(|asked| asked.distance != Distance::Unsent);
        let position = self.position.filter(|_| !with_distances);
        let content = match position {
            Some(_) => WITH_POSITION,
            None if with_distances => WITH_DISTANCES,
            None => 0,
        };
        let options = if self.data.is_some() { content | WITH_DATA } else { content };
        let options = if self.part.is_some() { options | IS_BLINK } else { options };
        out.put(&[POLL]);
        out.put(&self.round.to_le_bytes());
        out.put(&[(self.anchors.len() as u8) << 4 | options, self.wish.tag_byte()]);
        self.part.into_iter().for_each(|part| out.put(&[part]));
        for asked in &self.anchors {
            out.put(&asked.address.to_le_bytes());
        }
        for asked in self.anchors.iter().filter(|_| with_distances) {
            let units = match asked.distance {
                Distance::Unsent | Distance::Unknown => i16::MIN,
                Distance::Quarters(units) => units,
            };
            out.put(&units.to_le_bytes());
        }
        if let Some(position) = position {
            out.put(&position.0);
        }
        if let Some(data) = &self.data {
            data.emit(out);
        }
    }
}
