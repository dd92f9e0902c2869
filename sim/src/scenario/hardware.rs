//! What a scenario's node runs on: the driver on a simulated chip, or a radio straight on the air.

use std::cell::RefCell;
use std::convert::Infallible;
use std::future::Future;
use std::rc::Rc;

use embedded_hal::digital::OutputPin;
use embedded_hal::spi::{ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;
use ranging::dw1000::{ClockedSpi, Config, Dw1000, ResetLine, SpiClock};
use ranging::node::Restart;

use super::{Board, FaultKind, Level};
use crate::IrqPin;
use crate::air::{Path, PortId};
use crate::board::Handling;
use crate::direct::{Antenna, Direct};
use crate::{ChipConfig, ClockConfig, Node, NodeConfig, ResetPin, SimDelay, SimSpi, TaskId, World};

/// A node's firmware on whatever radio it is given: an app from `firmware-tag` or `firmware-anchor`.
pub(super) trait Firmware: 'static {
    /// Runs for ever, from a reset on.
    fn run<R: Restart + 'static>(
        self: Rc<Self>,
        radio: R,
        delay: SimDelay,
    ) -> impl Future<Output = Infallible> + 'static;
}

/// A node that can be switched.
pub(super) enum Hardware {
    /// Board, bus and chip.
    Board(Node),
    /// A radio straight on the air.
    Bare(Bare),
}

impl Hardware {
    /// Puts a node into the world and starts its firmware.
    pub(super) fn start(world: &World, level: Level, board: &Board, node: NodePlan, firmware: impl Firmware) -> Self {
        let firmware = Rc::new(firmware);
        match level {
            Level::Spi => {
                let chip = ChipConfig { clock: node.clock, ..ChipConfig::default() };
                let started = world.add_node(NodeConfig { path: node.path, chip, board: board.profile });
                let (config, fast_hz) = (node.config, board.spi_fast_hz);
                started.boot(move |peripherals| {
                    let bus = BoardSpi::new(peripherals.spi, fast_hz);
                    let reset = Reset(peripherals.reset);
                    let radio = Dw1000::new(bus, peripherals.irq, reset, peripherals.delay.clone(), config);
                    let running = firmware.clone().run::<BoardRadio>(radio, peripherals.delay);
                    async {
                        running.await;
                    }
                });
                Self::Board(started)
            }
            Level::Air => {
                let handling = Handling::new(&board.profile, board.spi_fast_hz);
                let antenna = Antenna::new(world, node.path, node.clock, &node.config, handling);
                let task_world = world.clone();
                let spawn = move |antenna: &Antenna| {
                    let running = firmware.clone().run::<Direct>(antenna.radio(), task_world.delay());
                    task_world.spawn(async {
                        running.await;
                    })
                };
                let task = RefCell::new(Some(spawn(&antenna)));
                Self::Bare(Bare { world: world.clone(), antenna, spawn: Box::new(spawn), task })
            }
        }
    }

    /// Does a fault to the node.
    pub(super) fn suffer(&self, fault: FaultKind) {
        match (self, fault) {
            (Self::Board(node), FaultKind::Off) => node.power_off(),
            (Self::Board(node), FaultKind::On) => node.power_on(),
            (Self::Board(node), FaultKind::Reset) => node.reset_processor(),
            (Self::Bare(node), FaultKind::Off) => node.stop(),
            (Self::Bare(node), FaultKind::On) => node.start(),
            (Self::Bare(node), FaultKind::Reset) => {
                node.stop();
                node.start();
            }
        }
    }

    /// Its number on the air.
    pub(super) fn port(&self) -> PortId {
        match self {
            Self::Board(node) => node.port(),
            Self::Bare(node) => node.antenna.port(),
        }
    }
}

type BoardRadio = Dw1000<BoardSpi, IrqPin, Reset, SimDelay>;

/// What a node is, beside its firmware.
pub(super) struct NodePlan {
    pub(super) path: Path,
    pub(super) clock: ClockConfig,
    pub(super) config: Config,
}

/// A node without a board.
pub(super) struct Bare {
    world: World,
    antenna: Antenna,
    spawn: Box<dyn Fn(&Antenna) -> TaskId>,
    task: RefCell<Option<TaskId>>,
}

impl Bare {
    fn stop(&self) {
        if let Some(task) = self.task.take() {
            self.world.abort(task);
        }
    }

    fn start(&self) {
        if self.task.borrow().is_none() {
            *self.task.borrow_mut() = Some((self.spawn)(&self.antenna));
        }
    }
}

/// The bus of a board that has two clocks for it.
struct BoardSpi {
    bus: SimSpi,
    slow_hz: u32,
    fast_hz: u32,
}

impl BoardSpi {
    fn new(bus: SimSpi, fast_hz: u32) -> Self {
        let slow_hz = bus.clock().hz();
        Self { bus, slow_hz, fast_hz }
    }
}

impl ErrorType for BoardSpi {
    type Error = Infallible;
}

impl SpiDevice for BoardSpi {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        self.bus.transaction(operations).await
    }
}

impl ClockedSpi for BoardSpi {
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), Infallible> {
        self.bus.clock().set_hz(match clock {
            SpiClock::Slow => self.slow_hz,
            SpiClock::Fast => self.fast_hz,
        });
        Ok(())
    }
}

struct Reset(ResetPin);

impl ResetLine for Reset {
    fn pull_low(&mut self) {
        match self.0.set_low() {
            Ok(()) => {}
            Err(never) => match never {},
        }
    }

    fn release(&mut self) {
        match self.0.set_high() {
            Ok(()) => {}
            Err(never) => match never {},
        }
    }
}
