//! Random operations on two and three chips on one air: `random_operations [OPERATIONS] [SEED]`.
//!
//! Hosts write valid and invalid values to registers, start and stop transmitters and receivers, pull reset lines, send
//! chips to sleep, switch off supplies, and change clocks and the air. Nothing may panic and no operation may last for
//! ever. To repeat a failure, use the seed in the last line of the output. It is the seed of the world and not of the
//! run.

use dw1000_sim::{AirConfig, BoardProfile, ChipConfig, ClockConfig, Node, NodeConfig, Path, Peripherals, World};
use embedded_hal::digital::OutputPin;
use embedded_hal_async::spi::{Operation, SpiDevice};
use rand::Rng;
use rand::seq::IndexedRandom;
use std::time::{Duration, Instant};

/// Operations in one world.
const IN_A_WORLD: u64 = 400;

/// Register files that have an effect. Some are listed more than once so that they are drawn more often.
const FILES: [u8; 26] = [
    0x01, 0x03, 0x04, 0x04, 0x08, 0x09, 0x0A, 0x0A, 0x0C, 0x0E, 0x0F, 0x17, 0x18, 0x1A, 0x1E, 0x1F, 0x21, 0x23, 0x27,
    0x28, 0x2A, 0x2C, 0x2D, 0x2E, 0x2F, 0x36,
];
/// SYS_CTRL: TXSTRT, TXDLYS, TRXOFF, WAIT4RESP, RXENAB, RXDLYE, HRBPT and combinations of them.
const COMMANDS: [u32; 14] = [
    0x0002,
    0x0006,
    0x0040,
    0x0082,
    0x0086,
    0x0100,
    0x0100,
    0x0100,
    0x0300,
    0x0102,
    0x0106,
    0x0042,
    0x0100_0000,
    0x0003,
];

fn main() {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u64| match arguments.next() {
        None => default,
        Some(text) => text.parse().unwrap_or_else(|_| panic!("not a number: {text}")),
    };
    let (operations, seed) = (number(1_000_000), number(1));
    let begin = Instant::now();
    let mut told = 0;
    let totals = run(operations, seed, |totals, world_seed| {
        if totals.operations - told >= 5_000_000 {
            told = totals.operations;
            println!("{totals:?} in {:.0} s; world {world_seed}", begin.elapsed().as_secs_f64());
        }
    });
    println!("{totals:?} from seed {seed} on in {:.0} s: nothing panicked", begin.elapsed().as_secs_f64());
}

/// The totals of all worlds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Totals {
    /// Operations.
    pub operations: u64,
    /// Transactions on the buses.
    pub transactions: u64,
    /// Transactions with chips that were off, in reset, asleep or slower than the bus.
    pub missed: u64,
    /// Frames whose transmission began.
    pub sent: u64,
    /// Preambles found.
    pub found: u64,
    /// Frames received.
    pub received: u64,
}

/// Runs worlds with seeds from `seed` on until `operations` operations are done. Before each world, `progress` receives
/// the totals up to now and the world's seed.
pub fn run(operations: u64, seed: u64, mut progress: impl FnMut(&Totals, u64)) -> Totals {
    let mut totals = Totals::default();
    let mut world_seed = seed;
    while totals.operations < operations {
        progress(&totals, world_seed);
        one_world(world_seed, &mut totals);
        world_seed += 1;
    }
    totals
}

fn one_world(seed: u64, totals: &mut Totals) {
    let cut_off_m = if seed.is_multiple_of(5) { 5_000.0 } else { 150.0 };
    let world = World::new(seed, AirConfig { cut_off_m, ..AirConfig::default() });
    let random = &mut world.random(0);
    let hosts: Vec<Host> = (0..random.random_range(2..=3)).map(|_| Host::new(&world, random)).collect();
    if random.random_bool(0.9) {
        world.run_for(Duration::from_millis(4));
        hosts.iter().for_each(|h| h.set_up(random));
    }
    for _ in 0..IN_A_WORLD {
        if random.random_bool(0.05) {
            exchange(&hosts, random);
        } else if let Some(host) = hosts.choose(random) {
            host.anything(random);
        }
    }
    for host in &hosts {
        let consumption = host.node.consumption();
        assert!(consumption.charge_uc.is_finite() && consumption.charge_uc >= 0.0);
        totals.transactions += host.node.chip_statistics().transactions;
        totals.missed += host.missed();
    }
    let air = world.statistics();
    totals.operations += IN_A_WORLD;
    totals.sent += air.frames_sent;
    totals.found += air.receptions;
    totals.received += air.received;
}

/// One host sends while the others listen. Sometimes it stops early, and another host begins at once.
fn exchange(hosts: &[Host], random: &mut impl Rng) {
    for host in hosts {
        host.command(0x0040);
        host.command(0x0100);
    }
    let Some(sender) = hosts.choose(random) else { return };
    sender.command(0x0040);
    sender.command(0x0002);
    if random.random_bool(0.5) {
        sender.world.run_for(Duration::from_micros(random.random_range(0..250)));
        match random.random_range(0..10) {
            0 => sender.node.power_off(),
            1 => {
                let Ok(()) = sender.node.peripherals().reset.set_low();
            }
            _ => sender.command(0x0040),
        }
        if let Some(next) = hosts.choose(random) {
            sender.world.run_for(Duration::from_micros(random.random_range(0..100)));
            next.command(0x0040);
            next.command(0x0002);
        }
    }
    sender.world.run_for(Duration::from_micros(random.random_range(0..500)));
}

struct Host {
    world: World,
    node: Node,
}

impl Host {
    fn new(world: &World, random: &mut impl Rng) -> Self {
        let far = if random.random_bool(0.1) { 4_000.0 } else { 30.0 };
        let position = [random.random_range(0.0..far), 0.0, 1.0];
        let clock = ClockConfig::crystal(random.random_range(-20.0..20.0));
        let counter = random.random_bool(0.5).then(|| (1 << 40) - random.random_range(1..1_000_000_000));
        let chip = ChipConfig { clock, counter, ..ChipConfig::default() };
        let config = NodeConfig { path: Path::Fixed(position), chip, board: BoardProfile::INSTANT };
        Self { world: world.clone(), node: world.add_node(config) }
    }

    fn transact(&self, operations: &mut [Operation<'_, u8>]) {
        let Peripherals { mut spi, .. } = self.node.peripherals();
        assert!(self.world.block_on(spi.transaction(operations)).is_some(), "a transaction ends");
    }

    fn write(&self, file: u8, offset: u16, data: &[u8]) {
        let (low, high) = (0x80 | (offset & 0x7F) as u8, (offset >> 7) as u8);
        let header: &[u8] = if offset == 0 { &[0x80 | file] } else { &[0xC0 | file, low, high] };
        self.transact(&mut [Operation::Write(header), Operation::Write(data)]);
    }

    fn read(&self, file: u8, offset: u16, data: &mut [u8]) {
        let (low, high) = (0x80 | (offset & 0x7F) as u8, (offset >> 7) as u8);
        let header: &[u8] = if offset == 0 { &[file] } else { &[0x40 | file, low, high] };
        self.transact(&mut [Operation::Write(header), Operation::Read(data)]);
    }

    /// SYS_CTRL.
    fn command(&self, bits: u32) {
        self.write(0x0D, 0, &bits.to_le_bytes());
    }

    /// Microcode, a fast bus, and settings that the chips often share, so that frames are received.
    fn set_up(&self, random: &mut impl Rng) {
        self.write(0x36, 0, &[0x01, 0x03]);
        self.write(0x2D, 0x06, &[0x00, 0x80]);
        self.world.run_for(Duration::from_micros(160));
        self.write(0x36, 0, &[0x00, 0x02]);
        self.node.peripherals().spi.clock().set_hz(20_000_000);
        self.configure(random);
    }

    /// Rate and preamble of TX_FCTRL and SYS_CFG; buffers, re-enabling, timeouts.
    fn configure(&self, random: &mut impl Rng) {
        let slow = random.random_bool(0.2);
        let length: u32 = random.random_range(3..40);
        let preamble: u32 = if slow { 0b0010 } else { 0b0101 };
        let rate: u32 = if slow { 0 } else { random.random_range(1..3) };
        self.write(0x08, 0, &(length | rate << 13 | 1 << 15 | 1 << 16 | preamble << 18).to_le_bytes());
        let bit = |random: &mut dyn rand::RngCore, at: u32| u32::from(random.random_bool(0.5)) << at;
        let config = 0x200 | bit(random, 12) | bit(random, 28) | bit(random, 29) | u32::from(slow) << 22;
        self.write(0x04, 0, &config.to_le_bytes());
    }

    /// Brings the chip up from any state.
    fn bring_up(&self, random: &mut impl Rng) {
        self.node.power_on();
        let Peripherals { mut reset, spi, .. } = self.node.peripherals();
        spi.clock().set_hz(2_000_000);
        let Ok(()) = reset.set_low();
        let Ok(()) = reset.set_high();
        self.world.run_for(Duration::from_micros(3_100));
        self.set_up(random);
    }

    fn missed(&self) -> u64 {
        let seen = self.node.chip_statistics();
        seen.deaf + seen.too_fast
    }

    fn anything(&self, random: &mut impl Rng) {
        let before = self.missed();
        self.something(random);
        if self.missed() > before && random.random_bool(0.3) {
            self.bring_up(random);
        }
    }

    fn something(&self, random: &mut impl Rng) {
        match random.random_range(0..1000) {
            0..250 => {
                self.command(COMMANDS.choose(random).copied().unwrap_or(0));
            }
            250..350 => self.start_at(random),
            350..600 => self.wait(random),
            600..680 => self.write(0x0F, 0, &[0xFF; 5]),
            680..760 => {
                let mut data = vec![0; random.random_range(0..64)];
                self.read(random.random_range(0..0x40), random.random_range(0..0x40), &mut data);
            }
            760..800 => self.configure(random),
            800..880 => {
                let mut data = vec![0; random.random_range(0..12)];
                random.fill(&mut data[..]);
                let offset =
                    if random.random_bool(0.8) { random.random_range(0..0x30) } else { random.random_range(0..0x2900) };
                self.write(FILES.choose(random).copied().unwrap_or(0), offset, &data);
            }
            880..900 => self.write(random.random_range(0..0x40), random.random(), &[random.random(), random.random()]),
            900..920 => self.soft_reset(random),
            920..940 => self.sleep(random),
            940..955 => self.transact(&mut [Operation::DelayNs(random.random_range(0..1_000_000))]),
            955..970 => {
                let Ok(()) = self.node.peripherals().reset.set_state(random.random_bool(0.7).into());
            }
            970..980 => self.supply(random),
            980..985 => self.node.peripherals().spi.clock().set_hz(random.random_range(1_000_000..24_000_000)),
            985..990 => self.node.chip().set_temperature(random.random_range(-40.0..85.0)),
            990..995 => self.world.air().set_loss(random.random_range(0.0..0.3)),
            _ => self.bring_up(random),
        }
    }

    /// Writes DX_TIME near the present, before or after it, or far from it, and a delayed start.
    fn start_at(&self, random: &mut impl Rng) {
        let mut now = [0; 8];
        self.read(0x06, 0, &mut now[..5]);
        let span: i64 = match random.random_range(0..10) {
            0 => random.random_range(-(1 << 39)..1 << 39),
            1 => random.random_range(-64_000_000..0),
            _ => random.random_range(0..130_000_000),
        };
        let at = u64::from_le_bytes(now).wrapping_add_signed(span);
        self.write(0x0A, 0, &at.to_le_bytes()[..5]);
        self.command([0x0006, 0x0086, 0x0300, 0x0106].choose(random).copied().unwrap_or(0x0006));
    }

    fn wait(&self, random: &mut impl Rng) {
        let micros = match random.random_range(0..100) {
            0..70 => random.random_range(0..200),
            70..99 => random.random_range(0..5_000),
            _ => random.random_range(0..20_000_000),
        };
        self.world.run_for(Duration::from_micros(micros));
    }

    fn soft_reset(&self, random: &mut impl Rng) {
        self.write(0x36, 3, &[random.random_range(0..16) << 4]);
        if random.random_bool(0.8) {
            self.write(0x36, 3, &[0xF0]);
        }
    }

    /// AON_WCFG, AON_CFG0 and SAVE.
    fn sleep(&self, random: &mut impl Rng) {
        self.write(0x2C, 0x00, &(random.random::<u16>() & 0x0846).to_le_bytes());
        self.write(
            0x2C,
            0x06,
            &(1 | random.random_range(0..4) << 2 | random.random_range(0u32..3) << 16).to_le_bytes(),
        );
        self.write(0x2C, 0x02, &[0]);
        self.write(0x2C, 0x02, &[2]);
    }

    fn supply(&self, random: &mut impl Rng) {
        if random.random_bool(0.5) {
            self.node.power_off();
        } else {
            self.node.power_on();
            self.node.peripherals().spi.clock().set_hz(2_000_000);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_operations_never_panic() {
        let totals = run(1_000_000, 1, |_, _| {});
        assert!(totals.operations >= 1_000_000);
        // The operations have an effect: frames are sent and received.
        assert!(totals.sent > 10_000 && totals.received > 1_000, "{totals:?}");
    }
}
