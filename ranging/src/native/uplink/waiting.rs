//! Entries that wait for the next anchor on the way.

use wire::serial_number::SerialNumber;
use wire::uwb::native::{Carried, Relayed};

/// What tells an entry from others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reported {
    pub tag: u16,
    pub round: u16,
    pub is_data: bool,
}

impl Reported {
    pub(super) fn of(entry: &Relayed) -> Self {
        Self { tag: entry.tag, round: entry.round, is_data: is_data(entry) }
    }
}

/// An entry that waits until the next anchor has taken it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    pub entry: Relayed,
    /// The superframe and the round slot of its poll, if this anchor has received it.
    pub polled: Option<(u16, u8)>,
    /// When and for which anchor it was last sent, as long as that anchor may still say that it took it.
    pub sent: Option<Sending>,
}

/// Where an entry was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sending {
    /// The anchor for which it was.
    pub next: u16,
    pub superframe: u16,
    /// In a relay frame.
    pub is_in_relay_frame: bool,
}

impl Waiting {
    /// Whether it is to be sent in a superframe. The anchor to which it was sent before has said that it has taken it, or that
    /// was lost, in `patience` superframes after that one.
    pub(super) fn is_due(&self, superframe: u16, patience: u16, has_gateway: bool) -> bool {
        let since = |sent: Sending| SerialNumber(superframe).steps_from(sent.superframe);
        !(has_gateway && self.may_be_heard(superframe)) && self.sent.is_none_or(|sent| since(sent) > patience)
    }

    /// Whether a gateway nearby may still say that it has received the poll itself.
    pub(super) fn may_be_heard(&self, superframe: u16) -> bool {
        self.polled.is_some_and(|(polled, _)| SerialNumber(superframe).steps_from(polled) < 2)
    }
}

/// Whether an entry is data of a tag's user.
pub(super) const fn is_data(entry: &Relayed) -> bool {
    matches!(entry.content, Carried::Data(_))
}
