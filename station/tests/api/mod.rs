//! The API over real connections: a station on a loopback port with a SQLite store, and a client that sends what it is
//! told to, byte for byte.

mod access;
mod client;
mod document;
mod hostile;
#[path = "../shared/port.rs"]
mod port;
mod provider;
mod proxies;
mod routes;
mod sign_in;
mod tls;
mod updates;
