//! A node of the simulated world whose firmware is an image in QEMU: its requests are carried out with the node's
//! bus, lines and time.

use std::cell::RefCell;
use std::future::{Future, pending};
use std::pin::Pin;
use std::rc::Rc;

use anyhow::{Context, Result};
use dw1000_sim::{Peripherals, Processor, TrueTime, World};
use embassy_futures::select::{Either, Either3, select, select3};
use embedded_hal::digital::OutputPin;
use embedded_hal::spi;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::SpiDevice;
use qemu_link::{Asked, LinkMessage, NodeStart, Operation, Request, Spent, WorldAnswer};
use wire::telemetry::Decoder;

use super::guest::Guest;
use super::steps::Steps;

/// The record of a node's run.
pub struct Life {
    /// Its telemetry, each message with its time.
    pub telemetry: Vec<(TrueTime, wire::telemetry::Message)>,
    /// Its requests.
    pub work: Work,
    /// Where its instructions are spent.
    pub steps: Steps,
    /// Why it ended early.
    pub failure: Option<anyhow::Error>,
    decoder: Decoder,
}

/// Counts of a node's work.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Number of requests.
    pub messages: u64,
    /// Number of transactions on the bus.
    pub transactions: u64,
    /// Number of operations that carry bytes, in these transactions.
    pub operations: u64,
    /// Instructions of ranging and of the code below it.
    pub ranging: u64,
    /// Instructions of all other code.
    pub background: u64,
}

impl Life {
    /// An empty record.
    pub fn new() -> Self {
        Self {
            telemetry: Vec::new(),
            work: Work::default(),
            steps: Steps::default(),
            failure: None,
            decoder: Decoder::new(),
        }
    }

    /// Number of frames sent or received, from its last telemetry counters.
    pub fn frames(&self) -> u64 {
        self.counters().map_or(0, |counters| u64::from(counters.sent) + u64::from(counters.received))
    }

    /// Number of rounds without a computed position, from its last telemetry counters.
    pub fn rounds_dropped(&self) -> u32 {
        self.counters().map_or(0, |counters| counters.rounds_dropped)
    }

    /// The last counters in its telemetry.
    fn counters(&self) -> Option<&wire::telemetry::Counters> {
        self.telemetry.iter().rev().find_map(|(_, message)| match message {
            wire::telemetry::Message::Counters(counters) => Some(counters),
            _ => None,
        })
    }

    fn add(&mut self, asked: &Asked<'_>) {
        let Spent { ranging, background } = asked.spent;
        self.work.ranging += u64::from(ranging);
        self.work.background += u64::from(background);
        self.steps.add(asked);
    }

    fn receive(&mut self, now: TrueTime, frames: &[u8]) {
        for byte in frames {
            // A frame of the image itself is always complete.
            if let Some(Ok(message)) = self.decoder.feed(*byte) {
                self.telemetry.push((now, message));
            }
        }
    }
}

/// A node in the simulated world.
pub struct SimulatedNode {
    /// Its processor.
    pub guest: Guest,
    /// The beginning of its config record's page.
    pub record: Vec<u8>,
    /// The end of the simulated time.
    pub end: TrueTime,
    /// The record of its run.
    pub life: Rc<RefCell<Life>>,
}

impl SimulatedNode {
    /// Runs until the simulated time ends.
    pub async fn run(mut self, peripherals: Peripherals) {
        if let Err(error) = self.serve(peripherals).await {
            self.life.borrow_mut().failure = Some(error);
        }
    }

    async fn serve(&mut self, mut peripherals: Peripherals) -> Result<()> {
        let Self { guest, record, end, life } = self;
        let (world, processor) = (peripherals.delay.world().clone(), peripherals.processor.clone());
        // A million of them, so that rounding loses nothing.
        let instruction_ps = u32::try_from(processor.board().instructions_ps(1_000_000) / 1_000_000)?;
        let mut background = Background::idle(&world, &processor, life);
        let mut body = LinkMessage::new();
        let mut ended = false;
        while let Some(message) = guest.request()? {
            let asked = Asked::decode(message)?;
            life.borrow_mut().add(&asked);
            processor.charge(asked.spent.ranging);
            background.add(asked.spent.background);
            body.clear();
            // True also for a line that is low again.
            let mut interrupted = false;
            match asked.request() {
                Request::Start => NodeStart { instruction_ps, record }.encode(&mut body)?,
                Request::Transaction { operations, sent } => {
                    let carrying = transact(&mut peripherals.spi, operations, sent, &mut body).await?;
                    let work = &mut life.borrow_mut().work;
                    work.transactions += 1;
                    work.operations += carrying as u64;
                }
                Request::Clock { fast } => {
                    let board = processor.board();
                    peripherals.spi.clock().set_hz(if fast { board.spi_fast_hz } else { board.spi_hz });
                }
                Request::Reset { low } => {
                    let Ok(()) = if low { peripherals.reset.set_low() } else { peripherals.reset.set_high() };
                }
                Request::Telemetry(frames) => background.send(frames),
                Request::Wait { until_ns, interrupt, background: until_done } => {
                    let until = TrueTime::from_ps(until_ns.saturating_mul(1000));
                    let raised = async {
                        match interrupt {
                            true => peripherals.irq.wait_for_high().await,
                            false => pending().await,
                        }
                    };
                    let done = async {
                        background.pass().await;
                        if !until_done {
                            pending().await
                        }
                    };
                    let waited = select3(raised, rest(&world, &processor, until), done);
                    match select(waited, world.sleep_until(*end)).await {
                        Either::First(Either3::First(_)) => interrupted = true,
                        Either::First(Either3::Second(()) | Either3::Third(())) => {}
                        Either::Second(()) => ended = true,
                    }
                }
            }
            let flags = [
                (interrupted || peripherals.irq.is_high(), WorldAnswer::IRQ_IS_HIGH),
                (background.is_busy(), WorldAnswer::BACKGROUND_IS_BUSY),
                (ended, WorldAnswer::END),
            ];
            let flags = flags.into_iter().filter(|(is, _)| *is).fold(0, |all, (_, flag)| all | flag);
            let now_ns = processor.settle(world.now()).as_ps() / 1000;
            guest.answer(&WorldAnswer { now_ns, flags, body: &body })?;
        }
        background.finish();
        life.borrow_mut().work.messages = guest.messages;
        ended.then_some(()).context("the image ended before the world")
    }
}

/// Waits with ranging's timer, as [`dw1000_sim::SimDelay`] does, but until an instant.
async fn rest(world: &World, processor: &Processor, until: TrueTime) {
    if until == TrueTime::NEVER {
        return pending().await;
    }
    processor.charge(processor.board().wait_instructions);
    processor.settle(world.now());
    world.sleep_until(until).await;
    world.sleep_until(processor.wake(world.now())).await;
}

/// A node's work below ranging: one step at a time, reported when it is done.
struct Background<'a> {
    world: &'a World,
    processor: &'a Processor,
    life: &'a RefCell<Life>,
    /// Instructions of the next step.
    instructions: u32,
    telemetry: Vec<u8>,
    /// The step in progress.
    step: Option<Pin<Box<dyn Future<Output = ()> + 'a>>>,
}

impl<'a> Background<'a> {
    fn idle(world: &'a World, processor: &'a Processor, life: &'a RefCell<Life>) -> Self {
        Self { world, processor, life, instructions: 0, telemetry: Vec::new(), step: None }
    }

    fn add(&mut self, instructions: u32) {
        self.instructions = self.instructions.saturating_add(instructions);
    }

    fn send(&mut self, frames: &[u8]) {
        self.telemetry.extend_from_slice(frames);
    }

    fn is_busy(&self) -> bool {
        self.instructions > 0 || self.step.is_some()
    }

    /// Does the pending work, as far as ranging leaves time for it. It may be interrupted and continued.
    async fn pass(&mut self) {
        while self.is_busy() {
            let instructions = &mut self.instructions;
            let step = self.step.get_or_insert_with(|| {
                let (world, processor, instructions) = (self.world, self.processor, std::mem::take(instructions));
                Box::pin(async move { processor.background(world, instructions).await })
            });
            step.await;
            self.step = None;
            self.finish();
        }
    }

    fn finish(&mut self) {
        self.life.borrow_mut().receive(self.world.now(), &std::mem::take(&mut self.telemetry));
    }
}

/// Does a transaction, appends received bytes to `received`, and returns the number of operations that carried bytes.
async fn transact(
    spi: &mut impl SpiDevice<u8>,
    operations: &[Operation],
    mut sent: &[u8],
    received: &mut LinkMessage,
) -> Result<usize> {
    let mut buffers: Vec<Vec<u8>> = Vec::new();
    for operation in operations {
        let (first, rest) = sent.split_at_checked(operation.sent()).context("fewer bytes than the operation sends")?;
        sent = rest;
        let mut buffer = first.to_vec();
        buffer.resize(operation.sent().max(operation.received()), 0);
        buffers.push(buffer);
    }
    let each = operations.iter().zip(&mut buffers).map(|(operation, buffer)| match operation {
        Operation::Write(_) => spi::Operation::Write(buffer),
        Operation::Read(_) => spi::Operation::Read(buffer),
        Operation::Transfer(_) => spi::Operation::TransferInPlace(buffer),
        Operation::DelayNs(ns) => spi::Operation::DelayNs(*ns),
    });
    let mut each: Vec<_> = each.collect();
    let carrying = each.iter().filter(|operation| !matches!(operation, spi::Operation::DelayNs(_))).count();
    spi.transaction(&mut each).await.map_err(|error| anyhow::anyhow!("the bus: {error:?}"))?;
    for (operation, buffer) in operations.iter().zip(&buffers) {
        let came = buffer.get(..operation.received()).unwrap_or_default();
        received.extend_from_slice(came).ok().context("too many bytes")?;
    }
    Ok(carrying)
}
