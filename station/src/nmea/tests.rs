//! The ports, with clients on loopback.

use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};

use super::*;
use crate::hub::NullStore;
use crate::model::{GeographicOrigin, SiteMap};
use crate::state::{LiveState, StateLimits};
use crate::store::Retention;
use crate::{ReportKind, SolvedFrom, SourceReport};

const SITE: &str = "hall";

struct Station {
    hub: Hub,
    addresses: Vec<SocketAddr>,
    _nmea: Nmea,
}

impl Station {
    /// A station with a port for each tag, in a site that has a geographic origin.
    async fn start(tags: &[&str], silent_after: Duration) -> Self {
        let mut live = LiveState::new(StateLimits::default());
        live.set_geographic_origins(&[site()]);
        let retention = Retention::default();
        let (hub, _) = Hub::start(live, NullStore, retention).await.unwrap();
        let (mut ports, mut addresses) = (Vec::new(), Vec::new());
        for tag in tags {
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            addresses.push(listener.local_addr().unwrap());
            ports.push(NmeaPort { tag: (*tag).to_owned(), site: None, listener });
        }
        let nmea = Nmea::start(&hub, ports, silent_after);
        Self { hub, addresses, _nmea: nmea }
    }

    async fn report(&self, tag: &str, x_m: f64) {
        let what = ReportKind::Position {
            tag: tag.to_owned(),
            round: None,
            position_m: [x_m, 0.0],
            z_m: Some(1.0),
            sigma_m: [0.1; 2],
            sigma_z_m: None,
            cov_xy_m2: 0.0,
            used: 5,
            solved_from: SolvedFrom::Ranges,
            doubt: None,
        };
        self.hub.reports().send(SourceReport { t: Utc::now(), site: SITE.to_owned(), what }).await.unwrap();
    }

    async fn client(&self, port: usize) -> Client {
        let (from, to) = TcpStream::connect(self.addresses[port]).await.unwrap().into_split();
        Client { lines: BufReader::new(from), to }
    }
}

fn site() -> SiteMap {
    let origin = r#"{"latitude_deg": 0, "longitude_deg": 0, "y_azimuth_deg": 0, "height_m": 5}"#;
    SiteMap { geographic_origin: Some(serde_json::from_str::<GeographicOrigin>(origin).unwrap()), ..SiteMap::new(SITE) }
}

struct Client {
    lines: BufReader<OwnedReadHalf>,
    to: OwnedWriteHalf,
}

impl Client {
    /// The next line; empty at the end of the connection.
    async fn line(&mut self) -> String {
        let mut line = String::new();
        let read = timeout(Duration::from_secs(60), self.lines.read_line(&mut line)).await.expect("a line in time");
        // What is cut is reset where bytes of the client were not read.
        read.map(|_| line).unwrap_or_default()
    }

    /// Reads until a line has these fields.
    async fn until(&mut self, fields: &str) -> String {
        loop {
            let line = self.line().await;
            assert!(!line.is_empty(), "disconnected before {fields}");
            if line.contains(fields) {
                return line;
            }
        }
    }
}

/// x in metres east of the origin as the fields of a longitude: a minute is 1855.325 m (2π · 6,378,142 m / 21,600), at
/// a height of 5 m. Three decimals are 2 m.
fn east(x_m: f64) -> String {
    format!(",0000{:.3}", (x_m / 1.855_325).floor() / 1e3)
}

#[tokio::test]
async fn each_port_has_the_positions_of_its_tag() {
    let station = Station::start(&["0x1001", "0x1002"], Duration::from_secs(30)).await;
    let (mut one, mut other) = (station.client(0).await, station.client(1).await);
    for client in [&mut one, &mut other] {
        client.until("GNGGA").await;
    }
    station.report("0x1001", 100.0).await;
    station.report("0x1002", 200.0).await;
    let gga = one.until(&east(100.0)).await;
    assert!(gga.starts_with("$GNGGA,") && gga.contains(",E,1,05,,6.0") && gga.ends_with("\r\n"), "{gga}");
    assert!(one.line().await.starts_with("$GNRMC,"));
    assert!(one.line().await.contains("GST,"));
    other.until(&east(200.0)).await;
    // Who comes later gets the last position at once.
    station.client(0).await.until(&east(100.0)).await;
}

#[tokio::test]
async fn a_tag_that_is_silent_has_no_position() {
    let station = Station::start(&["0x1001"], Duration::from_millis(300)).await;
    let mut client = station.client(0).await;
    assert!(client.until("GNRMC").await.contains(",V,"));
    station.report("0x1001", 100.0).await;
    client.until(",A,").await;
    let gga = client.until("GNGGA").await;
    assert!(gga.contains(",,,,,0,00,"), "{gga}");
    client.until(",V,").await;
    station.report("0x1001", 300.0).await;
    client.until(&east(300.0)).await;
}

#[tokio::test]
async fn a_site_without_a_geographic_origin_has_no_positions_until_it_gets_one() {
    let station = Station::start(&["0x1001"], Duration::from_secs(30)).await;
    station.hub.change(|live| live.set_geographic_origins(&[SiteMap::new(SITE)]));
    let mut client = station.client(0).await;
    station.report("0x1001", 100.0).await;
    for _ in 0..4 {
        let line = client.line().await;
        assert!(line.contains(",0,00,") || line.contains(",V,"), "{line}");
    }
    station.hub.change(|live| live.set_geographic_origins(&[site()]));
    station.report("0x1001", 100.0).await;
    client.until(&east(100.0)).await;
}

#[tokio::test]
async fn clients_that_do_not_read_hold_up_nobody() {
    let station = Station::start(&["0x1001"], Duration::from_secs(30)).await;
    let _hanging = [station.client(0).await, station.client(0).await];
    let mut reading = station.client(0).await;
    // 20,000 positions are 4 MB of sentences, more than a connection holds.
    for _ in 0..20_000 {
        station.report("0x1001", 100.0).await;
    }
    station.report("0x1001", 700.0).await;
    reading.until(&east(700.0)).await;
}

#[tokio::test]
async fn a_client_gets_ten_positions_a_second_and_the_newest_of_them() {
    let station = Station::start(&["0x1001"], Duration::from_secs(30)).await;
    let mut client = station.client(0).await;
    let begun = Instant::now();
    for centimetres in 0..100 {
        station.report("0x1001", f64::from(centimetres) / 100.0).await;
        sleep(Duration::from_millis(10)).await;
    }
    station.report("0x1001", 300.0).await;
    let mut fixes = 0;
    while !client.until(",E,1,").await.contains(&east(300.0)) {
        fixes += 1;
    }
    // The last one comes up to 100 ms later; the first at once.
    let most = begun.elapsed().as_millis() / 100 + 1;
    assert!(fixes >= 2 && fixes <= most, "{fixes} of at most {most}");
}

#[tokio::test]
async fn a_port_has_places_for_32_clients_and_they_are_free_again() {
    let station = Station::start(&["0x1001"], Duration::from_secs(30)).await;
    let mut clients = Vec::new();
    for _ in 0..CLIENTS {
        let mut client = station.client(0).await;
        client.until("GNGGA").await;
        clients.push(client);
    }
    assert_eq!(station.client(0).await.line().await, "");
    clients.truncate(CLIENTS - 1);
    let again = async {
        while station.client(0).await.line().await.is_empty() {
            sleep(Duration::from_millis(20)).await;
        }
    };
    timeout(Duration::from_secs(60), again).await.expect("the place of the one that is gone");
}

#[tokio::test]
async fn what_a_client_sends_is_ignored_and_it_may_end_its_direction() {
    let station = Station::start(&["0x1001"], Duration::from_secs(30)).await;
    let mut client = station.client(0).await;
    // gpsd sends probes of many makers.
    client.to.write_all(&b"$PASHQ,RID*28\r\n\xb5b\n".repeat(1000)).await.unwrap();
    client.to.shutdown().await.unwrap();
    client.until("GNGGA").await;
    station.report("0x1001", 100.0).await;
    client.until(&east(100.0)).await;
}
