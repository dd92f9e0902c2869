//! Two blocking drivers written in the manner of C on two simulated chips: single-sided ranging over 30 m.
//!
//! A C driver accesses its bus and its clock through a table of function pointers. Here that table leads to
//! [`World::block_on`] and [`World::run_for`]. One thread drives both drivers in turn: while one driver waits for its
//! bus or sleeps, everything else in the world continues. With a real C driver, [`Operations`] is the driver's own type
//! (such as `dwOps_t`), and the rest of this file's first half stays as it is.

use dw1000_sim::{AirConfig, BoardProfile, ChipConfig, ClockConfig, NodeConfig, Path, SimSpi, World};
use embedded_hal_async::spi::{Operation, SpiDevice};
use std::cell::RefCell;
use std::slice;
use std::time::Duration;

/// The functions that a C driver needs from its platform. `device` selects the chip.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Operations {
    /// Sends a header, then reads.
    pub read: extern "C" fn(device: u32, header: *const u8, header_length: usize, data: *mut u8, length: usize),
    /// Sends a header, then data.
    pub write: extern "C" fn(device: u32, header: *const u8, header_length: usize, data: *const u8, length: usize),
    /// Sets the bus to below 3 MHz (0) or to up to 20 MHz.
    pub set_fast: extern "C" fn(device: u32, fast: u8),
    /// Waits.
    pub delay_us: extern "C" fn(micros: u32),
}

/// The platform. C callbacks have no closure that could hold it.
struct Platform {
    world: World,
    buses: Vec<SimSpi>,
}

thread_local! {
    static PLATFORM: RefCell<Option<Platform>> = const { RefCell::new(None) };
}

fn with_platform<T>(act: impl FnOnce(&mut Platform) -> T) -> T {
    PLATFORM.with_borrow_mut(|platform| act(platform.as_mut().expect("the platform is set up first")))
}

fn transact(device: u32, operations: &mut [Operation<'_, u8>]) {
    with_platform(|Platform { world, buses }| {
        let Some(Ok(())) = world.block_on(buses[device as usize].transaction(operations)) else {
            unreachable!("a transaction of a simulated bus ends, and cannot fail")
        };
    });
}

extern "C" fn read(device: u32, header: *const u8, header_length: usize, data: *mut u8, length: usize) {
    // SAFETY: the driver passes two buffers of its own with their lengths, and nothing else uses them during the call.
    let (header, data) =
        unsafe { (slice::from_raw_parts(header, header_length), slice::from_raw_parts_mut(data, length)) };
    transact(device, &mut [Operation::Write(header), Operation::Read(data)]);
}

extern "C" fn write(device: u32, header: *const u8, header_length: usize, data: *const u8, length: usize) {
    // SAFETY: the driver passes two buffers of its own with their lengths, and nothing writes to them during the call.
    let (header, data) = unsafe { (slice::from_raw_parts(header, header_length), slice::from_raw_parts(data, length)) };
    transact(device, &mut [Operation::Write(header), Operation::Write(data)]);
}

extern "C" fn set_fast(device: u32, fast: u8) {
    let hz = if fast == 0 { 2_000_000 } else { 8_000_000 };
    with_platform(|platform| platform.buses[device as usize].clock().set_hz(hz));
}

extern "C" fn delay_us(micros: u32) {
    with_platform(|platform| platform.world.run_for(Duration::from_micros(micros.into())));
}

const OPERATIONS: Operations = Operations { read, write, set_fast, delay_us };

/// The driver. It depends on registers and [`Operations`], and not on the simulation.
struct Driver {
    device: u32,
    operations: Operations,
}

const TXFRS: u32 = 1 << 7;
const RXFCG: u32 = 1 << 14;

impl Driver {
    fn read<const N: usize>(&self, file: u8, offset: u8) -> [u8; N] {
        let (header, mut data) = ([0x40 | file, offset], [0; N]);
        (self.operations.read)(self.device, header.as_ptr(), header.len(), data.as_mut_ptr(), N);
        data
    }

    fn write(&self, file: u8, offset: u8, data: &[u8]) {
        let header = [0xC0 | file, offset];
        (self.operations.write)(self.device, header.as_ptr(), header.len(), data.as_ptr(), data.len());
    }

    /// Loads the first-path detector's microcode (user manual, 2.5.5.10); the rest stays as after reset.
    fn initialise(&self) {
        (self.operations.set_fast)(self.device, 0);
        assert_eq!(u32::from_le_bytes(self.read(0x00, 0)), 0xDECA_0130, "a DW1000");
        self.write(0x36, 0, &[0x01, 0x03]);
        self.write(0x2D, 0x06, &[0x00, 0x80]);
        (self.operations.delay_us)(151);
        self.write(0x36, 0, &[0x00, 0x02]);
        (self.operations.set_fast)(self.device, 1);
    }

    fn listen(&self) {
        self.write(0x0D, 0, &0x0100u32.to_le_bytes());
    }

    fn send(&self, body: &[u8]) {
        self.write(0x09, 0, body);
        // 6.81 Mbit/s, PRF 16, 128 symbols; two check bytes are added.
        self.write(0x08, 0, &(0x0015_C000 | (body.len() as u32 + 2)).to_le_bytes());
        self.write(0x0D, 0, &0x0002u32.to_le_bytes());
    }

    /// Polls until one of the `events` has happened. Returns whether it has within 10 ms.
    fn wait_for(&self, events: u32) -> bool {
        (0..1000).any(|_| {
            (self.operations.delay_us)(10);
            u32::from_le_bytes(self.read(0x0F, 0)) & events != 0
        })
    }

    fn stamp(&self, file: u8) -> u64 {
        let [a, b, c, d, e] = self.read(file, 0);
        u64::from_le_bytes([a, b, c, d, e, 0, 0, 0])
    }

    fn sent_at(&self) -> u64 {
        self.stamp(0x17)
    }

    fn received_at(&self) -> u64 {
        self.stamp(0x15)
    }
}

/// One exchange between two chips `metres` apart. Returns the measured distance.
pub fn exchange(metres: f64) -> f64 {
    let world = World::new(1, AirConfig::ideal());
    let buses = [0.0, metres].map(|x| {
        let chip = ChipConfig {
            clock: ClockConfig::IDEAL,
            // The antennas have no delay, so the example needs no calibration.
            tx_antenna_ticks: 0.0,
            rx_antenna_ticks: 0.0,
            ..ChipConfig::default()
        };
        let node = world.add_node(NodeConfig { path: Path::Fixed([x, 0.0, 1.0]), chip, board: BoardProfile::DWM1001 });
        node.peripherals().spi
    });
    PLATFORM.set(Some(Platform { world, buses: buses.into() }));

    let [tag, anchor] = [0, 1].map(|device| Driver { device, operations: OPERATIONS });
    delay_us(5_000);
    tag.initialise();
    anchor.initialise();

    anchor.listen();
    tag.send(b"poll");
    assert!(tag.wait_for(TXFRS) && anchor.wait_for(RXFCG));
    tag.listen();
    anchor.send(b"response");
    assert!(anchor.wait_for(TXFRS) && tag.wait_for(RXFCG));

    let span = |from: u64, to: u64| (to.wrapping_sub(from) & 0xFF_FFFF_FFFF) as f64;
    let round = span(tag.sent_at(), tag.received_at());
    let reply = span(anchor.received_at(), anchor.sent_at());
    PLATFORM.set(None);
    // A tick is 1 / (128 · 499.2 MHz); light in air.
    (round - reply) / 2.0 / 63.8976e9 * 299_704_645.0
}

fn main() {
    for metres in [1.0, 30.0, 100.0] {
        println!("{metres:6.2} m apart: measured {:.3} m", exchange(metres));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_blocking_drivers_measure_their_distance() {
        for metres in [1.0, 30.0, 100.0] {
            let measured = exchange(metres);
            // Each of two time stamps is rounded to a tick, and their difference is halved. A tick is 4.7 mm.
            assert!((measured - metres).abs() < 0.01, "{metres}: {measured}");
        }
    }
}
