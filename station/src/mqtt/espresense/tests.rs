//! Messages of receivers, in the form of the firmware's `BleFingerprint::fill`.

use super::*;

const FLAT: &str = "
floors:
  - {id: ground, rooms: [{name: Hall, points: [[0, 0], [6, 0], [6, 4], [0, 4]]}]}
  - {id: upper}
nodes:
  - {name: Living Room, point: [1, 1, 1], floors: [ground]}
  - {name: Bedroom, point: [1, 1, 4], floors: [upper]}
devices: [{id: 'iBeacon:*'}, {id: 'irk:1', name: Ana}]
";
/// An example of ESPresense's documentation.
const MESSAGE: &str = r#"{"mac":"dd8800003777","id":"iBeacon:426c7565-4368-6172-6d42-6561636f6e73-3838-4949",
    "rssi@1m":-59,"rssi":-81.10,"rxAdj":0,"rssiVar":7.42,"distance":6.58,"var":4.00,"int":2028}"#;
const BEACON: &str = "iBeacon:426c7565-4368-6172-6d42-6561636f6e73-3838-4949";

fn flat() -> (Espresense, mpsc::Receiver<SourceReport>) {
    let (sender, receiver) = mpsc::channel(100);
    (Espresense::new(House::read(FLAT).expect("a house"), "home".to_owned(), sender), receiver)
}

/// What comes of a message.
async fn whats(of: &mut (Espresense, mpsc::Receiver<SourceReport>), topic: &str, payload: &str) -> Vec<ReportKind> {
    of.0.take(topic, payload.as_bytes(), false).await;
    let mut whats = Vec::new();
    while let Ok(report) = of.1.try_recv() {
        assert_eq!(report.site, "home");
        whats.push(report.what);
    }
    whats
}

#[tokio::test]
async fn a_message_becomes_a_report_of_its_receiver() {
    let mut flat = flat();
    let topic = format!("espresense/devices/{BEACON}/living_room");
    let sighting = ReportKind::ReceiverSighting {
        receiver: "living_room".to_owned(),
        device: BEACON.to_owned(),
        rssi_dbm: -81.1,
        rssi_1m_dbm: Some(-59.0),
    };
    assert_eq!(whats(&mut flat, &topic, MESSAGE).await, [sighting]);
}

#[tokio::test]
async fn a_device_gets_its_name_once_and_from_the_file_first() {
    let mut flat = flat();
    let topic = "espresense/devices/irk:1/bedroom";
    let first = whats(&mut flat, topic, r#"{"name": "phone", "rssi": -60}"#).await;
    let name = |what: &ReportKind| match what {
        ReportKind::Node { node, name, role: NodeRole::Tag, .. } => Some((node.clone(), name.clone())),
        _ => None,
    };
    assert_eq!(first.len(), 2);
    assert_eq!(name(&first[0]), Some(("irk:1".to_owned(), Some("Ana".to_owned()))));
    assert_eq!(whats(&mut flat, topic, r#"{"name": "phone", "rssi": -60}"#).await.len(), 1);
}

#[tokio::test]
async fn receivers_of_another_floor_say_nothing_of_a_place_on_this_one() {
    let mut flat = flat();
    let [ground, upper] = ["living_room", "bedroom"].map(|node| format!("espresense/devices/{BEACON}/{node}"));
    assert_eq!(whats(&mut flat, &ground, r#"{"rssi": -60}"#).await.len(), 1);
    assert_eq!(whats(&mut flat, &upper, r#"{"rssi": -75}"#).await.len(), 0);
    assert_eq!(whats(&mut flat, &upper, r#"{"rssi": -50}"#).await.len(), 1);
}

#[tokio::test]
async fn garbage_is_refused_and_the_next_message_is_taken() {
    let mut flat = flat();
    let topic = format!("espresense/devices/{BEACON}/living_room");
    let garbage =
        ["", "no JSON", r#"{"rssi": NaN}"#, r#"{"rssi": 1e999}"#, r#"{"rssi": 40}"#, r#"{"rssi": "x"}"#, "[]", "\u{0}"];
    for payload in garbage {
        assert_eq!(whats(&mut flat, &topic, payload).await, [], "{payload}");
    }
    // The first one was logged, and the others wait for the next line.
    assert_eq!(flat.0.refused, garbage.len() as u64 - 1);
    let others = ["espresense/devices", "espresense/devices/a", "espresense/rooms/x/y", "espresense/devices/a/b/c", ""];
    for topic in others {
        assert_eq!(whats(&mut flat, topic, MESSAGE).await, [], "{topic}");
    }
    let long = format!("espresense/devices/iBeacon:{}/living_room", "x".repeat(60));
    assert_eq!(whats(&mut flat, &long, MESSAGE).await, []);
    // A message about a battery is none of ours, and no garbage.
    assert_eq!(whats(&mut flat, &topic, r#"{"batt": 97}"#).await, []);
    assert_eq!(flat.0.refused, garbage.len() as u64);
    // A name that is none is left out.
    let named = format!(r#"{{"rssi": -70, "name": "{}"}}"#, "x".repeat(65));
    assert_eq!(whats(&mut flat, &topic, &named).await.len(), 1);
}

#[tokio::test]
async fn unknown_receivers_and_unwanted_devices_are_left_out() {
    let mut flat = flat();
    assert_eq!(whats(&mut flat, &format!("espresense/devices/{BEACON}/attic"), MESSAGE).await, []);
    assert_eq!(whats(&mut flat, "espresense/devices/tile:1/living_room", MESSAGE).await, []);
    assert!(flat.0.strangers.contains("attic") && flat.0.refused == 0);
}
