//! A node that reaches its station by itself: its telemetry goes into datagrams, and receipts come back.
//!
//! ```text
//! frames of telemetry ─▶ Queue ─▶ Gateway::next ─▶ datagram, with a code ─▶ socket ─▶ station
//!                          ▲                                                             │
//!                          └────── Gateway::receive ◀──────── receipt ◀── socket ◀───────┘
//! ```
//!
//! [`Gateway`] has neither a clock nor a socket: a board's task calls [`run`] with both. The datagrams are those of
//! `baliza forward`, which has a disk for its queue. The station's receipts give the time: a node has no calendar.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod clock;
mod queue;

use core::cell::RefCell;

use embassy_futures::select::{Either, select};
use embedded_hal_async::delay::DelayNs;
use heapless::Deque;
use wire::config::{Wifi, WifiKey};
use wire::datagram::{Datagram, Envelope, MAX_DATAGRAM, MAX_FRAMES, Receipt, Received, Secret, ToNode, parse, sealed};

use clock::StationClock;
use queue::Queue;

/// Bytes of the station's messages to tags that may wait for the node: three messages.
const MESSAGE_BYTES: usize = 128;
/// Datagrams that may be without a receipt at a time.
const WINDOW: usize = 8;
/// A station that has not taken frames of this age does not read what is sent, microseconds: frames wait a tenth of a second
/// for others.
const ANSWER_US: u64 = 600_000;
/// A station that has not answered for this time is away, …
const AWAY_US: u64 = 2_000_000;
/// … and gets a datagram in each such time, until it answers.
const PROBE_US: u64 = 1_000_000;
/// After this time its name is to be looked up again.
const FORGOTTEN_US: u64 = 30_000_000;
/// From one look for datagrams to the next, milliseconds.
const LOOK_MS: u32 = 20;

/// Who a gateway is.
#[derive(Clone, Copy)]
pub struct GatewayIdentity {
    /// Its number; see [`Envelope::gateway`].
    pub gateway: u64,
    /// What it and the station know; `None`: datagrams have no code.
    pub secret: Option<Secret>,
    /// The short address of the node.
    pub node: u16,
}

impl GatewayIdentity {
    /// That of a node with these settings, this EUI-64 and this short address.
    pub fn of(settings: &Wifi, eui: u64, node: u16) -> Self {
        match settings.key {
            Some(WifiKey { gateway, secret }) => Self { gateway, secret: Some(Secret(secret)), node },
            None => Self { gateway: eui, secret: None, node },
        }
    }
}

/// What is known of the station.
#[derive(Clone, Copy)]
struct Station {
    /// The number of its run.
    run: u32,
    clock: StationClock,
}

/// The sender of one node's telemetry, with room for `BYTES` of frames. All times are microseconds since the node started.
pub struct Gateway<const BYTES: usize> {
    identity: GatewayIdentity,
    session: u32,
    queue: Queue<BYTES>,
    /// None before its first receipt.
    station: Option<Station>,
    /// When the first datagram was sent that the station has not answered since.
    asked_us: Option<u64>,
    /// When the last one was sent while the station was unknown or away.
    probed_us: Option<u64>,
    /// What the station tells the node, …
    messages: Deque<u8, MESSAGE_BYTES>,
    /// … and when it sent the last of it, by its own clock: an older datagram was recorded and sent again.
    told_us: u64,
}

impl<const BYTES: usize> Gateway<BYTES> {
    /// A gateway whose datagrams are counted in this session: a number that no other run of the node has.
    pub const fn new(identity: GatewayIdentity, session: u32) -> Self {
        Self {
            identity,
            session,
            queue: Queue::new(),
            station: None,
            asked_us: None,
            probed_us: None,
            messages: Deque::new(),
            told_us: 0,
        }
    }

    /// Takes a frame of telemetry. In a full queue it takes the place of the oldest ones.
    pub fn write(&mut self, frame: &[u8], now_us: u64) {
        self.queue.push(frame, now_us);
    }

    /// Whether the station reads what is written here.
    pub fn is_read(&self, now_us: u64) -> bool {
        let waits_us = self.queue.untaken_since_us().map_or(0, |since_us| now_us.saturating_sub(since_us));
        self.station.is_some() && waits_us < ANSWER_US
    }

    /// How long the station has not answered.
    pub fn silence_us(&self, now_us: u64) -> u64 {
        self.asked_us.map_or(0, |asked_us| now_us.saturating_sub(asked_us))
    }

    /// Whether the station has taken all that was written.
    pub fn is_empty(&self) -> bool {
        self.queue.untaken_since_us().is_none()
    }

    /// Frames that were lost, because the queue was full. It wraps.
    pub fn lost(&self) -> u32 {
        self.queue.lost()
    }

    /// Writes the next datagram that is to be sent now.
    pub fn next<'o>(&mut self, now_us: u64, out: &'o mut [u8; MAX_DATAGRAM]) -> Option<&'o [u8]> {
        let is_away = self.silence_us(now_us) >= AWAY_US;
        let is_probe = self.station.is_none() || is_away;
        if is_probe && self.probed_us.is_some_and(|at_us| now_us.saturating_sub(at_us) < PROBE_US) {
            return None;
        }
        let mut frames = [0; MAX_FRAMES];
        let window = if is_away { usize::MAX } else { WINDOW };
        let GatewayIdentity { gateway, node, .. } = self.identity;
        // Without a station: the receipt has its run and its time.
        let (number, station, is_repeated, sent_us, received_us) = (0, 0, false, 0, 0);
        let session = self.session;
        let mut envelope =
            Envelope { gateway, session, number, station, is_repeated, sent_us, received_us, node, frames: &[] };
        if let Some(Station { run, clock }) = &self.station {
            let (bundle, frames) = self.queue.next(now_us, window, clock, &mut frames)?;
            (envelope.station, envelope.number, envelope.is_repeated) = (*run, bundle.number, bundle.sendings > 1);
            (envelope.sent_us, envelope.received_us) = (clock.utc_us(now_us), bundle.received_us);
            envelope.frames = frames;
        }
        let length = envelope.emit(self.identity.secret.is_some(), out)?;
        self.asked_us.get_or_insert(now_us);
        self.probed_us = Some(now_us);
        Some(sealed(self.identity.secret.as_ref(), length, out))
    }

    /// Reads bytes of the station's messages to tags, in frames as a cable has them. Returns how many there were.
    pub fn read(&mut self, into: &mut [u8]) -> usize {
        let received = into.iter_mut().zip(core::iter::from_fn(|| self.messages.pop_front()));
        received.map(|(place, byte)| *place = byte).count()
    }

    /// Takes bytes that came from the network. Returns whether they are a datagram for this gateway.
    pub fn receive(&mut self, bytes: &[u8], now_us: u64) -> bool {
        match self.authentic(bytes) {
            Some(Datagram::Receipt(receipt)) => self.on_receipt(&receipt, now_us),
            Some(Datagram::ToNode(told)) => self.on_message(&told),
            Some(Datagram::Telemetry(_)) | None => false,
        }
    }

    /// A message for which there is no room is lost: the station sends it again.
    fn on_message(&mut self, told: &ToNode<'_>) -> bool {
        let is_ours = told.gateway == self.identity.gateway && told.session == self.session;
        let is_present = self.station.is_some_and(|station| station.run == told.station) && told.sent_us > self.told_us;
        if !is_ours || !is_present {
            return false;
        }
        self.told_us = told.sent_us;
        if told.frames.len() <= self.messages.capacity() - self.messages.len() {
            self.messages.extend(told.frames.iter().copied());
        }
        true
    }

    fn on_receipt(&mut self, receipt: &Receipt, now_us: u64) -> bool {
        let is_ours = receipt.gateway == self.identity.gateway && receipt.session == self.session;
        if !is_ours || receipt.station == 0 {
            return false;
        }
        let asked_us = self.asked_us.take().unwrap_or(now_us);
        let clock = |sent_us| StationClock::of(receipt.sent_us, sent_us, now_us);
        let clock = match self.station {
            Some(Station { run, clock: known }) if run == receipt.station => {
                // Of those that were taken, the last one was sent last.
                let sent = receipt.numbers.iter().fold(None, |sent, number| self.queue.taken(*number, now_us).or(sent));
                sent.map_or(known, |sent_us| known.or_better(clock(sent_us)))
            }
            known => {
                self.queue.recall();
                self.told_us = 0;
                // Nobody knows which of the datagrams it answers.
                known.map_or_else(|| clock(asked_us), |known| known.clock.or_better(clock(asked_us)))
            }
        };
        self.station = Some(Station { run: receipt.station, clock });
        true
    }

    fn authentic<'d>(&self, bytes: &'d [u8]) -> Option<Datagram<'d>> {
        let Received { datagram, signed, code } = parse(bytes).ok()?;
        let is_right = match (&self.identity.secret, code) {
            (Some(secret), Some(code)) => secret.is_code(signed, code),
            (Some(_), None) => false,
            (None, _) => true,
        };
        is_right.then_some(datagram)
    }
}

/// A socket to the station.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait DatagramSocket {
    /// Sends a datagram. What cannot be sent is lost, as it may be on its way.
    async fn send(&mut self, datagram: &[u8]);

    /// Waits for a datagram, and writes it into `into`. Returns its length. May be dropped while it waits.
    async fn receive(&mut self, into: &mut [u8; MAX_DATAGRAM]) -> usize;
}

/// Sends what a gateway's queue has, and takes receipts, until the station has been silent for half a minute: perhaps its
/// name leads to another address now. `clock` gives microseconds since the node started.
pub async fn run<const BYTES: usize>(
    gateway: &RefCell<Gateway<BYTES>>,
    link: &mut impl DatagramSocket,
    mut delay: impl DelayNs,
    clock: impl Fn() -> u64,
) {
    let begun_us = clock();
    let mut out = [0; MAX_DATAGRAM];
    let mut received = [0; MAX_DATAGRAM];
    loop {
        let silence_us = gateway.borrow().silence_us(clock());
        if silence_us.min(clock().saturating_sub(begun_us)) >= FORGOTTEN_US {
            return;
        }
        // A queue is not borrowed while the link waits.
        while let Some(length) = next_length(gateway, clock(), &mut out) {
            link.send(out.get(..length).unwrap_or_default()).await;
        }
        if let Either::First(length) = select(link.receive(&mut received), delay.delay_ms(LOOK_MS)).await {
            gateway.borrow_mut().receive(received.get(..length).unwrap_or_default(), clock());
        }
    }
}

fn next_length<const BYTES: usize>(
    gateway: &RefCell<Gateway<BYTES>>,
    now_us: u64,
    out: &mut [u8; MAX_DATAGRAM],
) -> Option<usize> {
    gateway.borrow_mut().next(now_us, out).map(<[u8]>::len)
}

#[cfg(test)]
mod tests;
