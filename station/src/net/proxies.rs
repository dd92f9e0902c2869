//! The address of a client behind a reverse proxy: from the headers of proxies that are trusted, and of no others.

use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

use axum::http::{HeaderMap, HeaderName, header};

/// What most proxies write: addresses, the client's first.
const X_FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");

/// Addresses that have their first bits in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IpNetwork {
    address: IpAddr,
    bits: u8,
}

/// A text is no network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoNetwork;

impl fmt::Display for NoNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("it is an address such as 192.0.2.1, or a network such as 192.0.2.0/24")
    }
}

impl std::error::Error for NoNetwork {}

impl FromStr for IpNetwork {
    type Err = NoNetwork;

    fn from_str(text: &str) -> Result<Self, NoNetwork> {
        let (address, bits) = match text.split_once('/') {
            Some((address, bits)) => (address, Some(bits.parse::<u8>().map_err(|_| NoNetwork)?)),
            None => (text, None),
        };
        let address: IpAddr = address.parse().map_err(|_| NoNetwork)?;
        let all = width(address);
        let bits = bits.unwrap_or(all);
        if bits > all { Err(NoNetwork) } else { Ok(Self { address, bits }) }
    }
}

impl IpNetwork {
    fn contains(&self, address: IpAddr) -> bool {
        let all = width(self.address);
        // An address of IPv4 has no bits of IPv6 in common.
        width(address) == all
            && (bits(address) ^ bits(self.address)).checked_shr((all - self.bits).into()).unwrap_or(0) == 0
    }
}

fn width(address: IpAddr) -> u8 {
    if address.is_ipv4() { 32 } else { 128 }
}

fn bits(address: IpAddr) -> u128 {
    match address {
        IpAddr::V4(address) => address.to_bits().into(),
        IpAddr::V6(address) => address.to_bits(),
    }
}

/// The proxies whose headers are believed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Proxies(pub Vec<IpNetwork>);

impl Proxies {
    /// Whether an address is that of a trusted proxy.
    pub fn has(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        self.0.iter().any(|network| network.contains(address))
    }

    /// The client of a connection from `peer`: the last address of `X-Forwarded-For`, or of `Forwarded` (RFC 7239),
    /// that is not a trusted proxy's. What stands before it may be made up by the client. What is no address ends the
    /// search at the proxy that wrote it. Where both headers are there and differ, one of them is the client's own:
    /// neither is believed.
    pub fn client(&self, peer: IpAddr, headers: &HeaderMap) -> IpAddr {
        if !self.has(peer) {
            return peer;
        }
        let [one, other] = [X_FORWARDED_FOR, header::FORWARDED].map(|name| {
            let is_forwarded = name == header::FORWARDED;
            headers.contains_key(&name).then(|| self.last(peer, headers, &name, is_forwarded))
        });
        match (one, other) {
            (Some(one), Some(other)) if one != other => peer,
            (Some(client), _) | (None, Some(client)) => client,
            (None, None) => peer,
        }
    }

    fn last(&self, peer: IpAddr, headers: &HeaderMap, name: &HeaderName, is_forwarded: bool) -> IpAddr {
        let values: Vec<_> = headers.get_all(name).iter().collect();
        // A header that is no text has no addresses.
        let hops = values.iter().rev().flat_map(|value| value.to_str().unwrap_or("?").rsplit(','));
        let mut client = peer;
        for hop in hops {
            let hop = if is_forwarded { forwarded_for(hop) } else { Some(hop) };
            match hop.and_then(address) {
                Some(address) => client = address,
                None => break,
            }
            if !self.has(client) {
                break;
            }
        }
        client
    }
}

/// The value of `for` in an element of `Forwarded`.
fn forwarded_for(element: &str) -> Option<&str> {
    element
        .split(';')
        .filter_map(|pair| pair.trim().split_once('='))
        .find(|(name, _)| name.eq_ignore_ascii_case("for"))
        .map(|(_, value)| value.strip_prefix('"').and_then(|value| value.strip_suffix('"')).unwrap_or(value))
}

/// An address, perhaps with brackets or a port.
fn address(text: &str) -> Option<IpAddr> {
    let text = text.trim();
    let bare = text.strip_prefix('[').and_then(|text| text.strip_suffix(']')).unwrap_or(text);
    let address = bare.parse().ok().or_else(|| text.parse::<SocketAddr>().ok().map(|address| address.ip()));
    address.map(|address| address.to_canonical())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(peer: &str, lines: &[(&str, &str)]) -> String {
        let proxies = ["127.0.0.1", "10.0.0.0/8", "2001:db8:1::/48"].map(|network| network.parse().unwrap());
        let mut headers = HeaderMap::new();
        for (name, value) in lines {
            headers.append(name.parse::<HeaderName>().unwrap(), value.parse().unwrap());
        }
        Proxies(proxies.to_vec()).client(peer.parse().unwrap(), &headers).to_string()
    }

    const FOR: &str = "x-forwarded-for";

    #[test]
    fn headers_of_others_than_trusted_proxies_are_ignored() {
        assert_eq!(client("192.0.2.7", &[(FOR, "198.51.100.1")]), "192.0.2.7");
        assert_eq!(client("127.0.0.2", &[("forwarded", "for=198.51.100.1")]), "127.0.0.2");
        assert_eq!(client("::1", &[(FOR, "198.51.100.1")]), "::1");
        assert_eq!(client("127.0.0.1", &[]), "127.0.0.1");
    }

    #[test]
    fn the_client_is_the_last_address_that_is_no_proxys_whatever_it_has_written_itself() {
        assert_eq!(client("127.0.0.1", &[(FOR, "198.51.100.1")]), "198.51.100.1");
        // The client has sent "1.1.1.1, 10.0.0.9"; two proxies have added an address each.
        assert_eq!(client("127.0.0.1", &[(FOR, "1.1.1.1, 10.0.0.9, 198.51.100.1, 10.0.0.3")]), "198.51.100.1");
        // The same in lines of their own.
        assert_eq!(client("127.0.0.1", &[(FOR, "1.1.1.1"), (FOR, "198.51.100.1"), (FOR, "10.0.0.3")]), "198.51.100.1");
        // A trusted proxy by IPv4 through a socket of IPv6.
        assert_eq!(client("::ffff:127.0.0.1", &[(FOR, "2001:db8:2::5")]), "2001:db8:2::5");
        assert_eq!(client("2001:db8:1::1", &[(FOR, "[2001:db8:2::5]:4711")]), "2001:db8:2::5");
        assert_eq!(client("127.0.0.1", &[(FOR, "198.51.100.1:4711")]), "198.51.100.1");
        // A client inside of the trusted network: there is nobody further out.
        assert_eq!(client("127.0.0.1", &[(FOR, "10.1.2.3")]), "10.1.2.3");
    }

    #[test]
    fn what_is_no_address_ends_the_search_at_the_proxy_that_wrote_it() {
        for value in ["", "unknown", "1.1.1.1, _hidden", "198.51.100.1, 10.0.0.256", "1.1.1.1,"] {
            assert_eq!(client("127.0.0.1", &[(FOR, value)]), "127.0.0.1", "{value}");
        }
        assert_eq!(client("127.0.0.1", &[(FOR, "1.1.1.1, unknown, 10.0.0.3")]), "10.0.0.3");
        let mut headers = HeaderMap::new();
        headers.insert(X_FORWARDED_FOR, header::HeaderValue::from_bytes(b"1.1.1.1,\xff").unwrap());
        let proxies = Proxies(vec!["127.0.0.1".parse().unwrap()]);
        assert_eq!(proxies.client([127, 0, 0, 1].into(), &headers).to_string(), "127.0.0.1");
    }

    /// The examples of RFC 7239, section 4.
    #[test]
    fn forwarded_is_read_as_its_rfc_writes_it() {
        for (value, address) in [
            ("For=\"[2001:db8:cafe::17]:4711\"", "2001:db8:cafe::17"),
            ("for=192.0.2.60;proto=http;by=203.0.113.43", "192.0.2.60"),
            ("for=192.0.2.43, for=198.51.100.17", "198.51.100.17"),
            ("for=\"_gazonk\"", "127.0.0.1"),
            ("proto=https", "127.0.0.1"),
        ] {
            assert_eq!(client("127.0.0.1", &[("forwarded", value)]), address, "{value}");
        }
    }

    #[test]
    fn two_headers_that_differ_are_not_believed() {
        let lines = |forwarded| [(FOR, "198.51.100.1"), ("forwarded", forwarded)];
        assert_eq!(client("127.0.0.1", &lines("for=198.51.100.1")), "198.51.100.1");
        assert_eq!(client("127.0.0.1", &lines("for=1.1.1.1")), "127.0.0.1");
    }

    #[test]
    fn networks_have_their_bits_and_no_more() {
        for text in ["", "10.0.0.0/33", "::/129", "10.0.0.0/-1", "10.0.0/8", "10.0.0.0/", "example.org", "10.0.0.1 "] {
            assert_eq!(text.parse::<IpNetwork>(), Err(NoNetwork), "{text}");
        }
        let contains =
            |network: &str, address: &str| network.parse::<IpNetwork>().unwrap().contains(address.parse().unwrap());
        assert!(contains("192.0.2.128/25", "192.0.2.129") && !contains("192.0.2.128/25", "192.0.2.127"));
        assert!(contains("0.0.0.0/0", "255.1.2.3") && !contains("0.0.0.0/0", "::1"));
        assert!(contains("::/0", "2001:db8::1") && contains("2001:db8::1", "2001:db8::1"));
        assert!(!contains("2001:db8::1", "2001:db8::2"));
    }
}
