//! The world: virtual time, the air, the nodes and their tasks.
//!
//! ```
//! use embedded_hal_async::spi::SpiDevice;
//! use dw1000_sim::{AirConfig, NodeConfig, Path, TrueTime, World};
//!
//! let world = World::new(1, AirConfig::default());
//! let node = world.add_node(NodeConfig::at([1.0, 2.0, 0.5]));
//! node.boot(|mut peripherals| async move {
//!     peripherals.delay.pause_ms(5).await;
//!     let mut id = [0; 4];
//!     peripherals.spi.transaction(&mut [
//!         embedded_hal::spi::Operation::Write(&[0x00]),
//!         embedded_hal::spi::Operation::Read(&mut id),
//!     ]).await.unwrap();
//!     assert_eq!(u32::from_le_bytes(id), 0xDECA_0130);
//! });
//! world.run_until(TrueTime::from_secs_f64(0.1));
//! ```

use crate::air::{Air, AirClient, AirConfig, AirEvent, AirStatistics, Path, PortId, RxSettings, Sniffed, TxStart};
use crate::board::BoardProfile;
use crate::chip::{Chip, ChipConfig, ChipEvent, ChipStatistics, Consumption};
use crate::irq::{IrqLine, IrqPin};
use crate::kernel::{Kernel, Next, TaskId};
use crate::pins::{ResetPin, SimDelay};
use crate::processor::Processor;
use crate::random::{Purpose, Stream, stream};
use crate::sleep::Sleep;
use crate::spi::{SimSpi, SpiClock};
use crate::time::TrueTime;
use std::cell::{Cell, RefCell, RefMut};
use std::collections::BTreeMap;
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::rc::{Rc, Weak};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

/// The simulation; clones share it.
#[derive(Clone)]
pub struct World(Rc<Shared>);

/// What happens at an instant.
pub(crate) enum Event {
    /// Something in the chip of a node.
    Chip { node: u32, event: ChipEvent },
    /// A frame reaches a point of its course at a receiver.
    Air(AirEvent),
    /// An action of the scenario, by its number, so that events stay small.
    Call(u32),
}

impl From<AirEvent> for Event {
    fn from(event: AirEvent) -> Self {
        Self::Air(event)
    }
}

type Action = Box<dyn FnOnce(&World)>;

struct Shared {
    seed: u64,
    kernel: Kernel<Event>,
    /// The pending actions by number, and the next number.
    actions: RefCell<(BTreeMap<u32, Action>, u32)>,
    air: RefCell<Air>,
    nodes: RefCell<Vec<Node>>,
    clients: RefCell<Vec<Rc<RefCell<dyn AirClient>>>>,
}

/// The settings of a node.
#[derive(Clone)]
pub struct NodeConfig {
    /// Its position over time.
    pub path: Path,
    /// Its chip and oscillator.
    pub chip: ChipConfig,
    /// Its processor.
    pub board: BoardProfile,
}

impl NodeConfig {
    /// A DWM1001 with a perfect crystal that stays at `position`, metres.
    pub fn at(position: [f64; 3]) -> Self {
        Self { path: Path::Fixed(position), chip: ChipConfig::default(), board: BoardProfile::DWM1001 }
    }

    /// The same with an oscillator that is `ppm` off and wanders as crystals do.
    pub fn with_crystal(mut self, ppm: f64) -> Self {
        self.chip.clock = crate::clock::ClockConfig::crystal(ppm);
        self
    }
}

type Firmware = Rc<dyn Fn(Peripherals) -> Pin<Box<dyn Future<Output = ()>>>>;

/// A node: a processor, a bus, a chip.
#[derive(Clone)]
pub struct Node {
    world: Weak<Shared>,
    chip: Rc<RefCell<Chip>>,
    irq: Rc<IrqLine>,
    processor: Processor,
    spi_clock: SpiClock,
    firmware: Rc<RefCell<Option<Firmware>>>,
    tasks: Rc<RefCell<Vec<TaskId>>>,
    powered: Rc<Cell<bool>>,
    port: PortId,
}

/// The peripherals of a board for its application.
pub struct Peripherals {
    /// The bus to the chip.
    pub spi: SimSpi,
    /// The chip's IRQ line.
    pub irq: IrqPin,
    /// The chip's RSTn.
    pub reset: ResetPin,
    /// Waits.
    pub delay: SimDelay,
    /// The processor, to which the application charges its code.
    pub processor: Processor,
    /// The node, to spawn further tasks.
    pub node: Node,
}

impl World {
    /// An empty world. Equal seeds and equal calls give equal runs.
    pub fn new(seed: u64, air: AirConfig) -> Self {
        let air = RefCell::new(Air::new(air, seed));
        Self(Rc::new(Shared {
            seed,
            kernel: Kernel::new(),
            actions: RefCell::default(),
            air,
            nodes: RefCell::default(),
            clients: RefCell::default(),
        }))
    }

    /// True time.
    pub fn now(&self) -> TrueTime {
        self.0.kernel.now()
    }

    /// Random numbers for a scenario or an application.
    pub fn random(&self, index: u64) -> Stream {
        stream(self.0.seed, Purpose::Scenario, index)
    }

    /// Adds a node with its supply on: the chip starts now.
    pub fn add_node(&self, config: NodeConfig) -> Node {
        let number = self.0.nodes.borrow().len() as u32;
        let processor = Processor::new(config.board);
        let irq = Rc::new(IrqLine::new(processor.clone()));
        let port = self.air().add_port(config.path);
        let chip = Rc::new(RefCell::new(Chip::new(self.now(), number, port, self.0.seed, config.chip, irq.clone())));
        self.0.clients.borrow_mut().push(chip.clone());
        let node = Node {
            world: Rc::downgrade(&self.0),
            chip,
            irq,
            spi_clock: SpiClock::new(processor.board().spi_hz),
            processor,
            firmware: Rc::default(),
            tasks: Rc::default(),
            powered: Rc::new(Cell::new(true)),
            port,
        };
        node.chip.borrow_mut().set_supply(self, true);
        self.0.nodes.borrow_mut().push(node.clone());
        node
    }

    /// Adds a client of the air that has no board. `client` makes it for the port that it gets.
    pub fn add_client<C: AirClient + 'static>(
        &self,
        path: Path,
        client: impl FnOnce(PortId) -> Rc<RefCell<C>>,
    ) -> (PortId, Rc<RefCell<C>>) {
        let port = self.air().add_port(path);
        let client = client(port);
        self.0.clients.borrow_mut().push(client.clone());
        (port, client)
    }

    /// The seed.
    pub fn seed(&self) -> u64 {
        self.0.seed
    }

    /// A delay that costs no processor anything.
    pub fn delay(&self) -> SimDelay {
        SimDelay { world: self.clone(), processor: None }
    }

    /// A processor's delay.
    pub fn delay_of(&self, processor: &Processor) -> SimDelay {
        SimDelay { world: self.clone(), processor: Some(processor.clone()) }
    }

    /// Runs a future beside the nodes.
    pub fn spawn(&self, future: impl Future<Output = ()> + 'static) -> TaskId {
        self.0.kernel.executor.spawn(future)
    }

    /// Drops a task in its present state.
    pub fn abort(&self, task: TaskId) {
        self.0.kernel.executor.abort(task);
    }

    /// Runs an action at an instant, such as a fault or a change of the air.
    pub fn at(&self, time: TrueTime, action: impl FnOnce(&World) + 'static) {
        let number = {
            let (actions, next) = &mut *self.0.actions.borrow_mut();
            actions.insert(*next, Box::new(action));
            std::mem::replace(next, *next + 1)
        };
        self.0.kernel.schedule(time, Event::Call(number));
    }

    /// Waits until an instant of true time.
    pub fn sleep_until(&self, time: TrueTime) -> Sleep {
        Sleep::new(self.clone(), time)
    }

    /// Waits until `until`. Ends within the poll if nothing else can happen before.
    pub async fn pass(&self, until: TrueTime) {
        let mut armed = None;
        poll_fn(|cx| {
            let kernel = self.kernel();
            if kernel.now() >= until || (armed.is_none() && kernel.advance_if_quiet(until)) {
                return Poll::Ready(());
            }
            match armed {
                Some(key) => kernel.retarget(key, cx.waker()),
                None => armed = Some(kernel.schedule_wake(until, cx.waker())),
            }
            Poll::Pending
        })
        .await;
    }

    /// Runs the world up to and including `time`.
    ///
    /// # Panics
    /// Panics inside a task or an [`AirClient`], like [`World::block_on`].
    pub fn run_until(&self, time: TrueTime) {
        let kernel = &self.0.kernel;
        let _horizon = kernel.enter("run_until", time);
        self.run_ready();
        while let Some(next) = kernel.next_event() {
            self.dispatch(next);
            self.run_ready();
        }
        kernel.arrive_at_horizon();
    }

    /// Runs the world until `future` is done, and returns its output; `None` if it waits for something that can never
    /// happen.
    ///
    /// This is for tests and blocking drivers, which are driven from outside: from the code that runs the world, from
    /// an action of [`World::at`], or from a sniffer. Nodes run with [`Node::boot`], and their tasks await.
    ///
    /// # Panics
    /// Panics inside a task (of [`Node::boot`], [`Node::spawn`], [`World::spawn`]) or an [`AirClient`]: there the world
    /// waits for the caller and so cannot continue.
    pub fn block_on<T>(&self, future: impl Future<Output = T>) -> Option<T> {
        let mut future = std::pin::pin!(future);
        let mut context = Context::from_waker(Waker::noop());
        let kernel = &self.0.kernel;
        let _horizon = kernel.enter("block_on", TrueTime::NEVER);
        self.run_ready();
        loop {
            if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
                return Some(output);
            }
            self.run_ready();
            self.dispatch(kernel.next_event()?);
            self.run_ready();
        }
    }

    /// Runs the world for a duration.
    pub fn run_for(&self, duration: Duration) {
        self.run_until(self.now() + duration);
    }

    /// The air, for the statement in which it is called.
    ///
    /// # Panics
    /// Panics if the result of an earlier call is still held. While it is held, nothing may run the world either.
    pub fn air(&self) -> RefMut<'_, Air> {
        self.0.air.borrow_mut()
    }

    /// Begins a frame of `sender` now, which is `tx.start`. Returns its number. Its bytes follow with [`Air::fill`].
    pub fn begin_frame(&self, sender: PortId, tx: TxStart) -> u32 {
        self.air().transmit(&self.0.kernel, sender, tx)
    }

    /// Switches the receiver of a port without a chip on, now. [`Air::deafen`] switches it off.
    pub fn listen(&self, port: PortId, settings: RxSettings) {
        self.air().listen(&self.0.kernel, port, settings);
    }

    /// Counts of what happened on the air so far.
    pub fn statistics(&self) -> AirStatistics {
        self.air().statistics()
    }

    /// Calls `sniffer` for each frame on the air, in the order of their RMARKERs. The call is at the instant of the
    /// RMARKER, after the sender's code has run. The sniffer may use the air, the chips and the world.
    pub fn sniff(&self, sniffer: impl FnMut(&Sniffed) + 'static) {
        self.air().sniff(sniffer);
    }

    pub(crate) fn schedule_chip(&self, at: TrueTime, node: u32, event: ChipEvent) {
        self.0.kernel.schedule(at, Event::Chip { node, event });
    }

    pub(crate) fn kernel(&self) -> &Kernel<Event> {
        &self.0.kernel
    }

    /// Polls the ready tasks, and shows the sniffers what was sent.
    fn run_ready(&self) {
        loop {
            self.0.kernel.executor.run_ready();
            let Some((frames, mut sniffers)) = self.air().take_sniffed() else { return };
            for frame in &frames {
                sniffers.iter_mut().for_each(|sniffer| sniffer(frame));
            }
            self.air().return_sniffers(sniffers);
        }
    }

    fn dispatch(&self, next: Next<Event>) {
        match next {
            Next::Timer(key) => self.0.kernel.fire_timer(key),
            Next::Event(Event::Chip { node, event }) => {
                let chip = self.0.nodes.borrow()[node as usize].chip.clone();
                chip.borrow_mut().handle(self, event);
            }
            Next::Event(Event::Air(event)) => {
                let heard = self.air().step(&self.0.kernel, event);
                if let Some(heard) = heard {
                    let client = self.0.clients.borrow()[event.port as usize].clone();
                    let _busy = self.0.kernel.hold();
                    client.borrow_mut().on_air(self, self.now(), heard);
                }
            }
            Next::Event(Event::Call(number)) => {
                let action = self.0.actions.borrow_mut().0.remove(&number);
                if let Some(action) = action {
                    action(self);
                }
            }
        }
    }
}

impl Node {
    fn world(&self) -> Option<World> {
        self.world.upgrade().map(World)
    }

    /// A set of peripherals, which a test drives by hand. All sets of a node share its bus clock.
    ///
    /// # Panics
    /// Panics if the world is gone.
    pub fn peripherals(&self) -> Peripherals {
        let world = self.world().expect("a node outlived its world");
        let processor = self.processor.clone();
        Peripherals {
            spi: SimSpi::new(world.clone(), self.chip.clone(), self.spi_clock.clone(), processor.clone()),
            irq: IrqPin::new(world.clone(), self.irq.clone()),
            reset: ResetPin { world: world.clone(), chip: self.chip.clone() },
            delay: world.delay_of(&processor),
            processor,
            node: self.clone(),
        }
    }

    /// Runs `firmware` now, and again from its beginning each time the node is switched on or reset. The bus clock is
    /// then the board's initial clock again.
    pub fn boot<F: Future<Output = ()> + 'static>(&self, firmware: impl Fn(Peripherals) -> F + 'static) {
        *self.firmware.borrow_mut() = Some(Rc::new(move |p| Box::pin(firmware(p))));
        self.restart();
    }

    /// Runs a task that ends when the node's supply ends.
    pub fn spawn(&self, future: impl Future<Output = ()> + 'static) {
        if let Some(world) = self.world() {
            self.tasks.borrow_mut().push(world.spawn(future));
        }
    }

    /// Switches the supply off: tasks and registers are lost, and a frame on the air is cut.
    pub fn power_off(&self) {
        self.powered.set(false);
        self.halt();
        if let Some(world) = self.world() {
            self.chip.borrow_mut().set_supply(&world, false);
        }
    }

    /// Switches the supply on: chip and firmware start.
    pub fn power_on(&self) {
        if let Some(world) = self.world()
            && !self.powered.replace(true)
        {
            self.chip.borrow_mut().set_supply(&world, true);
            self.restart();
        }
    }

    /// Resets the processor: its firmware restarts, and the chip stays as it is.
    pub fn reset_processor(&self) {
        if self.powered.get() {
            self.restart();
        }
    }

    /// The position of the node, metres.
    pub fn position(&self) -> [f64; 3] {
        self.world().map_or([0.0; 3], |w| {
            let now = w.now();
            w.air().position(self.port, now)
        })
    }

    /// Its number on the air, as in [`Sniffed::sender`].
    pub fn port(&self) -> PortId {
        self.port
    }

    /// Its processor.
    pub fn processor(&self) -> &Processor {
        &self.processor
    }

    /// Counts of what the firmware did with its chip.
    pub fn chip_statistics(&self) -> ChipStatistics {
        self.chip.borrow().statistics()
    }

    /// The charge that its chip has drawn from the supply until now.
    pub fn consumption(&self) -> Consumption {
        self.world().map_or_else(Consumption::default, |w| self.chip.borrow().consumption(w.now()))
    }

    /// The chip itself, for what only a simulation can know, for the statement in which it is called.
    ///
    /// # Panics
    /// Panics if the result of an earlier call is still held. While it is held, nothing may run the world either.
    pub fn chip(&self) -> RefMut<'_, Chip> {
        self.chip.borrow_mut()
    }

    fn restart(&self) {
        self.halt();
        self.spi_clock.set_hz(self.processor.board().spi_hz);
        let firmware = self.firmware.borrow().clone();
        if let Some(firmware) = firmware.filter(|_| self.powered.get()) {
            self.spawn(firmware(self.peripherals()));
        }
    }

    fn halt(&self) {
        let tasks = std::mem::take(&mut *self.tasks.borrow_mut());
        if let Some(world) = self.world() {
            tasks.into_iter().for_each(|t| world.abort(t));
            self.processor.reset(world.now());
        }
    }
}
