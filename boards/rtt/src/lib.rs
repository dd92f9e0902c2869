//! RTT: the log on channel 0, telemetry on channel 1. The program never waits for either. A probe reads them from
//! memory. ESPs with built-in USB contain their own probe.
#![no_std]
#![cfg(target_os = "none")]

use firmware_common::HostChannel;
use rtt_target::{ChannelMode, UpChannel, rtt_init, set_defmt_channel};

/// Some twenty log lines, bytes.
const LOG_BYTES: usize = 1024;
/// A tag of 384 rounds a second with four ranges sends some 80 kB/s of telemetry: the channel holds a tenth of a second,
/// for a computer that is busy for so long.
const TELEMETRY_BYTES: usize = 8 * 1024;
const _: () = assert!(wire::telemetry::MAX_FRAME < TELEMETRY_BYTES);

/// The channel of telemetry: whole frames, one after the other.
pub struct TelemetryChannel(UpChannel);

impl HostChannel for TelemetryChannel {
    fn write(&mut self, frame: &[u8]) -> bool {
        self.0.write(frame) == frame.len()
    }

    fn is_read(&self) -> bool {
        self.0.is_empty()
    }
}

/// Sets both channels up. Log lines before this are lost. May be called once in a program's run.
pub fn start() -> TelemetryChannel {
    let channels = rtt_init! {
        up: {
            0: { size: LOG_BYTES, mode: ChannelMode::NoBlockSkip, name: "defmt" }
            1: { size: TELEMETRY_BYTES, mode: ChannelMode::NoBlockSkip, name: "telemetry" }
        }
    };
    set_defmt_channel(channels.up.0);
    TelemetryChannel(channels.up.1)
}
