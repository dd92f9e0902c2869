//! A node at a debug probe, read by `baliza-probe`, which has the driver, through a pipe.

use std::io::Write as _;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result};
use host_tools::cli::companion::PROBE;
use node_link::monitor::{Event, Piped, Source};

/// The telemetry of a node at a debug probe.
pub struct PipedProbe {
    source: Piped,
    /// What goes to the node.
    input: ChildStdin,
    program: Child,
}

impl PipedProbe {
    /// Starts the program. It reports on standard error, and connects again after a loss.
    ///
    /// # Errors
    /// The program is not here, or cannot be started.
    pub fn start(probe: Option<&str>) -> Result<Self> {
        let mut command = Command::new(PROBE.find()?);
        command.args(["monitor", "--format", "telemetry", "--to-node-from-stdin"]);
        command.args(probe.iter().flat_map(|probe| ["--probe", *probe]));
        let cannot = || format!("cannot start {}", PROBE.program);
        let mut program = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().with_context(cannot)?;
        let output = program.stdout.take().with_context(cannot)?;
        let input = program.stdin.take().with_context(cannot)?;
        Ok(Self { source: Piped::new(output), input, program })
    }
}

impl Source for PipedProbe {
    fn next(&mut self, patience: Duration) -> Result<Option<Event>> {
        self.source.next(patience)
    }

    fn send(&mut self, bytes: &[u8]) -> bool {
        self.input.write_all(bytes).and_then(|()| self.input.flush()).is_ok()
    }
}

impl Drop for PipedProbe {
    fn drop(&mut self) {
        // It may have ended by itself.
        _ = self.program.kill();
        _ = self.program.wait();
    }
}
