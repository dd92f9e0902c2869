//! What goes into a tag's record or beside it: calibrated beacons and classifiers.

use super::{ANCHOR, refused};
use crate::support::Folder;

/// A tag, a beacon that is a node, and a listed beacon.
const WITH_BEACONS: &str = r#"
beacons_csv = "calibrated.csv"

[network]
pan = 0xBA11

[[node]]
name = "tag"
board = "dwm1001"
role = "tag"
scan_interval_ms = 100
scan_window_ms = 50

[[beacon]]
major = 7
minor = 1
position_m = [1, 2, 3]
path_loss_exponent = 2.5
"#;

#[test]
fn calibrated_beacons_go_into_the_tags_record() {
    let calibrated =
        "beacon,x_m,y_m,z_m,rssi_1m_dbm,path_loss_exponent\n000000b0-7-1,9,9,,-61.5,3\n7-2,4,5,2.5,-55,2.25\n";
    let folder = Folder::with(&[("site.toml", WITH_BEACONS), ("calibrated.csv", calibrated)]);
    folder.run("provision --config site.toml --out tag.bin").ok();
    let json = folder.run("provision --show tag.bin --json").ok().object();
    // The listed values have precedence, and the missing ones come from the calibration. The other beacon is added.
    let expected = serde_json::json!([
        { "major": 7, "minor": 1, "position_m": [1.0, 2.0, 3.0], "rssi_1m_dbm": -61.5, "path_loss_exponent": 2.5 },
        { "major": 7, "minor": 2, "position_m": [4.0, 5.0, 2.5], "rssi_1m_dbm": -55.0, "path_loss_exponent": 2.25 },
    ]);
    assert_eq!(json["beacon"], expected, "{json}");

    let refused = |text: &str, said: &str| {
        folder.write("calibrated.csv", text.as_bytes());
        let run = folder.run("provision --config site.toml --out other.bin");
        assert_eq!((run.code, run.stderr.trim_end()), (Some(2), said));
    };
    refused(
        "beacon,x_m,y_m\n7-3,4,5\n",
        "site.toml:2: beacon 7-3 of the file has no z_m: add its height there, or list it as [[beacon]]",
    );
    refused(
        "beacon,x_m,y_m,z_m\nB,4,5,2\n",
        "calibrated.csv: beacon \"B\" is not named by its numbers: major-minor, or network-major-minor as decode has it",
    );
}

/// A file of two classifiers that a node can hold, one that is too large and one of a kind that a node cannot hold.
fn classifiers() -> Vec<u8> {
    use positioning_core::nlos::{Feature, Input, Inputs, Kind, Model, Nearest, Platt, PowerDifference, Skewness};
    let inputs = Inputs([Input { feature: Feature::Kurtosis, mean: 3.0, deviation: 1.0 }].into_iter().collect());
    let kinds = [
        Kind::PowerDifference(PowerDifference::default()),
        Kind::Skewness(Skewness::default()),
        Kind::Nearest(Nearest { inputs: inputs.clone(), neighbours: 3, los: &[0; 300], nlos: &[1; 300] }),
        Kind::Nearest(Nearest { inputs, neighbours: 47, los: &[0; 94], nlos: &[] }),
    ];
    let encoded = kinds.map(|kind| {
        let mut buffer = [0; 1024];
        Model { kind, calibration: Platt::NONE }.encode(&mut buffer).expect("it fits").to_vec()
    });
    encoded.concat()
}

#[test]
fn a_classifier_goes_beside_the_record_of_a_tag() {
    let site = |lines: &str| {
        format!("[network]\npan = 0xBA11\n\n[[node]]\nname = \"t\"\nboard = \"dwm1001\"\nrole = \"tag\"\n{lines}")
    };
    let folder = Folder::with(&[("site.toml", &site(""))]);
    folder.write("nlos.model", &classifiers());
    folder.run("provision --config site.toml --out plain.bin").ok();
    folder.write("site.toml", site("nlos_model = \"nlos.model\"\nnlos_classifier = \"skewness\"\n").as_bytes());
    for (format, file) in [("bin", "t.bin"), ("hex", "t.hex")] {
        folder.run(&format!("provision --config site.toml --format {format} --out {file}")).ok();
        let run = folder.run(&format!("provision --show {file}")).ok();
        assert!(run.stdout.contains("\n# nlos_model: skewness (skewness_near)\n"), "{}", run.stdout);
        let run = folder.run(&format!("provision --show {file} --json")).ok();
        assert_eq!(run.object()["nlos_model"], "skewness (skewness_near)");
        let run = folder.run(&format!("provision --check {file}")).ok();
        assert!(run.stdout.contains(", with skewness (skewness_near); version 2"), "{}", run.stdout);
    }
    // The record itself is the same as without the classifier, and the 30 bytes of the classifier follow it.
    let (plain, with) = (folder.read("plain.bin"), folder.read("t.bin"));
    let model = folder.read("nlos.model");
    assert_eq!(plain[..1280], with[..1280]);
    assert_eq!(with[1280..1310], model[25..55]);
    assert!(with[1310..4096].iter().chain(&plain[1280..4096]).all(|byte| *byte == 0xFF));
    let mut damaged = with.clone();
    damaged[1290] ^= 1;
    folder.write("damaged.bin", &damaged);
    refused(
        &folder.run("provision --check damaged.bin"),
        "damaged.bin: page 1 of 2: the record is whole, but beside it is ",
    );

    for (lines, said) in [
        (
            "nlos_model = \"nlos.model\"\n",
            "site.toml:8: nlos_model: ./nlos.model: it has several classifiers, name one of ",
        ),
        ("nlos_model = \"no.model\"\n", "site.toml:8: nlos_model: ./no.model: cannot open it: "),
        ("nlos_model = \"plain.bin\"\n", "site.toml:8: nlos_model: ./plain.bin: not a model"),
        ("nlos_classifier = \"skewness\"\n", "site.toml:8: nlos_classifier without nlos_model: "),
        (
            "nlos_model = \"nlos.model\"\nnlos_classifier = \"nearest-reduced\"\n",
            "site.toml:8: nlos_model has 632 bytes: a node has room for 400",
        ),
        (
            "nlos_model = \"nlos.model\"\nnlos_classifier = \"nearest\"\n",
            "site.toml:8: nlos_model is nearest, which nodes do not hold: it must be power-difference, skewness, logistic or quantised",
        ),
    ] {
        folder.write("site.toml", site(lines).as_bytes());
        refused(&folder.run("provision --config site.toml --out x.bin"), &said.replace("./", ""));
    }
    folder.write("site.toml", ANCHOR.replace("position_m", "nlos_model = \"nlos.model\"\nposition_m").as_bytes());
    refused(
        &folder.run("provision --config site.toml --out x.bin"),
        "site.toml:12: nlos_model is a key of a node whose role is tag",
    );
}
