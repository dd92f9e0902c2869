//! A debug probe within the program. It finds RTT's control block by its symbol, as a host does, and copies the
//! channels' content to files of the host.

use core::ptr::{read_volatile, write_volatile};

use semihosting::fs::File;
use semihosting::io::Write;

/// The files for the channels, in the directory that QEMU runs in.
const FILES: [&core::ffi::CStr; 2] = [c"tag-simulated.defmt", c"tag-simulated.telemetry"];

/// A channel from the program to the host (SEGGER, *Real Time Transfer*).
#[repr(C)]
struct UpChannel {
    name: *const u8,
    buffer: *const u8,
    size: usize,
    write: usize,
    read: usize,
    flags: usize,
}

/// The control block. It has as many channels as there are files.
#[repr(C)]
struct ControlBlock {
    id: [u8; 16],
    up_channels: usize,
    down_channels: usize,
    up: [UpChannel; FILES.len()],
}

unsafe extern "C" {
    #[link_name = "_SEGGER_RTT"]
    static mut CONTROL_BLOCK: ControlBlock;
}

/// The probe.
pub struct Probe {
    files: [File; FILES.len()],
}

impl Probe {
    /// Creates the files. `None` if the host refuses them, or if there is no control block.
    pub(super) fn attach() -> Option<Self> {
        // SAFETY: the block has been set up by `rtt_init!`, with two channels.
        let id = unsafe { read_volatile(&raw const CONTROL_BLOCK.id) };
        if &id != b"SEGGER RTT\0\0\0\0\0\0" {
            return None;
        }
        let [log, telemetry] = FILES.map(|name| File::create(name).ok());
        Some(Self { files: [log?, telemetry?] })
    }

    /// Copies the channels' content to the files. Returns false if the host refuses it.
    pub fn drain(&mut self) -> bool {
        let mut taken = true;
        for (place, file) in self.files.iter_mut().enumerate() {
            // SAFETY: the index is within the block, which has that many channels. Nothing else in the program runs
            // meanwhile.
            let channel = unsafe { &raw mut CONTROL_BLOCK.up[place] };
            taken &= drain(channel, file);
        }
        taken
    }
}

fn drain(channel: *mut UpChannel, file: &mut File) -> bool {
    // SAFETY: the channel is RTT's, whose offsets stay within its buffer.
    unsafe {
        let write = read_volatile(&raw const (*channel).write);
        let mut read = read_volatile(&raw const (*channel).read);
        while read != write {
            let end = if read < write { write } else { (*channel).size };
            let part = core::slice::from_raw_parts((*channel).buffer.add(read), end - read);
            if file.write_all(part).is_err() {
                return false;
            }
            read = if end == (*channel).size { 0 } else { end };
        }
        write_volatile(&raw mut (*channel).read, read);
    }
    true
}
