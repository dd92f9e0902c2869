//! `baliza serve`: the station.

mod alarms;
mod encryption;
mod mqtt;
mod sign_in;
mod viewers;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use crate::{Admission, OpenSource, SimulatedSite, SourceSpec, read_webhooks, simulate, site_check};
use analysis::survey::presence::read_outlines;
use anyhow::{Context, Result, bail};
use node_link::gateway_key::GatewayKey;
use node_link::provision::SiteNames;
use recording::UserError;
use sim::scenario::Scenario;
use station_core::api::{self, App, Tls};
use station_core::model::{GeographicOrigin, PlacedNode, SiteMap, Zone};
use station_core::mqtt::{self as broker, Mqtt};
use station_core::state::StateLimits;
use station_core::store::Retention;
use station_core::webhooks::{Patience, Webhook, Webhooks};
use station_core::{Hub, LiveState, ReportKind, SourceReport, Store, Utc};
use tokio::net::TcpListener;
use tokio::sync::mpsc;

use self::alarms::Limiting;
use self::encryption::Encryption;
use self::mqtt::MqttArguments;
use self::sign_in::{SignInArguments, Users};
use self::viewers::{Listening, Viewers};
use host_tools::cli::stream::{STOP, catch_signals};
use host_tools::cli::tell::frame;
use host_tools::cli::{note, prompt};

/// Serve a live map, a store and an API of the positions of tags
///
/// The map is a page at the printed address. Positions, events and what a person draws are kept in a store, SQLite or
/// PostgreSQL. Other programs read the API, which /openapi.json describes. Each SOURCE is a node or a stream of
/// telemetry. A recording is played at its own pace. Ctrl-C ends the station with everything written.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    inputs: InputArguments,
    /// Where to listen; port 0 takes a free one. Beyond this computer only with --tokens or --oidc
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080", value_parser = listen_address)]
    listen: SocketAddr,
    /// A SQLite file, which is made where it does not exist, or postgres://USER:PASSWORD@HOST/DATABASE [default:
    /// baliza.db; for --simulate alone a temporary file]
    #[arg(long, value_name = "FILE|URL")]
    store: Option<String>,
    #[command(flatten)]
    sign_in: SignInArguments,
    #[command(flatten)]
    encryption: Encryption,
    /// Send events to other programs: a TOML file with a table `webhook` for each, as docs/use/station/network.md
    /// describes it
    #[arg(long, value_name = "FILE")]
    webhooks: Option<PathBuf>,
    /// Keep one position a second of positions that are older than this, days
    #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u64).range(1..=36_500))]
    thin_days: Option<u64>,
    /// Delete positions, events and the health of anchors that are older than this, days
    #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u64).range(1..=36_500))]
    keep_days: Option<u64>,
    /// Keep ranges and sightings too, for this time, days: about 33 bytes each in SQLite
    #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u64).range(1..=36_500))]
    measurement_days: Option<u64>,
    #[command(flatten)]
    mqtt: MqttArguments,
    #[command(flatten)]
    viewers: Viewers,
}

/// Parses `--listen`.
fn listen_address(text: &str) -> Result<SocketAddr, String> {
    let port = text.strip_prefix(':').unwrap_or(text).parse::<u16>();
    let example = format!("127.0.0.1:{}", port.unwrap_or(8080));
    text.parse().map_err(|_| format!("ADDRESS:PORT is expected, such as {example}"))
}

/// What the station gets its reports from: the same for `serve` and `live`.
#[derive(clap::Args)]
pub(super) struct InputArguments {
    /// Nodes, streams and recordings
    #[arg(value_name = "SOURCE")]
    sources: Vec<SourceSpec>,
    /// Run a simulation as well: that of a scenario's file, else tags that walk in a furnished room
    #[arg(long, value_name = "SCENARIO", num_args = 0..=1)]
    simulate: Option<Option<PathBuf>>,
    /// The scenario's file, as simulate has it
    #[arg(long, value_name = "FILE", requires = "simulate")]
    scenario: Option<PathBuf>,
    /// The names of nodes and the places of anchors, beacons and receivers: the file that provision reads
    #[arg(long, value_name = "FILE")]
    site: Option<PathBuf>,
    /// The name of the site that the sources belong to
    #[arg(long, value_name = "NAME", default_value = "site")]
    site_name: String,
    /// The rooms' outlines: CSV with room,x_m,y_m
    #[arg(long, value_name = "FILE")]
    rooms: Option<PathBuf>,
    /// The gateways whose datagrams are taken from other computers: the files that `baliza forward --key` has made, in
    /// one
    #[arg(long, value_name = "FILE")]
    gateways: Option<PathBuf>,
    /// Take datagrams without a key from other computers, too: whoever reaches the port invents positions
    #[arg(long)]
    open_udp: bool,
    #[command(flatten)]
    limiting: Limiting,
}

impl InputArguments {
    /// When a tag or an anchor counts as something.
    pub(super) fn limits(&self) -> StateLimits {
        self.limiting.limits()
    }
}

/// The words for sources, in the help of commands.
macro_rules! sources_help {
    () => {
        "\
Sources:
  probe[:VID:PID[:SERIAL]]  a node at a debug probe
  serial:PORT[@BAUD]        a node at a serial port; the path of a device alone will do
  udp:ADDRESS:PORT          datagrams of gateways (baliza forward) with any number of nodes; port 0 picks a free one
  FILE, FOLDER              telemetry in a file, or a recording: all nodes of a simulation's
  -                         standard input
"
    };
}
pub(super) use sources_help;

const EXAMPLES: &str = concat!(
    sources_help!(),
    "
Examples:
  baliza serve --simulate
  baliza serve --site site.toml serial:/dev/ttyACM0 serial:/dev/ttyACM1
  baliza serve --listen 0.0.0.0:8080 --tokens tokens.toml --store postgres://baliza@db/baliza udp:0.0.0.0:7000
  baliza serve --mqtt mqtt://baliza@broker --mqtt-password-file password --espresense config.yaml
  baliza serve --nmea 0x1001@127.0.0.1:10110 --foxglove --site site.toml udp:0.0.0.0:7000
  baliza serve --listen 0.0.0.0:8443 --tokens tokens.toml --tls-cert fullchain.pem --tls-key privkey.pem
  baliza serve --oidc oidc.toml --trusted-proxy 127.0.0.1 udp:0.0.0.0:7000
  baliza serve run/"
);

/// The name of a simulated site.
const SIMULATION: &str = "simulation";
/// Anchors and tags of the simulation without a scenario.
const SIMULATED: (usize, usize) = (6, 5);
/// The time between two looks at the signals.
const SIGNALS: Duration = Duration::from_millis(50);

/// Runs `baliza serve`.
///
/// # Errors
/// Flags or files are wrong, the store cannot be opened, or the address is in use.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mqtt = arguments.mqtt.read(&arguments.inputs.site_name)?;
    let sources = Sources::of(&arguments.inputs, mqtt)?;
    let users = arguments.sign_in.read(arguments.listen)?;
    let tls = arguments.encryption.read()?;
    let webhooks = arguments.webhooks.as_deref().map(read_webhooks).transpose()?.unwrap_or_default();
    // A temporary store is deleted when it is dropped.
    let temporary = match (&arguments.store, sources.is_simulation()) {
        (None, true) => Some(tempfile::tempdir().context("cannot make a temporary folder")?),
        (Some(_), _) | (None, false) => None,
    };
    let store = match (&arguments.store, &temporary) {
        (Some(store), _) => store.clone(),
        (None, Some(folder)) => folder.path().join("simulation.db").display().to_string(),
        (None, None) => "baliza.db".to_owned(),
    };
    let viewers = arguments.viewers.listen(sources.site())?;
    catch_signals()?;
    let runtime =
        tokio::runtime::Builder::new_multi_thread().enable_all().build().context("cannot start the runtime")?;
    runtime.block_on(serve(arguments, &store, Network { users, tls, webhooks, viewers }, sources))
}

/// How the station meets other computers.
struct Network {
    users: Users,
    tls: Option<Arc<Tls>>,
    webhooks: Vec<Webhook>,
    viewers: Listening,
}

async fn serve(arguments: &Arguments, url: &str, network: Network, sources: Sources) -> Result<()> {
    let Network { users, tls, webhooks, viewers } = network;
    let store = Store::open(url).await?;
    sources.configure(&store).await?;
    let days = |days: Option<u64>| days.map(|days| Duration::from_secs(86_400 * days));
    let retention = Retention {
        thin_after: days(arguments.thin_days),
        delete_after: days(arguments.keep_days),
        measurements: days(arguments.measurement_days),
    };
    let (earlier, placed) = (store.tags().await?, store.nodes().await?);
    let mut live = LiveState::new(arguments.inputs.limits());
    live.set_zones(store.zones().await?);
    live.set_geographic_origins(&store.sites().await?);
    let (hub, writing) = Hub::start(live, store.clone(), retention).await?;
    let webhooks = Webhooks::start(webhooks, Patience::default(), &hub);
    let _viewers = viewers.start(&hub, arguments.inputs.limits().silent_after)?;
    let listener = TcpListener::bind(arguments.listen)
        .await
        .with_context(|| format!("cannot listen on {}; --listen takes another address", arguments.listen))?;
    let address = listener.local_addr().context("cannot read the address")?;
    let sites = store.sites().await?.into_iter().map(|site| site.name);
    let mqtt = sources.start(&hub, &placed, note).map(|settings| Mqtt::start(&hub, settings, earlier.clone(), sites));
    let scheme = if tls.is_some() { "https" } else { "http" };
    prompt(&format!("listening on {scheme}://{address}\n"));
    let Users { access, oidc, proxies } = users;
    let app = App { access, oidc, proxies, tls, webhooks: webhooks.watch(), earlier, ..App::new(hub.clone(), store) };
    api::serve(listener, app, stopped()).await.context("cannot serve")?;
    hub.stop();
    let written = writing.await.context("the writer has failed");
    webhooks.finish().await;
    if let Some(mqtt) = mqtt {
        mqtt.stop().await;
    }
    written?;
    match hub.counts().dropped {
        0 => Ok(()),
        lost => bail!("{lost} rows are lost: the store could not take them"),
    }
}

/// Waits for a signal that ends the program.
pub(super) async fn stopped() {
    while !STOP.load(Ordering::Relaxed) {
        tokio::time::sleep(SIGNALS).await;
    }
}

/// What the station gets its reports from.
pub(super) struct Sources {
    /// The site of the nodes.
    site: String,
    names: SiteNames,
    zones: Vec<Zone>,
    /// Each with its name.
    sources: Vec<(String, OpenSource)>,
    admission: Arc<Admission>,
    simulation: Option<(Scenario, SimulatedSite)>,
    mqtt: Option<broker::MqttSettings>,
}

impl Sources {
    /// Reads the files of the arguments, and opens the sources that must be there. `mqtt` is what to do at a broker.
    ///
    /// # Errors
    /// A file is wrong, or a source cannot be opened.
    pub(super) fn of(arguments: &InputArguments, mqtt: Option<broker::MqttSettings>) -> Result<Self> {
        let specs = arguments.sources.iter().map(SourceSpec::each).collect::<Result<Vec<_>>>()?;
        let sources = specs.iter().flatten().map(|spec| {
            let source = spec.open()?;
            let (asked, name) = (spec.to_string(), source.name_of(spec));
            if name != asked {
                note(&format!("datagrams: {name}\n"));
            }
            Ok((name, source))
        });
        let sources = sources.collect::<Result<Vec<_>>>()?;
        let keys = arguments.gateways.as_deref().map(GatewayKey::read_all).transpose()?.unwrap_or_default();
        let admission = Arc::new(Admission { keys, is_open: arguments.open_udp });
        let names = arguments.site.as_deref().map(SiteNames::read).transpose()?.unwrap_or_default();
        let rooms = arguments.rooms.as_deref().map(read_outlines).transpose()?.unwrap_or_default();
        let scenario = arguments.scenario.as_ref();
        if let (Some(Some(_)), Some(_)) = (&arguments.simulate, scenario) {
            return Err(UserError::flag("--scenario", "--simulate names a scenario already").into());
        }
        let simulation = match arguments.simulate.as_ref().map(|file| file.as_ref().or(scenario)) {
            Some(Some(file)) => Some(host_tools::simulate::read_scenario(file, true)?),
            Some(None) => Some(Scenario::rooms(SIMULATED.0, SIMULATED.1)),
            None => None,
        };
        let simulation = simulation.map(|scenario| {
            let site = SimulatedSite::of(&scenario, SIMULATION, Utc::now());
            (scenario, site)
        });
        let mut zones = crate::zones(&arguments.site_name, &rooms);
        zones.extend(mqtt.iter().flat_map(broker::MqttSettings::zones));
        Ok(Self { site: arguments.site_name.clone(), zones, names, sources, admission, simulation, mqtt })
    }

    /// Whether there is nothing but the simulation.
    fn is_simulation(&self) -> bool {
        let has_house = self.mqtt.as_ref().is_some_and(|mqtt| mqtt.espresense.is_some());
        self.simulation.is_some() && self.sources.is_empty() && !has_house
    }

    /// The site of the sources, or of the simulation where there is nothing else.
    fn site(&self) -> &str {
        if self.is_simulation() { SIMULATION } else { &self.site }
    }

    /// The sites, and the rooms of each.
    pub(super) fn sites(&self) -> Vec<(SiteMap, Vec<Zone>)> {
        let origin = self.names.geographic_origin();
        let own = SiteMap { geographic_origin: origin.map(GeographicOrigin), ..SiteMap::new(&self.site) };
        let own = (!self.is_simulation()).then(|| (own, self.zones.clone()));
        let simulated = self.simulation.as_ref().map(|(_, site)| (site.site.clone(), site.zones.clone()));
        own.into_iter().chain(simulated).collect()
    }

    /// Writes the sites that the store does not have yet. What a person has drawn stays.
    async fn configure(&self, store: &Store) -> Result<()> {
        let known = store.sites().await?;
        let zones = store.zones().await?;
        for (site, rooms) in self.sites() {
            let known = known.iter().find(|known| known.name == site.name);
            if known.is_none() {
                store.put_site(&site).await?;
            }
            match (known.and_then(|known| known.geographic_origin), &site.geographic_origin) {
                (None, Some(origin)) => store.put_geographic_origin(&site.name, Some(origin)).await?,
                (Some(stored), Some(origin)) if stored != *origin => note(&format!(
                    "{}: the store has another geographic origin than --site, and keeps it; \
                     DELETE /api/v1/sites/{}/geographic-origin and a restart take that of the file\n",
                    site.name, site.name
                )),
                (Some(_), _) | (None, None) => (),
            }
            for room in rooms {
                if zones.iter().all(|zone| (&zone.site, &zone.name) != (&room.site, &room.name)) {
                    store.put_zone(&room).await?;
                }
            }
        }
        Ok(())
    }

    /// Reports the nodes, at last those that a person has placed, and starts a thread for each source. `note` takes a
    /// line for the user, such as that a person has placed a node elsewhere than `--site`. Returns what to do at the
    /// broker.
    pub(super) fn start(
        self,
        hub: &Hub,
        placed: &[PlacedNode],
        note: impl Fn(&str) + Clone + Send + 'static,
    ) -> Option<broker::MqttSettings> {
        let nodes = crate::nodes(&self.site, &self.names, Utc::now());
        let simulated = self.simulation.iter().flat_map(|(_, site)| site.nodes.clone()).collect::<Vec<_>>();
        let receivers = self.mqtt.iter().flat_map(|mqtt| mqtt.receivers(Utc::now())).collect::<Vec<_>>();
        for place in placed.iter().filter(|place| nodes.iter().any(|report| is_elsewhere(report, place))) {
            let PlacedNode { site, node, .. } = place;
            note(&format!(
                "{site}: {node} stays where the API has placed it, which is not its place in --site; \
                 DELETE /api/v1/nodes/{site}/{node} and a restart take that of the file\n"
            ));
        }
        let placed = placed.iter().flat_map(|node| node.reports(Utc::now())).collect::<Vec<_>>();
        let known = nodes.into_iter().chain(simulated).chain(receivers).chain(placed);
        let reports = hub.reports();
        thread::spawn(move || known.into_iter().all(|report| reports.blocking_send(report).is_ok()));
        site_check::watch(hub.clone(), note.clone());
        for (name, source) in self.sources {
            let (reports, site, note) = (hub.reports(), self.site.clone(), note.clone());
            let admission = Arc::clone(&self.admission);
            let mut messages = source.takes_messages().then(|| hub.messages().listen());
            thread::spawn(move || {
                let mut note = |text: &str| note(&format!("{name}: {text}\n"));
                let mut outgoing = || messages.as_mut()?.try_recv().ok().map(|message| frame(&message));
                let ways: (crate::ReportSender<'_>, crate::Outgoing<'_>) = (&mut sender(reports), &mut outgoing);
                match crate::run(source, &admission, &site, ways, &mut note) {
                    Ok(()) => note("it has ended"),
                    Err(error) => note(&format!("{error:#}")),
                }
            });
        }
        if let Some((scenario, site)) = self.simulation {
            let (reports, mut messages) = (hub.reports(), hub.messages().listen());
            let mut outgoing = move || messages.try_recv().ok();
            thread::spawn(move || simulate(scenario, &site.site.name, &mut sender(reports), &mut outgoing));
        }
        self.mqtt
    }
}

/// Whether a report of the site's file is of this node, with another position.
fn is_elsewhere(report: &SourceReport, placed: &PlacedNode) -> bool {
    let ReportKind::Node { node, position_m: Some(position_m), .. } = &report.what else { return false };
    (&report.site, node) == (&placed.site, &placed.node) && *position_m != placed.position_m
}

fn sender(reports: mpsc::Sender<SourceReport>) -> impl FnMut(SourceReport) -> bool {
    move |report| reports.blocking_send(report).is_ok()
}
