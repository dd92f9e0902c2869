//! A DW1000 at register level: what a host sees through SPI and the IRQ pin, and what the air receives.
//!
//! The source is the DW1000 user manual. Where it says nothing, the constants below state the assumptions. Not
//! modelled: automatic acknowledgement, GPIO, external synchronisation, sniff mode, and the DIS_* switches of SYS_CFG
//! except those of the receive buffers. `README.md` says where the model is more lenient than silicon.

mod bits;
mod bus;
mod config;
mod energy;
mod filter;
mod output_power;
mod power;
mod receive;
mod received;
mod registers;
mod transmit;
mod tuning;

pub(crate) use bus::{Address, Contact, Header};
pub use config::{ChipConfig, ChipStatistics};
pub use energy::{Activity, Consumption, Currents};

use crate::air::{AirClient, PortId, ReceptionEvent, Response};
use crate::clock::{Clock, Count};
use crate::irq::IrqLine;
use crate::random::{Purpose, Stream, stream};
use crate::time::TrueTime;
use crate::world::World;
use bits::{config as cfg, status};
use energy::Ledger;
use power::Power;
use rand::Rng;
use receive::Receiver;
use received::ReceiveSet;
use registers::{Memory, file};
use std::rc::Rc;
use transmit::Transmission;

/// From reset, power-up or wake-up until the crystal runs and the chip responds, microseconds.
const CRYSTAL_START_US: u64 = 3_000;
/// From then until the clock PLL has locked, microseconds.
const PLL_LOCK_US: u64 = 40;
/// From TXSTRT until the first preamble symbol, microseconds; a delayed start nearer than this raises TXPUTE.
const TX_START_US: u64 = 10;
/// From RXENAB until the receiver is on, microseconds.
const RX_START_US: u64 = 16;
/// From the end of a transmission until the receiver is on, microseconds, with WAIT4RESP and no W4R_TIM; also for
/// automatic re-enabling.
const RX_TURN_US: u64 = 10;
/// The time to load the LDE microcode.
const LDE_LOAD_US: u64 = 150;

const MASK_40: u64 = (1 << 40) - 1;
/// Half of the counter's period: starts farther ahead than that raise HPDWARN.
const HALF_PERIOD: f64 = (1u64 << 39) as f64;
/// Ticks of a chip's microsecond unit (512 counts at 499.2 MHz = 1.0256 µs): RX_FWTO, W4R_TIM.
const UNIT_TICKS: u64 = 65_536;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ChipEvent {
    what: What,
    generation: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum What {
    CrystalRuns,
    PllLocks,
    SleepEnds,
    TransmitterOn,
    PreambleSent,
    Marker,
    HeaderSent,
    TransmissionEnds,
    ReceiverOn,
    /// The start is far away: check it again when it is nearer.
    Recheck,
    Reject,
    FrameTimeout,
    PreambleTimeout,
}

/// Counters that make scheduled events stale, one per line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Line {
    Power,
    Trx,
    Wait,
}

impl What {
    const fn line(self) -> Line {
        match self {
            Self::CrystalRuns | Self::PllLocks | Self::SleepEnds => Line::Power,
            Self::TransmitterOn
            | Self::PreambleSent
            | Self::Marker
            | Self::HeaderSent
            | Self::TransmissionEnds
            | Self::ReceiverOn
            | Self::Recheck
            | Self::Reject
            | Self::PreambleTimeout => Line::Trx,
            Self::FrameTimeout => Line::Wait,
        }
    }
}

/// Which of transmitter and receiver is enabled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    Send,
    Receive,
}

/// The state of transmitter and receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trx {
    Idle,
    TxWait,
    Tx,
    RxWait,
    Rx,
}

/// The event counters of DIG_DIAG, by offset.
#[derive(Clone, Copy)]
enum Counter {
    HeaderError = 0x04,
    ReedSolomon = 0x06,
    FcsGood = 0x08,
    FcsError = 0x0A,
    Rejected = 0x0C,
    Overrun = 0x0E,
    SfdTimeout = 0x10,
    PreambleTimeout = 0x12,
    FrameTimeout = 0x14,
    Sent = 0x16,
    HalfPeriod = 0x18,
    PowerUp = 0x1A,
}

/// The chip.
pub struct Chip {
    node: u32,
    port: PortId,
    config: ChipConfig,
    clock: Clock,
    /// The count when the counter starts.
    first_count: u64,
    /// The count of the clock at which the counter was zero.
    counter_zero: Count,
    memory: Memory,
    status: u64,
    /// HPDWARN and TXPUTE, which belong to the pending start.
    warnings: u64,
    trx: Trx,
    power: Power,
    lines: [u32; 3],
    transmission: Option<Transmission>,
    receiver: Receiver,
    sets: [ReceiveSet; 2],
    /// The receive set that the host reads.
    host: usize,
    /// The receive set that the chip fills.
    ic: usize,
    response: Option<Response>,
    random: Stream,
    irq: Rc<IrqLine>,
    statistics: ChipStatistics,
    ledger: Ledger,
}

impl Chip {
    pub(crate) fn new(now: TrueTime, node: u32, port: PortId, seed: u64, config: ChipConfig, irq: Rc<IrqLine>) -> Self {
        let mut birth = stream(seed, Purpose::Birth, u64::from(node));
        let drawn: u64 = birth.random();
        let first_count = config.counter.unwrap_or(drawn) & MASK_40;
        // The clock starts at a count so high that it stays positive at the counter's zero.
        let first = Count::from_ticks(1 << 41);
        let clock = Clock::new(config.clock, first, stream(seed, Purpose::Oscillator, u64::from(node)));
        let mut chip = Self {
            node,
            port,
            config,
            clock,
            first_count,
            counter_zero: first,
            memory: Memory::reset(),
            status: 0,
            warnings: 0,
            trx: Trx::Idle,
            power: Power::off(),
            lines: [0; 3],
            transmission: None,
            receiver: Receiver::default(),
            sets: [ReceiveSet::new(), ReceiveSet::new()],
            host: 0,
            ic: 0,
            response: None,
            random: birth,
            irq,
            statistics: ChipStatistics::default(),
            ledger: Ledger::new(now),
        };
        chip.restart_counter(now);
        chip.default_registers();
        chip
    }

    /// Counts of the host's errors and of its use of the bus.
    pub fn statistics(&self) -> ChipStatistics {
        self.statistics
    }

    /// The counter at `time`, 40 bits, whole ticks.
    pub fn counter(&mut self, time: TrueTime) -> u64 {
        self.ticks(time) & MASK_40
    }

    /// The error of the chip's clock at `time`, parts per million.
    pub fn clock_ppm(&mut self, time: TrueTime) -> f64 {
        self.clock.ppm_at(time)
    }

    /// Changes the temperature around the chip.
    pub fn set_temperature(&mut self, celsius: f64) {
        self.config.temperature_c = celsius;
    }

    pub(crate) fn handle(&mut self, world: &World, event: ChipEvent) {
        if self.lines[event.what.line() as usize] != event.generation {
            return;
        }
        match event.what {
            What::CrystalRuns => self.crystal_runs(world),
            What::PllLocks => self.pll_locks(world),
            What::SleepEnds => self.wake(world),
            What::TransmitterOn => self.transmitter_on(world),
            What::PreambleSent => self.sent_so_far(status::TXPRS),
            What::Marker => self.marker(world),
            What::HeaderSent => self.sent_so_far(status::TXPHS),
            What::TransmissionEnds => self.transmission_ends(world),
            What::ReceiverOn => self.receiver_on(world),
            What::Recheck => self.recheck(world),
            What::Reject => self.reject(world),
            What::FrameTimeout => self.frame_timeout(world),
            What::PreambleTimeout => self.preamble_timeout(world),
        }
        self.settle(world);
    }

    fn schedule(&self, world: &World, at: TrueTime, what: What) {
        let event = ChipEvent { what, generation: self.lines[what.line() as usize] };
        world.schedule_chip(at, self.node, event);
    }

    fn schedule_in(&self, world: &World, micros: u64, what: What) {
        self.schedule(world, world.now() + std::time::Duration::from_micros(micros), what);
    }

    /// Makes the events scheduled on `line` stale.
    fn cancel(&mut self, line: Line) {
        let generation = &mut self.lines[line as usize];
        *generation = generation.wrapping_add(1);
    }

    /// Starts the counter, now.
    fn restart_counter(&mut self, now: TrueTime) {
        self.counter_zero = Count(self.clock.count_at(now).0.wrapping_sub(Count::from_ticks(self.first_count).0));
    }

    /// The chip's activity, which determines its current.
    fn activity(&self) -> Activity {
        let Some(powered) = self.power.activity(self.sleeps_with_counter()) else {
            return match (self.trx, &self.transmission) {
                (Trx::Tx, Some(t)) => t.activity(),
                (Trx::Rx, _) => match self.receiver.data {
                    Some(rate) => Activity::ReceiveData(rate),
                    None => Activity::ReceivePreamble,
                },
                (Trx::Idle | Trx::TxWait | Trx::Tx | Trx::RxWait, _) => Activity::Idle,
            };
        };
        powered
    }

    /// Ticks of the counter since it was zero, unwrapped.
    fn ticks(&mut self, time: TrueTime) -> u64 {
        Count(self.clock.count_at(time).0.wrapping_sub(self.counter_zero.0)).ticks()
    }

    /// The time at which the unwrapped counter shows `ticks`.
    fn time_of(&mut self, ticks: f64) -> TrueTime {
        self.clock.time_of(self.counter_zero.plus_ticks(ticks))
    }

    /// Ticks from now until the counter shows `wanted` (40 bits) minus `lead`. Negative if that is past.
    fn ticks_until(&mut self, now: TrueTime, wanted: u64, lead: u64) -> i64 {
        let ahead = wanted.wrapping_sub(lead).wrapping_sub(self.ticks(now)) & MASK_40;
        ((ahead << 24) as i64) >> 24
    }

    fn configuration(&self) -> u32 {
        self.memory.u32(file::SYS_CFG, 0)
    }

    fn configured(&self, bit: u32) -> bool {
        self.configuration() & bit != 0
    }

    fn count(&mut self, counter: Counter) {
        if self.memory.u8(file::DIG_DIAG, 0) & 1 != 0 {
            let value = (self.memory.u16(file::DIG_DIAG, counter as usize) + 1) & 0xFFF;
            self.memory.write(file::DIG_DIAG, counter as usize, &value.to_le_bytes());
        }
    }

    /// SYS_STATUS as the host reads it.
    fn status_word(&self) -> u64 {
        let mut word = self.status | self.warnings | self.sets[self.host].status | self.transmit_progress();
        if self.host == 1 {
            word |= status::HSRBP;
        }
        if self.ic == 1 {
            word |= status::ICRBP;
        }
        let mask = u64::from(self.memory.u32(file::SYS_MASK, 0));
        word | u64::from(word & mask & !1 != 0)
    }

    fn update_irq(&self, world: &World) {
        let active = self.power.answers() && self.status_word() & 1 != 0;
        let level = active == self.configured(cfg::HIRQ_POL);
        // A chip that is off or asleep drives the line low.
        self.irq.set(world, level && self.power.answers());
    }

    /// Every operation calls this at its end.
    fn settle(&mut self, world: &World) {
        self.account(world.now());
        self.update_irq(world);
    }
}

impl AirClient for Chip {
    fn on_air(&mut self, world: &World, now: TrueTime, heard: ReceptionEvent) {
        self.receive(world, now, heard);
        self.settle(world);
    }
}
