//! The transmitter: from TXSTRT to TXFRS.

use super::bits::{channel, config, control, status};
use super::registers::file;
use super::{Activity, Chip, Counter, Direction, HALF_PERIOD, Line, MASK_40, TX_START_US, Trx, What};
use crate::air::{Phy, Prf, Rate, Sfd, SfdKind, TxStart};
use crate::clock::TICKS_PER_PS;
use crate::time::{PS_PER_S, TrueTime};
use crate::world::World;
use crc::{CRC_16_KERMIT, CRC_16_MCRF4XX, Crc};
use std::rc::Rc;

/// The check sequence of IEEE 802.15.4, and the same with FCS_INIT2F's initial value.
const CHECK: Crc<u16> = Crc::<u16>::new(&CRC_16_KERMIT);
const CHECK_FROM_ONES: Crc<u16> = Crc::<u16>::new(&CRC_16_MCRF4XX);
/// Delayed starts ignore the low nine bits.
const STEP: u64 = 512;
/// Starts that are farther away than this are checked again later: the oscillator's random walk is not known that far
/// ahead.
const FAR_TICKS: i64 = 63_897_600 * 200;
/// A frame being sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transmission {
    phy: Phy,
    /// The unwrapped count at the RMARKER, ticks, without the antenna delay.
    marker: u64,
    /// The length with check bytes.
    length: usize,
    /// TXSTRT and TXDLYS, WAIT4RESP and SFCST as commanded.
    command: u32,
    /// RXENAB was commanded meanwhile, perhaps with RXDLYE. It takes effect at the end.
    pub(super) receive_after: Option<Enable>,
    frame: Option<u32>,
    past_marker: bool,
    /// The status bits set so far.
    progress: u64,
}

/// How the receiver is enabled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Enable {
    Now,
    /// At DX_TIME.
    Delayed,
}

impl Enable {
    /// The bits of SYS_CTRL that command it.
    pub(super) fn command(self) -> u32 {
        match self {
            Self::Now => control::RXENAB,
            Self::Delayed => control::RXENAB | control::RXDLYE,
        }
    }
}

impl Transmission {
    /// The sender's activity, which determines its current: preamble and delimiter, or what follows the RMARKER.
    pub(super) fn activity(&self) -> Activity {
        if self.past_marker { Activity::TransmitData(self.phy.rate) } else { Activity::TransmitPreamble(self.phy.prf) }
    }

    /// The host has cleared these status bits.
    pub(super) fn clear(&mut self, bits: u64) {
        self.progress &= !bits;
    }
}

/// The FCS of a frame with these bytes.
pub(super) fn check_of(bytes: &[u8], from_ones: bool) -> u16 {
    if from_ones { CHECK_FROM_ONES.checksum(bytes) } else { CHECK.checksum(bytes) }
}

impl Chip {
    /// SYS_CTRL was written.
    pub(super) fn command(&mut self, world: &World, command: u32) {
        if command & control::TRXOFF != 0 {
            self.idle(world);
        }
        if command & control::HRBPT != 0 {
            self.swing_host();
        }
        if command & control::TXSTRT != 0 {
            self.start_transmission(world, command);
        } else if command & control::RXENAB != 0 {
            self.enable_receiver(world, if command & control::RXDLYE == 0 { Enable::Now } else { Enable::Delayed });
        }
    }

    /// SYS_CTRL as it reads: the starts that are still pending (user manual, page 81).
    pub(super) fn control_word(&self) -> u32 {
        let start = match (self.trx, &self.transmission) {
            (Trx::TxWait, Some(t)) => t.command & (control::TXSTRT | control::TXDLYS),
            (Trx::RxWait, _) => self.receiver.command,
            (Trx::Idle | Trx::TxWait | Trx::Tx | Trx::Rx, _) => 0,
        };
        start | self.transmission.and_then(|t| t.receive_after).map_or(0, Enable::command)
    }

    /// Switches transmitter and receiver off at once.
    pub(super) fn idle(&mut self, world: &World) {
        if let Some(Transmission { progress, frame, .. }) = self.transmission.take() {
            self.status |= progress;
            if let Some(frame) = frame {
                world.air().cut(world.now(), frame);
            }
        }
        if self.trx == Trx::Rx {
            world.air().deafen(self.port);
        }
        self.trx = Trx::Idle;
        self.warnings = 0;
        self.cancel(Line::Trx);
        self.cancel(Line::Wait);
    }

    /// The bits of SYS_STATUS that the running transmission has set so far.
    pub(super) fn transmit_progress(&self) -> u64 {
        self.transmission.map_or(0, |t| t.progress)
    }

    fn start_transmission(&mut self, world: &World, command: u32) {
        let Some(phy) = self.transmit_phy().filter(|_| self.trx == Trx::Idle && self.on_pll()) else {
            self.statistics.not_idle += 1;
            return;
        };
        self.statistics.mistuned += u64::from(self.is_mistuned(Direction::Send));
        let now = world.now();
        let lead = TX_START_US * 638_976 / 10;
        let marker = if command & control::TXDLYS != 0 {
            let wanted = self.memory.u40(file::DX_TIME) & !(STEP - 1);
            let preamble_in = self.ticks_until(now, wanted, phy.shr_ticks());
            if preamble_in < 0 {
                self.late(Counter::HalfPeriod, status::HPDWARN);
            } else if (preamble_in as u64) < lead {
                self.late(Counter::PowerUp, status::TXPUTE);
            }
            // If the start of the preamble is past, the transmission waits for the counter to come round.
            let ticks = self.ticks(now);
            ticks + (wanted.wrapping_sub(phy.shr_ticks()).wrapping_sub(ticks) & MASK_40) + phy.shr_ticks()
        } else {
            self.status &= !status::OF_TRANSMISSION;
            (self.ticks(now) + lead + phy.shr_ticks()).next_multiple_of(STEP)
        };
        let fctrl = self.memory.u32(file::TX_FCTRL, 0);
        let length = (fctrl & if phy.long_frames { 0x3FF } else { 0x7F }) as usize;
        self.cancel(Line::Trx);
        self.trx = Trx::TxWait;
        self.transmission = Some(Transmission {
            phy,
            marker,
            length,
            command,
            receive_after: None,
            frame: None,
            past_marker: false,
            progress: 0,
        });
        self.recheck(world);
    }

    pub(super) fn late(&mut self, counter: Counter, warning: u64) {
        self.warnings |= warning;
        self.statistics.late += 1;
        self.count(counter);
    }

    /// Schedules the pending start, or another check of it. HPDWARN is cleared when half a period is left.
    pub(super) fn recheck(&mut self, world: &World) {
        let (start, what) = match (self.trx, self.transmission) {
            (Trx::TxWait, Some(t)) => {
                ((t.marker as f64) - t.phy.shr_ticks() as f64 + self.tx_delay(), What::TransmitterOn)
            }
            (Trx::RxWait, _) => (self.receiver.on_at as f64, What::ReceiverOn),
            _ => return,
        };
        let now = world.now();
        let ticks = self.ticks(now) as f64;
        let (next, what) =
            if start - ticks > HALF_PERIOD { (start - HALF_PERIOD, What::Recheck) } else { (start, what) };
        if what != What::Recheck {
            self.warnings &= !status::HPDWARN;
        }
        if next - ticks > FAR_TICKS as f64 {
            self.schedule(world, now.plus_ps(PS_PER_S / 10), What::Recheck);
        } else {
            // One more nanosecond makes sure that the instant is past. A start is exact.
            let spare_ps = if what == What::Recheck { 1_000 } else { 0 };
            let at = self.time_of(next).plus_ps(spare_ps);
            self.schedule(world, at, what);
        }
    }

    /// The delay from the chip to the antenna, ticks.
    fn tx_delay(&self) -> f64 {
        self.config.tx_antenna_ticks + self.delay_drift()
    }

    /// Ticks that temperature and supply add to each of the two delays. The manufacturer's 2.15 mm/°C and 5.35 cm/V
    /// (APS011) are interpreted as the change of a range if both chips are warmer: a range contains half of the sum of
    /// four delays.
    pub(super) fn delay_drift(&self) -> f64 {
        let metres = 0.00215 * (self.config.temperature_c - 23.0) + 0.0535 * (self.config.supply_v - 3.3);
        0.5 * metres / crate::air::SPEED_OF_LIGHT * 1e12 * TICKS_PER_PS
    }

    pub(super) fn transmitter_on(&mut self, world: &World) {
        let Some(mut t) = self.transmission else { return };
        self.trx = Trx::Tx;
        self.status &= !status::OF_TRANSMISSION;
        t.progress = status::TXFRB;
        let now = world.now();
        let marker = self.time_of(t.marker as f64 + self.tx_delay());
        let start = TxStart {
            phy: t.phy,
            ranging: self.memory.u32(file::TX_FCTRL, 0) & (1 << 15) != 0,
            start: now,
            marker,
            power_dbm: self.radiated_dbm(&t.phy, t.length) + self.config.antenna_dbi,
            sender_ppm: self.clock.ppm_at(now),
        };
        t.frame = Some(world.air().transmit(world.kernel(), self.port, start));
        self.transmission = Some(t);
        let sfd_ticks = u64::from(t.phy.sfd.symbols) * t.phy.prf.symbol_ticks();
        let preamble_end = self.time_of((t.marker - sfd_ticks) as f64 + self.tx_delay());
        self.schedule(world, preamble_end, What::PreambleSent);
        self.schedule(world, marker, What::Marker);
    }

    /// The transmission has reached a point that a status bit reports.
    pub(super) fn sent_so_far(&mut self, bit: u64) {
        if let Some(t) = &mut self.transmission {
            t.progress |= bit;
        }
    }

    pub(super) fn marker(&mut self, world: &World) {
        let Some(mut t) = self.transmission else { return };
        t.past_marker = true;
        self.transmission = Some(t);
        let antenna = u64::from(self.memory.u16(file::TX_ANTD, 0));
        let mut stamp = [0; 10];
        stamp[..5].copy_from_slice(&((t.marker + antenna) & MASK_40).to_le_bytes()[..5]);
        stamp[5..].copy_from_slice(&(t.marker & MASK_40).to_le_bytes()[..5]);
        self.memory.write(file::TX_TIME, 0, &stamp);
        let header_ends = t.marker + t.phy.phr_ticks();
        let header_end = self.time_of(header_ends as f64 + self.tx_delay());
        self.schedule(world, header_end, What::HeaderSent);
        let ends = header_ends + t.phy.payload_ticks(t.length);
        let end = self.time_of(ends as f64 + self.tx_delay());
        if let Some(frame) = t.frame {
            let bytes = self.outgoing(&t);
            world.air().fill(frame, bytes, end);
        }
        self.schedule(world, end, What::TransmissionEnds);
    }

    /// The frame's bytes from the buffer, with check bytes. A frame of fewer than two bytes consists only of its check
    /// bytes.
    fn outgoing(&self, t: &Transmission) -> Rc<[u8]> {
        let offset = (self.memory.u32(file::TX_FCTRL, 0) >> 22) as usize;
        let buffer = self.memory.file(file::TX_BUFFER);
        let byte = |i: usize| buffer.get(offset + i).copied().unwrap_or(0);
        let mut bytes: Vec<u8> = (0..t.length.max(1)).map(byte).collect();
        if t.command & control::SFCST == 0 && t.length >= 2 {
            let body = t.length - 2;
            let check = check_of(&bytes[..body], self.configured(config::FCS_INIT2F));
            bytes[body..].copy_from_slice(&check.to_le_bytes());
        }
        Rc::from(bytes)
    }

    pub(super) fn transmission_ends(&mut self, world: &World) {
        let Some(t) = self.transmission.take() else { return };
        self.status |= t.progress | status::TXFRS;
        self.count(Counter::Sent);
        self.trx = Trx::Idle;
        self.warnings = 0;
        if t.command & control::WAIT4RESP != 0 {
            self.listen_after_sending(world);
        } else if let Some(enable) = t.receive_after {
            self.enable_receiver(world, enable);
        } else if self.memory.u32(file::PMSC, 4) & (1 << 11) != 0 {
            self.sleep(world);
        }
    }

    /// The PHY settings in CHAN_CTRL and TX_FCTRL; `None` if they are not valid.
    fn transmit_phy(&self) -> Option<Phy> {
        let channels = self.memory.u32(file::CHAN_CTRL, 0);
        let fctrl = self.memory.u32(file::TX_FCTRL, 0);
        let rate = match (fctrl >> 13) & 3 {
            0 => Rate::Kbps110,
            1 => Rate::Kbps850,
            2 => Rate::Kbps6800,
            _ => return None,
        };
        let preamble = match (fctrl >> 18) & 0xF {
            // TXPSR in the low two bits, PE above (user manual, table 16).
            0b0001 => 64,
            0b0101 => 128,
            0b1001 => 256,
            0b1101 => 512,
            0b0010 => 1024,
            0b0110 => 1536,
            0b1010 => 2048,
            0b0011 => 4096,
            _ => return None,
        };
        Some(Phy {
            channel: self.channel((channels & 0xF) as u8)?,
            code: ((channels >> 22) & 0x1F) as u8,
            prf: prf((fctrl >> 16) & 3)?,
            rate,
            preamble,
            sfd: self.sfd(channels & channel::TNSSFD != 0, rate),
            long_frames: self.configuration() & config::PHR_MODE == config::PHR_MODE,
        })
    }

    pub(super) fn channel(&self, number: u8) -> Option<u8> {
        matches!(number, 1..=5 | 7).then_some(number)
    }

    /// The delimiter that CHAN_CTRL and SFD_LENGTH select at a rate (user manual, table 21).
    pub(super) fn sfd(&self, user: bool, rate: Rate) -> Sfd {
        let decawave = self.memory.u32(file::CHAN_CTRL, 0) & channel::DWSFD != 0;
        let length = u16::from(self.memory.u8(file::USR_SFD, 0));
        let kind = match (decawave, user) {
            (true, _) => SfdKind::Decawave,
            (false, true) => SfdKind::User,
            (false, false) => SfdKind::Ieee,
        };
        let symbols = match (rate, kind) {
            (Rate::Kbps110, _) => 64,
            (_, SfdKind::Ieee) => 8,
            (_, SfdKind::Decawave | SfdKind::User) => length.clamp(8, 64),
        };
        Sfd { kind, symbols }
    }
}

/// The PRF in two bits of TX_FCTRL or CHAN_CTRL.
pub(super) fn prf(bits: u32) -> Option<Prf> {
    match bits {
        1 => Some(Prf::Mhz16),
        2 => Some(Prf::Mhz64),
        _ => None,
    }
}

/// The instant `units` chip units after `now`.
pub(super) fn units_after(now: TrueTime, units: u64) -> TrueTime {
    now.plus_ps((units as f64 * super::UNIT_TICKS as f64 / TICKS_PER_PS) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_bytes_of_a_known_frame() {
        // The check value of CRC-16/KERMIT for "123456789" is 0x2189 (catalogue of parametrised CRC algorithms).
        assert_eq!(check_of(b"123456789", false), 0x2189);
        // The check over a frame with its check bytes is zero.
        let mut frame = vec![0x41, 0x88, 0x01, 0xCA, 0xDE];
        frame.extend(check_of(&frame, false).to_le_bytes());
        assert_eq!(check_of(&frame, false), 0);
    }
}
