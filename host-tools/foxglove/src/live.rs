//! A view on a WebSocket, to which Foxglove connects.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, WebSocketServerHandle};

use super::{Sink, Topic};

/// A server, which runs until it is dropped with its program.
pub struct Live {
    context: Arc<Context>,
    server: WebSocketServerHandle,
}

impl Live {
    /// Listens on a host and a port; port 0 chooses a free one.
    ///
    /// # Errors
    /// The port is in use or not allowed, or there is no such host.
    pub fn listen(host: &str, port: u16) -> Result<Self> {
        let context = Context::new();
        let server = context.websocket_server().name("baliza").bind(host, port).start_blocking();
        Ok(Self { server: server.with_context(|| format!("cannot listen on {host}:{port}"))?, context })
    }

    /// The port.
    pub fn port(&self) -> u16 {
        self.server.port()
    }
}

impl Sink for Live {
    type Channel = Arc<RawChannel>;

    fn open(&mut self, topic: Topic<'_>) -> Result<Arc<RawChannel>> {
        let Topic { name, encoding, schema } = topic;
        let channel = ChannelBuilder::new(name).context(&self.context).message_encoding(encoding).schema(schema);
        channel.build_raw().with_context(|| format!("cannot open the channel {name}"))
    }

    fn put(&mut self, channel: &Arc<RawChannel>, t_ns: u64, message: &[u8]) -> Result<()> {
        channel.log_with_meta(message, PartialMetadata::with_log_time(t_ns));
        Ok(())
    }
}
