//! No probes: the type of [`ProbeArguments::attach`] where the feature `probe` is not compiled in.

use std::ops::Range;

use anyhow::{Result, bail};

use super::ProbeArguments;
use crate::node::monitor::Memory;
use crate::node::provision::Firmware;
use crate::node::provision::transfer::Flash;

/// A chip behind a debug probe. Without the feature `probe` there is none.
pub enum Probe {}

impl Probe {
    pub(super) fn attach(arguments: &ProbeArguments, _: Option<&str>) -> Result<Self> {
        Self::is_connected(arguments).and_then(|_| bail!("no debug probe"))
    }

    pub(super) fn is_connected(_: &ProbeArguments) -> Result<bool> {
        bail!(
            "this program was built without the feature probe, so it does not reach debug probes: build it with \
             `cargo install --path host-tools`, or do without one (--serial, --file, --out; see --help)"
        )
    }

    /// The probe's name.
    pub fn name(&self) -> &str {
        match *self {}
    }

    /// The chip's name.
    pub fn chip(&self) -> String {
        match *self {}
    }
}

impl Memory for Probe {
    fn read(&mut self, _: u64, _: &mut [u8]) -> Result<()> {
        match *self {}
    }

    fn write_word(&mut self, _: u64, _: u32) -> Result<()> {
        match *self {}
    }

    fn ram(&self) -> Vec<Range<u64>> {
        match *self {}
    }

    fn reset(&mut self) -> Result<()> {
        match *self {}
    }
}

impl Flash for Probe {
    fn read(&mut self, _: u32, _: &mut [u8]) -> Result<()> {
        match *self {}
    }

    fn write_page(&mut self, _: u32, _: &[u8]) -> Result<()> {
        match *self {}
    }

    fn write_image(&mut self, _: &Firmware, _: &mut dyn FnMut(u64, u64)) -> Result<()> {
        match *self {}
    }

    fn restart(&mut self) -> Result<()> {
        match *self {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_the_feature_attaching_says_what_to_do() {
        let error = ProbeArguments::default().attach(None).err().expect("there are no probes").to_string();
        assert!(error.starts_with("this program was built without the feature probe"), "{error}");
    }
}
