//! One range between two DW1000s: the driver on two simulated chips, ten metres apart. `cargo run -p baliza-sim
//! --example one_range`.
//!
//! On a board the SPI device, the interrupt line, the reset line and the delay are those of its hardware layer;
//! everything from [`Dw1000::new`] on is the same.

use std::cell::Cell;
use std::convert::Infallible;
use std::rc::Rc;

use baliza_dw1000::driver::{ClockedSpi, Dw1000, ResetLine, SpiClock};
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::{ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;
use ranging::radio::{Config, MAX_FRAME};
use ranging::tof::single_sided_corrected;
use ranging::{PhyConfig, Radio, RadioDuration, Start};
use sim::{AirConfig, IrqPin, Node, NodeConfig, ResetPin, SimDelay, SimSpi, TrueTime, World};

/// A board's SPI device, whose clock the driver sets.
struct Bus(SimSpi);

impl ErrorType for Bus {
    type Error = Infallible;
}

impl SpiDevice for Bus {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        self.0.transaction(operations).await
    }
}

impl ClockedSpi for Bus {
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), Infallible> {
        self.0.clock().set_hz(match clock {
            SpiClock::Slow => 2_000_000,
            SpiClock::Fast => 8_000_000,
        });
        Ok(())
    }
}

/// A board's reset line.
struct Reset(ResetPin);

impl ResetLine for Reset {
    fn pull_low(&mut self) {
        let Ok(()) = self.0.set_low();
    }

    fn release(&mut self) {
        let Ok(()) = self.0.set_high();
    }
}

fn radio(node: &Node) -> Dw1000<Bus, IrqPin, Reset, SimDelay> {
    let parts = node.peripherals();
    Dw1000::new(Bus(parts.spi), parts.irq, Reset(parts.reset), parts.delay, Config::new(PhyConfig::FAST))
}

fn main() {
    let world = World::new(1, AirConfig::ideal());
    let nodes = [0.0, 10.0].map(|x| world.add_node(NodeConfig::at([x, 0.0, 1.0])));
    let [mut tag, mut anchor] = [radio(&nodes[0]), radio(&nodes[1])];
    // What the anchor's clock showed: the poll's arrival and the response's departure. On the air the response carries
    // both.
    let stamps = Rc::new(Cell::new(None));
    let of_anchor = stamps.clone();
    world.spawn(async move {
        anchor.init().await.expect("the chip answers");
        let mut buffer = [0; MAX_FRAME];
        let poll = anchor.receive(&mut buffer, Start::Now, RadioDuration::from_micros(60_000), false).await;
        let poll_rx = poll.expect("the poll arrives").rx_time;
        let at = Start::At(poll_rx.plus(RadioDuration::from_micros(500)));
        let response_tx = anchor.transmit(b"response", at, false).await.expect("there is time enough");
        of_anchor.set(Some((poll_rx, response_tx)));
    });
    world.spawn(async move {
        tag.init().await.expect("the chip answers");
        let at = tag.now().await.expect("the bus works").plus(RadioDuration::from_micros(20_000));
        let poll_tx = tag.transmit(b"poll", Start::At(at), true).await.expect("there is time enough");
        let mut buffer = [0; MAX_FRAME];
        let response = tag.receive(&mut buffer, Start::Now, RadioDuration::from_micros(30_000), false).await;
        let response = response.expect("the response arrives");
        let (poll_rx, response_tx) = stamps.get().expect("the anchor has answered");
        let clock_offset = response.diagnostics.clock_offset_ppm * 1e-6;
        let round = response.rx_time.since(poll_tx);
        let tof = single_sided_corrected(round, response_tx.since(poll_rx), clock_offset);
        println!("{:.3} m", tof.metres());
    });
    world.run_until(TrueTime::from_secs_f64(1.0));
}
