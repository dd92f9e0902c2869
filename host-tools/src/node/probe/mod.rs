//! Debug probes: [`ProbeArguments::attach`] makes a [`Probe`], which reads and writes a chip's memory and flash.
//!
//! The cargo feature `probe` compiles probe-rs in (`session`). Without it (`without`), attaching is an error.

#[cfg(feature = "probe")]
mod session;
#[cfg(not(feature = "probe"))]
mod without;

use anyhow::Result;

#[cfg(feature = "probe")]
pub use session::Probe;
#[cfg(not(feature = "probe"))]
pub use without::Probe;

/// Chooses a probe and its chip.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ProbeArguments {
    /// The probe, where there are several; its vendor and product as hexadecimal numbers
    #[arg(long, value_name = "VID:PID[:SERIAL]")]
    pub probe: Option<String>,
    /// The chip, in probe-rs's words [default: the board's, else what the probe finds out]
    #[arg(long, value_name = "NAME")]
    pub chip: Option<String>,
    /// The probe's clock, kHz [default: the probe's own choice]
    #[arg(long = "speed-khz", alias = "speed", value_name = "KHZ", value_parser = clap::value_parser!(u32).range(1..))]
    pub speed: Option<u32>,
}

impl ProbeArguments {
    /// Opens the probe and attaches to the chip, which runs on: `--chip`, else `default_chip`, else what the probe
    /// finds out.
    ///
    /// # Errors
    /// [`UserError`](crate::UserError) where the arguments do not select one probe and a known chip. Otherwise an error
    /// that says which step failed and what may help, or that `baliza` was built without the feature `probe`.
    pub fn attach(&self, default_chip: Option<&str>) -> Result<Probe> {
        Probe::attach(self, default_chip)
    }

    /// Whether a probe is connected that the arguments allow.
    ///
    /// # Errors
    /// `--probe` is wrong, or `baliza` was built without the feature `probe`.
    pub fn is_connected(&self) -> Result<bool> {
        Probe::is_connected(self)
    }
}
