//! Live positions as NMEA 0183, for programs that take a receiver of satellites: gpsd, QGIS, OpenCPN.
//!
//! Each tag has a port of its own, because these programs take one receiver a connection. The input is the hub's
//! updates; each client of a port gets the sentences of the tag's newest position. A client that reads slowly misses
//! positions, and none waits for it: there is one text a port, which the next position replaces. What clients send is
//! read and ignored. There is no access control in NMEA: whoever reaches a port can read along.

mod sentence;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{Semaphore, broadcast, watch};
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, sleep_until, timeout};

use crate::model::TagPosition;
use crate::{Hub, Update, Utc};

/// Clients of a port. A further one is disconnected at once.
const CLIENTS: usize = 32;
/// The least time between two positions that a client gets: receivers of satellites send at most ten a second.
const EVERY: Duration = Duration::from_millis(100);
/// A client that takes nothing for this time is disconnected.
const WRITE: Duration = Duration::from_secs(10);
/// How often a port whose tag has no position says so.
const VOID_EVERY: Duration = Duration::from_secs(1);
/// The time after which a connection is accepted again where that has failed.
const AGAIN: Duration = Duration::from_millis(100);

/// A tag, and where its clients connect.
#[derive(Debug)]
pub struct NmeaPort {
    /// The tag.
    pub tag: String,
    /// Only its positions in this site. None: in whichever it is.
    pub site: Option<String>,
    /// Where clients connect.
    pub listener: TcpListener,
}

/// The ports, which are open until this is dropped.
#[derive(Debug)]
pub struct Nmea {
    _tasks: JoinSet<()>,
}

impl Nmea {
    /// Serves tags, each at its port. A tag that has no position for `silent_after` has none from then on.
    pub fn start(hub: &Hub, ports: Vec<NmeaPort>, silent_after: Duration) -> Self {
        let mut tasks = JoinSet::new();
        let feeds = ports.into_iter().map(|NmeaPort { tag, site, listener }| {
            let (text, reader) = watch::channel(Arc::from(""));
            tasks.spawn(accept(listener, reader));
            Feed { tag, site, text, newest: None, is_warned: false }
        });
        let feeds: Vec<_> = feeds.collect();
        // Who listens to the hub gets a copy of each update.
        if !feeds.is_empty() {
            tasks.spawn(follow(hub.clone(), hub.listen(), feeds, silent_after));
        }
        Self { _tasks: tasks }
    }
}

/// What the clients of a port get.
struct Feed {
    tag: String,
    site: Option<String>,
    text: watch::Sender<Arc<str>>,
    /// When the tag's newest position arrived.
    newest: Option<Instant>,
    /// That the site has no geographic origin is in the log.
    is_warned: bool,
}

impl Feed {
    fn is_of(&self, position: &TagPosition) -> bool {
        self.tag == position.tag && self.site.as_ref().is_none_or(|site| *site == position.site)
    }

    fn take(&mut self, position: &TagPosition, hub: &Hub) {
        match hub.read(|live| live.geographic_origin(&position.site)) {
            Some(origin) => {
                self.is_warned = false;
                self.newest = Some(Instant::now());
                self.text.send_replace(sentence::fix(position, origin).into());
            }
            None if self.is_warned => (),
            None => {
                self.is_warned = true;
                let Self { tag, .. } = self;
                let site = &position.site;
                log::warn!("NMEA of {tag}: the site {site} has no geographic origin, so there are no positions");
            }
        }
    }

    fn tick(&mut self, silent_after: Duration) {
        if self.newest.is_none_or(|newest| newest.elapsed() > silent_after) {
            self.text.send_replace(sentence::no_fix(Utc::now()).into());
        }
    }
}

/// Follows the hub until it ends.
async fn follow(hub: Hub, mut updates: broadcast::Receiver<Update>, mut feeds: Vec<Feed>, silent_after: Duration) {
    let mut ticks = interval(VOID_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            update = updates.recv() => match update {
                Ok(Update::Position(position)) => {
                    let of_it = feeds.iter_mut().filter(|feed| feed.is_of(&position));
                    of_it.for_each(|feed| feed.take(&position, &hub));
                }
                Ok(Update::Event(_) | Update::Data(_) | Update::Changed) => (),
                Err(RecvError::Lagged(missed)) => hub.note_missed(missed),
                Err(RecvError::Closed) => break,
            },
            _ = ticks.tick() => feeds.iter_mut().for_each(|feed| feed.tick(silent_after)),
        }
    }
}

/// Lets clients in. They are disconnected when this task ends.
async fn accept(listener: TcpListener, text: watch::Receiver<Arc<str>>) {
    let places = Arc::new(Semaphore::new(CLIENTS));
    let mut clients = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            Some(_) = clients.join_next() => continue,
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((stream, peer)) => match Arc::clone(&places).try_acquire_owned() {
                Ok(place) => {
                    log::debug!("NMEA: {peer} is connected");
                    let text = text.clone();
                    clients.spawn(async move {
                        match feed(stream, text).await {
                            Ok(()) => log::debug!("NMEA: {peer} is gone"),
                            Err(error) => log::debug!("NMEA: {peer}: {error}"),
                        }
                        drop(place);
                    });
                }
                Err(_) => refuse(peer),
            },
            // Of one connection, or there are no more files: those that end make room.
            Err(error) => {
                log::warn!("NMEA: a connection cannot be accepted: {error}");
                sleep(AGAIN).await;
            }
        }
    }
}

fn refuse(peer: SocketAddr) {
    log::warn!("NMEA: {peer}: there are already {CLIENTS} clients at this port");
}

/// Sends a client each text that it has the time to read, until it is gone.
async fn feed(mut stream: TcpStream, mut text: watch::Receiver<Arc<str>>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let (mut from, mut to) = stream.split();
    let mut sent = [0; 256];
    let mut sends = true;
    // The newest position at once, if there is one.
    text.mark_changed();
    let mut next = Instant::now();
    loop {
        tokio::select! {
            // A client may end its own direction, and still read.
            read = from.read(&mut sent), if sends => sends = read? > 0,
            changed = changed(&mut text, next) => {
                if changed.is_err() {
                    return Ok(());
                }
                let newest = Arc::clone(&text.borrow_and_update());
                timeout(WRITE, to.write_all(newest.as_bytes())).await??;
                next = Instant::now() + EVERY;
            }
        }
    }
}

/// Waits until there is a new text, not before `next`.
async fn changed(text: &mut watch::Receiver<Arc<str>>, next: Instant) -> Result<(), watch::error::RecvError> {
    sleep_until(next).await;
    text.changed().await
}

#[cfg(test)]
mod tests;
