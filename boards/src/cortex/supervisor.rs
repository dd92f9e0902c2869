//! The supervisor of a Cortex-M board, and what it takes care of.

use crate::cortex::crash;
#[cfg(feature = "dwm1001")]
use crate::dwm1001::{Leds, Watchdog};
#[cfg(feature = "evk1000")]
use crate::evk1000::{Leds, Watchdog};
use crate::node::{self, Reporter, Tasks};
use crate::rtt::TelemetryChannel;

/// What the supervisor has of the board.
pub struct Care {
    /// The lights.
    pub leds: Leds,
    /// Runs already.
    pub watchdog: Watchdog,
    /// Telemetry's way out.
    pub telemetry: TelemetryChannel,
}

/// The supervisor: see [`node::supervise`].
#[embassy_executor::task]
pub async fn supervise(reporter: &'static Reporter, tasks: Tasks, care: Care) {
    let Care { mut leds, mut watchdog, mut telemetry } = care;
    let (write, feed) = (|frame: &[u8]| telemetry.write(frame), || watchdog.feed());
    let alive = |reporter: &Reporter| tasks.alive(reporter);
    node::supervise(reporter, write, |lit| leds.show(lit), feed, alive, crash::leave).await;
}
