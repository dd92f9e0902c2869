//! Positions for maps and viewers: GPX and MCAP of the store, NMEA and Foxglove of the running station.

use std::io::{BufRead, BufReader};
use std::net::TcpStream;

use serde_json::{Value, json};

use crate::foxglove_client::{connect, json_of, messages, wait};
use crate::serve::Station;
use crate::store::with_store;
use crate::support::Folder;

/// A site at the equator and the prime meridian, whose y axis points north.
const SITE: &str = "[network]\npan = 1\nregion = \"none\"\n[[node]]\nname = \"tag\"\nboard = \"dwm1001\"\n\
                    role = \"tag\"\naddress = 0x1001\n[geographic_origin]\nlatitude_deg = 0\nlongitude_deg = 0\n\
                    y_azimuth_deg = 0\nheight_m = 10.0\n";

/// Degrees of a point near that origin, 10 m high: the earth's radii there are a = 6,378,137 m to the east, and to the
/// north a (1 - e²) = 6,335,439 m. Within 40 m the curvature is below a nanodegree.
fn degrees([x_m, y_m]: [f64; 2]) -> [f64; 2] {
    [(y_m / 6_335_449.3).to_degrees(), (x_m / 6_378_147.0).to_degrees()]
}

/// Gives the site of the store `tags.db` its geographic origin by a site's file.
fn with_origin(folder: &Folder) {
    folder.write("site.toml", SITE.as_bytes());
    let (code, said) = Station::start(folder, "--store tags.db --site site.toml").stop();
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn a_history_becomes_tracks_on_the_earth() {
    let (folder, positions) = with_store();
    let run = folder.run("station export --store tags.db --format gpx --out tags.gpx");
    assert!(run.code == Some(2) && run.stderr.contains("has no geographic origin"), "{run:?}");
    with_origin(&folder);
    folder.run("station export --store tags.db --format gpx --out tags.gpx").ok();
    let read = gpx::read(folder.read("tags.gpx").as_slice()).expect("GPX");
    let [track] = read.tracks.as_slice() else { panic!("{read:?}") };
    assert_eq!(track.name.as_deref(), Some("0x1001"));
    let points: Vec<_> = track.segments.iter().flat_map(|segment| &segment.points).collect();
    assert_eq!(points.len(), positions.len());
    for (point, position) in points.iter().zip(positions) {
        let [latitude, longitude] = degrees(position);
        // 1.5 mm, by which the store rounds, are 1.4e-8°.
        let (found_latitude, found_longitude) = (point.point().y(), point.point().x());
        assert!(
            (found_latitude - latitude).abs() < 1.6e-8 && (found_longitude - longitude).abs() < 1.6e-8,
            "{point:?}"
        );
    }
    let times: Vec<_> = points.iter().map(|point| point.time).collect();
    assert!(times.iter().all(Option::is_some));

    // To standard output, and only of a part; a tag without positions has no track.
    let printed = folder.run("station export --store tags.db --format gpx --tag 0x1001 --out -").ok().stdout;
    assert_eq!(printed.as_bytes(), folder.read("tags.gpx"));
    let run = folder.run("station export --store tags.db --format gpx --to 2026-01-01T00:00:00Z --out none.gpx");
    assert!(run.code == Some(2) && run.stderr.contains("no positions in this time"), "{run:?}");
    let names = folder.names();
    assert!(!names.iter().any(|name| name.contains("none") || name.contains(".tmp")), "{names:?}");
}

#[test]
fn what_a_person_has_put_stays_where_the_sites_file_has_another_geographic_origin() {
    let folder =
        Folder::with(&[("site.toml", SITE), ("moved.toml", &SITE.replace("latitude_deg = 0", "latitude_deg = 1"))]);
    let origin = |station: &Station| station.json("/scenarios")[0]["geographic_origin"].clone();
    let expected = json!({"latitude_deg": 0.0, "longitude_deg": 0.0, "y_azimuth_deg": 0.0, "height_m": 10.0});
    let station = Station::start(&folder, "--site site.toml");
    assert_eq!(origin(&station), expected);
    station.stop();
    let station = Station::start(&folder, "--site moved.toml");
    assert_eq!(origin(&station), expected);
    assert!(station.said().contains("site: the store has another geographic origin than --site"), "{}", station.said());
}

#[test]
fn a_history_becomes_an_mcap_file() {
    let (folder, positions) = with_store();
    let export = "station export --store tags.db --format mcap --out";
    let without = folder.run(&format!("{export} plain.mcap")).ok();
    assert!(without.stderr.contains("positions of 1 tags of site, in plain.mcap"), "{}", without.stderr);
    assert!(!messages(&folder.read("plain.mcap")).contains_key("/0x1001/location"));
    with_origin(&folder);
    folder.run(&format!("{export} tags.mcap")).ok();
    let messages = messages(&folder.read("tags.mcap"));
    let rows = &messages["/0x1001/position"];
    assert_eq!(rows.len(), positions.len());
    for ((schema, t_ns, row), [x_m, y_m]) in rows.iter().zip(&positions) {
        let row = json_of(row);
        let number = |key: &str| row[key].as_f64().expect("a number");
        assert_eq!(schema, "baliza.Position");
        assert!((number("x_m") - x_m).abs() < 1.5e-3 && (number("y_m") - y_m).abs() < 1.5e-3, "{row}");
        assert!((number("t_s") - *t_ns as f64 / 1e9).abs() < 1e-3, "{row}");
    }
    for (topic, name) in [
        ("/0x1001/pose", "foxglove.PoseInFrame"),
        ("/0x1001/uncertainty", "foxglove.SceneUpdate"),
        ("/0x1001/location", "foxglove.LocationFix"),
    ] {
        assert!(messages[topic].iter().all(|(schema, ..)| schema == name), "{topic}");
        assert_eq!(messages[topic].len(), positions.len(), "{topic}");
    }
    // Protobuf: latitude and longitude are doubles, of field 1 and 2 (keys 0x09 and 0x11).
    let fix = &messages["/0x1001/location"][0].2;
    let double = |key: u8| {
        let at = fix.iter().position(|byte| *byte == key).expect("the field");
        f64::from_le_bytes(fix[at + 1..at + 9].try_into().expect("eight bytes"))
    };
    let [latitude, longitude] = degrees(positions[0]);
    assert!((double(0x09) - latitude).abs() < 1.6e-8 && (double(0x11) - longitude).abs() < 1.6e-8, "{fix:?}");
}

#[test]
fn a_running_station_sends_nmea_and_draws_in_foxglove() {
    let folder = Folder::with(&[]);
    let station = Station::start(
        &folder,
        "--simulate --nmea 0x1001@127.0.0.1:0 --nmea 0x1002@127.0.0.1:0 --foxglove 127.0.0.1:0",
    );
    let after = |begin: &str| {
        let said = station.said().lines().find_map(|line| line.strip_prefix(begin));
        said.unwrap_or_else(|| panic!("{}", station.said())).to_owned()
    };
    let nmea = |tag: &str| {
        let stream = TcpStream::connect(after(&format!("nmea of {tag}: tcp://"))).expect("connected");
        stream.set_read_timeout(Some(crate::support::PATIENCE)).expect("set");
        BufReader::new(stream).lines().map(|line| line.expect("a line"))
    };
    // No geographic origin so far.
    let void = nmea("0x1001").find(|line| line.starts_with("$GNRMC")).expect("a line");
    assert!(void.contains(",V,"), "{void}");
    let origin = r#"{"latitude_deg": 40.5, "longitude_deg": -3.75, "y_azimuth_deg": 0, "height_m": 650}"#;
    station.send("PUT", "/api/v1/sites/simulation/geographic-origin", origin);
    for tag in ["0x1001", "0x1002"] {
        // Within some metres of 40°30' north and 3°45' west, the simulated room's size.
        let fix = nmea(tag).find(|line| line.starts_with("$GNGGA") && !line.contains(",,,,,0,00,")).expect("a line");
        assert!(fix.contains(",4030.00") && fix.contains(",N,00344.99") && fix.contains(",W,1,"), "{fix}");
    }

    let mut client = connect(&after("foxglove: "));
    let mut topics = Vec::new();
    while !["/anchors", "/0x1001/pose", "/0x1002/location"].iter().all(|topic| topics.iter().any(|one| one == topic)) {
        let advertised = wait(&mut client, |message| match message {
            tungstenite::Message::Text(text) => serde_json::from_str::<Value>(text).ok(),
            _ => None,
        });
        let channels = advertised["channels"].as_array().cloned().unwrap_or_default();
        topics.extend(channels.iter().filter_map(|channel| channel["topic"].as_str().map(str::to_owned)));
    }
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn viewers_from_other_computers_have_to_be_allowed() {
    let folder = Folder::with(&[]);
    for (arguments, expected) in [
        ("--nmea 0x1001@0.0.0.0:0", "--nmea: 0.0.0.0:0 can be reached from other computers"),
        ("--foxglove 0.0.0.0:0", "--foxglove: 0.0.0.0:0 can be reached from other computers"),
        ("--nmea 127.0.0.1:10110", "TAG@ADDRESS:PORT"),
        ("--nmea @127.0.0.1:10110", "TAG@ADDRESS:PORT"),
        ("--nmea 0x1001@localhost", "TAG@ADDRESS:PORT"),
    ] {
        folder.run(&format!("serve --simulate --listen 127.0.0.1:0 {arguments}")).refused(expected);
    }
    let station = Station::start(&folder, "--simulate --nmea 0x1001@0.0.0.0:0 --viewers-unprotected");
    assert!(station.said().contains("nmea of 0x1001: tcp://0.0.0.0:"), "{}", station.said());
}
