//! A capture of all frames on the air: IEEE 802.15.4 frames with their check bytes (link type 195), times in
//! nanoseconds.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use anyhow::{Context, Result};
use pcap_file::pcap::{PcapHeader, PcapPacket, PcapWriter};
use pcap_file::{DataLink, TsResolution};
use sim::scenario::Simulation;

/// The longest frame of the standard, bytes.
const LONGEST_FRAME: u32 = 127;

/// The time of a frame's RMARKER since the beginning, and its bytes.
type Frame = (Duration, Rc<[u8]>);

/// A capture that collects frames while a simulation runs.
pub struct Capture {
    frames: Rc<RefCell<Vec<Frame>>>,
}

impl Capture {
    /// A capture of all frames from now on.
    pub fn of(simulation: &Simulation) -> Self {
        let frames: Rc<RefCell<Vec<Frame>>> = Rc::default();
        let filled = frames.clone();
        simulation.sniff(move |sniffed| {
            let nanoseconds = sniffed.marker.as_ps() / 1000;
            filled.borrow_mut().push((Duration::from_nanos(nanoseconds), sniffed.bytes.clone()));
        });
        Self { frames }
    }

    /// The capture as a pcap file.
    ///
    /// # Errors
    /// The pcap writer fails.
    pub fn to_pcap(&self) -> Result<Vec<u8>> {
        let header = PcapHeader {
            datalink: DataLink::IEEE802_15_4,
            ts_resolution: TsResolution::NanoSecond,
            snaplen: LONGEST_FRAME,
            ..PcapHeader::default()
        };
        let mut writer = PcapWriter::with_header(Vec::new(), header).context("cannot begin the capture")?;
        for (time, bytes) in self.frames.borrow().iter() {
            let packet = PcapPacket::new(*time, bytes.len() as u32, bytes);
            writer.write_packet(&packet).context("cannot capture a frame")?;
        }
        Ok(writer.into_writer())
    }
}
