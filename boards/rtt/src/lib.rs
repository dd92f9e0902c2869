//! RTT: the log on channel 0, telemetry on channel 1, and the host's messages to tags on channel 0 in the other direction.
//! The program never waits for any of them. A probe reads them from
//! memory. ESPs with built-in USB contain their own probe.
#![no_std]
#![cfg(target_os = "none")]

use firmware_common::HostChannel;
use rtt_target::{ChannelMode, DownChannel, UpChannel, rtt_init, set_defmt_channel};

/// Some twenty log lines, bytes.
const LOG_BYTES: usize = 1024;
/// A tag of 384 rounds a second with four ranges sends some 80 kB/s of telemetry: the channel holds a tenth of a second,
/// for a computer that is busy for so long.
/// With the feature `small` a quarter of it.
const TELEMETRY_BYTES: usize = if cfg!(feature = "small") { 2 } else { 8 } * 1024;
const _: () = assert!(wire::telemetry::MAX_FRAME < TELEMETRY_BYTES);
/// A message to a tag and half of the next one, bytes.
const MESSAGE_BYTES: usize = 64;
const _: () = assert!(wire::to_node::MAX_FRAME < MESSAGE_BYTES);

/// The channels of telemetry and of messages: whole frames, one after the other.
pub struct TelemetryChannel {
    telemetry: UpChannel,
    messages: DownChannel,
}

impl HostChannel for TelemetryChannel {
    fn write(&mut self, frame: &[u8]) -> bool {
        self.telemetry.write(frame) == frame.len()
    }

    fn is_read(&self) -> bool {
        self.telemetry.is_empty()
    }

    fn read(&mut self, into: &mut [u8]) -> usize {
        self.messages.read(into)
    }
}

/// Sets the channels up. Log lines before this are lost. May be called once in a program's run.
pub fn start() -> TelemetryChannel {
    let channels = rtt_init! {
        up: {
            0: { size: LOG_BYTES, mode: ChannelMode::NoBlockSkip, name: "defmt" }
            1: { size: TELEMETRY_BYTES, mode: ChannelMode::NoBlockSkip, name: "telemetry" }
        }
        down: {
            0: { size: MESSAGE_BYTES, name: "messages" }
        }
    };
    set_defmt_channel(channels.up.0);
    TelemetryChannel { telemetry: channels.up.1, messages: channels.down.0 }
}
