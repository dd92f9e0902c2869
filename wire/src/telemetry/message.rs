//! The messages, as they go over the wire: quantised, so that they are short, with accessors in SI units.
//!
//! Variants and fields are append-only: a variant's number is its place in the enumeration, and never changes. What cannot be
//! kept so takes another [`SCHEMA`](crate::telemetry::SCHEMA) number.

pub use crate::config::Board;
use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Deserializer, Serialize};

/// What a node tells.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Message {
    /// Who is speaking: sent at the start and every few seconds, so that a listener who comes late knows.
    Hello(Hello),
    /// A position, or why there is none.
    Fix(Fix),
    /// A range of a round.
    Range(Range),
    /// An advertisement heard.
    Sighting(Sighting),
    /// A change of the node's state.
    State(State),
    /// What was counted since the start.
    Counters(Counters),
    /// Why the node started.
    Reset(Reset),
    /// A difference of arrivals of a round that was overheard.
    Difference(Difference),
    /// In which room a tag is.
    Room(Room),
}

/// Who is speaking.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hello {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// The chip's EUI-64, or the record's.
    pub eui: u64,
    /// Short address.
    pub address: u16,
    /// Its role.
    pub role: Role,
    /// Its board.
    pub board: Board,
    /// The build: made of the commit and the sources when the image is built. An ELF file has the same bytes in its section `.baliza.build`.
    pub build: [u8; 8],
}

/// What a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Role {
    /// Positions itself.
    Tag,
    /// Stands and answers.
    Anchor,
    /// Advertises.
    Beacon,
}

/// A position, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fix {
    /// When it was published, since the node started, microseconds.
    pub t_us: u64,
    /// Counts the rounds, wrapping.
    pub round: u16,
    /// From the poll to the publication, microseconds.
    pub age_us: u32,
    /// Anchors asked; none: it is by beacons, and `round` goes on from the last round's.
    pub asked: u8,
    /// What came of the round.
    pub outcome: Outcome,
    /// What made the position.
    #[serde(deserialize_with = "or_unknown")]
    pub solver: Solver,
}

/// What makes a tag's positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Solver {
    /// Not known: the node is of an older build, which does not say it, or of a newer one.
    #[default]
    Unknown,
    /// A track, which every range changes.
    Track,
    /// `robust`, each round by itself.
    Robust,
    /// `b-wls`, each round by itself.
    BWls,
    /// `b-wls-r`, each round by itself.
    BWlsR,
    /// `bounding-box`, each round by itself.
    BoundingBox,
}

/// A field that was appended to the end of its message: a body that ends before it is an older build's, and a number that is not known
/// a newer one's.
fn or_unknown<'de, D: Deserializer<'de>>(from: D) -> Result<Solver, D::Error> {
    Ok(Solver::deserialize(from).unwrap_or_default())
}

/// What came of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// A position.
    Position {
        /// 0.1 mm.
        position: [i32; 3],
        /// Standard deviations, 0.1 mm; zero for a height that was given.
        deviation: [u32; 3],
        /// Correlations xy, xz, yz in 1/127.
        correlation: [i8; 3],
        /// Bit i: the round's i-th range, or the i-th nearest beacon, was used.
        used: u16,
        /// How far the ranges agree with it, 0 to 255.
        quality: u8,
    },
    /// None, with the reason of `positioning_core::SolveError`.
    Reason(Reason),
}

/// Why there is no position: `positioning_core::SolveError`, one by one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reason {
    /// Fewer ranges than unknowns need.
    TooFewAnchors,
    /// More ranges than a position takes.
    TooManyAnchors,
    /// A number of the input was out of all bounds.
    NotFinite,
    /// All anchors at one place.
    CoincidentAnchors,
    /// All anchors on one line.
    CollinearAnchors,
    /// The ranges cannot meet.
    RangesDisjoint,
    /// The geometry leaves the position undetermined.
    Diverged,
    /// An oracle method was asked for.
    SightUnknown,
}

/// A range of a round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range {
    /// When it was published, since the node started, microseconds.
    pub t_us: u64,
    /// The round, as in the fix that it belongs to.
    pub round: u16,
    /// Short address of the peer.
    pub peer: u16,
    /// 0.1 mm.
    pub distance: i32,
    /// Standard deviation expected with line of sight, 0.1 mm.
    pub deviation: u32,
    /// Where the anchor says it stands, 0.1 mm.
    pub place: Option<[i32; 3]>,
    /// What the receiver measured.
    pub diagnostics: Diagnostics,
}

/// How much farther an anchor is than the reference anchor, whose poll began the round. The reference itself comes first, with a
/// difference of zero: its place, the deviation that all differences of the round share, and what the receiver measured on the poll.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Difference {
    /// When it was published, since the node started, microseconds.
    pub t_us: u64,
    /// The round, as in the fix that it belongs to.
    pub round: u16,
    /// Short address of the reference anchor.
    pub reference: u16,
    /// Short address of the anchor.
    pub peer: u16,
    /// The distance to the anchor less that to the reference, 0.1 mm.
    pub difference: i32,
    /// Standard deviation expected with line of sight, beside the reference's, 0.1 mm.
    pub deviation: u32,
    /// Where the anchor says it stands, 0.1 mm.
    pub place: Option<[i32; 3]>,
    /// What the receiver measured.
    pub diagnostics: Diagnostics,
}

/// What the receiver measured on a frame: `ranging::Diagnostics`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Diagnostics {
    /// Received power, 0.01 dBm.
    pub rx_power: i16,
    /// Power of the first path, 0.01 dBm.
    pub first_path_power: i16,
    /// Place of the first path in the accumulator, 1/64 sample.
    pub first_path_index: u16,
    /// FP_AMPL1 to 3.
    pub first_path_amplitudes: [u16; 3],
    /// CIR_PWR.
    pub cir_power: u16,
    /// RXPACC.
    pub preamble_count: u16,
    /// STD_NOISE.
    pub noise_deviation: u16,
    /// The sender's clock against ours, 0.01 ppm.
    pub clock_offset: i16,
}

/// An advertisement heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sighting {
    /// When it was heard, since the node started, microseconds.
    pub t_us: u64,
    /// Which beacon.
    pub beacon: BeaconId,
    /// dBm.
    pub rssi: i8,
    /// What the beacon says its RSSI is at 1 m, dBm.
    pub measured_power: i8,
}

/// A beacon by what it advertises.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeaconId {
    /// The first four bytes of the UUID, big-endian: enough to tell networks apart.
    pub network: u32,
    /// Major number.
    pub major: u16,
    /// Minor number.
    pub minor: u16,
}

/// In which room a tag is, by its model of rooms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Room {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// Where it is from now on.
    pub is: RoomEstimate,
}

/// Where a tag is, in rooms. They are numbered as in the model; a probability is in 1/255, as it has been smoothed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RoomEstimate {
    /// No beacon of the model has been heard lately.
    Unknown,
    /// In this room.
    Room(RoomProbability),
    /// Between two rooms, the more probable one first.
    Between([RoomProbability; 2]),
}

/// A room that is likely.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RoomProbability {
    /// Its number in the model, from 0.
    pub room: u8,
    /// 1/255.
    pub probability: u8,
}

/// A change of the node's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct State {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// What it is from now on.
    pub is: Condition,
}

/// What a node may be in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Condition {
    /// There is no valid record in flash: the node is quiet.
    NoRecord(RecordError),
    /// The record is for another role or board than this image: the node is quiet.
    WrongRecord,
    /// Looking for peers.
    Searching,
    /// DecaRanging: paired with this peer.
    Paired(u16),
    /// Native: in step with the network that this anchor coordinates.
    Synchronised(u16),
    /// Native: a member with this many slots a superframe.
    Joined(u8),
    /// Native: this anchor coordinates.
    Coordinating,
    /// Native: this anchor follows that coordinator.
    Following(u16),
    /// The radio failed for the n-th time in a row, and is brought up again.
    RadioFailed(u32),
    /// The Bluetooth scanner was silent and has been restarted, for the n-th time.
    ScannerRestarted(u32),
    /// Advertises.
    Advertising,
    /// What a tag knows of beacons' levels on the spot is not used: all of it, or a part.
    Unused(Levels, RssiModelError),
    /// A listed beacon's levels contradict the place where it is listed: it makes no positions.
    BeaconMoved(BeaconEvidence),
    /// A listed beacon's levels are those of two senders: it makes no positions.
    BeaconDuplicated(BeaconEvidence),
    /// A listed beacon that was doubted agrees again.
    BeaconRestored(BeaconEvidence),
    /// Native: the tag gets no slots, because all places of the network are taken.
    NetworkFull,
    /// What a tag's motion sensor is good for.
    MotionSensor(MotionSensor),
}

/// What a tag's motion sensor is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MotionSensor {
    /// It is set up, and its movements count.
    Ready,
    /// It does not answer: positions alone tell whether the tag moves.
    Silent,
    /// Something else answers at its address: the same.
    Foreign,
    /// It has reported movement for minutes, and positions say that the tag stays: the same, until it reports none for some seconds.
    Endless,
}

/// What a tag knows of beacons' levels on the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Levels {
    /// All of it.
    All,
    /// The map of fingerprints.
    Map,
    /// The model of rooms.
    Rooms,
}

/// Why it is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RssiModelError {
    /// It is of this version, which the image does not read.
    Version(u8),
    /// A checksum is wrong, or it is cut short.
    Corrupt,
    /// It is whole, and not what a tag can use.
    Invalid,
    /// It is of beacons that the record does not list.
    OtherBeacons,
}

/// A listed beacon of which something else is believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeaconEvidence {
    /// Major number.
    pub major: u16,
    /// Minor number.
    pub minor: u16,
    /// For how long its levels have told so, seconds.
    pub seconds: u16,
}

/// What is wrong with the record in flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RecordError {
    /// Both pages are erased.
    Missing,
    /// It is of this version, which the image does not read.
    Version(u8),
    /// Its checksum is wrong, or it is cut short.
    Corrupt,
    /// It is whole, but what it says cannot be done.
    Invalid,
}

/// What was counted since the start; all wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// UWB frames sent.
    pub sent: u32,
    /// UWB frames received whole.
    pub received: u32,
    /// Windows that passed without a frame.
    pub timeouts: u32,
    /// Frames that came broken.
    pub corrupt: u32,
    /// Transmissions or receptions whose start lay in the past.
    pub late: u32,
    /// Frames that did not leave.
    pub not_sent: u32,
    /// Failures of the radio or its bus.
    pub radio_failures: u32,
    /// Rounds that the engine had no time for.
    pub rounds_dropped: u32,
    /// Telemetry frames dropped because the channel was full.
    pub telemetry_dropped: u32,
    /// Advertisements heard.
    pub sightings: u32,
    /// Advertisements dropped because nobody took them in time.
    pub sightings_dropped: u32,
}

/// Why the node started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reset {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// What the chip says.
    pub cause: ResetCause,
    /// What the firmware left before.
    pub crash: Option<Crash>,
}

/// What reset the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ResetCause {
    /// Power came.
    PowerOn,
    /// Power sagged.
    BrownOut,
    /// The reset pin, or a debugger.
    Pin,
    /// The firmware asked for it.
    Software,
    /// The watchdog.
    Watchdog,
    /// The processor locked up: a fault within a fault.
    Lockup,
    /// Woken from the deepest sleep.
    Wake,
    /// Something else; the chip's own number.
    Other(u32),
}

/// How the firmware ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Crash {
    /// Why.
    pub reason: CrashReason,
    /// Where: the program counter, or for a panic the address that it returns to.
    pub program_counter: u32,
    /// For a panic: its line, and a hash (FNV-1a, 32 bits) of its file's name; else zeros.
    pub line: u32,
    /// See `line`.
    pub file: u32,
}

/// Why the firmware ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CrashReason {
    /// It panicked.
    Panic,
    /// The processor faulted.
    Fault,
    /// The stack overflowed.
    StackOverflow,
    /// A task stood still, and the watchdog was let run out.
    Stalled,
}
