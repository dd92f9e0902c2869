//! `baliza forward`: the nodes at this computer for a station elsewhere.

use std::path::PathBuf;

use anyhow::Result;
use host_tools::cli::note;
use host_tools::cli::stream::{STOP, catch_signals};
use node_link::gateway_key::GatewayKey;

use super::serve::sources_help;
use crate::SourceSpec;
use crate::forward::{Settings, run as forward};

/// Send the telemetry of the nodes at this computer to a station elsewhere
///
/// The station is `baliza serve … udp:0.0.0.0:7000` on another computer. What it does not take waits on this disk, also
/// for days and across restarts, and is then stored with the times at which it was received. Ctrl-C ends it.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Nodes and streams
    #[arg(value_name = "SOURCE", required = true)]
    sources: Vec<SourceSpec>,
    /// Where the station receives datagrams
    #[arg(long, value_name = "HOST:PORT", value_parser = host_and_port)]
    to: String,
    /// The key by which the station knows this gateway. If the file does not exist, it is made: the station needs a copy of
    /// it (serve --gateways). Without a key, a station takes datagrams of its own computer only
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    /// The folder in which telemetry waits
    #[arg(long, value_name = "FOLDER", default_value = "baliza-queue")]
    queue: PathBuf,
    /// The most that waits, MB; beyond that, the oldest is deleted. A tag at 10 Hz takes about 3 MB an hour
    #[arg(long, value_name = "MB", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    queue_mb: u64,
}

/// Parses `--to`. Names are looked up later: at the start of a computer there may be no network.
fn host_and_port(text: &str) -> Result<String, String> {
    let (host, port) = text.rsplit_once(':').unwrap_or_default();
    let is_right = !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0);
    if is_right { Ok(text.to_owned()) } else { Err("HOST:PORT is expected, such as station.local:7000".to_owned()) }
}

const EXAMPLES: &str = concat!(
    sources_help!(),
    "
Examples:
  baliza forward serial:/dev/ttyACM0 --to station.local:7000 --key gateway.toml
  baliza forward probe serial:/dev/ttyACM1 --to 192.168.1.20:7000 --key gateway.toml --queue /var/lib/baliza/queue"
);

/// Runs `baliza forward`.
///
/// # Errors
/// A source cannot be opened, the key's file is wrong, or the queue cannot be used.
pub fn run(arguments: &Arguments) -> Result<()> {
    let key = match &arguments.key {
        Some(file) => {
            let name = file.file_stem().map_or_else(|| "gateway".into(), |stem| stem.to_string_lossy());
            let (key, is_new) = GatewayKey::read_or_make(file, &name)?;
            if is_new {
                let file = file.display();
                note(&format!(
                    "made a key: append {file} to the file of --gateways at the station, and start that again\n"
                ));
            }
            Some(key)
        }
        None => None,
    };
    catch_signals()?;
    let folder = &arguments.queue;
    let settings = Settings { to: &arguments.to, key, folder, most_bytes: arguments.queue_mb * 1_000_000 };
    let left = forward(&arguments.sources, settings, &STOP, &mut |text| note(&format!("{text}\n")))?;
    if left > 0 {
        note(&format!("{left} bytes wait in {} for the next baliza forward\n", folder.display()));
    }
    Ok(())
}
