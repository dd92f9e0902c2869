//! A house with ESPresense: its receivers' messages come in, positions go out.

use serde_json::json;
use station_core::mqtt::MqttSettings;
use station_core::mqtt::espresense::House;

use crate::mqtt::mosquitto::Mosquitto;
use crate::mqtt::station::{LEVEL, SITE, Station, keep_log, logged, settings, wait_for_log};

/// Four receivers in the corners of a room of 8 m by 6 m.
const HOUSE: &str = "
floors:
  - id: ground
    rooms:
      - {name: hall, points: [[0, 0], [8, 0], [8, 6], [0, 6]]}
nodes:
  - {name: South West, point: [0, 0, 1]}
  - {name: South East, point: [8, 0, 1]}
  - {name: North East, point: [8, 6, 1]}
  - {name: North West, point: [0, 6, 1]}
devices:
  - {id: 'irk:*'}
";
const PLACES: [(&str, [f64; 2]); 4] =
    [("south_west", [0.0, 0.0]), ("south_east", [8.0, 0.0]), ("north_east", [8.0, 6.0]), ("north_west", [0.0, 6.0])];

/// What receivers say of a device at a place: -59 dBm at 1 m, path loss exponent 3.
fn messages(at: [f64; 2]) -> Vec<(&'static str, String)> {
    let message = |(node, place): (&'static str, [f64; 2])| {
        let distance_m = (at[0] - place[0]).hypot(at[1] - place[1]).max(0.5);
        let rssi = -59.0 - 30.0 * distance_m.log10();
        (
            node,
            format!(r#"{{"id": "irk:1", "rssi@1m": -59, "rssi": {rssi:.2}, "distance": {distance_m:.2}, "int": 900}}"#),
        )
    };
    PLACES.map(message).into()
}

fn house(port: u16) -> MqttSettings {
    MqttSettings { espresense: Some((House::read(HOUSE).expect("a house"), SITE.to_owned())), ..settings(port) }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_receivers_hear_becomes_a_position_among_garbage() {
    let Some(broker) = Mosquitto::start() else { return };
    keep_log();
    let all = broker.listen();
    let station = Station::start(house(broker.port)).await;
    all.first("baliza/status");
    let topic = |node: &str| format!("espresense/devices/irk:1/{node}");
    let huge = format!(r#"{{"rssi": "{}"}}"#, "x".repeat(60_000));
    let at = [2.0, 4.5];
    let mut position = None;
    for _ in 0..60 {
        for (node, message) in messages(at) {
            for garbage in ["no JSON", r#"{"rssi": NaN}"#, r#"{"rssi": 1000}"#, "", &huge] {
                broker.publish(&topic(node), garbage, &[]);
            }
            broker.publish("espresense/devices/irk:1", &message, &[]);
            broker.publish(&topic(node), &message, &[]);
        }
        position = station.hub.read(|live| live.tag(SITE, "irk:1")).and_then(|tag| tag.last_position);
        if position.as_ref().is_some_and(|position| usize::from(position.used) == PLACES.len()) {
            break;
        }
    }
    let position = position.expect("a position");
    // The messages are exact, so what is left is the locator's knowledge of the path loss.
    let error_m = (position.x_m - at[0]).hypot(position.y_m - at[1]);
    assert!(error_m < 2.0, "{error_m} m: {position:?}");
    let out = all.first(&format!("baliza/{LEVEL}/tags/irk:1/position")).json();
    assert_eq!(out["site"], SITE);
    let line = wait_for_log("messages were refused").await;
    assert!(line.contains("espresense/devices/irk:1/"), "{line}");
    assert_eq!(logged("connected to").iter().filter(|line| line.ends_with(&format!(":{}", broker.port))).count(), 1);
    station.mqtt.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn receivers_are_among_the_nodes_and_a_message_too_large_costs_no_connection() {
    let Some(broker) = Mosquitto::start() else { return };
    keep_log();
    let all = broker.listen();
    let station = Station::start(house(broker.port)).await;
    let health = all.first(&format!("baliza/{LEVEL}/nodes/south_west/health")).json();
    assert_eq!((&health["role"], &health["name"]), (&json!("receiver"), &json!("South West")));
    assert_eq!(health["position_m"], json!([0.0, 0.0, 1.0]));
    // Beyond what the station says that it takes: 64 KiB.
    let file = broker.folder().join("huge");
    std::fs::write(&file, vec![b'x'; 1_000_000]).expect("a file");
    let mut publish = broker.client("mosquitto_pub");
    publish.args(["-t", "espresense/devices/irk:1/south_west", "-f"]).arg(&file);
    assert!(publish.status().expect("it runs").success());
    broker.publish("espresense/devices/irk:1/attic", r#"{"rssi": -60}"#, &[]);
    wait_for_log("the receiver attic is not in the file's `nodes`").await;
    assert_eq!(logged("connected to").iter().filter(|line| line.ends_with(&format!(":{}", broker.port))).count(), 1);
    station.mqtt.stop().await;
}
