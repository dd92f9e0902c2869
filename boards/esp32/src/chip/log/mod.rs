//! Where the log and the telemetry go: RTT, or with the feature `log-serial` the serial port. Neither is ever waited for.

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
