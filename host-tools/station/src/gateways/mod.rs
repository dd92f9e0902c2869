//! The station's side of gateways: who may send datagrams, whose telemetry they bring, and when that was.
//!
//! ```text
//! datagram ─▶ known gateway, right code ─▶ of this run of the station ─▶ not taken before ─▶ reports
//!               │ no: refused                │ no: receipt without numbers  │ no: receipt
//! ```
//!
//! A datagram that was sent before, or is old, is late: its positions go to the store, and change nothing that is live.

mod taken;

use std::collections::HashMap;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use node_link::gateway_key::GatewayKey;
use station_core::net::make_room;
use station_core::{ReportKind, SourceReport, Utc};
use wire::datagram::{Datagram, Envelope, MAX_DATAGRAM, MAX_NUMBERS, Receipt, Received, Secret, ToNode, parse, sealed};
use wire::telemetry::{Decoder, Message};

use self::taken::TakenNumbers;
use crate::sources::ReportSender;
use crate::{NodeClock, NodeReporter};

/// What is older when it arrives is late.
const LATE: Duration = Duration::from_secs(5);
/// A gateway's clock that differs by more is noted, and its times are corrected by whole seconds.
const WRONG_CLOCK_US: u64 = 2_000_000;
/// The most gateways without a key, sessions of a gateway, and nodes at a time. Another one takes the place of the one
/// that was silent for longest.
const MOST_GATEWAYS: usize = 1024;
const MOST_SESSIONS: usize = 64;
const MOST_NODES: usize = 4096;
/// A gateway that has sent nothing for this time gets no messages.
const REACHED: Duration = Duration::from_secs(60);
/// From one note about refused datagrams to the next.
const NOTE_EVERY: Duration = Duration::from_secs(60);

/// Who may send datagrams.
#[derive(Clone, Default)]
pub struct Admission {
    /// The gateways that have a key.
    pub keys: Vec<GatewayKey>,
    /// Whether others may send from elsewhere than this computer, too.
    pub is_open: bool,
}

impl Admission {
    /// Whether what nobody has authenticated is taken from there.
    pub fn takes_unauthenticated(&self, from: SocketAddr) -> bool {
        self.is_open || from.ip().to_canonical().is_loopback()
    }
}

/// What is known of a gateway.
struct Gateway {
    clock: NodeClock,
    is_clock_noted: bool,
    sessions: HashMap<u32, (TakenNumbers, Instant)>,
    received: Instant,
    /// From where its last datagram of this run came, and that one's session.
    at: (SocketAddr, u32),
}

impl Gateway {
    /// Whether a datagram was not taken before.
    fn is_new(&mut self, session: u32, number: u32, now: Instant) -> bool {
        if !self.sessions.contains_key(&session) {
            make_room(&mut self.sessions, MOST_SESSIONS, |(_, received)| *received);
        }
        let (taken, received) = self.sessions.entry(session).or_insert_with(|| (TakenNumbers::default(), now));
        *received = now;
        taken.insert(number)
    }

    /// How much the gateway's clock is behind, microseconds, by the datagrams with the shortest ways.
    fn behind_us(&mut self, sent_us: u64, arrived: Utc) -> i64 {
        let sent = Utc::clamped(i64::try_from(sent_us).unwrap_or(i64::MAX));
        self.clock.utc(sent.us() as f64 / 1e6, arrived).us().saturating_sub(sent.us())
    }
}

/// A node behind a gateway; what comes late has a reporter of its own, because it is not in order.
type NodeKey = (u64, u16, bool);

/// The numbers that were taken and have no receipt yet.
type DueReceipts = HashMap<(SocketAddr, u64, u32), Vec<u32>>;

/// All gateways of a station.
pub struct Gateways<'a> {
    admission: &'a Admission,
    site: &'a str,
    /// The number of this run.
    run: u32,
    known: HashMap<u64, Gateway>,
    nodes: HashMap<NodeKey, (NodeReporter, Instant)>,
    due: DueReceipts,
    refused: Refused,
}

/// Refused datagrams, which are noted now and then.
#[derive(Default)]
struct Refused {
    datagrams: u64,
    last: Option<(SocketAddr, &'static str)>,
    noted: Option<Instant>,
}

impl<'a> Gateways<'a> {
    /// The gateways of a station whose nodes are of this site, unless a key's entry says another one.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub fn new(admission: &'a Admission, site: &'a str) -> Result<Self> {
        let run = getrandom::u32().context("the system has no random numbers")?.max(1);
        Ok(Self {
            admission,
            site,
            run,
            known: HashMap::new(),
            nodes: HashMap::new(),
            due: DueReceipts::new(),
            refused: Refused::default(),
        })
    }

    /// Takes a datagram that came from `from` at `arrived`. Returns whether the station still takes reports.
    pub fn take(
        &mut self,
        bytes: &[u8],
        (from, arrived): (SocketAddr, Utc),
        send: ReportSender<'_>,
        note: &mut dyn FnMut(&str),
    ) -> bool {
        match self.authenticated(bytes, from) {
            Ok(envelope) => self.reports(&envelope, from, arrived, note).into_iter().all(send),
            Err(why) => {
                self.refuse(from, why);
                true
            }
        }
    }

    /// Counts a datagram that is refused.
    pub fn refuse(&mut self, from: SocketAddr, why: &'static str) {
        self.refused.datagrams += 1;
        self.refused.last = Some((from, why));
    }

    /// Notes what was refused, at most once a minute.
    pub fn note_refused(&mut self, note: &mut dyn FnMut(&str)) {
        let Refused { datagrams, last, noted } = &mut self.refused;
        if let Some((from, why)) = *last
            && noted.is_none_or(|at| at.elapsed() >= NOTE_EVERY)
        {
            note(&format!("{datagrams} refused so far; the last one, from {from}, {why}"));
            (*last, *noted) = (None, Some(Instant::now()));
        }
    }

    fn key(&self, gateway: u64) -> Option<&'a GatewayKey> {
        self.admission.keys.iter().find(|key| key.gateway == gateway)
    }

    /// The telemetry of a datagram whose sender may send.
    ///
    /// # Errors
    /// Why it is refused.
    fn authenticated<'d>(&self, bytes: &'d [u8], from: SocketAddr) -> Result<Envelope<'d>, &'static str> {
        let Received { datagram, signed, code } = parse(bytes).map_err(|_| "is of an unknown kind, or cut")?;
        let Datagram::Telemetry(envelope) = datagram else { return Err("is no telemetry") };
        match (self.key(envelope.gateway), code) {
            (Some(key), Some(code)) if Secret(key.secret).is_code(signed, code) => Ok(envelope),
            (Some(_), Some(_)) => Err("has another key than --gateways gives its gateway"),
            (Some(_), None) => Err("has no code, and --gateways has a key of its gateway"),
            (None, Some(_)) => Err("is of a gateway that is not in --gateways"),
            (None, None) if self.admission.takes_unauthenticated(from) => Ok(envelope),
            (None, None) => {
                Err("has no key, and comes from elsewhere: --gateways names those with keys, --open-udp takes all")
            }
        }
    }

    /// The reports that a datagram makes.
    fn reports(
        &mut self,
        envelope: &Envelope<'_>,
        from: SocketAddr,
        arrived: Utc,
        note: &mut dyn FnMut(&str),
    ) -> Vec<SourceReport> {
        let Envelope { gateway: id, session, number, node, .. } = *envelope;
        let now = Instant::now();
        let numbers = self.due.entry((from, id, session)).or_default();
        if envelope.station != self.run {
            // A receipt without numbers has the run.
            return Vec::new();
        }
        numbers.push(number);
        if !self.known.contains_key(&id) {
            make_room(&mut self.known, MOST_GATEWAYS, |gateway| gateway.received);
        }
        let gateway = self.known.entry(id).or_insert_with(|| Gateway {
            clock: NodeClock::default(),
            is_clock_noted: false,
            sessions: HashMap::new(),
            received: now,
            at: (from, session),
        });
        (gateway.received, gateway.at) = (now, (from, session));
        if !gateway.is_new(session, number, now) {
            return Vec::new();
        }
        let behind_us = gateway.behind_us(envelope.sent_us, arrived);
        let is_wrong = behind_us.unsigned_abs() > WRONG_CLOCK_US;
        if is_wrong && !std::mem::replace(&mut gateway.is_clock_noted, true) {
            let (name, by_s) = (self.name(id), behind_us.unsigned_abs() / 1_000_000);
            let way = if behind_us > 0 { "behind" } else { "ahead" };
            note(&format!("the clock of gateway {name} is {by_s} s {way}: its times are corrected by whole seconds"));
        }
        // Equal datagrams have equal times, also in another run of the station: the store keeps each position once.
        let correction_us =
            if is_wrong { behind_us.saturating_add(500_000).div_euclid(1_000_000) * 1_000_000 } else { 0 };
        let received_us = i64::try_from(envelope.received_us).unwrap_or(i64::MAX);
        let received = Utc::clamped(received_us.saturating_add(correction_us));
        let is_late = envelope.is_repeated || arrived.since(received) > LATE;
        let reporter = self.reporter((id, node, is_late), now);
        let messages = messages(envelope.frames);
        let last_us = messages.iter().map(Message::t_us).max().unwrap_or(0);
        let mut reports = Vec::new();
        for message in messages {
            let before_us = i64::try_from(last_us - message.t_us()).unwrap_or(i64::MAX);
            let t = Utc::clamped(received.us().saturating_sub(before_us));
            reports.extend(reporter.reports_of(t, &message));
        }
        let late = |SourceReport { t, site, what }| SourceReport { t, site, what: ReportKind::Late(Box::new(what)) };
        if is_late { reports.into_iter().map(late).collect() } else { reports }
    }

    fn reporter(&mut self, key: NodeKey, now: Instant) -> &mut NodeReporter {
        if !self.nodes.contains_key(&key) {
            make_room(&mut self.nodes, MOST_NODES, |(_, received)| *received);
        }
        let site = self.key(key.0).and_then(|of| of.site.as_deref()).unwrap_or(self.site);
        let (reporter, received) = self.nodes.entry(key).or_insert_with(|| (NodeReporter::of(site, key.1), now));
        *received = now;
        reporter
    }

    fn name(&self, gateway: u64) -> String {
        self.key(gateway).map_or_else(|| format!("0x{gateway:016x}"), |key| key.name.clone())
    }

    /// Sends a frame to the nodes of all gateways.
    pub fn send_to_nodes(&self, frame: &[u8], mut send: impl FnMut(&[u8], SocketAddr)) {
        let mut out = [0; MAX_DATAGRAM];
        for (&gateway, known) in self.known.iter().filter(|(_, known)| known.received.elapsed() < REACHED) {
            let secret = self.key(gateway).map(|key| Secret(key.secret));
            let (to, session) = known.at;
            let sent_us = Utc::now().us().unsigned_abs();
            let told = ToNode { gateway, session, station: self.run, sent_us, frames: frame };
            let Some(length) = told.emit(secret.is_some(), &mut out) else { continue };
            send(sealed(secret.as_ref(), length, &mut out), to);
        }
    }

    /// Sends the receipts of all that was taken since the last call.
    pub fn send_receipts(&mut self, mut send: impl FnMut(&[u8], SocketAddr)) {
        let mut out = [0; MAX_DATAGRAM];
        for ((from, gateway, session), numbers) in std::mem::take(&mut self.due) {
            let secret = self.key(gateway).map(|key| Secret(key.secret));
            let parts: Vec<_> = if numbers.is_empty() { vec![&[][..]] } else { numbers.chunks(MAX_NUMBERS).collect() };
            for part in parts {
                let numbers = part.iter().copied().collect();
                let sent_us = Utc::now().us().unsigned_abs();
                let receipt = Receipt { gateway, session, station: self.run, sent_us, numbers };
                let Some(length) = receipt.emit(secret.is_some(), &mut out) else { continue };
                send(sealed(secret.as_ref(), length, &mut out), from);
            }
        }
    }
}

/// The whole frames among these bytes.
fn messages(frames: &[u8]) -> Vec<Message> {
    let mut decoder = Decoder::new();
    frames.iter().filter_map(|byte| decoder.feed(*byte)?.ok()).collect()
}

#[cfg(test)]
mod tests;
