//! The source that is a chip behind a probe.
//!
//! Attached, it looks for the rings and polls them. Whatever fails then, a cable, the probe, the chip's power, ends in letting go of
//! the probe and attaching again, at first at once and then ever more slowly. A control block that vanishes or begins anew is a
//! node that restarts.

use std::collections::VecDeque;
use std::ops::Range;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::Result;
use probe_rs::config::MemoryRegion;
use probe_rs::{MemoryInterface, Session};

use super::image::Marks;
use super::rtt::{self, Memory, Polled, Rings};
use super::source::{Event, Pace, Source};
use crate::probe::ProbeArguments;

/// Makes connections to a chip.
pub trait Attach {
    /// Attaches, and says to what in a few words.
    ///
    /// # Errors
    /// There is no probe or no chip, in one sentence that says what to do.
    fn attach(&mut self) -> Result<(Box<dyn Memory>, String)>;
}

enum State {
    /// Never attached yet: a failure is final.
    New,
    /// Attached; the rings are sought.
    Seeking { memory: Box<dyn Memory>, since: Instant, told: bool },
    /// Attached, and reading.
    Reading { memory: Box<dyn Memory>, rings: Rings },
    /// Tries again at a time, then waits so long.
    Lost { again: Instant, wait: Duration },
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
    /// Looks for `marks`, where there is an ELF file; resets the node once at the start if `reset`.
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
            State::Lost { again, wait } if Instant::now() < again => State::Lost { again, wait },
            State::Lost { wait, .. } => match self.attach.attach() {
                Ok((memory, what)) => {
                    self.ready.push_back(Event::Connected(what));
                    self.seek(memory)
                }
                Err(_) => State::Lost { again: Instant::now() + wait, wait: (wait * 2).min(self.pace.longest) },
            },
            State::Seeking { mut memory, since, told } => {
                match rtt::find(memory.as_mut(), self.marks.as_ref().and_then(|marks| marks.rtt)) {
                    Ok(Some(rings)) => {
                        self.compare(memory.as_mut());
                        State::Reading { memory, rings }
                    }
                    Ok(None) => {
                        let silent = since.elapsed() > self.pace.silent;
                        if silent && !told {
                            self.ready.push_back(Event::Silent);
                        }
                        State::Seeking { memory, since, told: told || silent }
                    }
                    Err(error) => self.lose(&error),
                }
            }
            State::Reading { mut memory, mut rings } => match rings.poll(memory.as_mut()) {
                Ok(Polled::Bytes { bytes, anew }) => {
                    if anew {
                        self.ready.push_back(Event::Restarted);
                    }
                    self.ready.extend(bytes.into_iter().map(|(channel, bytes)| Event::Bytes(channel, bytes)));
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
        State::Seeking { memory, since: Instant::now(), told: false }
    }

    fn lose(&mut self, error: &anyhow::Error) -> State {
        self.ready.push_back(Event::Lost(format!("{error:#}")));
        State::Lost { again: Instant::now() + self.pace.retry, wait: self.pace.retry * 2 }
    }

    /// Flash that cannot be read tells nothing: the node's own word will.
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
}

impl Attach for ProbeArguments {
    fn attach(&mut self) -> Result<(Box<dyn Memory>, String)> {
        let session = ProbeArguments::attach(self, None)?;
        let name = session.target().name.clone();
        Ok((Box::new(Chip(session)), name))
    }
}

/// A chip by probe-rs; its first core, whose memory is the node's.
struct Chip(Session);

impl Memory for Chip {
    fn read(&mut self, address: u64, bytes: &mut [u8]) -> Result<()> {
        Ok(self.0.core(0)?.read(address, bytes)?)
    }

    fn write_word(&mut self, address: u64, word: u32) -> Result<()> {
        Ok(self.0.core(0)?.write_word_32(address, word)?)
    }

    fn ram(&self) -> Vec<Range<u64>> {
        let regions = self.0.target().memory_map.iter().filter_map(MemoryRegion::as_ram_region);
        regions.map(|region| region.range.clone()).collect()
    }

    fn reset(&mut self) -> Result<()> {
        Ok(self.0.core(0)?.reset()?)
    }
}
