//! What one client may use of the station: rates and connections, by its address.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::{lock, make_room};

/// How much is allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestLimits {
    /// Requests that change something or position a terminal, a second and address.
    pub writes_per_s: f64,
    /// How many of them may come at once.
    pub writes_at_once: f64,
    /// Wrong tokens, a second and address.
    pub wrong_tokens_per_s: f64,
    /// How many of them may come at once.
    pub wrong_tokens_at_once: f64,
    /// Sign-ins that are begun, a second and address.
    pub sign_ins_per_s: f64,
    /// How many of them may come at once.
    pub sign_ins_at_once: f64,
    /// Connections of all clients.
    pub connections: u32,
    /// Connections of one address, which is not that of a trusted proxy.
    pub connections_per_address: u32,
    /// A client has this time for the handshake of TLS.
    pub handshake: Duration,
    /// Whether the files of TLS have changed is looked up this often.
    pub renewal: Duration,
    /// A client has this time for the head of a request, and this time to send the next request.
    pub head: Duration,
    /// A request has this time from its head until its answer begins.
    pub request: Duration,
    /// A client that takes nothing of an answer for this time is disconnected.
    pub write: Duration,
    /// A listener at a WebSocket is asked this often whether it is still there.
    pub ping: Duration,
}

impl Default for RequestLimits {
    fn default() -> Self {
        Self {
            writes_per_s: 50.0,
            writes_at_once: 200.0,
            wrong_tokens_per_s: 0.2,
            wrong_tokens_at_once: 10.0,
            sign_ins_per_s: 0.5,
            sign_ins_at_once: 20.0,
            connections: 2_000,
            connections_per_address: 500,
            handshake: Duration::from_secs(10),
            renewal: Duration::from_secs(10),
            head: Duration::from_secs(15),
            request: Duration::from_secs(60),
            write: Duration::from_secs(30),
            ping: Duration::from_secs(20),
        }
    }
}

/// Addresses that are counted together: one of IPv4, or a network of IPv6 (/64), all of which one client may have.
pub fn client(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V4(address) => IpAddr::V4(address),
        IpAddr::V6(address) => IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() & (u128::MAX << 64))),
    }
}

/// Token buckets, one an address.
#[derive(Debug)]
pub struct Buckets {
    per_s: f64,
    at_once: f64,
    left: Mutex<HashMap<IpAddr, (f64, Instant)>>,
}

impl Buckets {
    /// Addresses that are remembered. One more replaces the one that was seen longest ago.
    const ADDRESSES: usize = 4_096;

    /// New buckets: each client starts with a full one.
    pub fn new(per_s: f64, at_once: f64) -> Self {
        Self { per_s, at_once, left: Mutex::default() }
    }

    /// Whether there is a token; else after how many seconds there is one.
    pub fn check(&self, address: IpAddr, now: Instant) -> Result<(), u64> {
        let left = lock(&self.left).get(&client(address)).map_or(self.at_once, |bucket| self.filled(*bucket, now));
        if left >= 1.0 { Ok(()) } else { Err(((1.0 - left) / self.per_s).ceil() as u64) }
    }

    /// Takes a token, where there is one.
    pub fn take(&self, address: IpAddr, now: Instant) -> Result<(), u64> {
        self.check(address, now)?;
        let address = client(address);
        let mut buckets = lock(&self.left);
        if !buckets.contains_key(&address) {
            make_room(&mut buckets, Self::ADDRESSES, |(_, at)| *at);
        }
        let bucket = buckets.entry(address).or_insert((self.at_once, now));
        *bucket = ((self.filled(*bucket, now) - 1.0).max(0.0), now);
        Ok(())
    }

    fn filled(&self, (left, at): (f64, Instant), now: Instant) -> f64 {
        (left + self.per_s * now.saturating_duration_since(at).as_secs_f64()).min(self.at_once)
    }
}

/// Who may connect.
#[derive(Clone, Debug)]
pub struct Connections {
    free: Arc<Semaphore>,
    all: u32,
    per_address: u32,
    counts: Arc<Mutex<HashMap<IpAddr, u32>>>,
}

/// A connection that counts until the last clone of it is gone.
#[derive(Clone, Debug)]
pub struct Connection {
    _held: Arc<Held>,
}

#[derive(Debug)]
struct Held {
    _permit: OwnedSemaphorePermit,
    client: IpAddr,
    counts: Arc<Mutex<HashMap<IpAddr, u32>>>,
}

impl Connections {
    /// A counter without open connections.
    pub fn new(limits: &RequestLimits) -> Self {
        let free = Arc::new(Semaphore::new(limits.connections as usize));
        Self { free, all: limits.connections, per_address: limits.connections_per_address, counts: Arc::default() }
    }

    /// A connection of this address, where there are not too many. A proxy may have those of all.
    pub fn open(&self, address: IpAddr, is_proxy: bool) -> Option<Connection> {
        let permit = self.free.clone().try_acquire_owned().ok()?;
        let client = client(address);
        let mut counts = lock(&self.counts);
        let count = counts.entry(client).or_default();
        if *count >= self.per_address && !is_proxy {
            return None;
        }
        *count += 1;
        drop(counts);
        Some(Connection { _held: Arc::new(Held { _permit: permit, client, counts: self.counts.clone() }) })
    }

    /// How many there are.
    pub fn open_now(&self) -> usize {
        (self.all as usize).saturating_sub(self.free.available_permits())
    }

    /// Waits until there is none.
    pub async fn closed(&self) {
        // The semaphore is never closed: an error cannot come, and would mean the same.
        let _ = self.free.acquire_many(self.all).await;
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        let mut counts = lock(&self.counts);
        if let Some(count) = counts.get_mut(&self.client) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.client);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_gives_its_content_at_once_and_then_its_rate() {
        let buckets = Buckets::new(0.5, 2.0);
        let [one, other] = ["192.0.2.1", "192.0.2.2"].map(|address| address.parse().unwrap());
        let start = Instant::now();
        assert_eq!([buckets.take(one, start), buckets.take(one, start)], [Ok(()), Ok(())]);
        // Half a token a second: the next one after 2 s.
        assert_eq!(buckets.take(one, start), Err(2));
        assert_eq!(buckets.take(one, start + Duration::from_secs(1)), Err(1));
        assert_eq!(buckets.take(other, start), Ok(()));
        assert_eq!(buckets.take(one, start + Duration::from_secs(2)), Ok(()));
        assert_eq!(buckets.take(one, start + Duration::from_secs(2)), Err(2));
    }

    #[test]
    fn addresses_of_one_ipv6_network_share_a_bucket_and_mapped_ones_are_ipv4() {
        let client = |text: &str| client(text.parse().unwrap());
        assert_eq!(client("2001:db8:0:1::1"), client("2001:db8:0:1:ffff::9"));
        assert_ne!(client("2001:db8:0:1::1"), client("2001:db8:0:2::1"));
        assert_eq!(client("::ffff:192.0.2.1"), client("192.0.2.1"));
    }

    #[test]
    fn many_addresses_do_not_fill_the_memory() {
        let buckets = Buckets::new(1.0, 1.0);
        for address in 0..10_000u32 {
            assert_eq!(buckets.take(IpAddr::V4(address.into()), Instant::now()), Ok(()));
        }
        assert_eq!(lock(&buckets.left).len(), Buckets::ADDRESSES);
    }

    #[test]
    fn connections_of_one_address_and_of_all_are_bounded_and_counted_until_they_end() {
        let connections =
            Connections::new(&RequestLimits { connections: 3, connections_per_address: 2, ..RequestLimits::default() });
        let [one, other] = ["192.0.2.1", "192.0.2.2"].map(|address| address.parse().unwrap());
        let held = [connections.open(one, false), connections.open(one, false)];
        assert!(held.iter().all(Option::is_some) && connections.open(one, false).is_none());
        let third = connections.open(other, false);
        assert!(third.is_some() && connections.open(other, false).is_none());
        assert_eq!(connections.open_now(), 3);
        drop(held);
        assert!(connections.open(one, false).is_some());
        assert_eq!(connections.open_now(), 1);
    }

    #[test]
    fn a_proxy_has_as_many_connections_as_all_together() {
        let connections =
            Connections::new(&RequestLimits { connections: 3, connections_per_address: 1, ..RequestLimits::default() });
        let proxy = "192.0.2.1".parse().unwrap();
        let held: Vec<_> = (0..4).map(|_| connections.open(proxy, true)).collect();
        assert_eq!(held.iter().map(Option::is_some).collect::<Vec<_>>(), [true, true, true, false]);
    }
}
