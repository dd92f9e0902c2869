//! Wi-Fi: from a node's telemetry to its station, in UDP. All of it runs in the main thread, the driver in threads of its
//! own below the ranging thread's priority.
//!
//! Each task goes on by itself: one keeps the Wi-Fi joined, one runs the network's stack, one sends. Without a network the
//! queue keeps what it can.

use core::cell::RefCell;
use core::fmt::Write;

use embassy_executor::Spawner;
use embassy_futures::select::select;
use embassy_net::dns::DnsQueryType;
use embassy_net::udp::{PacketMetadata, UdpSocket};
use embassy_net::{DhcpConfig, IpEndpoint, Runner, Stack, StackResources};
use embassy_time::{Delay, Timer};
use esp_hal::peripherals::WIFI;
use esp_radio::wifi::sta::StationConfig;
use esp_radio::wifi::{
    AuthenticationMethodConfig, Config, ControllerConfig, Interface, PowerSaveMode, WifiController, WifiError,
};
use firmware_common::node::Configured;
use firmware_common::{HostChannel, Settings};
use firmware_gateway::{DatagramSocket, GatewayIdentity};
use static_cell::StaticCell;
use wire::config::{LoadError, Region, Wifi};
use wire::datagram::MAX_DATAGRAM;

use super::{random, uptime_us};

/// Bytes of telemetry that can wait for the station: two seconds of an anchor that passes on 250 positions a second, some
/// minutes of a quiet tag.
const QUEUE: usize = 20 << 10;
/// Datagrams that can wait in the socket, each way.
const PACKETS: usize = 4;
/// The longest receipt is far shorter than a datagram of telemetry, bytes.
const RECEIVED: usize = 1024;
/// Sockets: datagrams, DHCP, DNS.
const SOCKETS: usize = 3;
/// From one attempt to join to the next, seconds, at first and at most.
const RETRY_S: [u64; 2] = [1, 30];
/// From one look for the station's name to the next, seconds.
const NAME_S: u64 = 5;

/// A node's own gateway. The tasks of the main thread share it.
pub type Gateway = RefCell<firmware_gateway::Gateway<QUEUE>>;

/// The chip's radio, switched off, and what the flash says of Wi-Fi.
pub struct Parts {
    pub(super) radio: WIFI<'static>,
    pub(super) settings: Result<Wifi, LoadError>,
}

impl Parts {
    /// Starts the tasks by which a node with these settings reaches its station. Returns the gateway that takes its
    /// telemetry. Without settings of Wi-Fi the node works without; the log says why.
    pub fn start(self, spawner: Spawner, node: &Configured) -> Option<&'static Gateway> {
        static GATEWAY: StaticCell<Gateway> = StaticCell::new();
        static SETTINGS: StaticCell<Wifi> = StaticCell::new();
        let wifi: &Wifi = match self.settings {
            Ok(wifi) => SETTINGS.init(wifi),
            Err(why) => {
                defmt::error!("no Wi-Fi, the node works without: {}", why);
                return None;
            }
        };
        let Configured { record, settings: Settings { address, eui, .. } } = node;
        let controller = match controller(self.radio, wifi, record.network.region) {
            Ok(controller) => controller,
            Err(error) => {
                defmt::error!("Wi-Fi does not start, the node works without: {}", error);
                return None;
            }
        };
        let mut seed = [0; 12];
        random(&mut seed);
        let [a, b, c, d, e, f, g, h, session @ ..] = seed;
        let (stack, runner) = stack(*address, u64::from_le_bytes([a, b, c, d, e, f, g, h]));
        let identity = GatewayIdentity::of(wifi, *eui, *address);
        let new = || RefCell::new(firmware_gateway::Gateway::new(identity, u32::from_le_bytes(session)));
        let gateway: &Gateway = GATEWAY.init_with(new);
        spawner.spawn(join(controller, wifi).unwrap());
        spawner.spawn(network(runner).unwrap());
        spawner.spawn(forward(stack, gateway, wifi).unwrap());
        Some(gateway)
    }
}

/// The host at a cable, if there is one, and the station. Both get all telemetry, and send messages to tags.
pub(super) struct Both<C> {
    pub(super) cable: C,
    pub(super) gateway: Option<&'static Gateway>,
}

impl<C: HostChannel> HostChannel for Both<C> {
    fn write(&mut self, frame: &[u8]) -> bool {
        let written = self.cable.write(frame);
        // The station's queue keeps the newest, and a cable that nobody is at must not hold them up.
        self.gateway.map_or(written, |gateway| {
            gateway.borrow_mut().write(frame, uptime_us());
            true
        })
    }

    fn is_read(&self) -> bool {
        self.cable.is_read() || self.gateway.is_some_and(|gateway| gateway.borrow().is_read(uptime_us()))
    }

    fn read(&mut self, into: &mut [u8]) -> usize {
        match self.cable.read(into) {
            0 => self.gateway.map_or(0, |gateway| gateway.borrow_mut().read(into)),
            read => read,
        }
    }
}

/// The country whose channels are used: of several countries' regions and of none, those that are allowed everywhere.
fn country(region: Option<Region>) -> [u8; 2] {
    match region {
        Some(Region::Us) => *b"US",
        Some(Region::Japan) => *b"JP",
        Some(Region::China) => *b"CN",
        Some(Region::Eu | Region::Unchecked) | None => *b"01",
    }
}

/// The driver, configured. It is not joined yet.
fn controller(radio: WIFI<'static>, wifi: &Wifi, region: Option<Region>) -> Result<WifiController<'static>, WifiError> {
    let authentication = match wifi.password.as_str() {
        "" => AuthenticationMethodConfig::Open,
        // Access points for WPA3 take WPA2 as well, unless they are configured otherwise.
        password => AuthenticationMethodConfig::Wpa2Personal(password.try_into()?),
    };
    let station =
        StationConfig::default().with_ssid(wifi.ssid.as_str().try_into()?).with_authentication(authentication);
    // Few frames come back: fewer buffers, and no aggregates, spare 30 KiB.
    let config = ControllerConfig::default()
        .with_country_info(country(region))
        .with_static_rx_buf_num(4)
        .with_dynamic_rx_buf_num(8)
        .with_dynamic_tx_buf_num(12)
        .with_ampdu_rx_enable(false)
        .with_ampdu_tx_enable(false)
        .with_initial_config(Config::Station(station));
    let mut controller = WifiController::new(radio, config)?;
    // A gateway has a cable for its power. While it sleeps from beacon to beacon, receipts wait a tenth of a second.
    controller.set_power_saving(PowerSaveMode::None)?;
    Ok(controller)
}

/// The network's stack, which gets its address by DHCP, under the node's name.
fn stack(address: u16, seed: u64) -> (Stack<'static>, Runner<'static, Interface>) {
    static RESOURCES: StaticCell<StackResources<SOCKETS>> = StaticCell::new();
    let mut dhcp = DhcpConfig::default();
    let mut name = heapless::String::new();
    // It fits.
    let _ = write!(name, "baliza-{address:04x}");
    dhcp.hostname = Some(name);
    let resources = RESOURCES.init_with(StackResources::new);
    embassy_net::new(Interface::station(), embassy_net::Config::dhcpv4(dhcp), resources, seed)
}

/// Keeps the Wi-Fi joined.
#[embassy_executor::task]
async fn join(mut controller: WifiController<'static>, wifi: &'static Wifi) {
    let [first_s, most_s] = RETRY_S;
    let mut pause_s = first_s;
    loop {
        match controller.connect_async().await {
            Ok(_) => {
                defmt::info!("Wi-Fi: joined {}", wifi.ssid.as_str());
                pause_s = first_s;
                match controller.wait_for_disconnect_async().await {
                    Ok(left) => defmt::warn!("Wi-Fi: {} is lost: {}", wifi.ssid.as_str(), left.reason),
                    Err(error) => defmt::warn!("Wi-Fi: {} is lost: {}", wifi.ssid.as_str(), error),
                }
            }
            Err(error) => defmt::warn!("Wi-Fi: cannot join {}: {}", wifi.ssid.as_str(), error),
        }
        Timer::after_secs(pause_s).await;
        pause_s = (2 * pause_s).min(most_s);
    }
}

#[embassy_executor::task]
async fn network(mut runner: Runner<'static, Interface>) {
    runner.run().await;
}

/// Sends what the gateway has to the station.
#[embassy_executor::task]
async fn forward(stack: Stack<'static>, gateway: &'static Gateway, wifi: &'static Wifi) {
    let mut lost = 0;
    loop {
        stack.wait_config_up().await;
        let found = stack.dns_query(&wifi.host, DnsQueryType::A).await;
        let Some(address) = found.ok().and_then(|addresses| addresses.first().copied()) else {
            defmt::warn!("Wi-Fi: the name of the station, {}, is not known", wifi.host.as_str());
            Timer::after_secs(NAME_S).await;
            continue;
        };
        defmt::info!("Wi-Fi: telemetry goes to {} (udp:{}:{})", wifi.host.as_str(), address, wifi.port);
        send(stack, gateway, IpEndpoint::new(address, wifi.port)).await;
        let now = gateway.borrow().lost();
        defmt::warn!("Wi-Fi: {} does not answer; {} frames were lost", wifi.host.as_str(), now.wrapping_sub(lost));
        lost = now;
    }
}

/// Sends until the station is silent, or the network is gone.
async fn send(stack: Stack<'static>, gateway: &Gateway, to: IpEndpoint) {
    let (mut arrived, mut leaving) = ([PacketMetadata::EMPTY; PACKETS], [PacketMetadata::EMPTY; PACKETS]);
    let (mut received, mut sent) = ([0; RECEIVED], [0; 2 * MAX_DATAGRAM]);
    let mut socket = UdpSocket::new(stack, &mut arrived, &mut received, &mut leaving, &mut sent);
    // A port of its own, chosen by the stack.
    if let Err(error) = socket.bind(0) {
        defmt::warn!("Wi-Fi: no socket: {}", error);
        Timer::after_secs(NAME_S).await;
        return;
    }
    let mut link = Udp { socket, to };
    select(firmware_gateway::run(gateway, &mut link, Delay, uptime_us), stack.wait_config_down()).await;
}

/// The socket to the station.
struct Udp<'s> {
    socket: UdpSocket<'s>,
    to: IpEndpoint,
}

impl DatagramSocket for Udp<'_> {
    async fn send(&mut self, datagram: &[u8]) {
        // What cannot be sent now is sent again as what gets lost.
        let _ = self.socket.send_to(datagram, self.to).await;
    }

    async fn receive(&mut self, into: &mut [u8; MAX_DATAGRAM]) -> usize {
        loop {
            // Datagrams of others, and too long ones, are none of the station's.
            if let Ok((length, from)) = self.socket.recv_from(into).await
                && from.endpoint == self.to
            {
                return length;
            }
        }
    }
}
