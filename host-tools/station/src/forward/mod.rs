//! `baliza forward`: from the nodes at this computer to a station elsewhere.
//!
//! ```text
//! source ─▶ Collector ─▶ Queue on disk ─▶ datagram ─▶ station
//!                          ▲    no receipt  │            │
//!                          └────────────────┘ ◀─ receipt ┘
//! ```
//!
//! A datagram is sent at once, and again if no receipt comes. The station takes what is sent again as late, so the newest
//! positions do not wait for those of a break.

mod collector;
mod queue;

use std::collections::HashMap;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use node_link::gateway_key::GatewayKey;
use station_core::Utc;
use wire::datagram::{Datagram, Envelope, MAX_DATAGRAM, Receipt, Received, Secret, ToNode, parse, sealed};

use self::collector::{Bundle, Collector};
use self::queue::{Place, Queue};
use crate::sources::{NodeInput, read_node};
use crate::{OpenSource, SourceSpec};

/// The longest wait for something to send.
const STEP: Duration = Duration::from_millis(10);
/// Without a receipt for this time, a datagram is sent again.
const ANSWERED_WITHIN: Duration = Duration::from_millis(500);
/// The most datagrams that are sent again at a time: their bytes fit into a socket's buffer.
const MOST_REPEATED: usize = 64;
/// Without any receipt for this time, the station is away, and only one datagram is sent again at a time.
const AWAY_AFTER: Duration = Duration::from_secs(3);
/// A station that is away may have another address.
const LOOK_UP_EVERY: Duration = Duration::from_secs(30);
/// At the start, the first look-up is awaited for this time.
const FIRST_LOOK_UP: Duration = Duration::from_secs(1);
/// At the end, receipts are awaited for this time.
const LAST_RECEIPTS: Duration = Duration::from_secs(2);

const NO_RANDOM: &str = "the system has no random numbers";

/// What a gateway sends where.
pub(crate) struct Settings<'a> {
    /// `HOST:PORT` of the station.
    pub(crate) to: &'a str,
    /// The key that the station knows.
    pub(crate) key: Option<GatewayKey>,
    /// The folder of the queue, …
    pub(crate) folder: &'a Path,
    /// … and the most bytes in it.
    pub(crate) most_bytes: u64,
}

/// Runs until all sources have ended, or `stop` is set. Returns how many bytes wait for a later run.
///
/// # Errors
/// A source cannot be opened, or the queue cannot be used.
pub(crate) fn run(
    specs: &[SourceSpec],
    settings: Settings<'_>,
    stop: &AtomicBool,
    note: &mut dyn FnMut(&str),
) -> Result<u64> {
    let mut sources = Vec::new();
    for spec in specs.iter().map(SourceSpec::each).collect::<Result<Vec<_>>>()?.into_iter().flatten() {
        if matches!(spec, SourceSpec::Udp(_)) {
            bail!("{spec}: datagrams are already of a gateway, which can send them to the station itself");
        }
        sources.push((spec.to_string(), spec.open()?));
    }
    let mut gateway = Gateway::open(settings)?;
    let (sender, inputs) = channel();
    for (name, source) in sources {
        let (sender, (to_node, frames)) = (sender.clone(), channel());
        gateway.nodes.push(to_node);
        thread::spawn(move || read(&name, source, &sender, &frames));
    }
    // The channel ends with the last source.
    drop(sender);
    gateway.pump(&inputs, stop, note);
    Ok(gateway.finish(note))
}

/// What a source's thread sends.
enum FromSource {
    Bundles(Vec<Bundle>),
    Note(String),
}

/// Reads a source to its end, and passes `frames` on to its node.
fn read(name: &str, source: OpenSource, sender: &Sender<FromSource>, frames: &Receiver<Vec<u8>>) {
    let mut collector = Collector::default();
    let mut take = |input: NodeInput| {
        let now_us = now_us();
        match input {
            NodeInput::Message(_, message) => collector.take(&message, now_us),
            NodeInput::Nothing => collector.pass(now_us),
            NodeInput::Lost => collector.lost(),
        }
        let dropped = collector.take_dropped();
        if dropped > 0 {
            let what = format!("{name}: {dropped} frames are dropped: their node has not said hello");
            let _ = sender.send(FromSource::Note(what));
        }
        let ready = collector.take_ready();
        ready.is_empty() || sender.send(FromSource::Bundles(ready)).is_ok()
    };
    let mut note = |text: &str| {
        // A receiver that is gone has ended.
        let _ = sender.send(FromSource::Note(format!("{name}: {text}")));
    };
    let ended = read_node(source, &mut take, &mut || frames.try_recv().ok(), &mut note);
    take(NodeInput::Lost);
    let how = ended.map_or_else(|error| format!("{error:#}"), |()| "it has ended".to_owned());
    let _ = sender.send(FromSource::Note(format!("{name}: {how}")));
}

fn now_us() -> u64 {
    Utc::now().us().unsigned_abs()
}

/// A datagram that no receipt has come for yet.
#[derive(Clone, Copy, Debug)]
struct Flight {
    place: Place,
    sent: Instant,
    is_repeated: bool,
}

/// The gateway.
struct Gateway<'a> {
    settings: Settings<'a>,
    number: u64,
    session: u32,
    /// The next datagram's number.
    next: u32,
    queue: Queue,
    /// None: the station's name is not known now.
    socket: Option<UdpSocket>,
    looked_up: Instant,
    /// The look-up that is going on.
    look_up: Option<Receiver<Option<UdpSocket>>>,
    /// The run of the station, 0 if it is unknown.
    station: u32,
    /// When it was first sent something that no receipt has followed, …
    asked: Option<Instant>,
    /// … and what was said of that.
    is_away: Option<bool>,
    /// The last datagram could not be written to the disk.
    is_disk_failing: bool,
    /// By session and number.
    flights: HashMap<(u32, u32), Flight>,
    /// Where frames for nodes go.
    nodes: Vec<Sender<Vec<u8>>>,
    /// When the station sent the last of them, by its clock: an older one was recorded and sent again.
    told_us: u64,
}

impl<'a> Gateway<'a> {
    fn open(settings: Settings<'a>) -> Result<Self> {
        let queue = Queue::open(settings.folder, settings.most_bytes)?;
        let number = settings.key.as_ref().map_or_else(getrandom::u64, |key| Ok(key.gateway));
        let (now, look_up) = (Instant::now(), look_up(settings.to));
        let found = look_up.recv_timeout(FIRST_LOOK_UP);
        Ok(Self {
            settings,
            number: number.context(NO_RANDOM)?,
            session: getrandom::u32().context(NO_RANDOM)?,
            next: 0,
            queue,
            look_up: found.is_err().then_some(look_up),
            socket: found.ok().flatten(),
            looked_up: now,
            station: 0,
            asked: None,
            is_away: None,
            is_disk_failing: false,
            flights: HashMap::new(),
            nodes: Vec::new(),
            told_us: 0,
        })
    }

    /// Sends what comes of the sources, until they have ended.
    fn pump(&mut self, inputs: &Receiver<FromSource>, stop: &AtomicBool, note: &mut dyn FnMut(&str)) {
        while !stop.load(Ordering::Relaxed) {
            match inputs.recv_timeout(STEP) {
                Ok(FromSource::Bundles(bundles)) => {
                    for bundle in bundles {
                        self.send_new(&bundle, note);
                    }
                }
                Ok(FromSource::Note(text)) => note(&text),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            self.step(note);
        }
    }

    /// Waits for the last receipts. Returns how many bytes are left.
    fn finish(mut self, note: &mut dyn FnMut(&str)) -> u64 {
        let begun = Instant::now();
        while self.queue.untaken_bytes() > 0 && begun.elapsed() < LAST_RECEIPTS {
            thread::sleep(STEP);
            self.step(note);
        }
        let left = self.queue.untaken_bytes();
        self.queue.close();
        left
    }

    /// Reads receipts, sends again what was lost, and tidies up.
    fn step(&mut self, note: &mut dyn FnMut(&str)) {
        let now = Instant::now();
        self.receive();
        let late: Vec<_> = self
            .flights
            .iter()
            .filter(|(_, flight)| now.duration_since(flight.sent) >= ANSWERED_WITHIN)
            .map(|(key, flight)| (*key, flight.place))
            .collect();
        for (key, place) in late {
            self.flights.remove(&key);
            self.queue.unanswered(place);
        }
        let is_away = self.asked.is_some_and(|at| now.duration_since(at) >= AWAY_AFTER);
        self.note_change(is_away, note);
        if let Some(found) = self.look_up.as_ref().and_then(|found| found.try_recv().ok()) {
            // A network that is not up knows no names: the address of before is as good as any.
            (self.look_up, self.socket) = (None, found.or(self.socket.take()));
        }
        if is_away && self.look_up.is_none() && now.duration_since(self.looked_up) >= LOOK_UP_EVERY {
            (self.looked_up, self.look_up) = (now, Some(look_up(self.settings.to)));
        }
        let most = if is_away { 1 } else { MOST_REPEATED };
        let mut repeated = self.flights.values().filter(|flight| flight.is_repeated).count();
        while repeated < most
            && let Some(place) = self.queue.next_waiting()
        {
            repeated += usize::from(self.send_again(place));
        }
        self.queue.tidy(now);
        let lost = self.queue.take_lost();
        if lost > 0 {
            note(&format!("the queue is full: {lost} of the oldest datagrams are deleted; --queue-mb allows more"));
        }
    }

    fn note_change(&mut self, is_away: bool, note: &mut dyn FnMut(&str)) {
        // At first there was no time for an answer.
        let is_early = self.station == 0 && !is_away;
        if is_early || self.is_away == Some(is_away) {
            return;
        }
        self.is_away = Some(is_away);
        let (to, folder) = (self.settings.to, self.settings.folder.display());
        note(&if is_away {
            let hint = match (&self.socket, &self.settings.key) {
                (None, _) => "its name is not known now",
                (Some(_), Some(_)) => "does it know the key?",
                (Some(_), None) => "does it take datagrams without a key?",
            };
            format!("{to} does not answer ({hint}); telemetry waits in {folder}")
        } else {
            format!("{to} takes the telemetry")
        });
    }

    fn send_new(&mut self, bundle: &Bundle, note: &mut dyn FnMut(&str)) {
        let number = self.next;
        self.next = self.next.wrapping_add(1);
        let envelope = Envelope {
            gateway: self.number,
            session: self.session,
            number,
            station: self.station,
            is_repeated: false,
            sent_us: now_us(),
            received_us: bundle.received_us,
            node: bundle.node,
            frames: &bundle.frames,
        };
        match self.queue.push(&envelope) {
            Ok(place) => {
                self.is_disk_failing = false;
                self.fly((self.session, number), place, false);
            }
            Err(error) if !std::mem::replace(&mut self.is_disk_failing, true) => {
                note(&format!("{error:#}: telemetry is sent, and does not wait where it gets lost"));
            }
            Err(_) => {}
        }
        self.transmit(&envelope);
    }

    /// Sends a datagram of the queue once more. Returns whether it is there.
    fn send_again(&mut self, place: Place) -> bool {
        let read = self.queue.read(place).inspect_err(|error| log::warn!("{error:#}"));
        let Ok(Some(bytes)) = read else { return false };
        let Ok(Received { datagram: Datagram::Telemetry(kept), .. }) = parse(&bytes) else { return false };
        // The key may be another one than that of the run before.
        let (gateway, station) = (self.number, self.station);
        self.fly((kept.session, kept.number), place, true);
        self.transmit(&Envelope { gateway, station, is_repeated: true, sent_us: now_us(), ..kept });
        true
    }

    /// A receipt for a datagram is awaited from now on.
    fn fly(&mut self, key: (u32, u32), place: Place, is_repeated: bool) {
        let sent = Instant::now();
        self.asked.get_or_insert(sent);
        self.flights.insert(key, Flight { place, sent, is_repeated });
    }

    fn secret(&self) -> Option<Secret> {
        self.settings.key.as_ref().map(|key| Secret(key.secret))
    }

    /// What cannot be sent now is sent again as what gets lost.
    fn transmit(&self, envelope: &Envelope<'_>) {
        let mut out = [0; MAX_DATAGRAM];
        let secret = self.secret();
        let Some(length) = envelope.emit(secret.is_some(), &mut out) else { return };
        let datagram = sealed(secret.as_ref(), length, &mut out);
        if let Some(Err(error)) = self.socket.as_ref().map(|socket| socket.send(datagram)) {
            log::debug!("cannot send to {}: {error}", self.settings.to);
        }
    }

    fn receive(&mut self) {
        let mut bytes = [0; MAX_DATAGRAM];
        loop {
            let Some(socket) = &self.socket else { return };
            let length = match socket.recv(&mut bytes) {
                Ok(length) => length,
                // Nobody listens there.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => continue,
                Err(_) => return,
            };
            match self.authentic(bytes.get(..length).unwrap_or_default()) {
                Some(Datagram::Receipt(receipt)) if receipt.gateway == self.number && receipt.station != 0 => {
                    self.take(&receipt);
                }
                Some(Datagram::ToNode(told)) => self.pass_on(told),
                Some(Datagram::Receipt(_) | Datagram::Telemetry(_)) | None => {}
            }
        }
    }

    /// Passes frames of the station on to all nodes.
    fn pass_on(&mut self, told: ToNode<'_>) {
        let is_ours = (told.gateway, told.session, told.station) == (self.number, self.session, self.station);
        if !is_ours || told.sent_us <= self.told_us {
            return;
        }
        self.told_us = told.sent_us;
        // A source that has ended has no node.
        self.nodes.retain(|node| node.send(told.frames.to_vec()).is_ok());
    }

    /// A datagram of the station, if it is one.
    fn authentic<'d>(&self, bytes: &'d [u8]) -> Option<Datagram<'d>> {
        let Received { datagram, signed, code } = parse(bytes).ok()?;
        let is_right = match (self.secret(), code) {
            (Some(secret), Some(code)) => secret.is_code(signed, code),
            (Some(_), None) => false,
            (None, _) => true,
        };
        is_right.then_some(datagram)
    }

    fn take(&mut self, receipt: &Receipt) {
        self.asked = None;
        if receipt.station != self.station {
            (self.station, self.told_us) = (receipt.station, 0);
            self.queue.recall();
            for (_, flight) in self.flights.drain() {
                self.queue.unanswered(flight.place);
            }
        }
        for number in &receipt.numbers {
            if let Some(flight) = self.flights.remove(&(receipt.session, *number)) {
                self.queue.taken(flight.place, Instant::now());
            }
        }
    }
}

/// Looks the station's name up, in a thread of its own: without a network that may take long.
fn look_up(to: &str) -> Receiver<Option<UdpSocket>> {
    let ((sender, found), to) = (channel(), to.to_owned());
    thread::spawn(move || {
        let socket = connect(&to).inspect_err(|error| log::info!("{to}: {error}"));
        // Nobody waits for it at the end of the program.
        let _ = sender.send(socket.ok());
    });
    found
}

/// A socket that sends to the station.
///
/// # Errors
/// Its name is not known now, or there is no way to it.
fn connect(to: &str) -> io::Result<UdpSocket> {
    let mut failed = ErrorKind::NotFound.into();
    for address in to.to_socket_addrs()? {
        let any: SocketAddr = if address.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0_u16; 8], 0).into() };
        let connected = UdpSocket::bind(any).and_then(|socket| {
            socket.connect(address)?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        });
        match connected {
            Ok(socket) => return Ok(socket),
            Err(error) => failed = error,
        }
    }
    Err(failed)
}
