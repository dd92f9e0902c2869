//! The air between the nodes: which nodes receive a frame, with what power and delay, and what is lost.
//!
//! A sender sets the instants of a frame (first preamble symbol, RMARKER, end) in true time. Each listening receiver
//! goes through the frame in steps of the event queue: preamble found, delimiter, PHY header, end. A receiver follows
//! one frame at a time. Another frame on the same band is interference: whatever it overlaps is lost, unless the
//! followed frame is stronger by the capture ratio. A stronger frame that comes while the first is still in its
//! preamble captures the receiver.

mod air_event;
pub mod bias;
mod channel;
mod lasting;
pub mod phy;
mod port;
mod propagation;
mod receiver;

pub use air_event::{AirClient, AirStatistics, Payload, Reception, ReceptionEvent, Sniffed};
pub(crate) use air_event::{AirEvent, Stage};
pub use channel::{Response, estimated_dbm};
pub use lasting::LastingErrors;
pub use phy::{Phy, Prf, Rate, Sfd, SfdKind};
pub use port::{Path, PortId, RxSettings};
pub use propagation::{Link, Material, SPEED_OF_LIGHT, Sight, Wall};

use crate::kernel::Kernel;
use crate::random::{Purpose, stream};
use crate::time::TrueTime;
use lasting::{Lasting, LastingField};
use port::{Port, Tuning};
use propagation::{End, Medium, Paths, distance_m, place_between};
use rustc_hash::FxHashMap;
use std::collections::VecDeque;
use std::collections::hash_map::Entry;
use std::rc::Rc;

/// The settings of the air.
#[derive(Clone, Debug)]
pub struct AirConfig {
    /// Probability that a reception is lost, at any power.
    pub loss: f64,
    /// Path loss exponent: 2 in free space.
    pub path_loss_exponent: f64,
    /// Scattered power relative to the direct path's power in line of sight, dB. −1.5 dB gives the 2-4 dB between
    /// received and first-path power that recordings show.
    pub scatter_db: f64,
    /// How much stronger a frame must be than the frames that overlap it, dB.
    pub capture_db: f64,
    /// How much less a frame with another preamble code disturbs, dB.
    pub code_isolation_db: f64,
    /// Beyond this distance nothing is received and nothing disturbs, metres.
    pub cut_off_m: f64,
    /// Standard deviation of a reception's time stamp at high power, metres. 0.027 gives double-sided ranges with 1.7
    /// cm, as recorded with DWM1001 in line of sight.
    pub stamp_noise_m: f64,
    /// Whether the power biases time stamps (APS011).
    pub range_bias: bool,
    /// Errors that averaging does not remove.
    pub lasting: Option<LastingErrors>,
    /// The floor plan.
    pub walls: Vec<Wall>,
}

impl Default for AirConfig {
    fn default() -> Self {
        Self {
            loss: 0.0,
            path_loss_exponent: 2.0,
            scatter_db: -1.5,
            capture_db: 6.0,
            code_isolation_db: 15.0,
            cut_off_m: 150.0,
            stamp_noise_m: 0.027,
            range_bias: true,
            lasting: None,
            walls: Vec::new(),
        }
    }
}

impl AirConfig {
    /// No noise, no bias, and losses only by power, for tests that compare time stamps to the tick.
    pub fn ideal() -> Self {
        Self { stamp_noise_m: 0.0, range_bias: false, ..Self::default() }
    }

    /// With the errors of recordings in line of sight.
    pub fn recorded() -> Self {
        Self { lasting: Some(LastingErrors::RECORDED), ..Self::default() }
    }
}

/// A frame that is about to be sent, without its bytes: they are needed at the RMARKER.
#[derive(Clone, Copy, Debug)]
pub struct TxStart {
    /// The PHY settings.
    pub phy: Phy,
    /// The ranging bit of its header.
    pub ranging: bool,
    /// When the first preamble symbol leaves the antenna.
    pub start: TrueTime,
    /// When the RMARKER leaves the antenna.
    pub marker: TrueTime,
    /// Radiated power, dBm.
    pub power_dbm: f64,
    /// Offset of the sender's clock, parts per million.
    pub sender_ppm: f64,
}

struct OnAir {
    sender: PortId,
    position: [f64; 3],
    sent: TxStart,
    /// Until the bytes are known, the end of its PHY header; then the end of its last bit. The frame may be cut before.
    end: TrueTime,
    bytes: Rc<[u8]>,
    /// The time at which its sender cut it.
    cut: Option<TrueTime>,
    collided: bool,
}

impl OnAir {
    /// The time from which its sender's antenna is silent.
    fn silent_from(&self) -> TrueTime {
        self.cut.map_or(self.end, |cut| cut.min(self.end))
    }

    /// Whether it was cut before its RMARKER, so that no delimiter was sent.
    fn has_no_delimiter(&self) -> bool {
        self.cut.is_some_and(|cut| cut < self.sent.marker)
    }
}

pub(crate) type Sniffer = Box<dyn FnMut(&Sniffed)>;

/// The air.
pub struct Air {
    config: AirConfig,
    seed: u64,
    ports: Vec<Port>,
    frames: VecDeque<OnAir>,
    /// Number of `frames[0]`.
    first: u32,
    /// The listening ports and their tunings, in no particular order.
    listening: Vec<(PortId, Tuning)>,
    /// The propagation paths between two ports at their last positions.
    paths: FxHashMap<(PortId, PortId), Paths>,
    lasting: Option<LastingField>,
    statistics: AirStatistics,
    sniffers: Vec<Sniffer>,
    is_sniffed: bool,
    /// The frames that the sniffers have not received yet.
    sniffed: Vec<Sniffed>,
    nothing: Rc<[u8]>,
}

impl Air {
    pub(crate) fn new(config: AirConfig, seed: u64) -> Self {
        Self {
            lasting: config.lasting.map(|errors| LastingField::new(errors, seed)),
            config,
            seed,
            ports: Vec::new(),
            frames: VecDeque::new(),
            first: 0,
            listening: Vec::new(),
            paths: FxHashMap::default(),
            statistics: AirStatistics::default(),
            sniffers: Vec::new(),
            is_sniffed: false,
            sniffed: Vec::new(),
            nothing: Rc::from([]),
        }
    }

    /// The configuration.
    pub fn config(&self) -> &AirConfig {
        &self.config
    }

    /// Counts of what happened so far.
    pub fn statistics(&self) -> AirStatistics {
        self.statistics
    }

    /// Calls `sniffer` for each frame when its bytes leave.
    pub fn sniff(&mut self, sniffer: impl FnMut(&Sniffed) + 'static) {
        self.is_sniffed = true;
        self.sniffers.push(Box::new(sniffer));
    }

    /// The position of a port.
    pub fn position(&self, port: PortId, time: TrueTime) -> [f64; 3] {
        self.ports[port as usize].path.at(time)
    }

    /// Sets the probability with which frames are lost from now on.
    pub fn set_loss(&mut self, probability: f64) {
        self.config.loss = probability;
    }

    /// A person carries the port's node before him or her, and shadows the links behind.
    pub fn wear(&mut self, port: PortId) {
        self.ports[port as usize].worn = true;
    }

    pub(crate) fn add_port(&mut self, path: Path) -> PortId {
        let id = self.ports.len() as PortId;
        let random = stream(self.seed, Purpose::Receiver, u64::from(id));
        self.ports.push(Port {
            path,
            listening: None,
            place_in_list: 0,
            session: 0,
            offers: Vec::new(),
            lock: None,
            random,
            antenna: self.lasting.as_ref().map(|lasting| lasting.antenna(id)),
            heading: 0.0,
            worn: false,
        });
        id
    }

    /// Begins a frame. Call it at `tx.start`. Its bytes follow with [`Air::fill`].
    pub(crate) fn transmit(&mut self, kernel: &Kernel<impl From<AirEvent>>, sender: PortId, tx: TxStart) -> u32 {
        self.forget(kernel.now());
        let id = self.first.wrapping_add(self.frames.len() as u32);
        let position = self.position(sender, tx.start);
        self.frames.push_back(OnAir {
            sender,
            position,
            sent: tx,
            end: tx.marker.plus_ps(receiver::ticks_ps(tx.phy.phr_ticks())),
            bytes: self.nothing.clone(),
            cut: None,
            collided: false,
        });
        self.statistics.frames_sent += 1;
        let tuning = Tuning::of(tx.phy.channel, tx.phy.code, tx.phy.prf);
        for index in 0..self.listening.len() {
            let (port, tuned) = self.listening[index];
            if tuned == tuning {
                self.offer(kernel, port, id);
            }
        }
        id
    }

    /// Sets the bytes of a frame (with check bytes) and its end. Call it at the RMARKER. A frame that was cut before
    /// has none.
    pub fn fill(&mut self, frame: u32, bytes: Rc<[u8]>, end: TrueTime) {
        let Some(on_air) = self.frames.get_mut(frame.wrapping_sub(self.first) as usize) else { return };
        on_air.bytes = bytes;
        on_air.end = end;
        let sent = on_air.sent;
        if self.is_sniffed {
            self.sniffed.push(Sniffed {
                start: sent.start,
                marker: sent.marker,
                end,
                sender: on_air.sender,
                bytes: on_air.bytes.clone(),
                phy: sent.phy,
                power_dbm: sent.power_dbm,
            });
        }
    }

    /// The frames that the sniffers have not received yet, and the sniffers, if there are such frames.
    pub(crate) fn take_sniffed(&mut self) -> Option<(Vec<Sniffed>, Vec<Sniffer>)> {
        let any = !self.sniffed.is_empty() && !self.sniffers.is_empty();
        any.then(|| (std::mem::take(&mut self.sniffed), std::mem::take(&mut self.sniffers)))
    }

    /// Puts the sniffers back, before those that were added in the meantime.
    pub(crate) fn return_sniffers(&mut self, mut sniffers: Vec<Sniffer>) {
        sniffers.append(&mut self.sniffers);
        self.sniffers = sniffers;
    }

    /// The sender stops in the middle of a frame, now.
    pub(crate) fn cut(&mut self, now: TrueTime, frame: u32) {
        if let Some(on_air) = self.frames.get_mut(frame.wrapping_sub(self.first) as usize) {
            on_air.cut = Some(now);
        }
    }

    /// Switches a port's receiver on, now.
    pub(crate) fn listen(&mut self, kernel: &Kernel<impl From<AirEvent>>, port: PortId, settings: RxSettings) {
        self.close(port);
        let p = &mut self.ports[port as usize];
        p.listening = Some((settings, kernel.now()));
        p.place_in_list = self.listening.len();
        let tuning = Tuning::of(settings.channel, settings.code, settings.prf);
        self.listening.push((port, tuning));
        for index in 0..self.frames.len() {
            let OnAir { sender, sent: TxStart { phy, .. }, .. } = self.frames[index];
            if sender != port && Tuning::of(phy.channel, phy.code, phy.prf) == tuning {
                self.offer(kernel, port, self.first.wrapping_add(index as u32));
            }
        }
    }

    /// Switches a port's receiver off.
    pub fn deafen(&mut self, port: PortId) {
        if self.close(port) {
            self.statistics.abandoned += 1;
        }
    }

    /// Ends a port's session. Returns whether it was receiving a frame.
    fn close(&mut self, port: PortId) -> bool {
        let p = &mut self.ports[port as usize];
        p.session = p.session.wrapping_add(1);
        p.offers.clear();
        if p.listening.take().is_some() {
            let place = p.place_in_list;
            self.listening.swap_remove(place);
            if let Some(&(moved, _)) = self.listening.get(place) {
                self.ports[moved as usize].place_in_list = place;
            }
        }
        self.ports[port as usize].lock.take().is_some()
    }

    /// Lets a listening port find a frame's preamble, if enough of it is left.
    fn offer(&mut self, kernel: &Kernel<impl From<AirEvent>>, port: PortId, frame: u32) {
        let Some((settings, since)) = self.ports[port as usize].listening else { return };
        let on_air = &self.frames[frame.wrapping_sub(self.first) as usize];
        let sent = on_air.sent;
        if sent.marker <= kernel.now() || on_air.cut.is_some() {
            return;
        }
        let Some(link) = self.link_to(port, frame, kernel.now()) else { return };
        let arrival = sent.start.plus_ps(link.delay_ps as u64);
        let symbol_ps = receiver::symbol_ps(sent.phy.prf);
        let found = arrival.max(since).plus_ps(u64::from(settings.detection_symbols()) * symbol_ps);
        let preamble_end = arrival.plus_ps(u64::from(sent.phy.preamble) * symbol_ps);
        let margin_db = link.power_dbm - sent.phy.preamble_sensitivity_dbm();
        // 6 dB below its sensitivity a receiver finds one preamble in 160 000.
        if found <= preamble_end && margin_db > -6.0 {
            let p = &mut self.ports[port as usize];
            p.offers.push((frame, link));
            let event = AirEvent { port, session: p.session, frame, stage: Stage::Preamble };
            kernel.schedule(found, event);
        }
    }

    /// The power of a frame at a port in line of sight, dBm.
    fn clear_dbm(&self, port: PortId, frame: u32, now: TrueTime) -> f64 {
        let on_air = &self.frames[frame.wrapping_sub(self.first) as usize];
        let distance_m = distance_m(on_air.position, self.position(port, now));
        propagation::clear_dbm(
            self.config.path_loss_exponent,
            distance_m,
            on_air.sent.phy.channel,
            on_air.sent.power_dbm,
        )
    }

    /// The path of a frame to a port; `None` beyond the cut-off distance.
    fn link_to(&mut self, port: PortId, frame: u32, now: TrueTime) -> Option<Link> {
        let on_air = &self.frames[frame.wrapping_sub(self.first) as usize];
        let (sent, from) = (on_air.sent, (on_air.sender, on_air.position));
        let to = (port, self.position(port, now));
        let distance_m = distance_m(from.1, to.1);
        if distance_m > self.config.cut_off_m {
            return None;
        }
        let medium = Medium { seed: self.seed, scatter_db: self.config.scatter_db, walls: &self.config.walls };
        let place = place_between(from, to);
        let paths = match self.paths.entry((from.0.min(to.0), from.0.max(to.0))) {
            Entry::Occupied(known) if known.get().place == place => *known.get(),
            other => *other.insert_entry(Paths::between(medium, from, to)).get(),
        };
        let lasting = self.lasting(from, to, now);
        Some(paths.link(self.config.path_loss_exponent, distance_m, lasting, (sent.phy.channel, sent.power_dbm)))
    }

    /// The lasting errors between two ends.
    fn lasting(&mut self, from: End, to: End, now: TrueTime) -> Lasting {
        let Some(field) = &mut self.lasting else { return Lasting::default() };
        if let Some(known) = field.known(from, to) {
            return known;
        }
        let [a, b] = [from, to].map(|end| {
            let port = &mut self.ports[end.0 as usize];
            port.turn(end.1, now);
            port.posture(end)
        });
        match (a, b) {
            (Some(a), Some(b)) => field.renew(a, b),
            (None, _) | (_, None) => Lasting::default(),
        }
    }

    /// Drops frames that can no longer overlap another frame on the air, and that no receiver follows.
    fn forget(&mut self, now: TrueTime) {
        let flight_ps = self.longest_flight_ps();
        let over = |f: &OnAir| f.end.plus_ps(flight_ps) < now;
        let oldest = self.frames.iter().filter(|f| !over(f)).map(|f| f.sent.start).min().unwrap_or(now);
        while self.frames.front().is_some_and(|f| over(f) && f.end.plus_ps(flight_ps) < oldest) {
            self.frames.pop_front();
            self.first = self.first.wrapping_add(1);
        }
    }

    /// The maximum flight time of a frame, picoseconds: to the cut-off distance, plus 300 m for obstacles.
    fn longest_flight_ps(&self) -> u64 {
        (self.config.cut_off_m / SPEED_OF_LIGHT * 1e12) as u64 + 1_000_000
    }
}
