//! A broker that goes away, comes back, or does not answer.

use std::time::{Duration, Instant};

use station_core::mqtt::Mqtt;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::{JoinHandle, JoinSet};

use crate::mqtt::mosquitto::port::Port;
use crate::mqtt::mosquitto::{Mosquitto, PATIENCE};
use crate::mqtt::station::{LEVEL, Station, keep_log, logged, settings};

#[tokio::test(flavor = "multi_thread")]
async fn after_a_kill_of_the_broker_under_load_the_state_is_there_again() {
    let Some(mut broker) = Mosquitto::start() else { return };
    keep_log();
    let station = Station::start(settings(broker.port)).await;
    let all = broker.listen();
    let tags: Vec<String> = (0..50).map(|tag| format!("0x{:04x}", 0x1001 + tag)).collect();
    let load = async |rounds: usize| {
        for round in 0..rounds {
            for tag in &tags {
                station.position(tag, [3.0, 0.5 + 0.01 * round as f64]).await;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    load(20).await;
    all.first(&format!("baliza/{LEVEL}/tags/0x1032/position"));
    for _ in 0..2 {
        broker.kill();
        // The hub goes on meanwhile.
        load(20).await;
        assert_eq!(station.hub.counts().missed, 0);
        let begun = Instant::now();
        broker.start_again();
        let all = broker.listen();
        all.wait("online", |seen| seen.topic == "baliza/status" && seen.payload == "online");
        for tag in &tags {
            for topic in [
                format!("baliza/{LEVEL}/tags/{tag}/position"),
                format!("baliza/{LEVEL}/tags/{tag}/room"),
                format!("homeassistant/device/baliza__my_20house__{tag}/config"),
            ] {
                all.first(&topic);
            }
        }
        println!("back after {:?}", begun.elapsed());
    }
    // One line for each time that it was lost, though several connections failed.
    let lines = logged(&format!("127.0.0.1:{}: ", broker.port));
    assert!((2..=4).contains(&lines.len()), "{lines:?}");
}

/// A line to a broker, which can be cut.
struct Line {
    port: u16,
    /// Keeps the port while the line is cut.
    held: Port,
    broker: u16,
    passing: JoinHandle<()>,
}

impl Line {
    async fn to(broker: u16) -> Self {
        let held = Port::free();
        let listener = TcpListener::bind(held.address).await.expect("its port");
        Self { port: held.address.port(), held, broker, passing: tokio::spawn(pass(listener, broker)) }
    }

    fn cut(&self) {
        self.passing.abort();
    }

    async fn mend(&mut self) {
        let listener = TcpListener::bind(self.held.address).await.expect("its port");
        self.passing = tokio::spawn(pass(listener, self.broker));
    }
}

/// Passes connections on. They end with it.
async fn pass(listener: TcpListener, broker: u16) {
    let mut connections = JoinSet::new();
    loop {
        let (mut near, _) = listener.accept().await.expect("a connection");
        connections.spawn(async move {
            let mut far = TcpStream::connect(("127.0.0.1", broker)).await?;
            tokio::io::copy_bidirectional(&mut near, &mut far).await
        });
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn events_of_the_time_without_a_connection_come_after_it() {
    let Some(broker) = Mosquitto::start() else { return };
    let mut line = Line::to(broker.port).await;
    let all = broker.listen();
    let station = Station::start(settings(line.port)).await;
    all.wait("online", |seen| seen.topic == "baliza/status" && seen.payload == "online");
    line.cut();
    // The last will.
    all.wait("offline", |seen| seen.topic == "baliza/status" && seen.payload == "offline");
    all.forget();
    for tag in ["0x1001", "0x1002", "0x1003"] {
        station.position(tag, [3.0, 2.0]).await;
        station.wait_for_position(tag, |position| position.room.is_some()).await;
    }
    assert_eq!(all.seen().len(), 0);
    line.mend().await;
    for tag in ["0x1001", "0x1002", "0x1003"] {
        assert_eq!(all.first(&format!("baliza/{LEVEL}/tags/{tag}/events")).json()["kind"], "entered");
    }
    all.wait("online", |seen| seen.topic == "baliza/status" && seen.payload == "online");
    station.mqtt.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broker_that_does_not_answer_holds_up_neither_the_hub_nor_the_stop() {
    let Some(broker) = Mosquitto::start() else { return };
    let all = broker.listen();
    let station = Station::start(settings(broker.port)).await;
    all.first("baliza/status");
    broker.signal("-STOP");
    let begun = Instant::now();
    for round in 0..20_000 {
        station.position(&format!("0x{:04x}", 0x1001 + round % 500), [3.0, 2.0]).await;
    }
    while station.hub.counts().reports < 20_000 {
        assert!(begun.elapsed() < PATIENCE, "{:?}", station.hub.counts());
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    tokio::time::timeout(PATIENCE, Mqtt::stop(station.mqtt)).await.expect("it does not wait for the broker");
    broker.signal("-CONT");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_station_without_its_broker_starts_and_finds_it_later() {
    let Some(mut broker) = Mosquitto::start() else { return };
    broker.kill();
    let station = Station::start(settings(broker.port)).await;
    station.position("0x1001", [3.0, 2.0]).await;
    tokio::time::sleep(Duration::from_secs(1)).await;
    broker.start_again();
    let all = broker.listen();
    all.first(&format!("baliza/{LEVEL}/tags/0x1001/position"));
    station.mqtt.stop().await;
}
