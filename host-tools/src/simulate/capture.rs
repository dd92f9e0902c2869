//! A capture of all frames on the air: IEEE 802.15.4 frames with their check bytes (link type 195), times in
//! nanoseconds. The format is that of libpcap (pcap-savefile(5)), in big-endian order.

use std::cell::RefCell;
use std::io::{self, Write};
use std::path::Path;
use std::rc::Rc;

use anyhow::{Context, Result};
use sim::scenario::Simulation;

use recording::output::Growing;

/// The longest frame of the standard, bytes. What is longer is cut.
const LONGEST_FRAME: u32 = 127;
/// Times are in nanoseconds, and the version is 2.4.
const MAGIC: u32 = 0xa1b2_3c4d;
const VERSION: u32 = 0x0002_0004;
/// IEEE 802.15.4 with check bytes.
const LINK_TYPE: u32 = 195;

/// The file of a capture, or the first error in writing it.
type Written = io::Result<Growing>;

/// A capture that is written while a simulation runs. Its file appears when it is finished.
pub struct Capture {
    /// Taken when it is finished.
    file: Rc<RefCell<Option<Written>>>,
}

impl Capture {
    /// A capture of all frames from now on.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn begin(simulation: &Simulation, file: &Path) -> Result<Self> {
        let mut growing = Growing::create(file)?;
        // The zone of times is that of Greenwich, and their accuracy is not known.
        let header = [MAGIC, VERSION, 0, 0, LONGEST_FRAME, LINK_TYPE];
        growing.write_all(header.map(u32::to_be_bytes).as_flattened()).context("cannot begin the capture")?;
        let file = Rc::new(RefCell::new(Some(Ok(growing))));
        let filled = file.clone();
        simulation.sniff(move |sniffed| {
            let mut file = filled.borrow_mut();
            let Some(Ok(growing)) = &mut *file else { return };
            if let Err(error) = write_frame(growing, sniffed.marker.as_ps() / 1000, &sniffed.bytes) {
                *file = Some(Err(error));
            }
        });
        Ok(Self { file })
    }

    /// Completes the file.
    ///
    /// # Errors
    /// The file cannot be written, or could not be written before.
    pub fn finish(self) -> Result<()> {
        match self.file.take() {
            Some(written) => Ok(written.context("cannot capture a frame")?.finish()?),
            None => Ok(()),
        }
    }
}

/// Writes seconds, nanoseconds, the length in the file, the length on the air, and the frame.
fn write_frame(to: &mut impl Write, time_ns: u64, frame: &[u8]) -> io::Result<()> {
    const SECOND_NS: u64 = 1_000_000_000;
    let kept = frame.get(..LONGEST_FRAME as usize).unwrap_or(frame);
    let header = [time_ns / SECOND_NS, time_ns % SECOND_NS, kept.len() as u64, frame.len() as u64];
    to.write_all(header.map(|field| (field as u32).to_be_bytes()).as_flattened())?;
    to.write_all(kept)
}

#[cfg(test)]
mod tests {
    use super::write_frame;

    #[test]
    fn a_frame_has_its_time_and_both_lengths() {
        let mut file = Vec::new();
        write_frame(&mut file, 2_000_000_003, &[7; 130]).expect("a vector");
        // 2 s and 3 ns; 127 of 130 bytes.
        assert_eq!(file[..16], [0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 127, 0, 0, 0, 130]);
        assert_eq!(file[16..], [7; 127]);
    }
}
