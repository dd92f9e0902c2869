//! The sans-I/O interface between an exchange and its node: what the exchange requests, and what the node answers.
//!
//! A [`Protocol`] is one side of an exchange, the tag's or the anchor's. The node steps it with the time and an
//! [`Event`], and it returns an [`Action`]. Every action but one is one call of [`Radio`](crate::Radio), a wait or a
//! sleep. The remaining one, a [`Report`], is for the node itself. [`node::run`](crate::node::run) is the loop that
//! executes the actions.
//!
//! Every reception has a window and every wait has an end. So an exchange always goes on, whatever frame is lost.

use crate::native::Rate;
use crate::radio::Sensors;
use crate::{Diagnostics, Pace, RadioDuration, RadioInstant, RxFrame, StampModel, Start};
use wire::uwb::native::{Downlink, PolledPosition, UserData};

pub use wire::telemetry::ArrivedFrame;

/// How long [`Action::Compensate`] takes at most: twice what a DWM1001 needs.
pub(crate) const COMPENSATION: RadioDuration = RadioDuration::from_micros(3_000);

/// The result of the last action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'b> {
    /// The radio was started, was restarted after an error, or has slept. Everything known of its clock is void. This
    /// is the first event of a protocol.
    Started,
    /// The frame left at this instant.
    Sent(RadioInstant),
    /// The frame did not leave, or this is not known ([`TransmitError`](crate::TransmitError)'s `TooLong`,
    /// `NoConfirmation`).
    NotSent,
    /// A frame was received.
    Received(RxFrame<'b>),
    /// A frame was received with errors.
    Corrupt,
    /// The reception's window passed.
    Timeout,
    /// The start of a transmission or reception lay in the past: nothing was done.
    Late,
    /// The wait has reached its instant, or the radio has finished what was requested.
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
        /// When to send it.
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
    /// The radio may sleep and lose its clock. The next event is [`Event::Started`] if it slept, [`Event::Woken`] if
    /// it did not.
    Sleep {
        /// Start of the sleep.
        from: RadioInstant,
        /// Length of the sleep from that start. It may be minutes, which is more than instants can distinguish.
        duration: RadioDuration,
    },
    /// [`Radio::compensate`](crate::Radio::compensate); the next event is [`Event::Woken`].
    Compensate,
    /// Something for the node itself; nothing is done with the radio.
    Report(Report<'m>),
}

/// What a protocol reports to its node.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Report<'m> {
    /// A round of ranging is over. It contains the measured ranges, at most one an anchor, perhaps none.
    Round(Round<'m>),
    /// A round among anchors was received. It contains how much farther each answering anchor is than the asking one,
    /// perhaps for no anchor.
    Differences(Differences<'m>),
    /// A tag's poll was received, which carries what is for hosts.
    Polled(&'m Polled),
    /// A frame has arrived at an anchor whose host computes the positions of tags.
    Arrival(Arrival),
    /// A host's message to this tag.
    Downlink(&'m ReceivedMessage),
    /// A change of state.
    Link(Link),
}

/// A host's message to a tag, as the tag received it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReceivedMessage {
    /// The message.
    pub message: Downlink,
    /// Nobody can have forged it: it came with a code, or from the host itself.
    pub is_trusted: bool,
}

/// What a tag's poll carries for hosts, as an anchor received it, asked or not, or as other anchors passed it on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Polled {
    /// Short address of the tag.
    pub tag: u16,
    /// Number of the poll's round, as the tag counts it.
    pub round: u16,
    /// Anchors that were asked.
    pub asked: u8,
    /// How long ago another anchor received it, which passed it on; zero of an own reception.
    pub age: RadioDuration,
    /// The tag's position.
    pub position: Option<PolledPosition>,
    /// Data of the tag's user.
    pub data: Option<UserData>,
}

/// When a frame arrived at an anchor: [`wire::telemetry::Arrival`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Arrival {
    /// Short address of the sender.
    pub source: u16,
    /// Of a blink: its number, as the tag counts. Of a sync frame: its superframe.
    pub number: u16,
    /// What arrived.
    pub frame: ArrivedFrame,
    /// When, in this radio's clock, corrected for the bias by received power; of an own sync frame: when it left.
    pub instant: RadioInstant,
    /// Received power, dBm; NaN if it is not known.
    pub rx_power_dbm: f32,
    /// Power of the first path, dBm; NaN if it is not known.
    pub first_path_power_dbm: f32,
}

/// One round of ranging.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Round<'m> {
    /// Counts the rounds of this protocol, wrapping.
    pub number: u16,
    /// When the poll left, in this radio's clock. For an anchor's protocol: when the poll arrived.
    pub poll: RadioInstant,
    /// Peers that were asked.
    pub asked: u8,
    /// The measured ranges.
    pub ranges: &'m [Range],
}

/// The distance to a peer.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range {
    /// Short address of the peer. For a tag the peer is the anchor; for an anchor it is the tag.
    pub peer: u16,
    /// Metres, corrected for the bias by received power. Negative values occur at short range.
    pub distance_m: f32,
    /// Its expected standard deviation with line of sight, metres.
    pub deviation_m: f32,
    /// The position that the peer reports, metres: only from anchors with a known position.
    pub position_m: Option<[f32; 3]>,
    /// What the receiver measured on the peer's last frame of the exchange.
    pub diagnostics: Diagnostics,
}

/// One round among anchors, received by a tag that only listens.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Differences<'m> {
    /// Counts the received rounds, wrapping.
    pub number: u16,
    /// When the poll came, in this radio's clock.
    pub poll: RadioInstant,
    /// Anchors that were asked.
    pub asked: u8,
    /// Short address of the anchor that asked.
    pub reference: u16,
    /// Position of the asking anchor, metres.
    pub reference_m: [f32; 3],
    /// Standard deviation that all differences of the round have in common, metres: that of the poll's timestamp.
    pub reference_deviation_m: f32,
    /// What the receiver measured on the poll.
    pub reference_diagnostics: Diagnostics,
    /// The measured differences, at most one for each anchor asked.
    pub differences: &'m [Difference],
}

/// How much farther an anchor is than the one that asked.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Difference {
    /// Short address of the anchor.
    pub peer: u16,
    /// Its distance minus that of the reference, metres.
    pub difference_m: f32,
    /// Standard deviation without the part that all differences of the round have in common, metres.
    pub deviation_m: f32,
    /// Position of the anchor, metres.
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
    /// DecaRanging: the peer was silent for too long; searching for one again.
    Lost(u16),
    /// Native: synchronised with the network that this anchor coordinates.
    Synchronised(u16),
    /// Native: no anchor was received for too long; searching.
    Unsynchronised,
    /// Native: the tag is a member and owns this many slots a superframe (as an average, rounded up).
    Joined(u8),
    /// Native: the tag requests slots, but the network has no place for a further member. Reported once, until the tag
    /// joins or searches again.
    NetworkFull,
    /// Native: the network's list has the tag no more. It requests slots again.
    Unlisted,
    /// Native: this anchor has become the coordinator of its network.
    Coordinating,
    /// Native: this anchor follows another coordinator again.
    Following(u16),
}

/// One side of an exchange.
pub trait Protocol {
    /// Takes the result of the last action, returns the next action.
    ///
    /// `now` is in the radio's clock and may be up to a few milliseconds old: for a received frame its arrival can be
    /// used, for a sent frame its departure. Steps must follow each other within 8 s, or begin with [`Event::Started`]
    /// again: the clock wraps after 17.2 s. After [`Action::Sleep`] the next step may come later.
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_>;

    /// Takes the radio's stamp model in force, before the step with the start event and after [`Action::Compensate`]. A
    /// frame that contains its own departure is snapped and delayed by it, and distances are corrected by its bias. It
    /// replaces the delay of the configuration. Without it the radio counts as one without steps and bias.
    fn calibrate(&mut self, stamps: &StampModel) {
        let _ = stamps;
    }

    /// Takes the radio's temperature and supply after [`Action::Compensate`].
    fn sense(&mut self, sensors: Sensors) {
        let _ = sensors;
    }

    /// Takes what the radio measured of the node's pace in the last action, before the step with the result of that
    /// action.
    fn pace(&mut self, pace: Pace) {
        let _ = pace;
    }

    /// Takes the node's current guidance. Protocols that do not need it ignore it.
    fn guide(&mut self, guidance: Guidance) {
        let _ = guidance;
    }

    /// What tells the data of the user that a tag's last poll carried ([`UserData::id`]), once for each poll. It is asked for
    /// beside [`Protocol::guide`] …
    fn carried(&mut self) -> Option<(bool, u8)> {
        None
    }

    /// … and then come the data for the next poll.
    fn carry(&mut self, data: Option<UserData>) {
        let _ = data;
    }

    /// Whether a host reads what the node reports: such an anchor is a gateway.
    fn set_host(&mut self, has_host: bool) {
        let _ = has_host;
    }

    /// A host's message to a tag, which a gateway is to send.
    fn send_down(&mut self, message: Downlink) {
        let _ = message;
    }

    /// Frames that were received and refused since the start, wrapping: they contradicted what the protocol knew of the
    /// network, or had no code where the network has a key. More than a few are a sign of forged frames.
    fn refused_frames(&self) -> u32 {
        0
    }

    /// Ends the last requested wait early because of new guidance. The next step is that of the end of the wait. If the
    /// radio slept, the protocol does not know for how long.
    fn rouse(&mut self, guidance: Guidance) {
        self.guide(guidance);
    }
}

/// For protocols in a `static`: an async function that took the protocol by value would copy it into its future.
impl<M: Protocol + ?Sized> Protocol for &mut M {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        (**self).step(now, event)
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        (**self).calibrate(stamps);
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

    fn carried(&mut self) -> Option<(bool, u8)> {
        (**self).carried()
    }

    fn send_down(&mut self, message: Downlink) {
        (**self).send_down(message);
    }

    fn carry(&mut self, data: Option<UserData>) {
        (**self).carry(data);
    }

    fn set_host(&mut self, has_host: bool) {
        (**self).set_host(has_host);
    }

    fn refused_frames(&self) -> u32 {
        (**self).refused_frames()
    }

    fn rouse(&mut self, guidance: Guidance) {
        (**self).rouse(guidance);
    }
}

/// The position that was computed of a round.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RoundFix {
    /// The round's number.
    pub round: u16,
    /// As a poll carries it.
    pub position: PolledPosition,
}

/// What a node passes to its protocol between steps.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Guidance {
    /// Position of the node, metres, if known: a tag chooses its next anchors by it.
    pub position_m: Option<[f32; 3]>,
    /// The position of a round for the tag's polls.
    pub fix: Option<RoundFix>,
    /// How often a tag is to range from now on; `None`: as before.
    pub rate: Option<Rate>,
    /// Whether the anchors of a round take turns in being the last one asked. The impulse response of each can then be
    /// read now and then ([`Radio::impulse_response`](crate::Radio::impulse_response)).
    pub turns: bool,
    /// How long the node will still compute with the rounds that it has. A tag that ranges as often as possible ends
    /// its next round no sooner.
    pub busy: RadioDuration,
    /// How long it computes with a round, in the mean.
    pub busy_per_round: RadioDuration,
}

impl Guidance {
    /// Nothing is known, nothing changes.
    pub const NONE: Self = Self {
        position_m: None,
        fix: None,
        rate: None,
        turns: false,
        busy: RadioDuration::ZERO,
        busy_per_round: RadioDuration::ZERO,
    };
}
