//! `baliza ble rooms`.

use crate::support::{Folder, TWO_ROOMS, recording};

/// Two rooms with three points each, two beacons, ten adverts of each. The RSSI values decrease towards the other room.
fn survey() -> String {
    let mut text = String::from("point,room,x_m,y_m,beacon,rssi_dbm,t_s\n");
    for (point, room, x, levels) in TWO_ROOMS {
        for advert in 0..20 {
            for (beacon, level) in (1..).zip(levels) {
                let (level, t) = (level + advert % 3 - 1, f64::from(advert) * 0.25);
                text += &format!("{point},{room},{x},0,{beacon},{level},{t}\n");
            }
        }
    }
    text
}

#[test]
fn a_survey_classifies_itself_and_other_stays() {
    let stays = "point,room,x_m,y_m,beacon,rssi_dbm,t_s\n\
                 p,hall,1,0,1,-54,0\np,hall,1,0,2,-79,0.1\nq,attic,7,0,1,127,0\nq,attic,7,0,2,-55,0.3\nr,cellar,9,0,3,-50,0\n";
    let folder = Folder::with(&[("f.csv", &survey()), ("t.csv", stays)]);
    let run = folder.run("ble rooms --fingerprints f.csv --leave-one-out --json --plot m.svg --out rooms.model").ok();
    let json = run.object();
    assert_eq!((&json["method"], &json["accuracy"], &json["points"]), (&"svm".into(), &1.0.into(), &6.into()));
    assert_eq!(json["rooms"], serde_json::json!(["hall", "attic"]));
    assert_eq!(json["confusion_matrix"], serde_json::json!([[3, 0, 0], [0, 3, 0]]));
    // Times from 0 to 4.75 s: four complete windows of one second.
    assert_eq!((&json["windows"], &json["methods"][1]["method"]), (&24.into(), &"knn".into()));
    let model = folder.read("rooms.model");
    assert!(
        model.starts_with(b"RM\x01")
            && model.ends_with(
                br#"{"beacons":["1","2"],"rooms":["hall","attic"]}
"#
            )
    );
    assert!(folder.read("m.svg").starts_with(b"<svg"));

    // The written model gives the same results as the trained one.
    let of = |source: &str| folder.run(&format!("ble rooms --{source} --targets t.csv --json")).ok().object();
    let taught = of("fingerprints f.csv");
    let (first, row) = (&taught["methods"][0], of("model rooms.model"));
    assert_eq!((&row["methods"][0], row["methods"].as_array().map(Vec::len)), (first, Some(1)));
    folder.run("ble rooms --fingerprints f.csv --method knn --out knn.model").ok();
    assert_eq!(&of("model knn.model")["methods"][0], &taught["methods"][1]);

    // q received one beacon, and reports an invalid RSSI for the other. r received no known beacon, in a room that was
    // not surveyed.
    let json = folder.run("ble rooms --fingerprints f.csv --targets t.csv --json").ok().object();
    assert_eq!(json["rooms"], serde_json::json!(["hall", "attic", "cellar"]));
    assert_eq!(json["confusion_matrix"], serde_json::json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]));
    assert!(folder.run("ble rooms --fingerprints f.csv --targets t.csv").ok().stdout.contains("66.7 %"));
}

#[test]
fn an_error_is_one_line() {
    let folder = Folder::with(&[
        ("f.csv", &survey()),
        ("one.csv", "point,room,x_m,y_m,beacon,rssi_dbm\np,hall,1,0,1,-54\n"),
        ("none.csv", "point,x_m,y_m,beacon,rssi_dbm\np,1,0,1,-54\n"),
    ]);
    let refused = |arguments: &str, said: &str| {
        let run = folder.run(arguments);
        assert_eq!((run.code, run.stderr.trim_end()), (Some(2), said), "{arguments}");
    };
    refused(
        "ble rooms --fingerprints f.csv",
        "--targets: say what is to be judged: --targets FILE, --rssi FILE or --leave-one-out",
    );
    refused(
        "ble rooms --fingerprints one.csv --leave-one-out",
        "one.csv:1: its points are all in one room: there is nothing to tell apart",
    );
    refused("ble rooms --model f.csv --targets f.csv", "f.csv: not a model");
    refused(
        "ble rooms --fingerprints f.csv --targets none.csv",
        "none.csv:1: point \"p\" has no room: column room is needed",
    );
}

#[test]
fn a_walk_has_a_room_each_minute() {
    // Two minutes at point a in the hall, then a minute and a second at point f in the attic; four adverts a second.
    let (hall, attic) = (TWO_ROOMS[0].3, TWO_ROOMS[5].3);
    let mut walk = String::from("epoch,t_s,beacon,rssi_dbm,tag\n");
    for quarter in 0..=4 * 181 {
        let levels = if quarter < 4 * 120 { hall } else { attic };
        for (beacon, level) in (1..).zip(levels) {
            walk += &format!("{quarter},{},{beacon},{level},t\n", 100.0 + 0.25 * f64::from(quarter));
        }
    }
    let folder =
        Folder::with(&[("f.csv", &survey()), ("rssi.csv", &walk), ("short.csv", "epoch,beacon,rssi_dbm\n0,1,-50\n")]);
    let run = folder.run("ble rooms --fingerprints f.csv --rssi rssi.csv").ok();
    assert_eq!(run.column("t_s"), ["100.000", "160.000", "220.000", "280.000"]);
    assert_eq!(run.column("room"), ["hall", "hall", "attic", "attic"]);
    assert_eq!(run.column("answer"), ["hall", "hall", "attic", "attic"]);
    assert_eq!((run.column("share")[2], run.column("windows")[3], run.column("tag")[0]), ("1.000", "1", "t"));

    // By the model of that survey, in intervals of 90 s: the second one has 30 of 90 windows in the hall.
    folder.run("ble rooms --fingerprints f.csv --out rooms.model").ok();
    let json = folder.run("ble rooms --model rooms.model --rssi rssi.csv --every-s 90 --json").ok().object();
    let second = &json["intervals"][1];
    assert_eq!(
        (&second["room"], &second["share"], &second["t_s"]),
        (&"attic".into(), &0.666_667.into(), &190.0.into())
    );

    let refused = folder.run("ble rooms --model rooms.model --rssi short.csv");
    let said = "short.csv: it lasts less than a window of 1 s: has it the column t_s?";
    assert_eq!((refused.code, refused.stderr.trim_end()), (Some(2), said));
}

#[test]
fn rooms_of_a_recorded_floor_are_distinguished() {
    let Some(floor) = recording("linde_floor") else { return };
    let file = floor.join("fingerprints.csv");
    let json = Folder::with(&[])
        .run(&format!("ble rooms --fingerprints {} --leave-one-out --json", file.display()))
        .ok()
        .object();
    assert!(json["accuracy"].as_f64().is_some_and(|accuracy| accuracy >= 0.92), "{json}");
    // The windows change their room within a dwell, but the answers of the tag do not. Few answers are a wrong room.
    assert!(json["window_changes"].as_u64() > Some(0) && json["settled"]["changes"] == 0, "{json}");
    assert!(json["settled"]["wrong"].as_u64() < Some(19), "{json}");
}
