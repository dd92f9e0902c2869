//! The hardware of a scenario's node: the driver on a simulated chip, or a radio directly on the air.

use std::cell::RefCell;
use std::convert::Infallible;
use std::future::Future;
use std::rc::Rc;

use baliza_dw1000::driver::{ClockedSpi, Dw1000, ResetLine, SpiClock};
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::{ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;
use ranging::Restart;
use ranging::radio::Config;

use super::draw::Draw;
use super::{FaultKind, Fidelity};
use crate::IrqPin;
use crate::air::{Path, PortId};
use crate::board::BoardProfile;
use crate::costs::{Charged, Costs};
use crate::direct::{Antenna, Direct};
use crate::{
    ChipConfig, ClockConfig, Node, NodeConfig, Processor, ResetPin, SimDelay, SimSpi, TaskId, TrueTime, World,
};

/// A node's firmware on any radio: an app from `firmware-tag` or `firmware-anchor`.
pub(super) trait Firmware: 'static {
    /// The settings of its hardware, besides its board.
    fn plan(&self) -> NodePlan;

    /// Runs for ever, from a reset on.
    fn run<R: Restart + 'static>(
        self: Rc<Self>,
        radio: R,
        delay: SimDelay,
        processor: Processor,
    ) -> impl Future<Output = Infallible> + 'static;
}

/// A node that can be switched.
pub(super) enum Hardware {
    /// Board, bus and chip.
    Board(Node),
    /// A radio directly on the air.
    Bare(Bare),
}

impl Hardware {
    /// Adds a node to the world and starts its firmware.
    pub(super) fn start(
        world: &World,
        level: Fidelity,
        board: BoardProfile,
        (path, antenna_delay_ticks): (Path, Option<f64>),
        firmware: impl Firmware,
    ) -> Self {
        let node = firmware.plan();
        let firmware = Rc::new(firmware);
        let costs = Costs::of(board.core);
        // Only a tag whose radio sleeps allows its own clocks to stop.
        let sleep_from = board.sleep_from.filter(|_| node.config.sleeps);
        // The executor's path to the task is added to the board's own handlers.
        let board = BoardProfile { sleep_from, wake_instructions: board.wake_instructions + costs.wake, ..board };
        match level {
            Fidelity::Spi => {
                let usual = ChipConfig::default();
                let [tx_antenna_ticks, rx_antenna_ticks] =
                    [usual.tx_antenna_ticks, usual.rx_antenna_ticks].map(|ticks| antenna_delay_ticks.unwrap_or(ticks));
                let chip = ChipConfig { clock: node.clock, tx_antenna_ticks, rx_antenna_ticks, ..usual };
                let started = world.add_node(NodeConfig { path, chip, board });
                let config = node.config;
                started.boot(move |peripherals| {
                    let processor = peripherals.processor;
                    let bus = BoardSpi::new(peripherals.spi, processor.clone());
                    let reset = Reset(peripherals.reset);
                    let radio = Dw1000::new(bus, peripherals.irq, reset, peripherals.delay.clone(), config);
                    let radio = Charged::new(radio, &processor);
                    let running = firmware.clone().run::<Charged<BoardRadio>>(radio, peripherals.delay, processor);
                    async {
                        running.await;
                    }
                });
                Self::Board(started)
            }
            Fidelity::Air => {
                let processor = Processor::new(board);
                let antenna = Antenna::new(world, path, node.clock, &node.config, processor.clone());
                let (task_world, task_processor) = (world.clone(), processor.clone());
                let spawn = move |antenna: &Antenna| {
                    let radio = Charged::new(antenna.radio(), &task_processor);
                    let delay = task_world.delay_of(&task_processor);
                    let running = firmware.clone().run::<Charged<Direct>>(radio, delay, task_processor.clone());
                    task_world.spawn(async {
                        running.await;
                    })
                };
                let task = RefCell::new(Some(spawn(&antenna)));
                Self::Bare(Bare { world: world.clone(), antenna, processor, spawn: Box::new(spawn), task })
            }
        }
    }

    /// The charge that the node has drawn from its supply since the simulation began. `None` without a chip.
    pub(super) fn draw(&self, now: TrueTime) -> Option<Draw> {
        match self {
            Self::Board(node) => {
                let processor = node.processor();
                Some(Draw::new(now, processor.times(now), processor.board(), &node.consumption()))
            }
            Self::Bare(_) => None,
        }
    }

    /// The board, if there is one.
    pub(super) fn board(&self) -> Option<&Node> {
        match self {
            Self::Board(node) => Some(node),
            Self::Bare(_) => None,
        }
    }

    /// Applies a fault to the node.
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

/// The settings of a node, besides its board.
pub(super) struct NodePlan {
    pub(super) clock: ClockConfig,
    pub(super) config: Config,
}

/// A node without a board.
pub(super) struct Bare {
    world: World,
    antenna: Antenna,
    processor: Processor,
    spawn: Box<dyn Fn(&Antenna) -> TaskId>,
    task: RefCell<Option<TaskId>>,
}

impl Bare {
    fn stop(&self) {
        if let Some(task) = self.task.take() {
            self.world.abort(task);
            self.processor.reset(self.world.now());
        }
    }

    fn start(&self) {
        if self.task.borrow().is_none() {
            *self.task.borrow_mut() = Some((self.spawn)(&self.antenna));
        }
    }
}

/// The bus of a board with two bus clocks, and the driver's instructions for each transaction.
struct BoardSpi {
    bus: SimSpi,
    processor: Processor,
    instructions: u32,
}

impl BoardSpi {
    fn new(bus: SimSpi, processor: Processor) -> Self {
        let instructions = Costs::of(processor.board().core).driver.transaction;
        Self { bus, processor, instructions }
    }
}

impl ErrorType for BoardSpi {
    type Error = Infallible;
}

impl SpiDevice for BoardSpi {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        self.processor.charge(self.instructions);
        self.bus.transaction(operations).await
    }
}

impl ClockedSpi for BoardSpi {
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), Infallible> {
        self.bus.clock().set_hz(match clock {
            SpiClock::Slow => self.processor.board().spi_hz,
            SpiClock::Fast => self.processor.board().spi_fast_hz,
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
