//! What an exchange asks of its node, and what the node answers: sans-I/O.
//!
//! A [`Protocol`] (the tag's or the anchor's side of an exchange) is stepped with the time and an [`Event`], and answers with an
//! [`Action`]. All but one action map one to one onto calls of [`Radio`](crate::Radio), a wait or a sleep; a [`Report`] is for the node
//! itself. [`node::run`](crate::node::run) is the loop that does them.
//!
//! Every reception has a window and every wait an end: an exchange never stands still, whatever is lost.

use crate::native::Rate;
use crate::radio::Sensors;
use crate::{Diagnostics, Pace, RadioDuration, RadioInstant, RxFrame, Start};

/// How long [`Action::Compensate`] takes at most: twice what a DWM1001 needs.
pub(crate) const COMPENSATION: RadioDuration = RadioDuration::from_micros(3_000);

/// What became of the last action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'b> {
    /// The radio was started, was restarted after an error, or has slept: what was known of its clock is void. The first event of a
    /// machine.
    Started,
    /// The frame left at this instant.
    Sent(RadioInstant),
    /// The frame did not leave, or nobody knows ([`TransmitError`](crate::TransmitError)'s `TooLong`, `NoConfirmation`).
    NotSent,
    /// A frame came.
    Received(RxFrame<'b>),
    /// A frame came broken.
    Corrupt,
    /// The reception's window passed.
    Timeout,
    /// The start of a transmission or reception lay in the past: nothing was done.
    Late,
    /// The instant waited for is there, or the radio is done with what it was asked.
    Woken,
    /// The report was taken.
    Reported,
}

/// What the node is to do next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action<'m> {
    /// [`Radio::transmit`](crate::Radio::transmit).
    Transmit {
        /// The frame, without its check bytes.
        frame: &'m [u8],
        /// When.
        start: Start,
        /// Whether the receiver is to be on as soon as the frame has left.
        listen: bool,
    },
    /// [`Radio::receive`](crate::Radio::receive).
    Receive {
        /// From when.
        start: Start,
        /// For how long.
        window: RadioDuration,
        /// Whether the receiver is to stay on after a frame.
        keep_listening: bool,
    },
    /// Radio off until this instant.
    WaitUntil(RadioInstant),
    /// The radio may sleep and lose its clock. The next event is [`Event::Started`] where it slept, [`Event::Woken`] where it did not.
    Sleep {
        /// Since when.
        from: RadioInstant,
        /// For how long from then: minutes, too, which instants do not tell apart.
        duration: RadioDuration,
    },
    /// [`Radio::compensate`](crate::Radio::compensate); the next event is [`Event::Woken`].
    Compensate,
    /// Something for the node itself; nothing is done with the radio.
    Report(Report<'m>),
}

/// What a machine tells its node.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Report<'m> {
    /// A round of ranging is over: the ranges had, at most one an anchor, perhaps none.
    Round(Round<'m>),
    /// A round among anchors was heard: by how much they are farther than the one that asked, perhaps for none of them.
    Differences(Differences<'m>),
    /// A change of state.
    Link(Link),
}

/// One round of ranging.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Round<'m> {
    /// Counts the rounds of this machine, wrapping.
    pub number: u16,
    /// When the poll left (an anchor's machine: came), in this radio's clock.
    pub poll: RadioInstant,
    /// Peers that were asked.
    pub asked: u8,
    /// The ranges had.
    pub ranges: &'m [Range],
}

/// The distance to a peer.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range {
    /// Short address of the peer: to a tag the anchor, to an anchor the tag.
    pub peer: u16,
    /// Metres, bias by received power corrected; negative values happen at short range.
    pub distance_m: f32,
    /// Standard deviation expected of it with line of sight, metres.
    pub deviation_m: f32,
    /// Where the peer says it stands, metres: anchors that know it.
    pub position_m: Option<[f32; 3]>,
    /// What the receiver measured on the peer's last frame of the exchange.
    pub diagnostics: Diagnostics,
}

/// One round among anchors, heard by a tag that only listens.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Differences<'m> {
    /// Counts the rounds heard, wrapping.
    pub number: u16,
    /// When the poll came, in this radio's clock.
    pub poll: RadioInstant,
    /// Anchors that were asked.
    pub asked: u8,
    /// Short address of the anchor that asked.
    pub reference: u16,
    /// Where it stands, metres.
    pub reference_m: [f32; 3],
    /// Standard deviation that all differences of the round have in common, metres: that of the poll's stamp.
    pub reference_deviation_m: f32,
    /// What the receiver measured on the poll.
    pub reference_diagnostics: Diagnostics,
    /// The differences had, at most one an anchor asked.
    pub differences: &'m [Difference],
}

/// How much farther an anchor is than the one that asked.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Difference {
    /// Short address of the anchor.
    pub peer: u16,
    /// Its distance less that of the reference, metres.
    pub difference_m: f32,
    /// Standard deviation beside what all differences of the round have in common, metres.
    pub deviation_m: f32,
    /// Where it stands, metres.
    pub position_m: [f32; 3],
    /// What the receiver measured on its answer.
    pub diagnostics: Diagnostics,
}

/// A change of a link or of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Link {
    /// DecaRanging: paired with this peer (its short address).
    Paired(u16),
    /// DecaRanging: the peer was not heard for too long; looking for one again.
    Lost(u16),
    /// Native: in step with the network that this anchor coordinates.
    Synchronised(u16),
    /// Native: no anchor was heard for too long; searching.
    Unsynchronised,
    /// Native: the tag is a member and owns this many slots a superframe (as an average, rounded up).
    Joined(u8),
    /// Native: the tag wants slots, and all places of the network are taken. Once, until it joins or searches again.
    NetworkFull,
    /// Native: this anchor has become the coordinator of its network.
    Coordinating,
    /// Native: this anchor follows another coordinator again.
    Following(u16),
}

/// One side of an exchange.
pub trait Protocol {
    /// Takes what became of the last action, answers with the next.
    ///
    /// `now` is in the radio's clock and may be up to a few milliseconds old: for a frame that came, its arrival serves; for one
    /// that left, its departure. Steps must follow each other within 8 s, or begin with [`Event::Started`] again: the clock
    /// wraps after 17.2 s. After [`Action::Sleep`] the next step may come later.
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_>;

    /// Takes the antenna delay in force, before the step that tells of the start, and after [`Action::Compensate`]: what a frame says of its
    /// own departure counts with it. It replaces what the machine was made with.
    fn calibrate(&mut self, antenna_delay: RadioDuration) {
        let _ = antenna_delay;
    }

    /// Takes the radio's temperature and supply after [`Action::Compensate`].
    fn sense(&mut self, sensors: Sensors) {
        let _ = sensors;
    }

    /// Takes what the radio measured of the node's pace in the last action, before the step that tells what became of the action.
    fn pace(&mut self, pace: Pace) {
        let _ = pace;
    }

    /// Takes what the node knows by now. Machines that do not care ignore it.
    fn guide(&mut self, guidance: Guidance) {
        let _ = guidance;
    }

    /// The wait that was asked for last ends before its time, because of what the node knows by now. The next step is that of its end;
    /// where the radio slept, nobody has told the machine for how long.
    fn rouse(&mut self, guidance: Guidance) {
        self.guide(guidance);
    }
}

/// For machines in a `static`: an async function that took the machine by value would copy it into its future.
impl<M: Protocol + ?Sized> Protocol for &mut M {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        (**self).step(now, event)
    }

    fn calibrate(&mut self, antenna_delay: RadioDuration) {
        (**self).calibrate(antenna_delay);
    }

    fn sense(&mut self, sensors: Sensors) {
        (**self).sense(sensors);
    }

    fn pace(&mut self, pace: Pace) {
        (**self).pace(pace);
    }

    fn guide(&mut self, guidance: Guidance) {
        (**self).guide(guidance);
    }

    fn rouse(&mut self, guidance: Guidance) {
        (**self).rouse(guidance);
    }
}

/// What a node tells its machine between steps.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Guidance {
    /// Where the node is, metres, where that is known: a tag chooses its next anchors by it.
    pub position_m: Option<[f32; 3]>,
    /// How often a tag is to range from now on; `None`: as before.
    pub rate: Option<Rate>,
    /// Whether anchors take turns in being the last that a round asks, so that the impulse response of each can be read now and
    /// then ([`Radio::impulse_response`](crate::Radio::impulse_response)).
    pub turns: bool,
    /// How long the node will still compute with the rounds that it has: a tag that ranges as often as it can ends its next round no
    /// sooner.
    pub busy: RadioDuration,
}

impl Guidance {
    /// Nothing is known, nothing is to change.
    pub const NONE: Self = Self { position_m: None, rate: None, turns: false, busy: RadioDuration::ZERO };
}
