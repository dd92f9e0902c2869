//! A capture of all frames on the air: IEEE 802.15.4 frames with their check bytes (link type 195), times in
//! nanoseconds.

use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;
use std::time::Duration;

use anyhow::{Context, Result};
use pcap_file::pcap::{PcapHeader, PcapPacket, PcapWriter};
use pcap_file::{DataLink, PcapError, TsResolution};
use sim::scenario::Simulation;

use crate::files::output::Growing;

/// The longest frame of the standard, bytes.
const LONGEST_FRAME: u32 = 127;

/// The file of a capture, or the first error in writing it.
type Written = Result<PcapWriter<Growing>, PcapError>;

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
        let header = PcapHeader {
            datalink: DataLink::IEEE802_15_4,
            ts_resolution: TsResolution::NanoSecond,
            snaplen: LONGEST_FRAME,
            ..PcapHeader::default()
        };
        let writer = PcapWriter::with_header(Growing::create(file)?, header).context("cannot begin the capture")?;
        let file = Rc::new(RefCell::new(Some(Ok(writer))));
        let filled = file.clone();
        simulation.sniff(move |sniffed| {
            let mut file = filled.borrow_mut();
            let Some(Ok(writer)) = &mut *file else { return };
            let time = Duration::from_nanos(sniffed.marker.as_ps() / 1000);
            let packet = PcapPacket::new(time, sniffed.bytes.len() as u32, &sniffed.bytes);
            if let Err(error) = writer.write_packet(&packet) {
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
            Some(written) => Ok(written.context("cannot capture a frame")?.into_writer().finish()?),
            None => Ok(()),
        }
    }
}
