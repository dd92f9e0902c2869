//! Runs an image to its end.

use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail};

use crate::chip::Chip;
use crate::ended;

/// Limit of an image's run time: each needs some seconds, so that a longer run hangs.
const PATIENCE: Duration = Duration::from_secs(300);

/// The output of an image until it ends.
///
/// # Errors
/// QEMU cannot be started, or the image fails or does not end.
pub fn run(chip: Chip, image: &Path) -> Result<String> {
    let mut command = chip.qemu();
    command.arg("-kernel").arg(image).stdin(Stdio::null()).stdout(Stdio::piped());
    let mut machine = command.spawn().with_context(|| format!("cannot run {}: {}", name(&command), install(chip)))?;
    let mut printed = machine.stdout.take().context("no output")?;
    let reader = thread::spawn(move || {
        let mut text = String::new();
        printed.read_to_string(&mut text).map(|_| text)
    });
    let status = ended(&mut machine, PATIENCE)?;
    let text = reader.join().ok().context("the reader panicked")??;
    let last = text.lines().last().unwrap_or("nothing");
    match status {
        Some(status) if status.success() => Ok(text),
        Some(status) => bail!("{} on {}: {status}; it printed last: {last}", image.display(), name(&command)),
        None => bail!("{} did not end in {} s; it printed last: {last}", image.display(), PATIENCE.as_secs()),
    }
}

fn name(command: &Command) -> String {
    command.get_program().to_string_lossy().into_owned()
}

/// How to get QEMU for a chip.
pub fn install(chip: Chip) -> &'static str {
    match chip {
        Chip::CortexM4F | Chip::CortexM3 => "on Debian `apt-get install qemu-system-arm`",
        Chip::RiscV32 => "on Debian `apt-get install qemu-system-misc`",
    }
}
