//! Telemetry in datagrams: what gateways pass on, and the bare stream of a single node.

use std::collections::HashMap;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use station_core::Utc;
use station_core::net::make_room;
use wire::datagram::is_datagram;
use wire::telemetry::{Address, Message};

use super::NodeReporter;
use super::gateways::{Admission, Gateways};
use super::sources::{Outgoing, PATIENCE, ReportSender};
use node_link::decode::Stream;

/// The largest datagram.
const DATAGRAM: usize = 65_536;
/// The greatest number of senders at a time. Another one takes the place of the one that was silent for longest.
const MOST_SENDERS: usize = 1024;
/// Datagrams that arrive within this time are taken together, …
const REST: Duration = Duration::from_millis(1);
/// … up to this number: then their receipts are due.
const TOGETHER: usize = 1024;
/// A sender that was silent for this time is forgotten.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(600);
/// A node says hello every two seconds. Two that do so within this time share a sender.
const SHARED_WITHIN: Duration = Duration::from_secs(10);

/// The stream of one sender.
struct Sender {
    stream: Stream,
    reporter: NodeReporter,
    received: Instant,
    /// Who said hello last, and when.
    hello: Option<(u16, Instant)>,
    /// Several nodes said hello, the last time then.
    shared: Option<Instant>,
}

impl Sender {
    fn new(site: &str, now: Instant) -> Self {
        Self { stream: Stream::default(), reporter: NodeReporter::new(site), received: now, hello: None, shared: None }
    }

    /// Whether it is known whose messages these are: frames do not say it. `note` is told of two nodes.
    fn is_of_one_node(&mut self, message: &Message, now: Instant, note: impl FnOnce(u16, u16)) -> bool {
        if let Message::Hello(hello) = message
            && let Some((other, at)) = self.hello.replace((hello.address, now))
            && other != hello.address
            && now.duration_since(at) < SHARED_WITHIN
            && self.shared.replace(now).is_none()
        {
            note(other, hello.address);
        }
        let is_over = self.shared.is_some_and(|at| now.duration_since(at) >= SHARED_WITHIN);
        self.shared = self.shared.filter(|_| !is_over);
        self.shared.is_none()
    }
}

/// A socket that receives from now on.
pub(super) fn bind(address: SocketAddr) -> Result<UdpSocket> {
    let socket = UdpSocket::bind(address).with_context(|| format!("cannot listen on udp:{address}"))?;
    socket.set_read_timeout(Some(PATIENCE)).context("cannot set a socket's timeout")?;
    Ok(socket)
}

/// Receives datagrams until the station ends. A bare stream belongs to one sender: an address with its port.
pub(super) fn listen(
    socket: &UdpSocket,
    admission: &Admission,
    site: &str,
    (send, outgoing): (ReportSender<'_>, Outgoing<'_>),
    note: &mut dyn FnMut(&str),
) -> Result<()> {
    let mut senders: HashMap<SocketAddr, Sender> = HashMap::new();
    let mut gateways = Gateways::new(admission, site)?;
    let mut datagram = vec![0; DATAGRAM];
    loop {
        wait(socket, &mut datagram)?;
        for _ in 0..TOGETHER {
            let Some((length, from)) = received(socket.recv_from(&mut datagram))? else { break };
            let bytes = datagram.get(..length).unwrap_or_default();
            let (now, arrived) = (Instant::now(), Utc::now());
            if is_datagram(bytes) {
                if !gateways.take(bytes, (from, arrived), send, note) {
                    return Ok(());
                }
                continue;
            }
            if !admission.takes_unauthenticated(from) {
                gateways.refuse(from, "is telemetry without a gateway: --open-udp takes it from elsewhere");
                continue;
            }
            if !senders.contains_key(&from) {
                senders.retain(|_, sender| now.duration_since(sender.received) < FORGOTTEN_AFTER);
                make_room(&mut senders, MOST_SENDERS, |sender| sender.received);
            }
            let sender = senders.entry(from).or_insert_with(|| Sender::new(site, now));
            sender.received = now;
            for byte in bytes {
                let Some((stamp, message)) = sender.stream.feed(*byte) else { continue };
                let tell = |one, other| {
                    note(&format!(
                        "{from} sends telemetry of {} and {}, and no frame says whose it is: refused; \
                         `baliza forward` says it",
                        Address(one),
                        Address(other)
                    ));
                };
                if !sender.is_of_one_node(&message, now, tell) {
                    continue;
                }
                if !sender.reporter.reports(stamp, &message, arrived).into_iter().all(&mut *send) {
                    return Ok(());
                }
            }
        }
        // What cannot be sent now is told again when the datagram comes again, or the message is due again.
        let mut transmit = |bytes: &[u8], to| drop(socket.send_to(bytes, to));
        gateways.send_receipts(&mut transmit);
        while let Some(frame) = outgoing() {
            gateways.send_to_nodes(&frame, &mut transmit);
        }
        gateways.note_refused(note);
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

#[cfg(test)]
mod tests {
    use super::*;
    use wire::telemetry::{Board, Condition, Hello, Role, State};

    #[test]
    fn two_nodes_of_one_sender_are_refused_until_one_is_alone() {
        let begin = Instant::now();
        let mut sender = Sender::new("hall", begin);
        let mut notes = Vec::new();
        let mut is_of_one = |ms: u64, hello: Option<u16>| {
            let message: Message = match hello {
                Some(address) => {
                    let (role, board) = (Role::Tag, Board::Dwm1001);
                    Hello { t_us: ms, eui: 1, address, role, board, build: [0; 8], keyed: false }.into()
                }
                None => State { t_us: ms, is: Condition::Searching }.into(),
            };
            let now = begin + Duration::from_millis(ms);
            sender.is_of_one_node(&message, now, |one, other| notes.push((one, other)))
        };
        assert!(is_of_one(0, Some(1)) && is_of_one(500, None) && is_of_one(2000, Some(1)));
        // Another node joins in, and goes after four seconds.
        assert!(!is_of_one(2500, Some(2)) && !is_of_one(2600, None) && !is_of_one(4000, Some(1)));
        assert!(!is_of_one(4500, Some(2)) && !is_of_one(6000, Some(1)) && !is_of_one(15_000, None));
        assert!(is_of_one(16_000, Some(1)) && is_of_one(16_100, None));
        // A board that is put in the place of another one.
        assert!(is_of_one(30_000, Some(3)) && is_of_one(30_500, None));
        assert_eq!(notes, [(1, 2)]);
    }
}
