//! The source for a chip behind a debug probe.
//!
//! After attaching, the source looks for the RTT rings and polls them. After any failure (a cable, the probe, the
//! chip's power) it releases the probe and attaches again, at first immediately and then at longer and longer
//! intervals. If the control block disappears or begins again, the node has restarted.

use std::collections::VecDeque;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::Result;

use super::elf::Marks;
use super::rtt::{self, Memory, Polled, Rings};
use super::source::{Event, Pace, Retry, Source};
use crate::probe::ProbeArguments;

/// Makes connections to a chip.
pub trait Attach {
    /// Attaches. Returns the chip's memory and a short description of the connection.
    ///
    /// # Errors
    /// There is no probe or no chip. The error is one sentence that says what to do.
    fn attach(&mut self) -> Result<(Box<dyn Memory>, String)>;
}

enum State {
    /// Not attached yet: a failure ends the source.
    New,
    /// Attached, and looking for the rings.
    Seeking { memory: Box<dyn Memory>, since: Instant, reported: bool },
    /// Attached, and reading.
    Reading { memory: Box<dyn Memory>, rings: Rings },
    /// Tries to connect again.
    Lost(Retry),
}

/// A chip behind a probe, as a source.
pub struct Probed<A> {
    attach: A,
    marks: Option<Marks>,
    reset: bool,
    pace: Pace,
    state: State,
    ready: VecDeque<Event>,
}

impl<A: Attach> Probed<A> {
    /// A source that looks for `marks`, where there is an ELF file. It resets the node once at the start if `reset` is
    /// set.
    pub fn new(attach: A, marks: Option<Marks>, reset: bool, pace: Pace) -> Self {
        Self { attach, marks, reset, pace, state: State::New, ready: VecDeque::new() }
    }

    fn step(&mut self) -> Result<()> {
        let state = std::mem::replace(&mut self.state, State::New);
        self.state = match state {
            State::New => {
                let (memory, what) = self.attach.attach()?;
                let (memory, what) = self.greet(memory, what)?;
                self.ready.push_back(Event::Connected(what));
                self.seek(memory)
            }
            State::Lost(retry) if !retry.is_due() => State::Lost(retry),
            State::Lost(retry) => match self.attach.attach() {
                Ok((memory, what)) => {
                    self.ready.push_back(Event::Connected(what));
                    self.seek(memory)
                }
                Err(_) => State::Lost(retry.next(&self.pace)),
            },
            State::Seeking { mut memory, since, reported } => {
                match rtt::find(memory.as_mut(), self.marks.as_ref().and_then(|marks| marks.rtt)) {
                    Ok(Some(rings)) => {
                        self.compare(memory.as_mut());
                        State::Reading { memory, rings }
                    }
                    Ok(None) => {
                        let silent = since.elapsed() > self.pace.silent;
                        if silent && !reported {
                            self.ready.push_back(Event::Silent);
                        }
                        State::Seeking { memory, since, reported: reported || silent }
                    }
                    Err(error) => self.lose(&error),
                }
            }
            State::Reading { mut memory, mut rings } => match rings.poll(memory.as_mut()) {
                Ok(Polled::Bytes { bytes, restarted }) => {
                    if restarted {
                        self.ready.push_back(Event::Restarted);
                    }
                    // Telemetry first, because it decides which lines of the log are shown.
                    let events = bytes.into_iter().rev().map(|(channel, bytes)| Event::Bytes(channel, bytes));
                    self.ready.extend(events);
                    State::Reading { memory, rings }
                }
                Ok(Polled::Gone) => {
                    self.ready.push_back(Event::Restarted);
                    self.seek(memory)
                }
                Err(error) => self.lose(&error),
            },
        };
        Ok(())
    }

    fn greet(&mut self, mut memory: Box<dyn Memory>, what: String) -> Result<(Box<dyn Memory>, String)> {
        if std::mem::take(&mut self.reset) {
            memory.reset()?;
        }
        Ok((memory, what))
    }

    fn seek(&self, memory: Box<dyn Memory>) -> State {
        State::Seeking { memory, since: Instant::now(), reported: false }
    }

    fn lose(&mut self, error: &anyhow::Error) -> State {
        self.ready.push_back(Event::Lost(format!("{error:#}")));
        State::Lost(Retry::first(&self.pace))
    }

    /// Compares the chip's flash with the ELF file. Flash that cannot be read gives no result; then the build that the
    /// node reports decides.
    fn compare(&mut self, memory: &mut dyn Memory) {
        let Some(marks) = self.marks.as_ref().filter(|marks| !marks.flash.is_empty()) else { return };
        let mut same = true;
        for (address, expected) in &marks.flash {
            let mut found = vec![0; expected.len()];
            if memory.read(*address, &mut found).is_err() {
                return;
            }
            same &= found == *expected;
        }
        self.ready.push_back(Event::Flashed { same });
    }
}

impl<A: Attach> Source for Probed<A> {
    fn next(&mut self, patience: Duration) -> Result<Option<Event>> {
        let begun = Instant::now();
        loop {
            if let Some(event) = self.ready.pop_front() {
                return Ok(Some(event));
            }
            self.step()?;
            if self.ready.is_empty() {
                let left = patience.saturating_sub(begun.elapsed());
                if left.is_zero() {
                    return Ok(None);
                }
                sleep(left.min(self.pace.poll));
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> bool {
        match &mut self.state {
            // An error shows itself at the next poll.
            State::Reading { memory, rings } => rings.send(memory.as_mut(), bytes).unwrap_or(false),
            State::New | State::Seeking { .. } | State::Lost(_) => false,
        }
    }
}

impl Attach for ProbeArguments {
    fn attach(&mut self) -> Result<(Box<dyn Memory>, String)> {
        let probe = ProbeArguments::attach(self, None)?;
        let name = probe.chip();
        Ok((probe.into_memory(), name))
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;
    use std::time::Duration;

    use anyhow::{Result, anyhow};

    use super::super::elf::Marks;
    use super::super::rtt::Memory;
    use super::super::source::{Event, NodeChannel, Pace, Source};
    use super::super::testing_chip::Ram;
    use super::{Attach, Probed};

    const PACE: Pace = Pace {
        poll: Duration::from_millis(1),
        retry: Duration::from_millis(2),
        longest: Duration::from_millis(4),
        silent: Duration::from_millis(20),
    };

    /// A simulated probe. The test changes the chip behind it.
    #[derive(Clone)]
    struct Desk(Rc<RefCell<Ram>>);

    impl Desk {
        fn new() -> Self {
            let mut ram = Ram::new(0x1000);
            ram.start(0x100);
            Self(Rc::new(RefCell::new(ram)))
        }

        fn source(&self, marks: Option<Marks>) -> Probed<Self> {
            Probed::new(self.clone(), marks, false, PACE)
        }
    }

    impl Attach for Desk {
        fn attach(&mut self) -> Result<(Box<dyn Memory>, String)> {
            if self.0.borrow().plugged { Ok((Box::new(self.clone()), "chip".into())) } else { Err(anyhow!("no probe")) }
        }
    }

    impl Memory for Desk {
        fn read(&mut self, address: u64, bytes: &mut [u8]) -> Result<()> {
            self.0.borrow_mut().read(address, bytes)
        }

        fn write(&mut self, address: u64, bytes: &[u8]) -> Result<()> {
            self.0.borrow_mut().write(address, bytes)
        }

        fn write_word(&mut self, address: u64, word: u32) -> Result<()> {
            self.0.borrow_mut().write_word(address, word)
        }

        fn ram(&self) -> Vec<std::ops::Range<u64>> {
            self.0.borrow().ram()
        }

        fn reset(&mut self) -> Result<()> {
            self.0.borrow_mut().reset()
        }
    }

    /// All events until the source has none.
    fn events(source: &mut dyn Source) -> Vec<Event> {
        std::iter::from_fn(|| source.next(Duration::from_millis(10)).expect("no failure")).collect()
    }

    fn log(text: &str) -> Event {
        Event::Bytes(NodeChannel::Log, text.into())
    }

    #[test]
    fn attached_it_reads_both_channels() {
        let desk = Desk::new();
        let mut source = desk.source(None);
        desk.0.borrow_mut().send(0, b"log");
        desk.0.borrow_mut().send(1, b"told");
        let told = Event::Bytes(NodeChannel::Telemetry, b"told".to_vec());
        assert_eq!(events(&mut source), [Event::Connected("chip".into()), told, log("log")]);
        assert_eq!(desk.0.borrow().resets, 0);
    }

    #[test]
    fn bytes_go_to_the_node_as_far_as_its_ring_has_room() {
        let desk = Desk::new();
        let mut source = desk.source(None);
        assert!(!source.send(b"too early"));
        events(&mut source);
        // 63 bytes, round the end of the ring.
        for length in [40, 40, 20] {
            assert!(source.send(&vec![7; length]));
            assert_eq!(desk.0.borrow_mut().receive(), vec![7; length]);
        }
        assert!(source.send(&[1; 60]) && !source.send(&[2; 4]) && source.send(&[3; 3]));
        assert_eq!(desk.0.borrow_mut().receive(), [&[1; 60][..], &[3; 3]].concat());
        desk.0.borrow_mut().unplug();
        assert!(!source.send(b"too late"));
    }

    #[test]
    fn a_probe_that_is_not_there_at_the_start_is_a_failure() {
        let desk = Desk::new();
        desk.0.borrow_mut().unplug();
        assert_eq!(desk.source(None).next(Duration::ZERO).expect_err("no probe").to_string(), "no probe");
    }

    #[test]
    fn unplugged_it_attaches_again() {
        let desk = Desk::new();
        let mut source = desk.source(None);
        events(&mut source);
        desk.0.borrow_mut().unplug();
        assert_eq!(events(&mut source), [Event::Lost("the probe is gone".into())]);
        desk.0.borrow_mut().send(0, b"meanwhile");
        assert!(events(&mut source).is_empty());
        desk.0.borrow_mut().plugged = true;
        assert_eq!(events(&mut source), [Event::Connected("chip".into()), log("meanwhile")]);
    }

    #[test]
    fn a_reset_and_a_block_that_has_moved_are_survived() {
        let desk = Desk::new();
        let mut source = desk.source(None);
        desk.0.borrow_mut().send(0, b"before");
        events(&mut source);
        // Another image, with its control block at another address.
        desk.0.borrow_mut().clear();
        assert_eq!(events(&mut source), [Event::Restarted]);
        desk.0.borrow_mut().start(0x800);
        desk.0.borrow_mut().send(0, b"after");
        assert_eq!(events(&mut source), [log("after")]);
        // The same, but faster than the polling.
        desk.0.borrow_mut().start(0x800);
        desk.0.borrow_mut().send(0, b"again");
        assert_eq!(events(&mut source), [Event::Restarted, log("again")]);
    }

    #[test]
    fn a_node_without_rings_is_reported_once() {
        let desk = Desk::new();
        desk.0.borrow_mut().clear();
        let mut source = desk.source(None);
        std::thread::sleep(PACE.silent);
        let mut seen = events(&mut source);
        std::thread::sleep(PACE.silent * 2);
        seen.extend(events(&mut source));
        seen.extend(events(&mut source));
        assert_eq!(seen, [Event::Connected("chip".into()), Event::Silent]);
    }

    #[test]
    fn the_flash_is_compared_with_the_elf_file() {
        let desk = Desk::new();
        let mark = |expected: &[u8]| Marks { rtt: Some(Ram::BASE + 0x100), flash: vec![(0x1002, expected.to_vec())] };
        let seen = |expected: &[u8]| events(&mut desk.source(Some(mark(expected)))).pop();
        // Flash that cannot be read gives no result.
        assert_eq!(seen(b"ab"), Some(Event::Connected("chip".into())));
        desk.0.borrow_mut().flash.push((0x1000, b"..ab".to_vec()));
        assert_eq!(seen(b"ab"), Some(Event::Flashed { same: true }));
        assert_eq!(seen(b"cd"), Some(Event::Flashed { same: false }));
    }

    #[test]
    fn a_reset_is_done_once_and_first() {
        let desk = Desk::new();
        let mut source = Probed::new(desk.clone(), None, true, PACE);
        events(&mut source);
        desk.0.borrow_mut().unplug();
        events(&mut source);
        desk.0.borrow_mut().plugged = true;
        events(&mut source);
        assert_eq!(desk.0.borrow().resets, 1);
    }
}
