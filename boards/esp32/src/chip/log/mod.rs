//! The channel of log and telemetry: RTT, or the serial port with the feature `log-serial`. The program never waits for
//! either.

// Microseconds since the start, as in telemetry.
defmt::timestamp!("{=u64:us}", super::uptime_us());

#[cfg(feature = "log-serial")]
mod serial;

#[cfg(not(feature = "log-serial"))]
pub use baliza_board_rtt::TelemetryChannel;
#[cfg(not(feature = "log-serial"))]
pub(super) use baliza_board_rtt::start;
#[cfg(feature = "log-serial")]
pub(super) use serial::start;
#[cfg(feature = "log-serial")]
pub use serial::{Port, TelemetryChannel};
