//! Reads what Foxglove gets: MCAP files, and messages of a WebSocket.

use std::collections::BTreeMap;
use std::time::Duration;

use serde_json::Value;
use tungstenite::client::IntoClientRequest;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

/// The messages of a file by topic: schema, time in nanoseconds, bytes.
pub fn messages(file: &[u8]) -> BTreeMap<String, Vec<(String, u64, Vec<u8>)>> {
    let mut by_topic: BTreeMap<String, Vec<_>> = BTreeMap::new();
    for message in mcap::MessageStream::new(file).expect("an MCAP file") {
        let message = message.expect("a message");
        let schema = message.channel.schema.as_ref().expect("a schema").name.clone();
        let row = (schema, message.log_time, message.data.to_vec());
        by_topic.entry(message.channel.topic.clone()).or_default().push(row);
    }
    by_topic
}

pub fn json_of(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).expect("JSON")
}

/// A client of a WebSocket.
pub type Client = WebSocket<MaybeTlsStream<std::net::TcpStream>>;

/// The next message that `of` takes.
pub fn wait<T>(client: &mut Client, of: impl Fn(&Message) -> Option<T>) -> T {
    loop {
        let message = client.read().expect("a message");
        if let Some(found) = of(&message) {
            return found;
        }
    }
}

/// A client of Foxglove's server at this address.
pub fn connect(address: &str) -> Client {
    let mut request = address.into_client_request().expect("an address");
    request.headers_mut().insert("Sec-WebSocket-Protocol", "foxglove.sdk.v1".parse().expect("a name"));
    let (client, _) = tungstenite::connect(request).expect("connected");
    if let MaybeTlsStream::Plain(stream) = client.get_ref() {
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("set");
    }
    client
}
