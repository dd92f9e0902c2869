//! The Bluetooth air: beacons that advertise, scanners that hear them; beside the UWB air, in the same virtual time.
//!
//! A beacon sends an event every interval and 0 to 10 ms more, on its channels one after the other ([`Advertiser`]); a scanner listens to
//! one channel after the other ([`Scanner`]). What it hears is the RSSI by [`Medium`] and by the walls in between, and the very bytes
//! that were sent, with an RSSI in whole dBm as controllers give it. Two advertisements at once on a channel lose each other, unless one
//! is much stronger. Equal seeds give equal runs.

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

/// RSSI that says that it is not known (Bluetooth Core 5.4, volume 4, part E, 7.7.65.2).
const UNKNOWN: i8 = 127;
/// An advertisement is heard beside another that is weaker by this, dB: what receivers do, and better than the standard's 21 dB asks
/// (Bluetooth Core 5.4, volume 6, part A, 4.2).
const CAPTURE_DB: f64 = 10.0;
/// Bytes on the air beside the advertising data: preamble, access address, header, address, check; eight microseconds each.
const OVERHEAD: u64 = 1 + 4 + 2 + 6 + 3;
/// The longest advertisement, microseconds.
const LONGEST_US: u64 = 8 * (OVERHEAD + 31);
/// At the sensitivity 30.8 % are lost (Bluetooth Core 5.4, volume 6, part A, 4.1): 0.8 dB below this even odds.
const EVEN_ODDS_DB: f64 = 0.8;

/// The air's configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct BluetoothConfig {
    /// How RSSI values fare.
    pub medium: Medium,
    /// Probability that a reception is lost, whatever its power: to other users of the band.
    pub loss: f64,
    /// The RSSI at which receivers lose 30.8 %, dBm.
    pub sensitivity_dbm: f64,
    /// Every receiver reads so much too high, dB.
    pub receiver_offset_db: f64,
    /// Probability that a controller does not know an RSSI, and says so …
    pub unknown_rssi: f64,
    /// … by this: 127 as the standard has it, where some say 0.
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
    /// Advertisements sent, on every channel each.
    pub sent: u64,
    /// Receptions.
    pub heard: u64,
    /// Receptions lost for want of power.
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
    /// What is on the air, or was until just now.
    on_air: Vec<Packet>,
    ears: Vec<Ear>,
    /// Numbers given to ears.
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
    /// Since when it scans.
    on_since: Option<TrueTime>,
    hear: Hear,
    draws: Stream,
}

/// What became of an advertisement at an ear.
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

    /// How RSSI values fare.
    pub fn medium(&self) -> Medium {
        self.config.medium
    }

    /// What happened so far.
    pub fn statistics(&self) -> BluetoothStatistics {
        self.shared.borrow().statistics
    }

    /// A scanner that is off, of the node with this address, wherever its path says; `hear` gets what it hears.
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

    /// Sends on one channel, from now on; how long that takes.
    fn send(&self, sender: &Rc<Sender>, channel: Channel, data: &Rc<[u8]>) -> Duration {
        let took = Duration::from_micros(8 * (OVERHEAD + data.len() as u64));
        let from = self.world.now();
        let packet = Packet { from, to: from + took, channel, sender: sender.clone(), data: data.clone() };
        let mut shared = self.shared.borrow_mut();
        shared.statistics.sent += 1;
        // What ended before the longest of those that are on the air began disturbs nobody any more.
        shared.on_air.retain(|other| other.to + Duration::from_micros(LONGEST_US) > from);
        shared.on_air.push(packet.clone());
        let air = self.clone();
        self.world.at(packet.to, move |_| air.arrive(&packet));
        took
    }

    /// An advertisement has ended: whoever listened to all of it has heard it.
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
        let rssi = |packet: &Packet| packet.sender.rssi_dbm(&self.walls, at, packet.channel);
        let received_dbm = rssi(packet) + channel::noise_db(packet.channel, &mut ear.draws);
        // Always as many draws: what one reception meets changes no other.
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
            // No controller says more than 20 dBm or less than −127.
            Reception::Received((received_dbm + config.receiver_offset_db).round().clamp(-127.0, 20.0) as i8)
        }
    }
}

impl Ear {
    /// Whether it listened to all of an advertisement.
    fn listens(&self, packet: &Packet) -> bool {
        self.on_since.is_some_and(|since| scanner::is_on(since, packet.channel, packet.from, packet.to))
    }
}

#[cfg(test)]
mod tests;
