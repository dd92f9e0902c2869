//! A port for a server that comes later, or goes and comes again.

use std::net::{Ipv4Addr, SocketAddr};

use tokio::net::TcpSocket;

/// A port of the loopback address, at which nothing listens. While this lives, the system gives it to nobody else.
#[derive(Debug)]
pub struct Port {
    pub address: SocketAddr,
    /// Bound, but it does not listen. Only Linux lets a server listen at the same port besides.
    #[cfg(target_os = "linux")]
    _held: TcpSocket,
}

impl Port {
    /// A port of the system's choice.
    pub fn free() -> Self {
        let held = TcpSocket::new_v4().expect("a socket");
        held.set_reuseaddr(true).expect("as all servers do");
        held.bind((Ipv4Addr::LOCALHOST, 0).into()).expect("a port");
        let address = held.local_addr().expect("an address");
        Self {
            address,
            #[cfg(target_os = "linux")]
            _held: held,
        }
    }
}
