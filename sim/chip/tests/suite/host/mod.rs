//! A host that reads and writes registers by their number, as the user manual names them.

use dw1000_sim::{AirConfig, BoardProfile, ChipConfig, ClockConfig, Node, NodeConfig, Peripherals, World};
use embedded_hal_async::spi::{Operation, SpiDevice};
use std::time::Duration;

/// Ticks of a microsecond.
pub const MICROSECOND: f64 = 63_897.6;
/// The 40-bit counter wraps.
pub const MASK: u64 = (1 << 40) - 1;
/// Light in air, metres a tick: 299 792 458 / 1.000293 / 63 897 600 000.
pub const METRES_PER_TICK: f64 = 0.004_690_389;

/// A node whose processor takes no time, and its registers.
pub struct Host {
    pub world: World,
    pub node: Node,
    pub p: Peripherals,
}

/// An air without noise, bias, random loss or echoes.
pub fn quiet() -> AirConfig {
    AirConfig { scatter_db: -60.0, ..AirConfig::ideal() }
}

/// A chip with a perfect clock that starts at `counter`.
pub fn chip(counter: u64) -> ChipConfig {
    ChipConfig { clock: ClockConfig::IDEAL, counter: Some(counter), ..ChipConfig::default() }
}

/// A node at (x, 0, 0), its chip started, its receiver ready (microcode loaded), the bus at 8 MHz.
pub fn ready(world: &World, x: f64, chip: ChipConfig) -> Host {
    let host = started(world, x, chip);
    host.load_microcode();
    host.fast();
    host
}

/// A node at (x, 0, 0) whose chip has just locked its PLL.
pub fn started(world: &World, x: f64, chip: ChipConfig) -> Host {
    let node = world.add_node(NodeConfig { chip, board: BoardProfile::INSTANT, ..NodeConfig::at([x, 0.0, 0.0]) });
    let p = node.peripherals();
    world.run_for(Duration::from_millis(5));
    Host { world: world.clone(), node, p }
}

impl Host {
    /// Reads `N` bytes of a register file from an offset.
    pub fn read<const N: usize>(&self, file: u8, offset: u16) -> [u8; N] {
        let mut data = [0; N];
        self.transact(&mut [Operation::Write(&header(false, file, offset)), Operation::Read(&mut data)]);
        data
    }

    pub fn write(&self, file: u8, offset: u16, data: &[u8]) {
        self.transact(&mut [Operation::Write(&header(true, file, offset)), Operation::Write(data)]);
    }

    pub fn transact(&self, operations: &mut [Operation<'_, u8>]) {
        let mut spi = self.node.peripherals().spi;
        self.world.block_on(spi.transaction(operations)).expect("a transaction ends").expect("and cannot fail");
    }

    pub fn read_u32(&self, file: u8, offset: u16) -> u32 {
        u32::from_le_bytes(self.read(file, offset))
    }

    pub fn read_u40(&self, file: u8, offset: u16) -> u64 {
        let [a, b, c, d, e] = self.read(file, offset);
        u64::from_le_bytes([a, b, c, d, e, 0, 0, 0])
    }

    pub fn write_u32(&self, file: u8, offset: u16, value: u32) {
        self.write(file, offset, &value.to_le_bytes());
    }

    pub fn write_u40(&self, file: u8, value: u64) {
        self.write(file, 0, &value.to_le_bytes()[..5]);
    }

    pub fn status(&self) -> u64 {
        self.read_u40(0x0F, 0)
    }

    pub fn clear_status(&self) {
        self.write(0x0F, 0, &[0xFF; 5]);
    }

    /// SYS_CTRL.
    pub fn command(&self, bits: u32) {
        self.write_u32(0x0D, 0, bits);
    }

    pub fn after_us(&self, micros: u64) {
        self.world.run_for(Duration::from_micros(micros));
    }

    pub fn fast(&self) {
        self.p.spi.clock().set_hz(8_000_000);
    }

    pub fn slow(&self) {
        self.p.spi.clock().set_hz(2_000_000);
    }

    /// User manual, 2.5.5.10: PMSC_CTRL0 = 0x0301, OTP_CTRL = 0x8000, 150 µs, PMSC_CTRL0 = 0x0200.
    pub fn load_microcode(&self) {
        self.write(0x36, 0, &[0x01, 0x03]);
        self.write(0x2D, 0x06, &[0x00, 0x80]);
        self.after_us(151);
        self.write(0x36, 0, &[0x00, 0x02]);
    }

    /// Puts a frame into the buffer. The chip adds its check bytes.
    pub fn prepare(&self, body: &[u8]) {
        self.write(0x09, 0, body);
        // 6.81 Mbit/s, ranging bit, PRF 16, 128 symbols, as after reset except for the length.
        self.write_u32(0x08, 0, 0x0015_C000 | (body.len() as u32 + 2));
    }

    /// Sends a frame at once and waits until it has left.
    pub fn send(&self, body: &[u8]) {
        self.prepare(body);
        self.command(TXSTRT);
        self.after_us(600);
        assert_ne!(self.status() & TXFRS, 0, "sent");
    }

    /// RX_BUFFER's first `N` bytes.
    pub fn received<const N: usize>(&self) -> [u8; N] {
        self.read(0x11, 0)
    }
}

/// The three kinds of header.
pub fn header(write: bool, file: u8, offset: u16) -> Vec<u8> {
    let first = u8::from(write) << 7 | file;
    match offset {
        0 => vec![first],
        1..128 => vec![first | 0x40, offset as u8],
        _ => vec![first | 0x40, 0x80 | (offset & 0x7F) as u8, (offset >> 7) as u8],
    }
}

pub const CPLOCK: u64 = 1 << 1;
pub const TXFRB: u64 = 1 << 4;
pub const TXPRS: u64 = 1 << 5;
pub const TXPHS: u64 = 1 << 6;
pub const TXFRS: u64 = 1 << 7;
pub const RXPRD: u64 = 1 << 8;
pub const RXSFDD: u64 = 1 << 9;
pub const LDEDONE: u64 = 1 << 10;
pub const RXPHD: u64 = 1 << 11;
pub const RXPHE: u64 = 1 << 12;
pub const RXDFR: u64 = 1 << 13;
pub const RXFCG: u64 = 1 << 14;
pub const RXFCE: u64 = 1 << 15;
pub const RXRFSL: u64 = 1 << 16;
pub const RXRFTO: u64 = 1 << 17;
pub const LDEERR: u64 = 1 << 18;
pub const RXOVRR: u64 = 1 << 20;
pub const RXPTO: u64 = 1 << 21;
pub const SLP2INIT: u64 = 1 << 23;
pub const RXSFDTO: u64 = 1 << 26;
pub const HPDWARN: u64 = 1 << 27;
pub const AFFREJ: u64 = 1 << 29;
pub const HSRBP: u64 = 1 << 30;
pub const ICRBP: u64 = 1 << 31;
pub const TXPUTE: u64 = 1 << 34;

pub const SFCST: u32 = 1;
pub const TXSTRT: u32 = 1 << 1;
pub const TXDLYS: u32 = 1 << 2;
pub const TRXOFF: u32 = 1 << 6;
pub const WAIT4RESP: u32 = 1 << 7;
pub const RXENAB: u32 = 1 << 8;
pub const RXDLYE: u32 = 1 << 9;
pub const HRBPT: u32 = 1 << 24;
