//! What a node's code costs, in instructions, and the radio and the protocol that charge these costs to their node's
//! [`Processor`]. The table is `costs.csv`, which `cargo xtask promises costs` makes in QEMU.
//!
//! The costs cover the firmware's own crates, compiled with the firmware's profile: the driver over a bus that takes no
//! time, between one transaction and the next; each step of the exchange's protocols by the frame that it handles; the
//! wake-up by the executor, down to the awaited operation; a round in the engine, and the report of its position. The
//! board's own code (bus, interrupt handlers, timers) is part of the [`BoardProfile`](dw1000_sim::BoardProfile). None
//! of these costs was measured on a board.

use std::cell::Cell;
use std::sync::LazyLock;

use dw1000_sim::{Core, Processor};
use ranging::Restart;
use ranging::exchange::{Action, Event, Guidance, Protocol, Report};
use ranging::radio::{Capabilities, MAX_FRAME, RangeBias, Sample, Sensors, StampModel};
use ranging::{Pace, Radio, RadioDuration, RadioInstant, ReceiveError, ResponseWindow, RxFrame, Start, TransmitError};
use wire::uwb::native::{Downlink, Frame, IntegrityCode, Message, Nonce, SyncFrame, UserData, software_code};

const TABLE: &str = include_str!("costs.csv");

/// The columns of the table.
const CORES: [(&str, Core); 3] =
    [("cortex-m4f", Core::CortexM4F), ("cortex-m3", Core::CortexM3), ("riscv32", Core::RiscV32)];

/// Instructions on one kind of processor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Costs {
    /// From the instant at which a task is marked ready to its first instruction after the wait, the executor's part
    /// included.
    pub wake: u32,
    /// The driver's operations.
    pub driver: DriverCosts,
    /// The steps of the exchange's protocols.
    pub machine: ProtocolCosts,
    /// The codes of frames with a key.
    pub code: CodeCosts,
    /// What a tag does besides ranging.
    pub tag: TagCosts,
}

/// The code of a response, which takes four blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CodeCosts {
    /// Without the cipher.
    pub made: u32,
    /// With AES in software, its key included.
    pub in_software: u32,
}

/// Blocks of the code of a response.
const RESPONSE_BLOCKS: u32 = 4;

impl CodeCosts {
    /// Charges the blocks of the codes that a step has made.
    fn charge(&self, processor: &Processor, blocks: u32) {
        let block_ns = processor.board().cipher_block_ns;
        let response = if block_ns > 0 { self.made } else { self.in_software };
        processor.charge(response * blocks / RESPONSE_BLOCKS);
        processor.charge_ns(block_ns * blocks);
    }
}

/// The driver's operations, without their transactions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriverCosts {
    /// Each transaction, without the bus.
    pub transaction: u32,
    /// Reading the clock.
    pub now: u32,
    /// Sending at once.
    pub send_now: u32,
    /// Sending at an instant.
    pub send_at: u32,
    /// Receiving, up to the wait for the frame.
    pub receive_begin: u32,
    /// The same with the receiver on already.
    pub receive_go_on: u32,
    /// Receiving, from the interrupt on, with the inputs of the diagnostics.
    pub receive_frame: u32,
    /// Receiving, from the interrupt on, when the window has passed.
    pub receive_timeout: u32,
    /// The end of a transmission, from the interrupt on.
    pub sent: u32,
    /// Switching the transceiver off.
    pub idle: u32,
}

/// The steps of the protocols, by the frame or event that they handle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProtocolCosts {
    /// A tag makes its poll.
    pub poll_made: u32,
    /// An anchor answers a poll.
    pub poll_answered: u32,
    /// A tag computes a range from a response.
    pub response_received: u32,
    /// The same with the last response, and the round is reported.
    pub round_ended: u32,
    /// A sync frame is processed.
    pub beacon_received: u32,
    /// An anchor makes its sync frame.
    pub beacon_made: u32,
    /// A frame for another node is ignored.
    pub overheard: u32,
    /// Anything else: the next window or wait is chosen.
    pub scheduled: u32,
}

/// What a tag does besides ranging.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TagCosts {
    /// The handover of a round from ranging to the engine: ranging's part.
    pub handover: u32,
    /// A round of 4 and of 8 ranges in the engine with tracking, in the plane, with its position published.
    pub track_plane: [u32; 2],
    /// The same in space.
    pub track_space: [u32; 2],
    /// The same, with each round solved by itself by the most expensive method, `robust`.
    pub solve_plane: [u32; 2],
    /// The same in space.
    pub solve_space: [u32; 2],
    /// A range that is published with the position.
    pub publish_range: u32,
    /// A line of the log.
    pub line: u32,
    /// The features of an impulse response that was read, with the computation of its magnitudes.
    pub features: u32,
    /// An advertisement of a beacon: found in the list and smoothed.
    pub advert: u32,
}

/// The numbers of ranges that the table has costs for.
const RANGES: [f64; 2] = [4.0, 8.0];

impl TagCosts {
    /// The cost of a round of `ranges` ranges, by the straight line through the table's two values.
    pub fn round(&self, tracks: bool, space: bool, ranges: usize) -> u32 {
        let costs = match (tracks, space) {
            (true, false) => self.track_plane,
            (true, true) => self.track_space,
            (false, false) => self.solve_plane,
            (false, true) => self.solve_space,
        };
        let [few, many] = costs.map(f64::from);
        let slope = (many - few) / (RANGES[1] - RANGES[0]);
        (few + slope * (ranges as f64 - RANGES[0])).max(0.0) as u32
    }
}

impl Costs {
    /// The costs for a kind of processor.
    pub fn of(core: Core) -> &'static Self {
        static COSTS: LazyLock<[Costs; 3]> = LazyLock::new(|| {
            CORES.map(|(name, _)| match parse(TABLE, name) {
                Ok(costs) => costs,
                Err(message) => panic!("costs.csv: {message}; `cargo xtask promises costs` makes it"),
            })
        });
        let column = CORES.iter().position(|(_, known)| *known == core);
        &COSTS[column.unwrap_or_default()]
    }
}

/// Parses the column `name` of a table.
fn parse(table: &str, name: &str) -> Result<Costs, String> {
    let mut lines = table.lines().map(|line| line.split(','));
    let header = lines.next().ok_or("empty")?;
    let column = header.clone().position(|head| head == name).ok_or_else(|| format!("no column {name}"))?;
    let rows: Vec<(&str, &str)> =
        lines.filter_map(|mut row| Some((row.clone().next()?, row.nth(column).unwrap_or_default()))).collect();
    let cost = |what: &str| -> Result<u32, String> {
        let (_, cell) = rows.iter().find(|(row, _)| *row == what).ok_or_else(|| format!("no row {what}"))?;
        cell.parse().map_err(|_| format!("{what}, {name}: {cell:?} is not a number"))
    };
    let rounds =
        |what: &str| -> Result<[u32; 2], String> { Ok([cost(&format!("{what}-4"))?, cost(&format!("{what}-8"))?]) };
    Ok(Costs {
        wake: cost("executor.wake")?,
        driver: DriverCosts {
            transaction: cost("driver.transaction")?,
            now: cost("driver.now")?,
            send_now: cost("driver.send-now")?,
            send_at: cost("driver.send-at")?,
            receive_begin: cost("driver.receive-begin")?,
            receive_go_on: cost("driver.receive-go-on")?,
            receive_frame: cost("driver.receive-frame")?,
            receive_timeout: cost("driver.receive-timeout")?,
            sent: cost("driver.sent")?,
            idle: cost("driver.idle")?,
        },
        machine: ProtocolCosts {
            poll_made: cost("machine.poll-made")?,
            poll_answered: cost("machine.poll-answered")?,
            response_received: cost("machine.response-received")?,
            round_ended: cost("machine.round-ended")?,
            beacon_received: cost("machine.beacon-received")?,
            beacon_made: cost("machine.beacon-made")?,
            overheard: cost("machine.overheard")?,
            scheduled: cost("machine.scheduled")?,
        },
        code: CodeCosts { made: cost("code.made")?, in_software: cost("code.in-software")? },
        tag: TagCosts {
            handover: cost("tag.handover")?,
            track_plane: rounds("tag.track-plane")?,
            track_space: rounds("tag.track-space")?,
            solve_plane: rounds("tag.solve-plane")?,
            solve_space: rounds("tag.solve-space")?,
            publish_range: cost("tag.publish-range")?,
            line: cost("tag.line")?,
            features: cost("tag.features")?,
            advert: cost("tag.advert")?,
        },
    })
}

thread_local! {
    /// Blocks of the codes that were made since they were last charged. A simulation runs in one thread.
    static BLOCKS: Cell<u32> = const { Cell::new(0) };
}

/// Makes the code of a frame, and counts its blocks for the [`Charged`] protocol that runs.
pub fn counted_code(key: &[u8; 16], nonce: &Nonce, parts: [&[u8]; 2]) -> IntegrityCode {
    let bytes: usize = parts.iter().map(|part| part.len()).sum();
    // Two blocks, and one for each 16 bytes of the length and what follows it.
    BLOCKS.set(BLOCKS.get() + 2 + (bytes + 2).div_ceil(16) as u32);
    software_code(key, nonce, parts)
}

/// A protocol or a radio whose code takes processor time of its node.
pub struct Charged<T> {
    inner: T,
    processor: Processor,
    costs: &'static Costs,
    /// For a radio: the receiver stayed on after the last operation.
    listens: bool,
    /// For a protocol: the cost of handing over what the last step reported, before the next step.
    handover: u32,
    /// For a protocol: it ignores responses to other addresses than this one. `None`: it takes all responses.
    address: Option<u16>,
    /// For a protocol: sees it before each step.
    before: Option<Before<T>>,
}

/// Sees a protocol, the time and an event.
type Before<T> = Box<dyn Fn(&T, RadioInstant, &Event<'_>)>;

impl<T> Charged<T> {
    /// Charges the costs of `inner` to `processor`.
    pub fn new(inner: T, processor: &Processor) -> Self {
        let costs = Costs::of(processor.board().core);
        Self { inner, processor: processor.clone(), costs, listens: false, handover: 0, address: None, before: None }
    }

    /// For a protocol that ignores responses to other addresses than this one.
    pub fn with_address(self, address: u16) -> Self {
        Self { address: Some(address), ..self }
    }

    /// For a protocol that is seen before each of its steps.
    pub fn seen(self, before: impl Fn(&T, RadioInstant, &Event<'_>) + 'static) -> Self {
        Self { before: Some(Box::new(before)), ..self }
    }
}

impl ProtocolCosts {
    /// The cost of a step. A frame of another exchange counts as the native frame in its place: a blink or an answer
    /// counts as the frame that is made or received.
    fn of_step(&self, address: Option<u16>, event: &Event<'_>, action: &Action<'_>) -> u32 {
        let message = |bytes: &[u8]| Frame::parse(bytes).ok().map(|frame| frame.message);
        let sent = match action {
            Action::Transmit { frame, .. } => Some(message(frame)),
            Action::Receive { .. }
            | Action::WaitUntil(_)
            | Action::Sleep { .. }
            | Action::Compensate
            | Action::Report(_) => None,
        };
        let reports_round = match action {
            Action::Report(Report::Round(_) | Report::Differences(_)) => true,
            Action::Report(Report::Polled(_) | Report::Arrival(_) | Report::Link(_) | Report::Downlink(_))
            | Action::Transmit { .. }
            | Action::Receive { .. }
            | Action::WaitUntil(_)
            | Action::Sleep { .. }
            | Action::Compensate => false,
        };
        match event {
            Event::Received(received) => match Frame::parse(received.bytes) {
                Ok(frame) => match frame.message {
                    Message::Poll(poll) if sent.is_none() && poll.part.is_none() => self.overheard,
                    // Of a blink the arrival is noted; an answer is more work.
                    Message::Poll(_) => self.poll_answered,
                    Message::Response(_) if address.is_some_and(|address| frame.destination != address) => {
                        self.overheard
                    }
                    Message::Response(_) if reports_round => self.round_ended,
                    Message::Response(_) => self.response_received,
                    Message::SyncFrame(sync_frame) => self.beacon_received + self.in_sync_frame(&sync_frame),
                    Message::RelayFrame(frame) => self.overheard + self.relaying(frame.entries.len()),
                    Message::Request(_) | Message::Final { .. } | Message::Challenge(_) => self.beacon_received,
                },
                Err(_) if sent.is_some() => self.poll_answered,
                Err(_) => self.response_received,
            },
            Event::Started
            | Event::Sent(_)
            | Event::NotSent
            | Event::Corrupt
            | Event::Timeout
            | Event::Late
            | Event::Woken
            | Event::Reported => match sent {
                Some(Some(Message::SyncFrame(sync_frame))) => self.beacon_made + self.in_sync_frame(&sync_frame),
                Some(Some(Message::RelayFrame(frame))) => self.poll_made + self.relaying(frame.entries.len()),
                Some(_) => self.poll_made,
                None => self.scheduled,
            },
        }
    }
}

impl ProtocolCosts {
    /// What relayed entries cost, to take them or to make them. Each has less to do than a poll that is overheard, and counts
    /// as one.
    fn relaying(&self, entries: usize) -> u32 {
        self.overheard * entries as u32
    }

    fn in_sync_frame(&self, sync_frame: &SyncFrame) -> u32 {
        self.relaying(sync_frame.relay.as_ref().map_or(0, |relay| relay.entries.len()))
    }
}

impl<M: Protocol> Protocol for Charged<M> {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        // The node's loop reads the clock before it hands a report over, so this is charged after the step that reports.
        let handover = core::mem::take(&mut self.handover);
        if let Some(before) = &self.before {
            before(&self.inner, now, &event);
            // What it made for itself costs the node nothing.
            BLOCKS.set(0);
        }
        let action = self.inner.step(now, event);
        self.handover = match &action {
            Action::Report(Report::Round(_) | Report::Differences(_)) => self.costs.tag.handover,
            // A message of telemetry, as long as that of a range.
            Action::Report(Report::Polled(_) | Report::Arrival(_) | Report::Downlink(_)) => {
                self.costs.tag.publish_range
            }
            Action::Report(Report::Link(_))
            | Action::Transmit { .. }
            | Action::Receive { .. }
            | Action::WaitUntil(_)
            | Action::Sleep { .. }
            | Action::Compensate => 0,
        };
        self.processor.charge(self.costs.machine.of_step(self.address, &event, &action) + handover);
        self.costs.code.charge(&self.processor, BLOCKS.take());
        action
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        self.inner.calibrate(stamps);
    }

    fn sense(&mut self, sensors: Sensors) {
        self.inner.sense(sensors);
    }

    fn pace(&mut self, pace: Pace) {
        self.inner.pace(pace);
    }

    fn guide(&mut self, guidance: Guidance) {
        self.inner.guide(guidance);
    }

    fn set_host(&mut self, has_host: bool) {
        self.inner.set_host(has_host);
    }

    fn refused_frames(&self) -> u32 {
        self.inner.refused_frames()
    }

    fn carried(&mut self) -> Option<(bool, u8)> {
        self.inner.carried()
    }

    fn send_down(&mut self, message: Downlink) {
        self.inner.send_down(message);
    }

    fn carry(&mut self, data: Option<UserData>) {
        self.inner.carry(data);
    }

    fn rouse(&mut self, guidance: Guidance) {
        self.inner.rouse(guidance);
    }
}

impl<R: Radio> Radio for Charged<R> {
    type Error = R::Error;

    const CAPABILITIES: Capabilities = R::CAPABILITIES;

    async fn now(&mut self) -> Result<RadioInstant, Self::Error> {
        self.processor.charge(self.costs.driver.now);
        self.inner.now().await
    }

    fn antenna_delay(&self) -> RadioDuration {
        self.inner.antenna_delay()
    }

    fn range_bias(&self) -> RangeBias {
        self.inner.range_bias()
    }

    async fn transmit(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Self::Error>> {
        let costs = &self.costs.driver;
        self.processor.charge(match start {
            Start::Now => costs.send_now,
            Start::At(_) => costs.send_at,
        });
        let sent = self.inner.transmit(frame, start, listen).await;
        self.processor.charge(costs.sent);
        self.listens = listen && sent.is_ok();
        sent
    }

    async fn receive<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        start: Start,
        window: RadioDuration,
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Self::Error>> {
        let costs = &self.costs.driver;
        let goes_on = self.listens && start == Start::Now;
        self.processor.charge(if goes_on { costs.receive_go_on } else { costs.receive_begin });
        let received = self.inner.receive(buffer, start, window, keep_listening).await;
        self.processor.charge(match received {
            Ok(_) | Err(ReceiveError::Corrupt) => costs.receive_frame,
            Err(ReceiveError::Timeout | ReceiveError::Late | ReceiveError::Radio(_)) => costs.receive_timeout,
        });
        self.listens = keep_listening && received.is_ok();
        received
    }

    async fn idle(&mut self) -> Result<(), Self::Error> {
        self.processor.charge(self.costs.driver.idle);
        self.listens = false;
        self.inner.idle().await
    }

    fn pace(&self) -> Pace {
        self.inner.pace()
    }

    async fn compensate(&mut self) -> Result<Option<Sensors>, Self::Error> {
        self.inner.compensate().await
    }

    async fn impulse_response(
        &mut self,
        window: ResponseWindow,
        take: impl FnMut(Sample),
    ) -> Result<Option<u16>, Self::Error> {
        let first = self.inner.impulse_response(window, take).await?;
        if first.is_some() {
            self.processor.charge(self.costs.tag.features);
        }
        Ok(first)
    }
}

impl<R: Restart> Restart for Charged<R> {
    async fn restart(&mut self) -> Result<(), Self::Error> {
        self.inner.restart().await
    }

    async fn sleep(&mut self, micros: u32, roused: impl Future<Output = ()>) -> Result<bool, Self::Error> {
        self.inner.sleep(micros, roused).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_every_cost_of_every_processor() {
        for (name, core) in CORES {
            assert_eq!(parse(TABLE, name).as_ref(), Ok(Costs::of(core)));
        }
    }

    #[test]
    fn a_table_that_lacks_something_says_what() {
        assert_eq!(parse("what,riscv32\n", "cortex-m3"), Err("no column cortex-m3".to_owned()));
        assert_eq!(parse("what,riscv32\n", "riscv32"), Err("no row executor.wake".to_owned()));
        let cell = parse("what,riscv32\nexecutor.wake,x\n", "riscv32");
        assert_eq!(cell, Err("executor.wake, riscv32: \"x\" is not a number".to_owned()));
    }

    #[test]
    fn rounds_between_the_tables_are_on_a_line() {
        let tag = &Costs::of(Core::CortexM4F).tag;
        let costs = TagCosts { track_plane: [1000, 3000], ..tag.clone() };
        // 500 instructions per range.
        let expected = [(0, 0), (3, 500), (4, 1000), (6, 2000), (8, 3000), (10, 4000)];
        for (ranges, instructions) in expected {
            assert_eq!(costs.round(true, false, ranges), instructions, "{ranges}");
        }
    }
}
