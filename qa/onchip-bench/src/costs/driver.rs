//! Measures the driver in the node's own loop. A script takes the place of the protocol and lets the driver send,
//! receive and wait. Every stretch between the protocol, the bus and the waits is measured.

use core::cell::{Cell, RefCell};
use core::pin::pin;
use core::task::{Context, Waker};

use baliza_dw1000::driver::Dw1000;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_common::Reporter;
use firmware_tag::{TaskChannels, TelemetrySink};
use ranging::exchange::{Action, Event, Protocol};
use ranging::radio::Config;
use ranging::{PhyConfig, Radio, RadioDuration, RadioInstant, Start};

use super::chip::{ChipDelay, Irq, NextEvent, ScriptedChip, Spi};
use super::{Mean, since};
use crate::instrument::{between, stamp};

/// The costs of the driver's operations, instructions, without their transactions.
#[derive(Default)]
pub struct DriverCosts {
    /// A transaction.
    pub transaction: Mean,
    /// A reading of the clock.
    pub now: Mean,
    /// Sending at once, from the protocol's action to the wait.
    pub send_now: Mean,
    /// Sending at a time, from the protocol's action to the wait.
    pub send_at: Mean,
    /// The end of a transmission, from the interrupt to the protocol.
    pub sent: Mean,
    /// Receiving with the receiver off before, from the protocol's action to the wait.
    pub receive_begin: Mean,
    /// The same with the receiver already on.
    pub receive_go_on: Mean,
    /// A received frame, from the interrupt to the protocol.
    pub receive_frame: Mean,
    /// The end of a window, from the interrupt to the protocol.
    pub receive_timeout: Mean,
    /// Switching the radio off when it is already off.
    pub idle: Mean,
    /// From the executor's call of the task to the end of the wait.
    pub resume: Mean,
}

/// A stretch: instructions without the bus, and the number of transactions.
type Stretch = (u32, u32);

/// An action of the script.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Act {
    /// Receive in a window of `window_ms` milliseconds, with a frame or without.
    Receive { window_ms: u32, frame: bool, keep: bool },
    /// Send `bytes` bytes.
    Send { bytes: usize, at: bool, listen: bool },
}

/// The script runs twice: in the first round, the registers still have the values of the start.
const SCRIPT: [Act; 13] = [
    Act::Receive { window_ms: 5, frame: true, keep: true },
    Act::Receive { window_ms: 5, frame: true, keep: true },
    Act::Receive { window_ms: 5, frame: true, keep: false },
    Act::Receive { window_ms: 5, frame: false, keep: false },
    // The same window, then another one: one transaction more.
    Act::Receive { window_ms: 5, frame: false, keep: false },
    Act::Receive { window_ms: 4, frame: false, keep: false },
    Act::Send { bytes: 21, at: false, listen: true },
    Act::Receive { window_ms: 4, frame: false, keep: false },
    Act::Send { bytes: 21, at: true, listen: false },
    Act::Send { bytes: 21, at: true, listen: false },
    // The same length, then another one: one transaction more.
    Act::Send { bytes: 22, at: true, listen: false },
    Act::Send { bytes: 22, at: false, listen: false },
    Act::Receive { window_ms: 5, frame: false, keep: false },
];

/// The progress of the script.
struct Marks {
    /// The number of actions that have begun, and when the last one began.
    acts: Cell<usize>,
    begun: Cell<u32>,
    /// The stretches of each action: up to the wait, and after it.
    stretches: RefCell<[[Stretch; 2]; 2 * SCRIPT.len()]>,
}

impl Marks {
    /// Checks that the event is the one that the last action expects. Otherwise something else was measured.
    fn check(&self, event: Event<'_>) {
        let last = self.acts.get().checked_sub(1).map(|act| SCRIPT[act % SCRIPT.len()]);
        let as_wanted = match (last, event) {
            (None, Event::Started)
            | (Some(Act::Receive { frame: true, .. }), Event::Received(_))
            | (Some(Act::Receive { frame: false, .. }), Event::Timeout)
            | (Some(Act::Send { .. }), Event::Sent(_)) => true,
            (None | Some(_), _) => false,
        };
        assert!(as_wanted, "{last:?} came to {event:?}");
    }
}

struct Script<'a> {
    chip: &'a ScriptedChip,
    marks: &'a Marks,
    frame: [u8; 32],
}

impl Protocol for Script<'_> {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let instructions = since(self.chip.resumed.get());
        let (inside, transactions) = self.chip.take_inside();
        let acts = self.marks.acts.get();
        // The first event is that of the start.
        if let Some(last) = acts.checked_sub(1) {
            self.marks.stretches.borrow_mut()[last][1] = (instructions.saturating_sub(inside), transactions);
        }
        self.marks.check(event);
        self.chip.starting.set(false);
        let act = SCRIPT[acts % SCRIPT.len()];
        self.marks.acts.set(acts + 1);
        self.marks.begun.set(stamp());
        match act {
            Act::Receive { window_ms, keep, .. } => Action::Receive {
                start: Start::Now,
                window: RadioDuration::from_micros(1000 * window_ms),
                keep_listening: keep,
            },
            Act::Send { bytes, at, listen } => {
                let later = now.plus(RadioDuration::from_micros(1000));
                let start = if at { Start::At(later) } else { Start::Now };
                Action::Transmit { frame: &self.frame[..bytes], start, listen }
            }
        }
    }
}

/// Measures the costs.
///
/// # Panics
/// The driver does not do what the script expects.
pub fn measure() -> DriverCosts {
    let costs = DriverCosts::default();
    let chip = ScriptedChip::new();
    let marks =
        Marks { acts: Cell::new(0), begun: Cell::new(0), stretches: RefCell::new([[(0, 0); 2]; 2 * SCRIPT.len()]) };
    {
        let reporter = Reporter::<NoopRawMutex, 256>::new(|| 0);
        let handover = TaskChannels::<NoopRawMutex>::new();
        let sink = TelemetrySink::new(&reporter, false);
        let radio = Dw1000::new(Spi(&chip), Irq(&chip), (), ChipDelay(&chip), Config::new(PhyConfig::FAST));
        let script = Script { chip: &chip, marks: &marks, frame: [7; 32] };
        let mut node = pin!(firmware_tag::ranging(radio, ChipDelay(&chip), script, &handover, &sink));
        let mut context = Context::from_waker(Waker::noop());
        for (number, act) in (0..2).flat_map(|_| SCRIPT).enumerate() {
            let polled = stamp();
            assert!(node.as_mut().poll(&mut context).is_pending());
            if number > 0 {
                costs.resume.add(between(polled, chip.resumed.get()));
            }
            assert_eq!(marks.acts.get(), number + 1, "the driver does one act at a time");
            let waiting = chip.waiting.take().expect("the driver waits for the interrupt");
            let (inside, transactions) = chip.take_inside();
            let instructions = between(marks.begun.get(), waiting);
            marks.stretches.borrow_mut()[number][0] = (instructions.saturating_sub(inside), transactions);
            chip.next.set(Some(match act {
                Act::Send { .. } => NextEvent::Sent,
                Act::Receive { frame: true, .. } => NextEvent::Frame,
                Act::Receive { frame: false, .. } => NextEvent::Timeout,
            }));
        }
    }
    // Only the second round counts: the driver then knows the chip's registers.
    let stretches = marks.stretches.into_inner();
    let (_, stretches) = stretches.split_at(SCRIPT.len());
    for pair in [[4, 5], [9, 10]] {
        let [(same, fewer), (other, more)] = pair.map(|at: usize| stretches[at][0]);
        assert_eq!(more, fewer + 1, "a register more is written");
        costs.transaction.add(other - same);
    }
    let transaction = costs.transaction.get().unwrap_or_default();
    clock(&costs, transaction);
    let now = costs.now.get().unwrap_or_default();
    let beside = |(instructions, transactions): Stretch| instructions.saturating_sub(transactions * transaction);
    let mut on = false;
    for (act, [begin, end]) in SCRIPT.iter().zip(stretches) {
        match act {
            Act::Send { at, listen, .. } => {
                let sending = if *at { &costs.send_at } else { &costs.send_now };
                sending.add(beside(*begin));
                costs.sent.add(beside(*end));
                on = *listen;
            }
            Act::Receive { frame, keep, .. } => {
                let beginning = if on { &costs.receive_go_on } else { &costs.receive_begin };
                beginning.add(beside(*begin));
                on = *frame && *keep;
                if *frame {
                    costs.receive_frame.add(beside(*end));
                } else if end.1 > 0 {
                    // The node's loop reads the clock after it.
                    costs.receive_timeout.add(beside(*end).saturating_sub(now));
                }
            }
        }
    }
    costs
}

/// Measures the clock and the switching-off alone.
fn clock(costs: &DriverCosts, transaction: u32) {
    let chip = ScriptedChip::new();
    let mut radio = Dw1000::new(Spi(&chip), Irq(&chip), (), ChipDelay(&chip), Config::new(PhyConfig::FAST));
    embassy_futures::block_on(async {
        radio.init().await.expect("the chip starts");
        chip.take_inside();
        let begun = stamp();
        radio.now().await.expect("the chip answers");
        let instructions = since(begun);
        let (inside, transactions) = chip.take_inside();
        costs.now.add((instructions - inside).saturating_sub(transactions * transaction));
        let begun = stamp();
        radio.idle().await.expect("the chip answers");
        let instructions = since(begun);
        let (inside, transactions) = chip.take_inside();
        costs.idle.add((instructions - inside).saturating_sub(transactions * transaction));
    });
}
