//! No server: this program was built without the feature.

use anyhow::{Result, bail};
use host_tools::cli::live_view::Address;
use station_core::Hub;

/// Without the feature there is none.
pub enum FoxgloveServer {}

impl FoxgloveServer {
    /// Says that this program cannot.
    ///
    /// # Errors
    /// Always.
    pub fn listen(address: &Address) -> Result<Self> {
        bail!(
            "cannot listen on {address}: this program was built without Foxglove; \
             cargo install --path host-tools/station --features foxglove"
        )
    }

    /// There is nothing to send to.
    pub async fn follow(self, _: Hub, _: String) {
        match self {}
    }
}
