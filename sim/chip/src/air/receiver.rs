//! A receiver's course through a frame, step by step.

use super::air_event::{AirEvent, Payload, Reception, ReceptionEvent, Stage};
use super::bias::range_bias_m;
use super::phy::{Phy, Prf};
use super::port::Lock;
use super::propagation::{SPEED_OF_LIGHT, dbm, milliwatts};
use super::{Air, PortId};
use crate::clock::TICKS_PER_PS;
use crate::kernel::Kernel;
use crate::random::gauss;
use crate::time::TrueTime;
use rand::Rng;

/// Nominal duration of a preamble symbol, picoseconds.
pub(super) fn symbol_ps(prf: Prf) -> u64 {
    (prf.symbol_ticks() as f64 / TICKS_PER_PS) as u64
}

pub(super) fn ticks_ps(ticks: u64) -> u64 {
    (ticks as f64 / TICKS_PER_PS) as u64
}

impl Air {
    /// Does one step. Returns the event for the port's client, if there is one.
    pub(crate) fn step(&mut self, kernel: &Kernel<impl From<AirEvent>>, event: AirEvent) -> Option<ReceptionEvent> {
        if self.ports[event.port as usize].session != event.session {
            return None;
        }
        if event.stage == Stage::Preamble {
            return self.find_preamble(kernel, event);
        }
        let lock = self.ports[event.port as usize].lock.filter(|l| l.frame == event.frame)?;
        match event.stage {
            Stage::Preamble => None,
            Stage::Sfd => self.find_sfd(kernel, event, lock),
            Stage::SfdTimeout if lock.lost => Some(self.give_up_counted(event.port, ReceptionEvent::SfdTimeout)),
            Stage::SfdTimeout => Some(self.give_up(event.port, ReceptionEvent::SfdTimeout)),
            Stage::Header => Some(self.read_header(kernel, event, lock)),
            Stage::End => Some(self.finish(event, lock)),
        }
    }

    fn find_preamble(&mut self, kernel: &Kernel<impl From<AirEvent>>, event: AirEvent) -> Option<ReceptionEvent> {
        let now = kernel.now();
        let offers = &mut self.ports[event.port as usize].offers;
        let offer = offers.iter().position(|o| o.0 == event.frame)?;
        let (_, link) = offers.swap_remove(offer);
        let index = event.frame.wrapping_sub(self.first) as usize;
        let sent = self.frames[index].sent;
        // The frame was cut before its preamble was found.
        if self.frames[index].silent_from().plus_ps(link.delay_ps as u64) < now {
            return None;
        }
        let port = &mut self.ports[event.port as usize];
        let (settings, _) = port.listening?;
        let (capture_db, loss) = (self.config.capture_db, self.config.loss);
        let taken_over = match port.lock {
            // After its delimiter, the followed frame keeps the receiver, even if it is disturbed.
            Some(lock) => {
                // A receiver that waits in vain for a delimiter still follows its frame, even if the frame is over and
                // dropped, or cut.
                let followed = self.frames.get(lock.frame.wrapping_sub(self.first) as usize)?;
                let preamble_end = followed.sent.marker.min(followed.silent_from());
                let in_preamble = now < preamble_end.plus_ps(lock.link.delay_ps as u64);
                if !in_preamble || link.power_dbm < lock.link.power_dbm + capture_db {
                    return None;
                }
                Some(lock.frame)
            }
            None => None,
        };
        self.statistics.receptions += 1;
        if loss > 0.0 && port.random.random_bool(loss) {
            self.statistics.lost_by_chance += 1;
            return None;
        }
        let margin_db = link.power_dbm - sent.phy.preamble_sensitivity_dbm();
        // 11 dB above its sensitivity, a receiver misses one preamble in 10⁹.
        if margin_db < 11.0 && !drawn_within(&mut port.random, 1.0 / (1.0 + (-2.0 * margin_db).exp())) {
            self.statistics.lost_to_noise += 1;
            return None;
        }
        let symbol = symbol_ps(sent.phy.prf);
        let marker = sent.marker.plus_ps(link.delay_ps as u64);
        let sfd_ps = u64::from(sent.phy.sfd.symbols) * symbol;
        let symbols = (marker.ps_since(now).saturating_sub(sfd_ps) + symbol / 2) / symbol;
        port.lock = Some(Lock { frame: event.frame, link, found: now, symbols: symbols as u16, lost: false });
        if let Some(lost) = taken_over {
            self.collide(lost);
        }
        let timeout = settings.sfd_timeout_at(now, sent.phy.prf);
        if settings.finds_sfd(sent.phy.sfd, sent.phy.rate) && timeout.is_none_or(|t| marker <= t) {
            kernel.schedule(marker, AirEvent { stage: Stage::Sfd, ..event });
        } else if let Some(timeout) = timeout {
            kernel.schedule(timeout, AirEvent { stage: Stage::SfdTimeout, ..event });
        }
        Some(ReceptionEvent::Preamble)
    }

    fn find_sfd(
        &mut self,
        kernel: &Kernel<impl From<AirEvent>>,
        event: AirEvent,
        lock: Lock,
    ) -> Option<ReceptionEvent> {
        let now = kernel.now();
        let followed = &self.frames[lock.frame.wrapping_sub(self.first) as usize];
        let (phy, never_sent) = (followed.sent.phy, followed.has_no_delimiter());
        let (settings, _) = self.ports[event.port as usize].listening?;
        if never_sent || self.drowned(event.port, lock, lock.found, now) {
            if never_sent {
                self.statistics.lost_to_noise += 1;
            } else {
                self.collide(lock.frame);
            }
            self.ports[event.port as usize].lock = Some(Lock { lost: true, ..lock });
            if let Some(timeout) = settings.sfd_timeout_at(lock.found, phy.prf) {
                kernel.schedule(timeout, AirEvent { stage: Stage::SfdTimeout, ..event });
            }
            return None;
        }
        let header_end = now.plus_ps(ticks_ps(phy.phr_ticks()));
        kernel.schedule(header_end, AirEvent { stage: Stage::Header, ..event });
        Some(ReceptionEvent::Sfd)
    }

    fn read_header(&mut self, kernel: &Kernel<impl From<AirEvent>>, event: AirEvent, lock: Lock) -> ReceptionEvent {
        let now = kernel.now();
        let index = lock.frame.wrapping_sub(self.first) as usize;
        let (phy, end) = (self.frames[index].sent.phy, self.frames[index].end);
        let marker = self.frames[index].sent.marker.plus_ps(lock.link.delay_ps as u64);
        let port = &mut self.ports[event.port as usize];
        let wrong_mode = port.listening.is_none_or(|(s, _)| s.long_frames != phy.long_frames);
        if wrong_mode || self.frames[index].bytes.is_empty() {
            return self.give_up(event.port, ReceptionEvent::HeaderError);
        }
        if self.drowned(event.port, lock, marker, now) {
            self.collide(lock.frame);
            return self.give_up_counted(event.port, ReceptionEvent::HeaderError);
        }
        let at = end.plus_ps(lock.link.delay_ps as u64);
        kernel.schedule(at, AirEvent { stage: Stage::End, ..event });
        ReceptionEvent::Header { bytes: self.frames[index].bytes.clone(), phy }
    }

    fn finish(&mut self, event: AirEvent, lock: Lock) -> ReceptionEvent {
        let index = lock.frame.wrapping_sub(self.first) as usize;
        let sent = self.frames[index].sent;
        let delay = lock.link.delay_ps as u64;
        let (header_end, end) =
            (sent.marker.plus_ps(delay + ticks_ps(sent.phy.phr_ticks())), self.frames[index].end.plus_ps(delay));
        let collided = self.drowned(event.port, lock, header_end, end);
        let bytes = self.frames[index].bytes.clone();
        let port = &mut self.ports[event.port as usize];
        let cut = self.frames[index].cut.is_some_and(|cut| cut < self.frames[index].end);
        let noisy = cut || !drawn_within(&mut port.random, success(&sent.phy, lock.link.power_dbm, bytes.len()));
        let payload = match (collided || noisy, port.random.random_bool(0.5)) {
            (false, _) => Payload::Good,
            (true, false) => Payload::Uncorrectable,
            (true, true) => Payload::Corrupted,
        };
        let deviations = gauss(&mut port.random);
        let noise_seed = port.random.random();
        self.close(event.port);
        match (collided, noisy) {
            (true, _) => self.collide(lock.frame),
            (false, true) => self.statistics.lost_to_noise += 1,
            (false, false) => self.statistics.received += 1,
        }
        let bias_factor = self.ports[event.port as usize].antenna.map_or(1.0, |antenna| antenna.bias_factor);
        let first_path_dbm = lock.link.first_path_dbm;
        let stamp_m = deviations * stamp_deviation_m(self.config.stamp_noise_m, first_path_dbm, lock.symbols)
            + if self.config.range_bias {
                bias_factor * range_bias_m(sent.phy.channel, sent.phy.prf, lock.link.power_dbm)
            } else {
                0.0
            };
        ReceptionEvent::Frame(Reception {
            bytes,
            phy: sent.phy,
            ranging: sent.ranging,
            marker: sent.marker.plus_ps(lock.link.delay_ps.round() as u64),
            stamp_error_ps: stamp_m / SPEED_OF_LIGHT * 1e12,
            link: lock.link,
            sender_ppm: sent.sender_ppm,
            symbols: lock.symbols,
            payload,
            noise_seed,
        })
    }

    /// Ends a reception that failed because of a setting that does not match.
    fn give_up(&mut self, port: PortId, heard: ReceptionEvent) -> ReceptionEvent {
        self.statistics.abandoned += 1;
        self.give_up_counted(port, heard)
    }

    fn give_up_counted(&mut self, port: PortId, heard: ReceptionEvent) -> ReceptionEvent {
        self.close(port);
        heard
    }

    fn collide(&mut self, frame: u32) {
        self.statistics.lost_to_collision += 1;
        let on_air = &mut self.frames[frame.wrapping_sub(self.first) as usize];
        self.statistics.frames_collided += u64::from(!on_air.collided);
        on_air.collided = true;
    }

    /// Whether other frames between two instants at this port are too strong for the frame that it follows.
    fn drowned(&mut self, port: PortId, lock: Lock, from: TrueTime, to: TrueTime) -> bool {
        if self.frames.len() == 1 {
            return false;
        }
        let own = self.frames[lock.frame.wrapping_sub(self.first) as usize].sent.phy;
        let flight_ps = self.longest_flight_ps();
        let mut sum_mw = 0.0;
        for index in 0..self.frames.len() {
            let other = &self.frames[index];
            let id = self.first.wrapping_add(index as u32);
            let apart = other.silent_from().plus_ps(flight_ps) < from || other.sent.start > to;
            if id == lock.frame || other.sender == port || apart {
                continue;
            }
            let (start, end, phy) = (other.sent.start, other.silent_from(), other.sent.phy);
            if !Phy::share_band(own.channel, phy.channel) {
                continue;
            }
            // No wall and no echo lifts a frame by 15 dB above its power in free space.
            if self.clear_dbm(port, id, to) + 15.0 < lock.link.power_dbm - self.config.capture_db {
                continue;
            }
            let Some(link) = self.link_to(port, id, to) else { continue };
            let delay = link.delay_ps as u64;
            if start.plus_ps(delay) < to && end.plus_ps(delay) > from {
                let same = own.code == phy.code && own.prf == phy.prf;
                let isolation_db = if same { 0.0 } else { self.config.code_isolation_db };
                sum_mw += milliwatts(link.power_dbm - isolation_db);
            }
        }
        sum_mw > 0.0 && lock.link.power_dbm - dbm(sum_mw) < self.config.capture_db
    }
}

fn drawn_within(random: &mut impl Rng, probability: f64) -> bool {
    // If the probability is almost 1, no draw is needed.
    probability > 1.0 - 1e-9 || random.random::<f64>() < probability
}

/// Probability that a payload is received: nine in ten at the sensitivity for 20 bytes, one half 1 dB below it.
fn success(phy: &Phy, power_dbm: f64, bytes: usize) -> f64 {
    let margin_db = power_dbm - phy.rate.sensitivity_dbm();
    // 12 dB above the sensitivity, one payload in 10¹² is lost.
    if margin_db > 12.0 {
        return 1.0;
    }
    let for_20 = 1.0 / (1.0 + (-9f64.ln() - 9f64.ln() * margin_db).exp());
    for_20.powf(bytes as f64 / 20.0)
}

/// Standard deviation of a time stamp: the configured one at high power; 1.41 times as much at −93 dBm on the first
/// path with 114 accumulated preamble symbols, as a preamble of 128 gives. The noise in the accumulator falls with the
/// number of symbols summed in it.
fn stamp_deviation_m(at_high_power_m: f64, first_path_dbm: f64, symbols: u16) -> f64 {
    let noise = 10f64.powf((-93.0 - first_path_dbm) / 10.0) * 114.0 / f64::from(symbols.max(1));
    at_high_power_m * (1.0 + noise).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::air::{Rate, Sfd, SfdKind};

    #[test]
    fn one_frame_in_ten_is_lost_at_the_sensitivity() {
        let sfd = Sfd { kind: SfdKind::Ieee, symbols: 8 };
        let phy =
            Phy { channel: 5, code: 9, prf: Prf::Mhz64, rate: Rate::Kbps6800, preamble: 128, sfd, long_frames: false };
        assert!((success(&phy, -93.0, 20) - 0.9).abs() < 1e-12);
        assert!((success(&phy, -94.0, 20) - 0.5).abs() < 1e-12);
        // Two blocks of 20 bytes: 0.9².
        assert!((success(&phy, -93.0, 40) - 0.81).abs() < 1e-12);
        assert!(success(&phy, -85.0, 127) > 0.9999);
    }

    #[test]
    fn stamps_are_noisier_when_weak() {
        assert!((stamp_deviation_m(0.027, -93.0, 114) - 0.027 * 2f64.sqrt()).abs() < 1e-12);
        assert!((stamp_deviation_m(0.027, -73.0, 114) - 0.027 * 1.01f64.sqrt()).abs() < 1e-12);
        // Eight times the symbols give an eighth of the noise.
        assert!((stamp_deviation_m(0.027, -93.0, 912) - 0.027 * 1.125f64.sqrt()).abs() < 1e-12);
    }
}
