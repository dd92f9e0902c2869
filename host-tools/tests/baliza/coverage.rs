//! `baliza coverage` and `baliza plan-anchors`.

use crate::support::Folder;

const BEACONS: &str = "beacon,x_m,y_m,rssi_1m_dbm,path_loss_exponent\na,0,0,-60,2\nb,8,0,-60,2\nc,4,6,-60,2\n";
const FINGERPRINTS: &str = "point,x_m,y_m,beacon,rssi_dbm\np,1,0,a,-61\np,1,0,b,-75\nq,5,0,a,-72\nq,5,0,a,127\n";

#[test]
fn maps_are_measured_or_simulated_and_both_are_compared() {
    let folder = Folder::with(&[("b.csv", BEACONS), ("f.csv", FINGERPRINTS), ("w.csv", "x_m,y_m\n3,-1\n3,5\n")]);
    let json = folder.run("coverage --fingerprints f.csv --json").ok().json();
    assert_eq!((&json[0]["source"], &json[1]), (&"measured".into(), &serde_json::Value::Null));
    assert_eq!(json[0]["beacons"][0]["heard"], 1.0, "{json}");

    let run =
        folder.run("coverage --fingerprints f.csv --beacons b.csv --walls w.csv --json --plot m.png --out m.csv").ok();
    let json = run.json();
    assert_eq!(json[1]["source"], "simulated");
    // a: −60 at 1 m (1 dB more than measured), −60 − 13.979400 − 4 behind the wall at 5 m (5.979400 less): mean
    // −2.489700.
    let bias = json[1]["beacons"][0]["bias_db"].as_f64().expect("a number");
    assert!((bias + 2.4897).abs() < 1e-4, "{json}");
    assert_eq!(json[1]["beacons"][2]["bias_db"], serde_json::Value::Null);
    assert!(json[1]["error_p50_m"].as_f64().is_some_and(|error| (0.5..4.0).contains(&error)), "{json}");
    assert!(folder.read("m.png").starts_with(b"\x89PNG"));
    let cells = String::from_utf8(folder.read("m.csv")).expect("text");
    assert!(cells.starts_with("source,x_m,y_m,heard,error_m,a,b,c\nmeasured,"), "{}", &cells[..80]);

    let refused = |arguments: &str, said: &str| {
        let run = folder.run(arguments);
        assert_eq!((run.code, run.stderr.trim_end()), (Some(2), said));
    };
    refused("coverage --beacons b.csv --of x", "--of: \"x\" is neither mean, heard, error nor a beacon: a, b, c");
    refused("coverage --fingerprints f.csv --of error", "--of: the least error needs the beacons' places: --beacons");
    let run = folder.run("coverage --beacons b.csv --cell-m 0.01");
    assert!(run.code == Some(2) && run.stderr.starts_with("--cell-m: "), "{run:?}");
}

#[test]
fn places_are_found_among_candidates_or_everywhere() {
    let folder = Folder::with(&[("b.csv", BEACONS)]);
    let json = folder.run("plan-anchors --count 1 --fixed b.csv --area 0,0,8,6 --plot p.svg --json").ok().object();
    assert_eq!((&json["kind"], &json["cells"], &json["candidates"]), (&"beacons".into(), &192.into(), &63.into()));
    assert!(json["error_mean_m"].as_f64() < json["before_m"].as_f64(), "{json}");
    assert!(folder.read("p.svg").starts_with(b"<svg"));

    // Two of three candidates are chosen, but never the candidate beside another one.
    let candidates = "beacon,x_m,y_m\nleft,0,3\nleft-too,0.1,3\nabove,4,6\n";
    folder.write("c.csv", candidates.as_bytes());
    let run = folder.run("plan-anchors --count 2 --kind anchors --candidates c.csv --area 0,0,8,6 --json").ok();
    let names: Vec<_> = run.object()["places"].as_array().expect("a list").iter().map(|p| p["name"].clone()).collect();
    assert!(names.contains(&"above".into()), "{names:?}");
    assert!(folder.run("place --count 2 --candidates c.csv").ok().stdout.contains("3 candidates"));
    // A plan is a file for `simulate`, for the next plan and for `solve`; on the walls only, at a height.
    let plan = "plan-anchors --count 3 --kind anchors --area 0,0,8,6 --on-walls --spacing-m 2 --height-m 2.4";
    let run = folder.run(&format!("{plan} --out a.csv")).ok();
    // Along the outline every two metres: 4 + 3 + 4 + 3 positions.
    assert!(run.stdout.contains("14 candidates"), "{}", run.stdout);
    let anchors = String::from_utf8(folder.read("a.csv")).expect("text");
    let mut rows = anchors.lines();
    assert_eq!(rows.next(), Some("anchor,x_m,y_m,z_m"));
    let mut count = 0;
    for row in rows {
        let fields: Vec<_> = row.split(',').collect();
        let is_on_wall = ["0.0000", "8.0000"].contains(&fields[1]) || ["0.0000", "6.0000"].contains(&fields[2]);
        assert!(is_on_wall && fields[0].starts_with("anchor-") && fields[3] == "2.4000", "{row}");
        count += 1;
    }
    assert_eq!(count, 3);
    folder.run("plan-anchors --count 1 --kind anchors --area 0,0,8,6 --fixed a.csv").ok();
    folder.run(&format!("{plan} --out plan.toml")).ok();
    let simulated = folder.run("simulate --scenario plan.toml --seconds 2 --json").ok().object();
    assert_eq!(simulated["anchors"], 3);
    assert!(simulated["fixes"].as_u64().is_some_and(|fixes| fixes > 0), "{simulated}");
    let run = folder.run("plan-anchors --count 1 --area 0,0,8,6 --out plan.toml");
    assert!(run.code == Some(2) && run.stderr.starts_with("--height-m: a scenario needs"), "{run:?}");

    let run = folder.run("place --count 2");
    assert_eq!(
        (run.code, run.stderr.trim_end()),
        (Some(2), "--area: say where tags are, or give --walls or --candidates")
    );
}
