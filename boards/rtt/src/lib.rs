//! RTT: the log on channel 0, telemetry on channel 1, neither ever waited for. A probe reads them from memory; the ESPs with
//! built-in USB are their own probe.
#![no_std]
#![cfg(target_os = "none")]

use rtt_target::{ChannelMode, UpChannel, rtt_init, set_defmt_channel};

/// Bytes of the channels: some twenty log lines, and as many frames of telemetry.
const _: () = assert!(wire::telemetry::MAX_FRAME < 1024);

/// The channel of telemetry: whole frames, one after the other.
pub struct TelemetryChannel(UpChannel);

impl TelemetryChannel {
    /// Writes a whole frame, or nothing where it has no room now.
    pub fn write(&mut self, frame: &[u8]) -> bool {
        self.0.write(frame) == frame.len()
    }
}

/// Sets both channels up. Log lines before are lost. Once a program.
pub fn start() -> TelemetryChannel {
    let channels = rtt_init! {
        up: {
            0: { size: 1024, mode: ChannelMode::NoBlockSkip, name: "defmt" }
            1: { size: 1024, mode: ChannelMode::NoBlockSkip, name: "telemetry" }
        }
    };
    set_defmt_channel(channels.up.0);
    TelemetryChannel(channels.up.1)
}
