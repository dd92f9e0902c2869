//! The Bluetooth air: beacons that advertise and scanners that receive them. It runs beside the UWB air, in the same
//! virtual time.
//!
//! A beacon sends an event after every interval plus 0 to 10 ms, on its channels one after the other ([`Advertiser`]).
//! A scanner listens to one channel after the other ([`Scanner`]). A scanner receives the bytes that were sent, and an
//! RSSI in whole dBm, as controllers report it. The RSSI follows from [`Medium`] and from the walls in between. Two
//! advertisements at the same time on one channel destroy each other, unless one is much stronger. Equal seeds give
//! equal runs.

mod advertiser;
mod channel;
mod field;
mod scanner;

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use rand::Rng;

use crate::air::{Path, Wall};
use crate::random::{Purpose, Stream, stream};
use crate::{TrueTime, World};

pub use advertiser::{Advertiser, Sender};
pub use channel::{Channel, Medium};
pub use scanner::Scanner;

/// The RSSI value that means "not known" (Bluetooth Core 5.4, volume 4, part E, 7.7.65.2).
const UNKNOWN: i8 = 127;
/// An advertisement is received if every overlapping one is weaker by at least this, dB. Real receivers do so, and this
/// is better than the 21 dB of the standard (Bluetooth Core 5.4, volume 6, part A, 4.2).
const CAPTURE_DB: f64 = 10.0;
/// Bytes on the air besides the advertising data: preamble, access address, header, address, check. A byte takes eight
/// microseconds.
const OVERHEAD: u64 = 1 + 4 + 2 + 6 + 3;
/// The longest advertisement, microseconds.
const LONGEST_US: u64 = 8 * (OVERHEAD + 31);
/// At the sensitivity 30.8 % of the receptions are lost (Bluetooth Core 5.4, volume 6, part A, 4.1). Half of them are
/// lost 0.8 dB below it.
const EVEN_ODDS_DB: f64 = 0.8;

/// The air's configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct BluetoothConfig {
    /// The propagation.
    pub medium: Medium,
    /// Probability that a reception is lost to other users of the band, at any power.
    pub loss: f64,
    /// The RSSI at which receivers lose 30.8 % of the receptions, dBm.
    pub sensitivity_dbm: f64,
    /// The error of every receiver's RSSI, dB; positive values are too high.
    pub receiver_offset_db: f64,
    /// Probability that a controller does not know an RSSI and reports so …
    pub unknown_rssi: f64,
    /// … by this value: 127 in the standard; some controllers report 0.
    pub unknown_rssi_dbm: i8,
}

impl Default for BluetoothConfig {
    fn default() -> Self {
        Self {
            medium: Medium::default(),
            loss: 0.0,
            sensitivity_dbm: -96.0,
            receiver_offset_db: 0.0,
            unknown_rssi: 0.0,
            unknown_rssi_dbm: UNKNOWN,
        }
    }
}

/// What happened on the air.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BluetoothStatistics {
    /// Advertisements sent; each channel counts.
    pub sent: u64,
    /// Receptions.
    pub heard: u64,
    /// Receptions lost because the power was too low.
    pub lost_to_noise: u64,
    /// Receptions lost by chance.
    pub lost_by_chance: u64,
    /// Receptions lost to another advertisement.
    pub lost_to_collision: u64,
}

/// The air; clones share it.
#[derive(Clone)]
pub struct Bluetooth {
    world: World,
    config: Rc<BluetoothConfig>,
    walls: Rc<[Wall]>,
    shared: Rc<RefCell<Shared>>,
}

#[derive(Default)]
struct Shared {
    /// The advertisements that are on the air or ended a short time ago.
    on_air: Vec<Packet>,
    ears: Vec<Ear>,
    /// The number of the next receiver.
    next_ear: u64,
    statistics: BluetoothStatistics,
}

/// An advertisement on one channel.
#[derive(Clone)]
struct Packet {
    from: TrueTime,
    to: TrueTime,
    channel: Channel,
    sender: Rc<Sender>,
    data: Rc<[u8]>,
}

type Hear = Rc<dyn Fn(&[u8], i8)>;

/// A receiver.
struct Ear {
    number: u64,
    path: Path,
    /// The time at which it began to scan.
    on_since: Option<TrueTime>,
    hear: Hear,
    draws: Stream,
}

/// The result of an advertisement at a receiver.
enum Reception {
    Received(i8),
    LostToNoise,
    LostByChance,
    LostToCollision,
}

impl Bluetooth {
    /// An air without beacons and scanners.
    pub fn new(world: &World, config: BluetoothConfig, walls: &[Wall]) -> Self {
        Self { world: world.clone(), config: Rc::new(config), walls: walls.into(), shared: Rc::default() }
    }

    /// The propagation.
    pub fn medium(&self) -> Medium {
        self.config.medium
    }

    /// What happened so far.
    pub fn statistics(&self) -> BluetoothStatistics {
        self.shared.borrow().statistics
    }

    /// A scanner for the node with this address. It is off at first. Its position follows `path`. Each reception calls
    /// `hear`.
    pub fn scanner(&self, address: u16, path: Path, hear: impl Fn(&[u8], i8) + 'static) -> Scanner {
        let mut shared = self.shared.borrow_mut();
        let number = shared.next_ear;
        shared.next_ear += 1;
        let index = u64::from(address) << 32 | number;
        let draws = stream(self.world.seed(), Purpose::Scanner, index);
        shared.ears.push(Ear { number, path, on_since: None, hear: Rc::new(hear), draws });
        Scanner::new(self.clone(), number)
    }

    /// A beacon's radio.
    pub fn advertiser(&self, sender: Sender) -> Advertiser {
        Advertiser::new(self.clone(), sender)
    }

    fn switch(&self, ear: u64, on: bool) {
        let now = self.world.now();
        if let Some(ear) = self.shared.borrow_mut().ears.iter_mut().find(|other| other.number == ear) {
            ear.on_since = on.then_some(now);
        }
    }

    fn remove(&self, ear: u64) {
        self.shared.borrow_mut().ears.retain(|other| other.number != ear);
    }

    /// Sends on one channel, from now on, and returns the duration.
    fn send(&self, sender: &Rc<Sender>, channel: Channel, data: &Rc<[u8]>) -> Duration {
        let took = Duration::from_micros(8 * (OVERHEAD + data.len() as u64));
        let from = self.world.now();
        let packet = Packet { from, to: from + took, channel, sender: sender.clone(), data: data.clone() };
        let mut shared = self.shared.borrow_mut();
        shared.statistics.sent += 1;
        // Drop an advertisement that ended before the longest one still on the air began: it can disturb no other.
        shared.on_air.retain(|other| other.to + Duration::from_micros(LONGEST_US) > from);
        shared.on_air.push(packet.clone());
        let air = self.clone();
        self.world.at(packet.to, move |_| air.arrive(&packet));
        took
    }

    /// An advertisement has ended. Every receiver that listened to all of it may have received it.
    fn arrive(&self, packet: &Packet) {
        let mut heard: Vec<(Hear, i8)> = Vec::new();
        {
            let mut shared = self.shared.borrow_mut();
            let Shared { on_air, ears, statistics, .. } = &mut *shared;
            let others = on_air.iter().filter(|other| {
                other.channel == packet.channel
                    && other.from < packet.to
                    && packet.from < other.to
                    && !Rc::ptr_eq(&other.sender, &packet.sender)
            });
            let others: Vec<&Packet> = others.collect();
            for ear in ears.iter_mut().filter(|ear| ear.listens(packet)) {
                match self.receive(packet, &others, ear) {
                    Reception::Received(rssi) => {
                        statistics.heard += 1;
                        heard.push((ear.hear.clone(), rssi));
                    }
                    Reception::LostToNoise => statistics.lost_to_noise += 1,
                    Reception::LostByChance => statistics.lost_by_chance += 1,
                    Reception::LostToCollision => statistics.lost_to_collision += 1,
                }
            }
        }
        for (hear, rssi) in heard {
            hear(&packet.data, rssi);
        }
    }

    fn receive(&self, packet: &Packet, others: &[&Packet], ear: &mut Ear) -> Reception {
        let config = &self.config;
        let at = ear.path.at(packet.to);
        let rssi = |packet: &Packet| packet.sender.rssi_dbm(&self.walls, at, packet.channel, packet.to);
        let received_dbm = rssi(packet) + channel::noise_db(packet.channel, &mut ear.draws);
        // The number of draws is always the same, so that the result of one reception changes no other.
        let (power, chance, known): (f64, f64, f64) = (ear.draws.random(), ear.draws.random(), ear.draws.random());
        let odds = (received_dbm - config.sensitivity_dbm + EVEN_ODDS_DB).exp();
        if power >= odds / (1.0 + odds) {
            Reception::LostToNoise
        } else if chance < config.loss {
            Reception::LostByChance
        } else if others.iter().any(|other| rssi(other) > received_dbm - CAPTURE_DB) {
            Reception::LostToCollision
        } else if known < config.unknown_rssi {
            Reception::Received(config.unknown_rssi_dbm)
        } else {
            // No controller reports more than 20 dBm or less than −127 dBm.
            Reception::Received((received_dbm + config.receiver_offset_db).round().clamp(-127.0, 20.0) as i8)
        }
    }
}

impl Ear {
    /// Whether the receiver listened to all of an advertisement.
    fn listens(&self, packet: &Packet) -> bool {
        self.on_since.is_some_and(|since| scanner::is_on(since, packet.channel, packet.from, packet.to))
    }
}

#[cfg(test)]
mod tests;
