//! What `baliza serve` and `baliza live` feed into the station: the telemetry of nodes, live, from files or simulated.
//! [`screen`] is the map of `live`.
//!
//! Each [`SourceSpec`] is opened and read by a thread of its own, through the same decoder as `monitor`. A [`NodeReporter`]
//! converts the messages of one node to [`SourceReport`](station_core::SourceReport)s, with the host's time by a [`NodeClock`].
#![forbid(unsafe_code)]

pub mod cli;
mod export;
mod forward;
#[cfg(feature = "foxglove")]
mod foxglove;
mod foxglove_server;
mod gateways;
mod node_clock;
mod oidc;
mod piped_probe;
mod remote;
mod reporter;
pub mod screen;
mod simulated;
mod site_check;
mod site_file;
mod sources;
mod tokens;
mod udp;
mod webhooks;

#[cfg(feature = "foxglove")]
pub use export::write_mcap;
pub use export::{Exported, Selection, is_of_export, write_folder, write_gpx};
pub use gateways::Admission;
pub use node_clock::NodeClock;
pub use oidc::read_oidc;
pub use remote::Remote;
pub use reporter::NodeReporter;
pub use simulated::{SimulatedSite, simulate};
pub use site_file::{nodes, zones};
pub use sources::{OpenSource, Outgoing, ReportSender, SourceSpec, run};
pub use tokens::read_tokens;
pub use webhooks::read_webhooks;
