//! A node at a debug probe, read by `baliza-probe`, which has the driver, through a pipe.

use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result};
use host_tools::cli::companion::PROBE;
use node_link::monitor::Piped;

/// The telemetry of a node at a debug probe.
pub struct PipedProbe {
    /// What the program reads of the node.
    pub source: Piped,
    program: Child,
}

impl PipedProbe {
    /// Starts the program. It reports on standard error, and connects again after a loss.
    ///
    /// # Errors
    /// The program is not here, or cannot be started.
    pub fn start(probe: Option<&str>) -> Result<Self> {
        let mut command = Command::new(PROBE.find()?);
        command.args(["monitor", "--format", "telemetry"]).args(probe.iter().flat_map(|probe| ["--probe", *probe]));
        let cannot = || format!("cannot start {}", PROBE.program);
        let mut program = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().with_context(cannot)?;
        let output = program.stdout.take().with_context(cannot)?;
        Ok(Self { source: Piped::new(output), program })
    }
}

impl Drop for PipedProbe {
    fn drop(&mut self) {
        // It may have ended by itself.
        _ = self.program.kill();
        _ = self.program.wait();
    }
}
