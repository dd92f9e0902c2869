//! A node of the world whose firmware is an image in QEMU: its requests are done with the node's bus, lines and time.

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
use qemu_link::{Answer, Asked, Message, Operation, Request, Spent, Start};
use wire::telemetry::Decoder;

use super::guest::Guest;
use super::steps::Steps;

/// What became of a node.
pub struct Life {
    /// What it told, and when that was told.
    pub told: Vec<(TrueTime, wire::telemetry::Message)>,
    /// What it asked for.
    pub work: Work,
    /// What its instructions went to.
    pub steps: Steps,
    /// Why it ended early.
    pub failure: Option<anyhow::Error>,
    decoder: Decoder,
}

/// What a node did.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Requests.
    pub messages: u64,
    /// Transactions on the bus.
    pub transactions: u64,
    /// Operations of transactions that carry bytes.
    pub operations: u64,
    /// Instructions of ranging, and below.
    pub ranging: u64,
    /// Instructions of all else.
    pub background: u64,
}

impl Life {
    /// Nothing yet.
    pub fn new() -> Self {
        Self {
            told: Vec::new(),
            work: Work::default(),
            steps: Steps::default(),
            failure: None,
            decoder: Decoder::new(),
        }
    }

    /// Frames that it sent or received, as it told at its end.
    pub fn frames(&self) -> u64 {
        self.counters().map_or(0, |counters| u64::from(counters.sent) + u64::from(counters.received))
    }

    /// Rounds that no position was computed of, as it told at its end.
    pub fn rounds_dropped(&self) -> u32 {
        self.counters().map_or(0, |counters| counters.rounds_dropped)
    }

    /// The last that it told.
    fn counters(&self) -> Option<&wire::telemetry::Counters> {
        self.told.iter().rev().find_map(|(_, message)| match message {
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

    fn tell(&mut self, now: TrueTime, frames: &[u8]) {
        for byte in frames {
            // The image's own frames are whole.
            if let Some(Ok(message)) = self.decoder.feed(*byte) {
                self.told.push((now, message));
            }
        }
    }
}

/// A node in the world.
pub struct Node {
    /// Its processor.
    pub guest: Guest,
    /// What it is: the beginning of a record's page.
    pub record: Vec<u8>,
    /// When the world ends.
    pub end: TrueTime,
    /// What becomes of it.
    pub life: Rc<RefCell<Life>>,
}

impl Node {
    /// Runs until the world ends.
    pub async fn run(mut self, peripherals: Peripherals) {
        if let Err(error) = self.serve(peripherals).await {
            self.life.borrow_mut().failure = Some(error);
        }
    }

    async fn serve(&mut self, mut peripherals: Peripherals) -> Result<()> {
        let Self { guest, record, end, life } = self;
        let (world, processor) = (peripherals.delay.world().clone(), peripherals.processor.clone());
        // A million of them, so that nothing is lost in rounding.
        let instruction_ps = u32::try_from(processor.board().instructions_ps(1_000_000) / 1_000_000)?;
        let mut background = Background::idle(&world, &processor, life);
        let mut body = Message::new();
        let mut ended = false;
        while let Some(message) = guest.request()? {
            let asked = Asked::decode(message)?;
            life.borrow_mut().add(&asked);
            processor.charge(asked.spent.ranging);
            background.add(asked.spent.background);
            body.clear();
            // Also by a line that is low again.
            let mut interrupted = false;
            match asked.request() {
                Request::Start => Start { instruction_ps, record }.encode(&mut body)?,
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
                Request::Telemetry(frames) => background.tell(frames),
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
                (interrupted || peripherals.irq.is_high(), Answer::IRQ_IS_HIGH),
                (background.is_busy(), Answer::BACKGROUND_IS_BUSY),
                (ended, Answer::END),
            ];
            let flags = flags.into_iter().filter(|(is, _)| *is).fold(0, |all, (_, flag)| all | flag);
            let now_ns = processor.settle(world.now()).as_ps() / 1000;
            guest.answer(&Answer { now_ns, flags, body: &body })?;
        }
        background.finish();
        life.borrow_mut().work.messages = guest.messages;
        ended.then_some(()).context("the image ended before the world")
    }
}

/// A wait by ranging's timer, as [`dw1000_sim::SimDelay`] is one, but until an instant.
async fn rest(world: &World, processor: &Processor, until: TrueTime) {
    if until == TrueTime::NEVER {
        return pending().await;
    }
    processor.charge(processor.board().wait_instructions);
    processor.settle(world.now());
    world.sleep_until(until).await;
    world.sleep_until(processor.wake(world.now())).await;
}

/// What a node does below ranging: a step at a time, which it tells of when it is done.
struct Background<'a> {
    world: &'a World,
    processor: &'a Processor,
    life: &'a RefCell<Life>,
    /// Of the next step.
    instructions: u32,
    telemetry: Vec<u8>,
    /// The step that is being done.
    step: Option<Pin<Box<dyn Future<Output = ()> + 'a>>>,
}

impl<'a> Background<'a> {
    fn idle(world: &'a World, processor: &'a Processor, life: &'a RefCell<Life>) -> Self {
        Self { world, processor, life, instructions: 0, telemetry: Vec::new(), step: None }
    }

    fn add(&mut self, instructions: u32) {
        self.instructions = self.instructions.saturating_add(instructions);
    }

    fn tell(&mut self, frames: &[u8]) {
        self.telemetry.extend_from_slice(frames);
    }

    fn is_busy(&self) -> bool {
        self.instructions > 0 || self.step.is_some()
    }

    /// Does what there is to do, as far as ranging leaves time for it. It may be given up and gone on with.
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
        self.life.borrow_mut().tell(self.world.now(), &std::mem::take(&mut self.telemetry));
    }
}

/// Does a transaction; what was received is added to `received`. How many operations carried bytes.
async fn transact(
    spi: &mut impl SpiDevice<u8>,
    operations: &[Operation],
    mut sent: &[u8],
    received: &mut Message,
) -> Result<usize> {
    let mut buffers: Vec<Vec<u8>> = Vec::new();
    for operation in operations {
        let (first, rest) = sent.split_at_checked(operation.sent()).context("fewer bytes than were told")?;
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
