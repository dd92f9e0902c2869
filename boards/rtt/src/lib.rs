//! RTT: the log on channel 0, telemetry on channel 1. The program never waits for either. A probe reads them from
//! memory. ESPs with built-in USB contain their own probe.
#![no_std]
#![cfg(target_os = "none")]

use rtt_target::{ChannelMode, UpChannel, rtt_init, set_defmt_channel};

/// The sizes of the channels in bytes: some twenty log lines, and as many frames of telemetry.
const _: () = assert!(wire::telemetry::MAX_FRAME < 1024);

/// The channel of telemetry: whole frames, one after the other.
pub struct TelemetryChannel(UpChannel);

impl TelemetryChannel {
    /// Writes a whole frame, or nothing if the channel has no room now. Returns whether it was written.
    pub fn write(&mut self, frame: &[u8]) -> bool {
        self.0.write(frame) == frame.len()
    }
}

/// Sets both channels up. Log lines before this are lost. May be called once in a program's run.
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
