//! What the station publishes.

use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};
use station_core::ReportKind;
use station_core::model::TagPosition;

use crate::mqtt::mosquitto::{Mosquitto, Seen};
use crate::mqtt::station::{LEVEL, SITE, Station, settings};

/// The keys of an object, sorted.
fn keys(object: &Value) -> Vec<&str> {
    let mut keys: Vec<_> = object.as_object().expect("an object").keys().map(String::as_str).collect();
    keys.sort_unstable();
    keys
}

#[tokio::test(flavor = "multi_thread")]
async fn positions_rooms_events_and_health_reach_their_topics() {
    let Some(broker) = Mosquitto::start() else { return };
    let all = broker.listen();
    let station = Station::start(settings(broker.port)).await;
    assert_eq!(all.first("baliza/status").payload, "online");
    station.anchor("0x0101").await;
    station.position("0x1001", [3.0, 2.0]).await;

    let position = all.first(&format!("baliza/{LEVEL}/tags/0x1001/position"));
    // The document of /api/v1/live is a `TagPosition`.
    let read: TagPosition = serde_json::from_str(&position.payload).expect("a position");
    assert_eq!((read.site.as_str(), read.tag.as_str(), read.x_m, read.y_m), (SITE, "0x1001", 3.0, 2.0));
    assert_eq!((read.z_m, read.sigma_z_m, read.room.as_deref()), (Some(1.2), Some(0.3), Some("kitchen")));
    let room = format!("baliza/{LEVEL}/tags/0x1001/room");
    let inside = all.wait("the room", |seen| seen.topic == room && seen.json()["room"] == "kitchen").json();
    let expected = json!({"site": SITE, "tag": "0x1001", "name": null, "room": "kitchen", "zones": [],
        "silent": false, "reason": null, "supply_v": null});
    assert_eq!(inside, expected);
    let event = all.first(&format!("baliza/{LEVEL}/tags/0x1001/events")).json();
    assert_eq!((&event["kind"], &event["zone"]), (&json!("entered"), &json!("kitchen")));
    let health = all.first(&format!("baliza/{LEVEL}/nodes/0x0101/health")).json();
    assert_eq!(
        (&health["node"], &health["role"], &health["moved"]),
        (&json!("0x0101"), &json!("anchor"), &json!(false))
    );

    let data = ReportKind::Data { tag: "0x1001".to_owned(), number: 7, data: b"open".to_vec() };
    station.report(data).await;
    let told = all.first(&format!("baliza/{LEVEL}/tags/0x1001/data")).json();
    assert_eq!((&told["tag"], &told["number"], &told["data"]), (&json!("0x1001"), &json!(7), &json!("6F70656E")));

    // Who comes later gets the state, and no events.
    let later = broker.listen();
    later.first(&room);
    let seen = later.first(&format!("baliza/{LEVEL}/tags/0x1001/position"));
    assert!(seen.retained, "{seen:?}");
    assert_eq!(later.of(&format!("baliza/{LEVEL}/tags/0x1001/events")).len(), 0);
    assert_eq!(later.of(&format!("baliza/{LEVEL}/tags/0x1001/data")).len(), 0);

    // Outside, which the tag leaves the room for.
    station.position("0x1001", [30.0, 2.0]).await;
    all.wait("outside", |seen| seen.topic == room && seen.json()["room"].is_null());
    station.mqtt.stop().await;
    all.wait("offline", |seen| seen.topic == "baliza/status" && seen.payload == "offline");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tag_has_at_most_one_position_a_second_and_the_last_one_comes() {
    let Some(broker) = Mosquitto::start() else { return };
    let all = broker.listen();
    let station = Station::start(settings(broker.port)).await;
    all.first("baliza/status");
    let begun = Instant::now();
    // 100 positions, about 50 a second.
    for step in 0..100 {
        station.position("0x1001", [f64::from(step) / 100.0, 2.0]).await;
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let topic = format!("baliza/{LEVEL}/tags/0x1001/position");
    let last = all.wait("the last position", |seen| seen.topic == topic && seen.json()["x_m"] == json!(0.99));
    assert!(!last.retained);
    // One at once, and one for each second that has gone by.
    let most = 1 + begun.elapsed().as_secs() as usize;
    let count = all.of(&topic).len();
    assert!((2..=most).contains(&count), "{count} positions in {:?}", begun.elapsed());
}

/// The keys that Home Assistant's documentation has for devices ("Device discovery payload"), and for the platforms
/// `sensor`, `device_tracker` and `binary_sensor`.
const SHARED: [&str; 4] = ["availability", "components", "device", "origin"];
const DEVICE: [&str; 12] = [
    "configuration_url",
    "connections",
    "hw_version",
    "identifiers",
    "manufacturer",
    "model",
    "model_id",
    "name",
    "serial_number",
    "suggested_area",
    "sw_version",
    "via_device",
];
const COMMON: [&str; 7] = ["entity_category", "icon", "name", "platform", "state_topic", "unique_id", "value_template"];
const SENSOR: [&str; 3] = ["device_class", "state_class", "unit_of_measurement"];

#[tokio::test(flavor = "multi_thread")]
async fn home_assistant_gets_a_device_for_each_tag_and_anchor() {
    let Some(broker) = Mosquitto::start() else { return };
    let all = broker.listen();
    let station = Station::start(settings(broker.port)).await;
    station.anchor("0x0101").await;
    station.position("0x1001", [3.0, 2.0]).await;
    station.report(ReportKind::Supply { node: "0x1001".to_owned(), supply_v: 3.1 }).await;
    // A space is 20 in hexadecimal.
    let config = "homeassistant/device/baliza__my_20house__0x1001/config";
    let has_supply =
        |seen: &Seen| seen.topic == config && seen.json()["components"].as_object().map(Map::len) == Some(4);
    let tag = all.wait("the supply's sensor", has_supply).json();
    let anchor = all.first("homeassistant/device/baliza__my_20house__0x0101/config").json();
    for document in [&tag, &anchor] {
        assert_eq!(keys(document), SHARED);
        assert!(keys(&document["device"]).iter().all(|key| DEVICE.contains(key)), "{document}");
        assert!(document["origin"]["name"].is_string());
        assert_eq!(document["availability"], json!([{"topic": "baliza/status"}]));
    }
    assert_eq!(tag["device"]["name"], "0x1001");
    assert_eq!(anchor["device"]["name"], "corner");

    let components = tag["components"].as_object().expect("components");
    let mut platforms = Vec::new();
    for (id, component) in components {
        assert_eq!(component["unique_id"], json!(id));
        let platform = component["platform"].as_str().expect("a platform");
        let own: &[&str] = match platform {
            "device_tracker" => &["source_type", "json_attributes_topic"],
            "sensor" => &SENSOR,
            _ => &["device_class"],
        };
        assert!(keys(component).iter().all(|key| COMMON.contains(key) || own.contains(key)), "{component}");
        platforms.push(platform);
        assert_eq!(component["state_topic"], json!(format!("baliza/{LEVEL}/tags/0x1001/room")));
    }
    assert_eq!(platforms, ["sensor", "device_tracker", "binary_sensor", "sensor"]);
    let supply = &components["baliza__my_20house__0x1001__supply"];
    assert_eq!((&supply["device_class"], &supply["unit_of_measurement"]), (&json!("voltage"), &json!("V")));
    let room = all.wait("the voltage", |seen| seen.topic.ends_with("0x1001/room") && seen.json()["supply_v"] == 3.1);
    assert_eq!(room.json()["tag"], "0x1001");
    let of = |platform: &str| components.values().find(|component| component["platform"] == platform).expect("there");
    // Home Assistant's values of `source_type` and `device_class`.
    assert_eq!(of("device_tracker")["source_type"], "bluetooth_le");
    let position = format!("baliza/{LEVEL}/tags/0x1001/position");
    assert_eq!(of("device_tracker")["json_attributes_topic"], json!(position));
    assert_eq!(of("binary_sensor")["device_class"], "connectivity");
    let moved = anchor["components"].as_object().expect("components").values().next().expect("one");
    assert_eq!((&moved["platform"], &moved["device_class"]), (&json!("binary_sensor"), &json!("problem")));

    // Home Assistant starts.
    all.forget();
    // As often as Home Assistant would have to: a message of quality 0 may be lost.
    let again = (0..60).find_map(|_| {
        broker.publish("homeassistant/status", "online", &[]);
        std::thread::sleep(std::time::Duration::from_secs(1));
        all.of(config).into_iter().next()
    });
    let again = again.expect("the device is described again");
    assert!(!again.retained && again.json() == tag);
    drop(station);
}

#[tokio::test(flavor = "multi_thread")]
async fn documents_of_forgotten_tags_and_nodes_are_cleared() {
    let Some(broker) = Mosquitto::start() else { return };
    let all = broker.listen();
    let station = Station::start(settings(broker.port)).await;
    station.anchor("0x0101").await;
    station.position("0x1001", [3.0, 2.0]).await;
    let topics = [
        format!("baliza/{LEVEL}/tags/0x1001/room"),
        format!("baliza/{LEVEL}/tags/0x1001/position"),
        format!("baliza/{LEVEL}/nodes/0x0101/health"),
        "homeassistant/device/baliza__my_20house__0x1001/config".to_owned(),
        "homeassistant/device/baliza__my_20house__0x0101/config".to_owned(),
    ];
    for topic in &topics {
        all.first(topic);
    }
    station.hub.change(|live| {
        live.forget(SITE, "0x1001");
        live.forget_node(SITE, "0x0101");
    });
    for topic in &topics {
        all.wait("an empty document", |seen| seen.topic == *topic && seen.payload.is_empty());
    }
    station.mqtt.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn devices_of_deleted_tags_are_cleared_and_those_of_other_sites_stay() {
    let Some(broker) = Mosquitto::start() else { return };
    let ghost = format!("baliza/{LEVEL}/tags/ghost/room");
    let config = "homeassistant/device/baliza__my_20house__ghost/config";
    let other = "baliza/elsewhere/tags/ghost/room";
    for topic in [&ghost, config, other] {
        broker.publish(topic, "{}", &["-r"]);
    }
    let all = broker.listen();
    for topic in [&ghost, config, other] {
        assert!(all.first(topic).retained);
    }
    let station = Station::start(settings(broker.port)).await;
    station.position("0x1001", [3.0, 2.0]).await;
    all.wait("the tag's room is cleared", |seen| seen.topic == ghost && seen.payload.is_empty());
    all.wait("its device is cleared", |seen| seen.topic == config && seen.payload.is_empty());
    all.first(&format!("baliza/{LEVEL}/tags/0x1001/room"));
    assert!(all.of(other).iter().all(|seen| !seen.payload.is_empty()));
    station.mqtt.stop().await;
}
