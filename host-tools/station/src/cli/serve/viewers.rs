//! The flags of `baliza serve` for maps and viewers: NMEA and Foxglove.

use std::net::SocketAddr;
use std::str::FromStr;
use std::time::Duration;

use anyhow::{Context, Result};
use recording::UserError;
use station_core::Hub;
use station_core::net::is_loopback_name;
use station_core::nmea::{Nmea, NmeaPort};
use tokio::net::TcpListener;
use tokio::task::JoinSet;

use crate::foxglove_server::FoxgloveServer;
use host_tools::cli::live_view::Address;

/// The flags.
#[derive(clap::Args)]
#[command(next_help_heading = "Maps and viewers")]
pub struct Viewers {
    /// Send a tag's positions as NMEA 0183 (GGA, RMC, GST) to who connects to this port, as gpsd and QGIS do; may be
    /// given for several tags. The site needs a geographic origin
    #[arg(long, value_name = "TAG@ADDRESS:PORT")]
    nmea: Vec<TagAt>,
    /// Let Foxglove draw all tags live, on a WebSocket
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8765", value_parser = Address::parse)]
    foxglove: Option<Address>,
    /// The site of these tags [default: that of the sources, else the simulation]
    #[arg(long, value_name = "NAME")]
    viewers_site: Option<String>,
    /// Let other computers connect to --nmea and --foxglove, which ask for no token
    #[arg(long)]
    viewers_unprotected: bool,
}

/// A tag, and where its NMEA is served.
#[derive(Clone, Debug)]
struct TagAt {
    tag: String,
    address: SocketAddr,
}

impl FromStr for TagAt {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is not TAG@ADDRESS:PORT, such as 0x1001@127.0.0.1:10110");
        let (tag, address) = text.rsplit_once('@').ok_or_else(wrong)?;
        let address = address.parse().map_err(|_| wrong())?;
        if tag.is_empty() { Err(wrong()) } else { Ok(Self { tag: tag.to_owned(), address }) }
    }
}

/// The viewers' listeners, before the station runs.
pub struct Listening {
    site: String,
    /// Each with its tag.
    nmea: Vec<(String, std::net::TcpListener)>,
    foxglove: Option<FoxgloveServer>,
}

/// What serves the viewers, until it is dropped.
pub struct Served {
    _nmea: Nmea,
    _foxglove: JoinSet<()>,
}

impl Viewers {
    /// Listens for viewers of the tags of `--viewers-site`, else of `site`. To be called outside of the runtime: the
    /// server for Foxglove starts its own.
    ///
    /// # Errors
    /// Others can reach an address without `--viewers-unprotected`, or it is in use.
    pub fn listen(&self, site: &str) -> Result<Listening> {
        let mut nmea = Vec::new();
        for TagAt { tag, address } in &self.nmea {
            self.refuse_others("--nmea", address.ip().is_loopback(), address)?;
            let cannot = || format!("cannot listen on {address}; --nmea takes another port");
            let listener = std::net::TcpListener::bind(address).with_context(cannot)?;
            listener.set_nonblocking(true).with_context(cannot)?;
            let address = listener.local_addr().with_context(cannot)?;
            host_tools::cli::note(&format!("nmea of {tag}: tcp://{address}\n"));
            nmea.push((tag.clone(), listener));
        }
        if let Some(address) = &self.foxglove {
            self.refuse_others("--foxglove", is_loopback_name(address.host()), address)?;
        }
        let foxglove = self.foxglove.as_ref().map(FoxgloveServer::listen).transpose()?;
        Ok(Listening { site: self.viewers_site.clone().unwrap_or_else(|| site.to_owned()), nmea, foxglove })
    }

    fn refuse_others(
        &self,
        flag: &'static str,
        is_loopback: bool,
        address: &impl std::fmt::Display,
    ) -> Result<(), UserError> {
        if is_loopback || self.viewers_unprotected {
            return Ok(());
        }
        let what = format!(
            "{address} can be reached from other computers, and it asks for no token: whoever connects sees where tags \
             are; give --viewers-unprotected as well if this is meant"
        );
        Err(UserError::flag(flag, what))
    }
}

impl Listening {
    /// Serves the viewers from now on. `silent_after`: a tag without a position for this time has none.
    ///
    /// # Errors
    /// A listener cannot be used.
    pub fn start(self, hub: &Hub, silent_after: Duration) -> Result<Served> {
        let Self { site, nmea, foxglove } = self;
        let ports = nmea.into_iter().map(|(tag, listener)| {
            let listener = TcpListener::from_std(listener).context("cannot use a port of --nmea")?;
            Ok(NmeaPort { tag, site: Some(site.clone()), listener })
        });
        let nmea = Nmea::start(hub, ports.collect::<Result<_>>()?, silent_after);
        let mut serving = JoinSet::new();
        if let Some(foxglove) = foxglove {
            serving.spawn(foxglove.follow(hub.clone(), site));
        }
        Ok(Served { _nmea: nmea, _foxglove: serving })
    }
}
