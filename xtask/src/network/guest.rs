//! A node's processor: an image in QEMU, and the pipe to it.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Stdio};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, ensure};
use qemu_link::{MAX_MESSAGE, WorldAnswer};

use crate::chip::Chip;
use crate::qemu;

/// An image that runs, or waits for an answer.
pub struct Guest {
    process: Process,
    to: ChildStdin,
    from: ChildStdout,
    buffer: Vec<u8>,
    /// Messages taken.
    pub messages: u64,
}

/// The process; killed when it is dropped.
#[derive(Clone)]
pub struct Process(Arc<Mutex<Child>>);

impl Guest {
    /// Starts an image.
    pub fn start(chip: Chip, image: &Path) -> Result<Self> {
        let mut command = chip.qemu();
        command.arg("-kernel").arg(image).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().with_context(|| format!("cannot run {command:?}: {}", qemu::install(chip)))?;
        let to = child.stdin.take().context("no input")?;
        let from = child.stdout.take().context("no output")?;
        let process = Process(Arc::new(Mutex::new(child)));
        Ok(Self { process, to, from, buffer: vec![0; MAX_MESSAGE], messages: 0 })
    }

    /// The process, for the code that ends it.
    pub fn process(&self) -> Process {
        self.process.clone()
    }

    /// Waits for the next request, without its length; `None`: the program has ended.
    pub fn request(&mut self) -> Result<Option<&[u8]>> {
        // An image writes a message at once, and a pipe takes it at once: this is mostly one read.
        let (mut have, mut length) = (0, 2);
        while have < length {
            let more = self.from.read(&mut self.buffer[have..])?;
            if more == 0 && have == 0 {
                return Ok(None);
            }
            ensure!(more > 0, "the image broke off within a message");
            have += more;
            if let (true, [low, high, ..]) = (have >= 2, &*self.buffer) {
                length = 2 + usize::from(u16::from_le_bytes([*low, *high]));
            }
        }
        ensure!(length == have, "{have} bytes came for a message of {length}");
        self.messages += 1;
        Ok(Some(&self.buffer[2..have]))
    }

    /// Answers it.
    pub fn answer(&mut self, answer: &WorldAnswer<'_>) -> Result<()> {
        Ok(self.to.write_all(&answer.encode()?)?)
    }
}

impl Process {
    /// Ends it, whatever it does.
    pub fn kill(&self) {
        let mut child = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // One that has ended cannot be killed.
        let _ = child.kill();
        let _ = child.wait();
    }
}

impl Drop for Guest {
    fn drop(&mut self) {
        self.process.kill();
    }
}
