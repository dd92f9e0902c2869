//! Debug probes, as far as commands see them: [`ProbeArguments`] choose one, [`ProbeArguments::attach`] opens it.
//!
//! The program `baliza-probe` has the driver, and [`install`]s it, because a driver of probes takes longer to build than
//! all the rest. Without one, an operation ends in [`NoDriver`], and `baliza` hands the command over to `baliza-probe`.

use std::sync::OnceLock;

use anyhow::Result;

use crate::monitor::Memory;
use crate::provision::transfer::Flash;

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

/// A chip behind a debug probe.
pub trait Probe {
    /// The probe: its value for `--probe`, and its own name.
    fn name(&self) -> &str;
    /// The chip's name, in the driver's words.
    fn chip(&self) -> String;
    /// The chip's memory.
    fn into_memory(self: Box<Self>) -> Box<dyn Memory>;
    /// The chip's flash.
    fn into_flash(self: Box<Self>) -> Box<dyn Flash>;
}

/// Reaches debug probes.
pub trait Driver: Sync {
    /// Opens the probe and attaches to the chip, which runs on: `--chip`, else `default_chip`, else what the probe
    /// finds out.
    ///
    /// # Errors
    /// [`UserError`](recording::UserError) where the arguments do not select one probe and a known chip. Otherwise an
    /// error that says which step failed and what may help.
    fn attach(&self, arguments: &ProbeArguments, default_chip: Option<&str>) -> Result<Box<dyn Probe>>;

    /// Whether a probe is connected that the arguments allow.
    ///
    /// # Errors
    /// `--probe` is wrong.
    fn is_connected(&self, arguments: &ProbeArguments) -> Result<bool>;
}

/// This program has no driver of debug probes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("this program does not reach debug probes; baliza-probe does, or do without one (--serial, --file, --out)")]
pub struct NoDriver;

static DRIVER: OnceLock<&'static dyn Driver> = OnceLock::new();

/// From now on, probes are reached by this driver. A second one is not installed.
pub fn install(driver: &'static dyn Driver) {
    let _ = DRIVER.set(driver);
}

fn driver() -> Result<&'static dyn Driver, NoDriver> {
    DRIVER.get().copied().ok_or(NoDriver)
}

impl ProbeArguments {
    /// Opens the probe: [`Driver::attach`].
    ///
    /// # Errors
    /// Those of the driver, or [`NoDriver`].
    pub fn attach(&self, default_chip: Option<&str>) -> Result<Box<dyn Probe>> {
        driver()?.attach(self, default_chip)
    }

    /// Whether a probe is connected that the arguments allow.
    ///
    /// # Errors
    /// Those of the driver, or [`NoDriver`].
    pub fn is_connected(&self) -> Result<bool> {
        driver()?.is_connected(self)
    }
}

#[cfg(test)]
mod tests {
    use super::{NoDriver, ProbeArguments};

    #[test]
    fn without_a_driver_attaching_says_what_to_do() {
        let error = ProbeArguments::default().attach(None).err().expect("there is no driver");
        assert!(error.is::<NoDriver>());
        assert!(error.to_string().contains("baliza-probe"), "{error}");
    }
}
