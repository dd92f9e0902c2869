//! `--foxglove`: the live view of a command, with and without the feature of this name.

use anyhow::Result;
use node_link::monitor::NodeOutput;

/// `--foxglove`: where to listen.
#[derive(Clone, Debug)]
pub struct Address {
    host: String,
    port: u16,
}

impl Address {
    /// Parses `HOST:PORT`.
    ///
    /// # Errors
    /// The text is not of this form.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is not HOST:PORT");
        let (host, port) = text.rsplit_once(':').ok_or_else(wrong)?;
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let port = port.parse().map_err(|_| wrong())?;
        if host.is_empty() { Err(wrong()) } else { Ok(Self { host: host.to_owned(), port }) }
    }

    /// The name or the address of the computer.
    pub fn host(&self) -> &str {
        &self.host
    }

    /// The port.
    pub fn port(&self) -> u16 {
        self.port
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

#[cfg(feature = "foxglove")]
mod with {
    use std::time::{Duration, Instant, SystemTime};

    use foxglove_scenes::{Live as Server, View};

    use super::{Address, NodeOutput, Result};

    /// The interval after which all anchors are sent again.
    const AGAIN: Duration = Duration::from_secs(1);

    /// A server of what a node says, with the host's time.
    pub struct LiveView {
        view: View<Server>,
        anchors_at: Instant,
    }

    impl LiveView {
        /// Starts to listen, and prints the address.
        ///
        /// # Errors
        /// The port is in use or not allowed.
        pub fn listen(Address { host, port }: &Address) -> Result<Self> {
            let live = Server::listen(host, *port)?;
            crate::cli::note(&format!("foxglove: ws://{host}:{}\n", live.port()));
            Ok(Self { view: View::new(live), anchors_at: Instant::now() })
        }

        /// Sends a node's output.
        ///
        /// # Errors
        /// A message cannot be encoded.
        pub fn output(&mut self, output: &NodeOutput) -> Result<()> {
            if let NodeOutput::Message(stamp, message) = output {
                self.view.telemetry(now_ns(), *stamp, message)?;
            }
            self.repeat_anchors()
        }

        fn repeat_anchors(&mut self) -> Result<()> {
            if self.anchors_at.elapsed() >= AGAIN {
                self.anchors_at = Instant::now();
                self.view.repeat_anchors(now_ns())?;
            }
            Ok(())
        }
    }

    fn now_ns() -> u64 {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
    }
}
#[cfg(feature = "foxglove")]
pub use with::LiveView;

/// Without the feature there is none.
#[cfg(not(feature = "foxglove"))]
pub enum LiveView {}

#[cfg(not(feature = "foxglove"))]
impl LiveView {
    /// Says that this program cannot.
    ///
    /// # Errors
    /// Always.
    pub fn listen(_: &Address) -> Result<Self> {
        Err(super::without("--foxglove", "foxglove").into())
    }

    /// There is nothing to send to.
    ///
    /// # Errors
    /// Never.
    pub fn output(&mut self, _: &NodeOutput) -> Result<()> {
        match *self {}
    }
}
