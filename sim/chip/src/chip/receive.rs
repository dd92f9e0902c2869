//! The receiver: from RXENAB to a frame in a buffer, an error or a timeout.

use super::bits::{channel, config, status};
use super::filter::{Filter, header_length};
use super::received::frame_info;
use super::registers::file;
use super::transmit::{Enable, check_of, prf, units_after};
use super::{Chip, Counter, Direction, Line, MASK_40, RX_START_US, RX_TURN_US, Trx, What};
use crate::air::{Payload, Phy, Prf, Rate, Reception, ReceptionEvent, Response, RxSettings};
use crate::clock::TICKS_PER_PS;
use crate::random::gauss;
use crate::time::TrueTime;
use crate::world::World;
use rand::Rng;

/// The state of the receiver.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Receiver {
    /// The unwrapped count at which it is switched on.
    pub(super) on_at: u64,
    /// RXENAB and RXDLYE as commanded; none if it is switched on automatically.
    pub(super) command: u32,
    preamble_found: bool,
    /// The rate of the PHY header or payload that is being received.
    pub(super) data: Option<Rate>,
    /// The frame timeout continues over automatic re-enabling.
    waiting: bool,
    /// After an error the next time stamp is wrong unless the receiver was reset (user manual, 4.1.6).
    pub(super) stale: bool,
}

impl Chip {
    /// RXENAB. While a frame is being sent, the command is kept until the end. The manual does not say so, but
    /// published drivers rely on it.
    pub(super) fn enable_receiver(&mut self, world: &World, enable: Enable) {
        if let (Trx::TxWait | Trx::Tx, Some(transmission)) = (self.trx, &mut self.transmission) {
            transmission.receive_after = Some(enable);
            return;
        }
        if self.trx != Trx::Idle || !self.on_pll() || self.rx_settings().is_none() {
            self.statistics.not_idle += 1;
            return;
        }
        let now = world.now();
        let ticks = self.ticks(now);
        let soonest = ticks + RX_START_US * 638_976 / 10;
        self.receiver.on_at = match enable {
            Enable::Now => {
                self.clear_reception_events();
                soonest
            }
            Enable::Delayed => {
                let wanted = self.memory.u40(file::DX_TIME) & !511;
                if self.ticks_until(now, wanted, 0) < 0 {
                    self.late(Counter::HalfPeriod, status::HPDWARN);
                }
                (ticks + (wanted.wrapping_sub(ticks) & MASK_40)).max(soonest)
            }
        };
        self.await_receiver(world, enable.command(), false);
    }

    /// WAIT4RESP: switches the receiver on after W4R_TIM.
    pub(super) fn listen_after_sending(&mut self, world: &World) {
        let wait = u64::from(self.memory.u32(file::ACK_RESP_T, 0) & 0xF_FFFF) * super::UNIT_TICKS;
        self.receiver.on_at = self.ticks(world.now()) + wait.max(RX_TURN_US * 638_976 / 10);
        self.await_receiver(world, 0, false);
    }

    fn await_receiver(&mut self, world: &World, command: u32, waiting: bool) {
        self.cancel(Line::Trx);
        self.receiver.waiting = waiting;
        self.receiver.command = command;
        self.trx = Trx::RxWait;
        self.recheck(world);
    }

    /// Clears the events that an enabled receiver starts without. A received frame that the host has not taken yet
    /// keeps its bits.
    fn clear_reception_events(&mut self) {
        self.status &= !status::OF_RECEPTION;
        if !self.double_buffered() || !self.sets[self.ic].full {
            self.sets[self.ic].status = 0;
        }
    }

    pub(super) fn receiver_on(&mut self, world: &World) {
        let Some(settings) = self.rx_settings() else { return };
        self.trx = Trx::Rx;
        self.receiver.preamble_found = false;
        self.receiver.data = None;
        self.clear_reception_events();
        self.statistics.mistuned += u64::from(self.is_mistuned(Direction::Receive));
        world.air().listen(world.kernel(), self.port, settings);
        let now = world.now();
        let frame_wait = u64::from(self.memory.u16(file::RX_FWTO, 0));
        if self.configured(config::RXWTOE) && !self.receiver.waiting {
            self.cancel(Line::Wait);
            self.schedule(world, units_after(now, frame_wait), What::FrameTimeout);
        }
        let chunks = u64::from(self.memory.u16(file::DRX_CONF, 0x24));
        if chunks > 0 {
            // The counter adds one chunk of its own.
            let ticks = (chunks + 1) * u64::from(settings.pac) * settings.prf.symbol_ticks();
            self.schedule(world, now.plus_ps((ticks as f64 / TICKS_PER_PS) as u64), What::PreambleTimeout);
        }
    }

    pub(super) fn frame_timeout(&mut self, world: &World) {
        if matches!(self.trx, Trx::Rx | Trx::RxWait) {
            self.status |= status::RXRFTO;
            self.count(Counter::FrameTimeout);
            self.receiver.stale = true;
            self.idle(world);
        }
    }

    pub(super) fn preamble_timeout(&mut self, world: &World) {
        if self.trx == Trx::Rx && !self.receiver.preamble_found {
            // Like the other timeout, and unlike errors, this leaves the receiver off.
            self.status |= status::RXPTO;
            self.count(Counter::PreambleTimeout);
            self.idle(world);
        }
    }

    /// The frame filter rejects the frame after its header.
    pub(super) fn reject(&mut self, world: &World) {
        if self.trx == Trx::Rx {
            world.air().deafen(self.port);
            self.fail(world, status::AFFREJ, Counter::Rejected, false);
        }
    }

    pub(super) fn receive(&mut self, world: &World, now: TrueTime, heard: ReceptionEvent) {
        if self.trx != Trx::Rx {
            return;
        }
        match heard {
            ReceptionEvent::Preamble => {
                self.receiver.preamble_found = true;
                self.status |= status::RXPRD;
            }
            ReceptionEvent::SfdTimeout => self.fail(world, status::RXSFDTO, Counter::SfdTimeout, false),
            ReceptionEvent::Sfd => {
                self.status |= status::RXSFDD;
                // The PHY header distinguishes 850 kbit/s and 6.8 Mbit/s.
                let slow = self.configured(config::RXM110K);
                self.receiver.data = Some(if slow { Rate::Kbps110 } else { Rate::Kbps6800 });
            }
            ReceptionEvent::HeaderError => self.fail(world, status::RXPHE, Counter::HeaderError, true),
            ReceptionEvent::Header { bytes, phy } => self.header(world, now, &bytes, &phy),
            ReceptionEvent::Frame(reception) => self.frame(world, reception),
        }
    }

    fn header(&mut self, world: &World, now: TrueTime, bytes: &[u8], phy: &Phy) {
        self.status |= status::RXPHD;
        self.receiver.data = Some(phy.rate);
        if self.double_buffered() && self.sets[self.ic].full {
            self.overrun(world);
            return;
        }
        if self.configured(config::FFEN) && !self.filter().passes(bytes) {
            let ticks = header_length(bytes).min(bytes.len()) as u64 * 8 * phy.rate.bit_ticks();
            self.schedule(world, now.plus_ps((ticks as f64 / TICKS_PER_PS) as u64), What::Reject);
        }
    }

    /// A frame arrives and the host has not released its buffer (user manual, 4.3.5). The reception is aborted, and
    /// RX_FINFO, RX_TIME and RX_FQUAL of the frames received before are no longer right.
    fn overrun(&mut self, world: &World) {
        world.air().deafen(self.port);
        for set in &mut self.sets {
            self.random.fill(&mut set.info);
            self.random.fill(&mut set.time);
            self.random.fill(&mut set.quality);
        }
        self.fail(world, status::RXOVRR, Counter::Overrun, true);
    }

    fn filter(&self) -> Filter {
        let mut eui = [0; 8];
        eui.copy_from_slice(self.memory.file(file::EUI));
        let own = self.memory.u32(file::PANADR, 0);
        Filter { config: self.configuration(), pan: (own >> 16) as u16, short: own as u16, eui }
    }

    /// A reception failed: switches the receiver off, or on again automatically.
    fn fail(&mut self, world: &World, bit: u64, counter: Counter, stale: bool) {
        self.status |= bit;
        self.count(counter);
        self.receiver.stale |= stale;
        self.after_reception(world, self.configured(config::RXAUTR), true);
    }

    /// Switches the receiver on again automatically, or off. The frame timeout continues (`waiting`) unless a frame's
    /// data came, with or without errors: a reception that does not set RXDFR does not stop it (user manual, 7.2.14).
    fn after_reception(&mut self, world: &World, again: bool, waiting: bool) {
        if again {
            self.receiver.on_at = self.ticks(world.now()) + RX_TURN_US * 638_976 / 10;
            self.await_receiver(world, 0, waiting);
            return;
        }
        self.trx = Trx::Idle;
        self.cancel(Line::Trx);
        self.cancel(Line::Wait);
        // ARXSLP.
        if self.memory.u32(file::PMSC, 4) & (1 << 12) != 0 {
            self.sleep(world);
        }
    }

    fn frame(&mut self, world: &World, reception: Reception) {
        if reception.payload == Payload::Uncorrectable {
            self.fail(world, status::RXRFSL, Counter::ReedSolomon, true);
            return;
        }
        let good = self.store(world, &reception);
        if good && self.double_buffered() {
            self.sets[self.ic].full = true;
            self.ic ^= 1;
            self.sets[self.ic].status &= if self.sets[self.ic].full { status::OF_SET } else { 0 };
        }
        let again = self.configured(config::RXAUTR) && (self.double_buffered() || !good);
        self.cancel(Line::Wait);
        self.after_reception(world, again, false);
    }

    /// Puts a frame into the chip's current set. Returns whether its check bytes are right.
    fn store(&mut self, world: &World, reception: &Reception) -> bool {
        let now = world.now();
        let length = reception.bytes.len().min(1024);
        let damaged = match reception.payload {
            Payload::Good | Payload::Uncorrectable => None,
            Payload::Corrupted => Some((self.random.random_range(0..length), self.random.random_range(1..=255u8))),
        };
        let from_ones = self.configured(config::FCS_INIT2F);
        let located = self.lde_ready(now);
        let stamps = self.stamps(reception);
        let (interval, offset, carrier) = self.clock_offset(now, reception);
        // 21 bits.
        self.memory.write(file::DRX_CONF, 0x28, &(carrier & 0x1F_FFFF).to_le_bytes()[..3]);
        let response = Response::of(reception);
        self.memory.write(file::DRX_CONF, 0x2C, &response.rxpacc_nosat.to_le_bytes());

        let set = &mut self.sets[self.ic];
        set.buffer[..length].copy_from_slice(&reception.bytes[..length]);
        if let Some((place, flips)) = damaged {
            set.buffer[place] ^= flips;
        }
        let frame = &set.buffer[..length];
        let good = length >= 2
            && check_of(&frame[..length - 2], from_ones).to_le_bytes() == [frame[length - 2], frame[length - 1]];
        set.info = frame_info(reception, length, response.rxpacc).to_le_bytes();
        set.tracking_interval = interval.to_le_bytes();
        set.tracking_offset[..4].copy_from_slice(&(offset as u32 & 0x7_FFFF).to_le_bytes());
        set.status = status::RXDFR | if good { status::RXFCG } else { status::RXFCE };
        set.time = [0; 14];
        set.time[9..].copy_from_slice(&stamps.raw.to_le_bytes()[..5]);
        set.quality = [0; 8];
        if located {
            let f = response.first_path_amplitudes();
            set.status |= status::LDEDONE;
            set.time[..5].copy_from_slice(&stamps.adjusted.to_le_bytes()[..5]);
            set.time[5..7].copy_from_slice(&((response.first_path * 64.0) as u16).to_le_bytes());
            // FP_AMPL1 is three samples after the first path, FP_AMPL2 two, FP_AMPL3 one.
            set.time[7..9].copy_from_slice(&f[2].to_le_bytes());
            let noise = (response.noise * 2f64.sqrt()).round() as u16;
            for (slot, value) in [noise, f[1], f[0], response.cir_power].into_iter().enumerate() {
                set.quality[2 * slot..2 * slot + 2].copy_from_slice(&value.to_le_bytes());
            }
            let (peak, height) = response.peak();
            // The threshold in LDE_THRESH is the noise times NTM (user manual, 7.2.47).
            let multiplier = u16::from(self.memory.u8(file::LDE_IF, 0x0806) & 0x1F);
            self.memory.write(file::LDE_IF, 0x0000, &noise.saturating_mul(multiplier).to_le_bytes());
            self.memory.write(file::LDE_IF, 0x1000, &peak.to_le_bytes());
            self.memory.write(file::LDE_IF, 0x1002, &height.to_le_bytes());
        }
        if !located && self.memory.u32(file::PMSC, 4) & (1 << 17) != 0 {
            // LDERUNE without microcode: the detector fails.
            self.status |= status::LDEERR;
        }
        self.response = Some(response);
        self.count(if good { Counter::FcsGood } else { Counter::FcsError });
        good
    }

    fn stamps(&mut self, reception: &Reception) -> Stamps {
        let delay = self.config.rx_antenna_ticks + self.delay_drift();
        let arrived = self.clock.count_at(reception.marker).plus_ticks(delay).0.wrapping_sub(self.counter_zero.0);
        let mut error = reception.stamp_error_ps * TICKS_PER_PS;
        if std::mem::take(&mut self.receiver.stale) {
            // 64 to 512 ticks, 0.3 to 2.4 m.
            error += self.random.random_range(64.0..512.0);
            self.statistics.bad_stamps += 1;
        }
        let adjusted = arrived as f64 / 256.0 + error - f64::from(self.memory.u16(file::LDE_IF, 0x1804));
        Stamps { adjusted: adjusted.round() as u64 & MASK_40, raw: (arrived >> 8) & MASK_40 & !511 }
    }

    /// RX_TTCKI, RXTOFS and DRX_CAR_INT. All are positive if our clock runs faster than the sender's.
    fn clock_offset(&mut self, now: TrueTime, reception: &Reception) -> (u32, i32, i32) {
        let ours = self.clock.ppm_at(now) - reception.sender_ppm;
        let mut noisy = |deviation_ppm: f64| (ours + deviation_ppm * gauss(&mut self.random)) * 1e-6;
        let interval: u32 = match reception.phy.prf {
            Prf::Mhz16 => 0x01F0_0000,
            Prf::Mhz64 => 0x01FC_0000,
        };
        let offset = (noisy(0.2) * f64::from(interval)).round() as i32;
        // User manual, 7.2.40.11: a step is 998.4 MHz / 2 / 1024 / 2¹⁷, and an eighth of it at 110 kbit/s.
        let chips = if reception.phy.rate == Rate::Kbps110 { 8192.0 } else { 1024.0 };
        let step_hz = 998.4e6 / 2.0 / chips / 131_072.0;
        let carrier = (noisy(0.05) * Phy::centre_hz(reception.phy.channel) / step_hz).round();
        (interval, offset, carrier.clamp(-1_048_576.0, 1_048_575.0) as i32)
    }

    pub(super) fn swing_host(&mut self) {
        let set = &mut self.sets[self.host];
        set.full = false;
        set.status = 0;
        self.host ^= 1;
        self.status &= !status::RXOVRR;
    }

    fn double_buffered(&self) -> bool {
        !self.configured(config::DIS_DRXB)
    }

    /// The receiver settings in SYS_CFG, CHAN_CTRL and the tuning registers; `None` if they are not valid.
    fn rx_settings(&self) -> Option<RxSettings> {
        let channels = self.memory.u32(file::CHAN_CTRL, 0);
        let slow = self.configured(config::RXM110K);
        let rate = if slow { Rate::Kbps110 } else { Rate::Kbps6800 };
        Some(RxSettings {
            channel: self.channel((channels >> 4 & 0xF) as u8)?,
            code: (channels >> 27) as u8,
            prf: prf(channels >> 18 & 3)?,
            sfd: self.sfd(channels & channel::RNSSFD != 0, rate),
            slow,
            long_frames: self.configuration() & config::PHR_MODE == config::PHR_MODE,
            // DRX_TUNE2: 0x31…, 0x33…, 0x35…, 0x37… for chunks of 8, 16, 32, 64.
            pac: 8 << (self.memory.u8(file::DRX_CONF, 0x0B) >> 1 & 3),
            sfd_timeout: self.memory.u16(file::DRX_CONF, 0x20),
        })
    }
}

struct Stamps {
    /// The time of the first path minus the antenna delay.
    adjusted: u64,
    /// The time on the 125 MHz clock, without any correction.
    raw: u64,
}
