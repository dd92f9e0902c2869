//! Tests of the DW1000 driver of `ranging` on simulated chips at register level, with the timing of a board.

mod frames;
mod ranges;
mod upkeep;

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;
use std::time::Duration;

use baliza_dw1000::driver::{ClockedSpi, Dw1000, Error, ResetLine, SpiClock as Speed, Wake, WakeBy};
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::{ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;
use ranging::phy::{Channel, DataRate, PhyConfig, PreambleLength, Prf};
use ranging::radio::{Config, FrameFilter, MAX_FRAME, TxPower};
use ranging::time::METRES_PER_TICK;
use ranging::{Radio, RadioDuration, RadioInstant, ReceiveError, ResponseWindow, Sample, Start, TransmitError};
use sim::{
    AirConfig, ChipConfig, ClockConfig, IrqPin, Node, NodeConfig, Peripherals, ResetPin, SimDelay, SimSpi, SpiClock,
    TrueTime, World,
};

/// A DWM1001's bus: 2 MHz until the PLL has locked, 8 MHz after.
struct Bus(SimSpi, SpiClock);

impl ErrorType for Bus {
    type Error = Infallible;
}

impl SpiDevice for Bus {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        self.0.transaction(operations).await
    }
}

impl ClockedSpi for Bus {
    fn set_clock(&mut self, clock: Speed) -> Result<(), Infallible> {
        self.1.set_hz(match clock {
            Speed::Slow => 2_000_000,
            Speed::Fast => 8_000_000,
        });
        Ok(())
    }
}

struct Reset(ResetPin);

impl ResetLine for Reset {
    fn pull_low(&mut self) {
        let Ok(()) = self.0.set_low();
    }
    fn release(&mut self) {
        let Ok(()) = self.0.set_high();
    }
}

type Driver<R = Reset> = Dw1000<Bus, IrqPin, R, SimDelay>;

fn driver(peripherals: Peripherals, config: Config) -> Driver {
    let clock = peripherals.spi.clock();
    let bus = Bus(peripherals.spi, clock);
    Dw1000::new(bus, peripherals.irq, Reset(peripherals.reset), peripherals.delay, config)
}

fn us(micros: u32) -> RadioDuration {
    RadioDuration::from_micros(micros)
}

/// A node on the x axis whose clock has a constant error of `ppm`.
fn node_at(world: &World, x: f64, ppm: f64) -> Node {
    let mut config = NodeConfig::at([x, 0.0, 1.0]);
    config.chip.clock = ClockConfig { offset_ppm: ppm, ..ClockConfig::IDEAL };
    world.add_node(config)
}

/// Two nodes, 10 m apart, whose clocks have errors of ±`ppm`.
fn two_nodes(ppm: f64) -> (World, Node, Node) {
    let world = World::new(7, AirConfig::ideal());
    let (a, b) = (node_at(&world, 0.0, ppm), node_at(&world, 10.0, -ppm));
    (world, a, b)
}

fn fast() -> Config {
    Config::new(PhyConfig::FAST)
}

/// The instant `span` from now, as a delayed start.
async fn soon(radio: &mut Driver, span: RadioDuration) -> RadioInstant {
    radio.now().await.unwrap().plus(span)
}

/// Checks that the host did nothing that the chip would not have accepted.
fn assert_well_treated(node: &Node) {
    let seen = node.chip_statistics();
    assert_eq!((seen.too_fast, seen.deaf, seen.not_idle, seen.bad_stamps), (0, 0, 0, 0), "{seen:?}");
}

#[derive(Clone, Debug, PartialEq)]
struct Received {
    bytes: Vec<u8>,
    rx_time: RadioInstant,
    ppm: f32,
    first_path_index: f32,
    rx_power_dbm: f32,
    first_path_power_dbm: f32,
}

/// Receives a frame and copies it, so that it can be kept.
async fn receive(
    radio: &mut Driver,
    start: Start,
    window: RadioDuration,
    keep: bool,
) -> Result<Received, ReceiveError<Error<Infallible>>> {
    let mut buffer = [0; MAX_FRAME];
    radio.receive(&mut buffer, start, window, keep).await.map(|frame| Received {
        bytes: frame.bytes.to_vec(),
        rx_time: frame.rx_time,
        ppm: frame.diagnostics.clock_offset_ppm,
        first_path_index: frame.diagnostics.first_path_index,
        rx_power_dbm: frame.diagnostics.rx_power_dbm,
        first_path_power_dbm: frame.diagnostics.first_path_power_dbm,
    })
}

/// Runs two applications to their ends and returns their results.
fn run<A: 'static, B: 'static>(
    world: &World,
    a: impl Future<Output = A> + 'static,
    b: impl Future<Output = B> + 'static,
) -> (A, B) {
    let (left, right) = (Rc::new(RefCell::new(None)), Rc::new(RefCell::new(None)));
    let (l, r) = (left.clone(), right.clone());
    world.spawn(async move { *l.borrow_mut() = Some(a.await) });
    world.spawn(async move { *r.borrow_mut() = Some(b.await) });
    world.run_until(TrueTime::from_secs_f64(30.0));
    let taken = (left.borrow_mut().take(), right.borrow_mut().take());
    (taken.0.expect("the first ended"), taken.1.expect("the second ended"))
}
