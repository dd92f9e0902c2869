//! Messages of a host to a tag: a gateway's sync frames carry them from anchor to anchor, and to the tag.

use super::{Carried, Relayed, UserData};

/// A message to a tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Downlink {
    /// Short address of the tag.
    pub tag: u16,
    /// Short address of the gateway that sends it.
    pub gateway: u16,
    /// Superframes for which anchors keep it; the newer of two messages has more left.
    pub left: u16,
    /// What its bytes are: [`Downlink::command`].
    pub kind: u8,
    /// Its number, which the tag's answer repeats, and its bytes.
    pub data: UserData,
}

/// What a message says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TagCommand<'d> {
    /// Up to [`UserData::MOST`] bytes for the tag's program, at least one.
    Data(&'d [u8]),
    /// The tag shows where it is, by its light, for this many seconds.
    Identify(u8),
    /// The tag ranges this often from now on until it restarts, rounds in 100 s; 0: as its record says.
    Rate(u32),
}

/// What became of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Answer {
    /// The tag does it, or its program has the bytes.
    Taken,
    /// The tag does not know such messages, or what it asks for is not possible.
    Unknown,
    /// The network has no key, so anybody could ask for this.
    NeedsKey,
    /// The tag's program has not taken earlier ones yet.
    Full,
}

impl Answer {
    const ALL: [Self; 4] = [Self::Taken, Self::Unknown, Self::NeedsKey, Self::Full];

    /// The answer with this code; one of a newer build is [`Answer::Unknown`].
    pub fn from_code(code: u8) -> Self {
        Self::ALL.get(usize::from(code)).copied().unwrap_or(Self::Unknown)
    }
}

impl Downlink {
    const DATA: u8 = 0;
    const IDENTIFY: u8 = 1;
    const RATE: u8 = 2;

    /// A message with this number, before a gateway sends it; `None` for no bytes, or more than [`UserData::MOST`].
    pub fn new(tag: u16, number: u8, command: TagCommand<'_>) -> Option<Self> {
        let (kind, data) = match command {
            TagCommand::Data(bytes) => (Self::DATA, UserData::new(number, bytes)?),
            TagCommand::Identify(seconds) => (Self::IDENTIFY, UserData::new(number, &[seconds])?),
            TagCommand::Rate(chz) => (Self::RATE, UserData::new(number, &chz.to_le_bytes())?),
        };
        Some(Self { tag, gateway: 0, left: 0, kind, data })
    }

    /// What tells it from other messages to its tag.
    pub const fn id(&self) -> (u8, u8) {
        (self.kind, self.data.number())
    }

    /// What it says; `None` of a kind that this build does not know.
    pub fn command(&self) -> Option<TagCommand<'_>> {
        match (self.kind, self.data.bytes()) {
            (Self::DATA, bytes) => Some(TagCommand::Data(bytes)),
            (Self::IDENTIFY, [seconds]) => Some(TagCommand::Identify(*seconds)),
            (Self::RATE, bytes) => bytes.try_into().ok().map(|chz| TagCommand::Rate(u32::from_le_bytes(chz))),
            _ => None,
        }
    }
}

/// As sync frames carry it.
impl From<Downlink> for Relayed {
    fn from(Downlink { tag, gateway, left, kind, data }: Downlink) -> Self {
        Self { tag, round: gateway, at: left, asked: kind, content: Carried::Downlink(data) }
    }
}

impl Relayed {
    /// The message to a tag that this is.
    pub fn downlink(&self) -> Option<Downlink> {
        let Self { tag, round: gateway, at: left, asked: kind, content: Carried::Downlink(data) } = *self else {
            return None;
        };
        Some(Downlink { tag, gateway, left, kind, data })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_comes_back_as_it_was_and_one_of_a_newer_build_is_unknown() {
        for command in [TagCommand::Data(b"door 3"), TagCommand::Identify(30), TagCommand::Rate(1_000)] {
            let message = Downlink::new(7, 200, command).expect("it fits");
            let Downlink { tag, data, .. } = message;
            assert_eq!((tag, data.number(), message.command()), (7, 200, Some(command)));
            let sent = Downlink { gateway: 3, left: 6_000, ..message };
            assert_eq!(Relayed::from(sent).downlink(), Some(sent));
            assert_eq!(Downlink { kind: 15, ..message }.command(), None);
        }
        assert_eq!(Downlink::new(7, 0, TagCommand::Data(&[])), None);
        assert_eq!(Downlink::new(7, 0, TagCommand::Data(&[1; UserData::MOST + 1])), None);
        let identify = Downlink::new(7, 0, TagCommand::Identify(1)).expect("it fits");
        assert_eq!(Downlink { kind: Downlink::RATE, ..identify }.command(), None, "a byte is no rate");
        assert_eq!([0, 1, 2, 3, 9].map(Answer::from_code)[3..], [Answer::Full, Answer::Unknown]);
    }
}
