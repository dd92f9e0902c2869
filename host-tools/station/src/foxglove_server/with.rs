//! The server.

use std::time::{Duration, SystemTime};

use anyhow::Result;
use foxglove_scenes::{Live as Server, View};
use host_tools::cli::live_view::Address;
use station_core::model::NodeStatus;
use station_core::{Hub, LiveState, Update};
use tokio::sync::broadcast::error::RecvError;

use crate::foxglove::tag_position;

/// The interval after which all anchors are sent again.
const AGAIN: Duration = Duration::from_secs(1);

/// A server that listens.
pub struct FoxgloveServer(View<Server>);

impl FoxgloveServer {
    /// Starts to listen, and prints the address.
    ///
    /// # Errors
    /// The port is in use or not allowed.
    pub fn listen(address: &Address) -> Result<Self> {
        let live = Server::listen(address.host(), address.port())?;
        host_tools::cli::note(&format!("foxglove: ws://{}:{}\n", address.host(), live.port()));
        Ok(Self(View::new(live)))
    }

    /// Sends the positions of a site's tags, and its anchors and beacons, until the station stops.
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
                        tag_position(&mut self.0, &position, epoch, origin)
                    }
                    Ok(Update::Position(_) | Update::Event(_) | Update::Data(_) | Update::Changed) => Ok(()),
                    Err(RecvError::Lagged(missed)) => {
                        hub.note_missed(missed);
                        Ok(())
                    }
                    Err(RecvError::Closed) => break,
                },
                _ = nodes.tick() => self.send_nodes(&hub.read(LiveState::nodes), &site),
            };
            if let Err(error) = sent {
                log::warn!("Foxglove: {error:#}");
            }
        }
    }

    fn send_nodes(&mut self, nodes: &[NodeStatus], site: &str) -> Result<()> {
        for node in nodes.iter().filter(|node| node.site == site) {
            let Some(position_m) = node.position_m else { continue };
            self.0.anchor(now_ns(), node.name.as_deref().unwrap_or(&node.node), position_m)?;
        }
        self.0.repeat_anchors(now_ns())
    }
}

fn now_ns() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}
