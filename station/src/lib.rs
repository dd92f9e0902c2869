//! The station: a store, an API and a live map of the positions of tags.
//!
//! | module | what is in it |
//! |---|---|
//! | [`model`] | what the station knows: positions, tags, nodes, zones, events, sites, campaigns |
//! | [`input`] | what sources send: positions, ranges, sightings, nodes |
//! | [`messages`] | messages to tags |
//! | [`state`] | the current state: the last position of each tag, the health of each node, who is in which zone |
//! | [`store`] | SQLite or PostgreSQL |
//! | [`hub`] | takes reports, updates the state, tells the listeners, writes to the store in batches |
//! | [`mqtt`] | positions and events to a broker, Home Assistant, ESPresense's receivers |
//! | [`gpx`] | positions as tracks on the earth |
//! | [`nmea`] | live positions for programs that take a receiver of satellites |
//! | [`rssi`] | RSSI values of nodes at known places to a position |
//! | [`terminal`] | a terminal's RSSI values to its position |
//! | [`api`] | HTTP: REST, WebSocket, server-sent events, the page |
//! | [`net`] | connections: TLS, limits, proxies, requests to others |
//! | [`oidc`] | sign-in at a provider of OpenID Connect |
//! | [`webhooks`] | events to other programs |
//!
//! Data flows one way: a source makes a [`SourceReport`] and sends it to the [`Hub`]; the hub's task applies it to the
//! [`LiveState`] state, which returns [`Update`]s; these go to the listeners at once and to the [`Store`] in batches. The
//! API reads the live state and the store. It writes what a person configures (sites, zones, campaigns) to the store,
//! and reloads the live state from there.
#![forbid(unsafe_code)]

pub mod api;
mod bounds;
pub mod gpx;
pub mod hub;
pub mod input;
pub mod messages;
pub mod model;
pub mod mqtt;
pub mod net;
pub mod nmea;
pub mod oidc;
pub mod rssi;
mod shapes;
pub mod state;
pub mod store;
pub mod terminal;
mod utc;
pub mod webhooks;

pub use hub::Hub;
pub use input::{ReportKind, SolvedFrom, SourceReport};
pub use state::{LiveState, Update};
pub use store::Store;
pub use utc::{NoUtc, Utc};
