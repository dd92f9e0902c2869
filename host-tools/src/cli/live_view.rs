//! `--foxglove`: the live view of a command, with and without the feature of this name.

use anyhow::Result;
use host_tools::node::monitor::NodeOutput;

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

    /// Whether only this computer can reach it.
    #[cfg(feature = "station")]
    pub fn is_loopback(&self) -> bool {
        baliza_station::net::is_loopback_name(&self.host)
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

    #[cfg(feature = "station")]
    use baliza_station::{Hub, Live, Update, model::Node};
    use host_tools::view::{Live as Server, View};
    #[cfg(feature = "station")]
    use tokio::sync::broadcast::error::RecvError;

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

        /// Sends the positions of a site's tags, and its anchors and beacons, until the station stops.
        #[cfg(feature = "station")]
        pub async fn follow(mut self, hub: Hub, site: String) {
            let mut updates = hub.listen();
            let mut nodes = tokio::time::interval(AGAIN);
            let mut epoch = 0_u64;
            loop {
                let sent = tokio::select! {
                    update = updates.recv() => match update {
                        Ok(Update::Position(position)) if position.site == site => {
                            let origin = hub.read(|live| live.geographic_origin(&site));
                            epoch += 1;
                            self.view.tag_position(&position, epoch, origin)
                        }
                        Ok(Update::Position(_) | Update::Event(_) | Update::Changed) => Ok(()),
                        Err(RecvError::Lagged(missed)) => {
                            hub.note_missed(missed);
                            Ok(())
                        }
                        Err(RecvError::Closed) => break,
                    },
                    _ = nodes.tick() => self.send_nodes(&hub.read(Live::nodes), &site),
                };
                if let Err(error) = sent {
                    log::warn!("Foxglove: {error:#}");
                }
            }
        }

        #[cfg(feature = "station")]
        fn send_nodes(&mut self, nodes: &[Node], site: &str) -> Result<()> {
            for node in nodes.iter().filter(|node| node.site == site) {
                let Some(position_m) = node.position_m else { continue };
                self.view.anchor(now_ns(), node.name.as_deref().unwrap_or(&node.node), position_m)?;
            }
            self.repeat_anchors()
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
    pub fn listen(Address { host, port }: &Address) -> Result<Self> {
        anyhow::bail!("cannot listen on {host}:{port}: this baliza was built without its feature foxglove")
    }

    /// There is nothing to send to.
    #[cfg(feature = "station")]
    pub async fn follow(self, _: baliza_station::Hub, _: String) {
        match self {}
    }

    /// There is nothing to send to.
    ///
    /// # Errors
    /// Never.
    pub fn output(&mut self, _: &NodeOutput) -> Result<()> {
        match *self {}
    }
}
