//! `baliza serve --mqtt` at a real broker: what the tests of the station's crate cannot see.

use std::process::Command;
use std::time::Duration;

use serde_json::json;

use self::mosquitto::Mosquitto;
use crate::serve::Station;
use crate::support::{Folder, PATIENCE, root};

#[allow(dead_code)]
#[path = "../../../../station/tests/mqtt/mosquitto.rs"]
mod mosquitto;

#[test]
fn a_killed_station_is_offline_and_a_stopped_one_says_so() {
    let Some(broker) = Mosquitto::start() else { return };
    let folder = Folder::with(&[]);
    let all = broker.listen();
    let url = format!("mqtt://127.0.0.1:{}", broker.port);
    let is =
        |payload: &'static str| move |seen: &mosquitto::Seen| seen.topic == "baliza/status" && seen.payload == payload;
    let mut station = Station::start(&folder, &format!("--simulate --mqtt {url}"));
    all.wait("online", is("online"));
    // A position of the simulation, as the API has it.
    let position = all.first("baliza/simulation/tags/0x1001/position").json();
    let tags = station.json("/api/v1/tags");
    let live = tags.as_array().expect("a list").iter().find(|tag| tag["tag"] == "0x1001").expect("it is there");
    let keys = |value: &serde_json::Value| value.as_object().expect("an object").keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&position), keys(&live["last_position"]));
    all.wait("the room", |seen| seen.topic.ends_with("/0x1001/room") && seen.json()["room"] == json!("room 1"));
    station.kill();
    all.wait("the last will", is("offline"));

    all.forget();
    let station = Station::start(&folder, &format!("--simulate --mqtt {url}"));
    all.wait("online", is("online"));
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");
    all.wait("offline", is("offline"));
}

#[test]
fn a_station_goes_on_without_its_broker_and_never_says_the_password() {
    let Some(broker) = Mosquitto::with_user("me", "right") else { return };
    let folder = Folder::with(&[("password", "a-wrong-secret\n")]);
    let flags = format!("--mqtt mqtt://me@127.0.0.1:{} --mqtt-password-file password", broker.port);
    let mut station = Station::start(&folder, &format!("--simulate {flags}"));
    station.wait("/api/v1/tags", |tags| tags.as_array().is_some_and(|tags| tags.len() == 5));
    let told = station.wait_for_line("the broker refuses the user me");
    let (code, rest) = station.stop();
    let said = told + &rest;
    assert_eq!(code, Some(0), "{said}");
    assert!(!said.contains("a-wrong-secret"), "{said}");
}

#[test]
fn wrong_flags_of_mqtt_are_refused_without_the_password() {
    let folder =
        Folder::with(&[("no.pem", "text"), ("config.yaml", "floors:\n  - id: a\nnodes: 7\n"), ("empty.yaml", "")]);
    for (arguments, told) in [
        ("--mqtt http://me:secret@broker", "--mqtt"),
        ("--mqtt me:secret@broker", "--mqtt"),
        ("--mqtt mqtt://broker --mqtt-prefix a/#", "--mqtt-prefix"),
        ("--mqtt mqtt://broker --mqtt-discovery +", "--mqtt-discovery"),
        ("--mqtt mqtt://broker --mqtt-every-s 3601", "--mqtt-every-s"),
        ("--mqtt mqtt://broker --mqtt-every-s NaN", "--mqtt-every-s"),
        ("--mqtt mqtt://broker --mqtt-ca no.pem", "--mqtt-ca"),
        ("--mqtt mqtts://broker --mqtt-ca no.pem", "no.pem"),
        ("--mqtt mqtts://broker --mqtt-ca missing.pem", "missing.pem"),
        ("--mqtt mqtt://broker --mqtt-password-file missing", "missing"),
        ("--mqtt mqtt://broker --espresense missing.yaml", "missing.yaml"),
        ("--mqtt mqtt://broker --espresense config.yaml", "config.yaml:3"),
        ("--mqtt mqtt://broker --espresense empty.yaml", "empty.yaml: "),
        ("--espresense config.yaml", "--mqtt"),
    ] {
        let run = folder.run(&format!("serve {arguments}"));
        assert_eq!(run.code, Some(2), "{arguments}: {run:?}");
        assert!(run.stderr.contains(told) && !run.stderr.contains("secret"), "{arguments}: {}", run.stderr);
    }
}

#[test]
fn the_page_about_home_assistant_works_as_written() {
    let page = std::fs::read_to_string(root().join("docs/use/station/home-assistant.md")).expect("the page");
    let Some(broker) = Mosquitto::with_user("baliza", "secret") else { return };
    let folder = Folder::with(&[("password", "secret\n")]);
    std::fs::create_dir_all(folder.path("examples/espresense")).expect("a folder");
    let example = std::fs::read(root().join("examples/espresense/config.yaml")).expect("the example");
    folder.write("examples/espresense/config.yaml", &example);

    let serve = page.lines().find_map(|line| line.strip_prefix("baliza serve ")).expect("the command");
    let station = Station::start(&folder, &serve.replace("homeassistant.local", &format!("127.0.0.1:{}", broker.port)));
    station.wait("/api/v1/nodes", |nodes| {
        let is_receiver = |node: &&serde_json::Value| node["role"] == "receiver";
        nodes.as_array().is_some_and(|nodes| nodes.iter().filter(is_receiver).count() == 3)
    });
    let rooms = station.json("/api/v1/rooms");
    assert_eq!(rooms.as_array().map(Vec::len), Some(2), "{rooms}");
    broker.listen().first("baliza/status");

    let lines: Vec<_> = page.lines().filter(|line| line.starts_with("mosquitto_")).collect();
    assert!(lines.len() >= 6, "{lines:?}");
    let (says, sees): (Vec<&str>, Vec<&str>) = lines.iter().partition(|line| line.starts_with("mosquitto_pub"));
    let run = |line: &str| {
        let here = line.replace("-h homeassistant.local", &format!("-h 127.0.0.1 -p {}", broker.port));
        let output = Command::new("timeout").args(["180", "sh", "-c", &here]).current_dir(folder.path("")).output();
        let output = output.expect("a shell");
        assert!(output.status.success(), "{line}: {output:?}");
    };
    // Receivers say it about once a second.
    let begun = std::time::Instant::now();
    let position = loop {
        says.iter().copied().for_each(run);
        let tags = station.json("/api/v1/tags");
        let position = &tags[0]["last_position"];
        if position.is_object() {
            break position.clone();
        }
        assert!(begun.elapsed() < PATIENCE, "{tags}");
        std::thread::sleep(Duration::from_millis(500));
    };
    // Nearest to the receiver in the kitchen, which is the left part of the flat: x is at most 4 m.
    assert!(position["x_m"].as_f64().is_some_and(|x_m| x_m < 4.0), "{position}");
    sees.iter().copied().for_each(run);
}
