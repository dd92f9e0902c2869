//! Telemetry in datagrams: what a gateway passes on, of any number of nodes.

use std::collections::HashMap;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use station_core::Utc;
use station_core::net::make_room;

use super::NodeReporter;
use super::sources::{PATIENCE, ReportSender};
use node_link::decode::Stream;

/// The largest datagram.
const DATAGRAM: usize = 65_536;
/// The greatest number of senders at a time. Another one takes the place of the one that was silent for longest.
const MOST_SENDERS: usize = 1024;
/// Datagrams that arrive within this time are taken together.
const REST: Duration = Duration::from_millis(1);
/// A sender that was silent for this time is forgotten.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(600);

/// The stream of one sender.
struct Sender {
    stream: Stream,
    reporter: NodeReporter,
    received: Instant,
}

/// A socket that receives from now on.
pub(super) fn bind(address: SocketAddr) -> Result<UdpSocket> {
    let socket = UdpSocket::bind(address).with_context(|| format!("cannot listen on udp:{address}"))?;
    socket.set_read_timeout(Some(PATIENCE)).context("cannot set a socket's timeout")?;
    Ok(socket)
}

/// Receives datagrams until the station ends. A stream belongs to one sender: an address with its port.
pub(super) fn listen(socket: &UdpSocket, site: &str, send: ReportSender<'_>) -> Result<()> {
    let mut senders: HashMap<SocketAddr, Sender> = HashMap::new();
    let mut datagram = vec![0; DATAGRAM];
    loop {
        wait(socket, &mut datagram)?;
        while let Some((length, from)) = received(socket.recv_from(&mut datagram))? {
            let now = Instant::now();
            if !senders.contains_key(&from) {
                senders.retain(|_, sender| now.duration_since(sender.received) < FORGOTTEN_AFTER);
                make_room(&mut senders, MOST_SENDERS, |sender| sender.received);
            }
            let sender = senders.entry(from).or_insert_with(|| Sender {
                stream: Stream::default(),
                reporter: NodeReporter::new(site),
                received: now,
            });
            sender.received = now;
            let arrived = Utc::now();
            for byte in datagram.iter().take(length) {
                let Some((stamp, message)) = sender.stream.feed(*byte) else { continue };
                if !sender.reporter.reports(stamp, &message, arrived).into_iter().all(&mut *send) {
                    return Ok(());
                }
            }
        }
    }
}

/// Waits for a datagram, at most for the socket's timeout, and then for those that come shortly after it: a thread that
/// wakes up for each costs more than the datagrams do.
fn wait(socket: &UdpSocket, datagram: &mut [u8]) -> Result<()> {
    let set_nonblocking = |on| socket.set_nonblocking(on).context("cannot set a socket's mode");
    set_nonblocking(false)?;
    let arrived = received(socket.peek_from(datagram))?;
    set_nonblocking(true)?;
    if arrived.is_some() {
        thread::sleep(REST);
    }
    Ok(())
}

/// What has arrived. None: nothing, or an answer to something that this socket has not sent.
fn received<T>(result: io::Result<T>) -> Result<Option<T>> {
    match result {
        Ok(arrived) => Ok(Some(arrived)),
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::ConnectionRefused
            ) =>
        {
            Ok(None)
        }
        Err(error) => Err(error).context("cannot receive datagrams"),
    }
}
