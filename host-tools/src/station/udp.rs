//! Telemetry in datagrams: what a gateway passes on, of any number of nodes.

use std::collections::HashMap;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use baliza_station::Utc;

use super::Reporter;
use super::sources::{PATIENCE, Send};
use crate::node::decode::Stream;

/// The largest datagram.
const DATAGRAM: usize = 65_536;
/// The greatest number of senders at a time. Another one takes the place of the one that was silent for longest.
const MOST_SENDERS: usize = 1024;
/// A sender that was silent for this time is forgotten.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(600);

/// The stream of one sender.
struct Sender {
    stream: Stream,
    reporter: Reporter,
    heard: Instant,
}

/// A socket that receives from now on.
pub(super) fn bind(address: SocketAddr) -> Result<UdpSocket> {
    let socket = UdpSocket::bind(address).with_context(|| format!("cannot listen on udp:{address}"))?;
    socket.set_read_timeout(Some(PATIENCE)).context("cannot set a socket's timeout")?;
    Ok(socket)
}

/// Receives datagrams until the station ends. A stream belongs to one sender: an address with its port.
pub(super) fn listen(socket: &UdpSocket, site: &str, send: Send<'_>) -> Result<()> {
    let mut senders: HashMap<SocketAddr, Sender> = HashMap::new();
    let mut datagram = vec![0; DATAGRAM];
    loop {
        let (length, from) = match socket.recv_from(&mut datagram) {
            Ok(received) => received,
            // A timeout, or the answer to nothing that we sent.
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::ConnectionRefused
                ) =>
            {
                continue;
            }
            Err(error) => return Err(error).context("cannot receive datagrams"),
        };
        let now = Instant::now();
        if !senders.contains_key(&from) {
            senders.retain(|_, sender| now.duration_since(sender.heard) < FORGOTTEN_AFTER);
            if senders.len() >= MOST_SENDERS {
                let oldest = senders.iter().min_by_key(|(_, sender)| sender.heard).map(|(address, _)| *address);
                oldest.map(|oldest| senders.remove(&oldest));
            }
        }
        let sender = senders.entry(from).or_insert_with(|| Sender {
            stream: Stream::default(),
            reporter: Reporter::new(site),
            heard: now,
        });
        sender.heard = now;
        let arrived = Utc::now();
        for byte in datagram.iter().take(length) {
            let Some((stamp, message)) = sender.stream.feed(*byte) else { continue };
            if !sender.reporter.reports(stamp, &message, arrived).into_iter().all(&mut *send) {
                return Ok(());
            }
        }
    }
}
