//! `baliza simulate`: what scripts use, files that `solve` reads, and errors with line numbers.

use crate::support::{Folder, without_flags};

const SCENARIO: &str = "[[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\n\
    [[node]]\nrole = \"anchor\"\nposition_m = [6, 0, 2]\n[[node]]\nrole = \"anchor\"\nposition_m = [6, 5, 2]\n\
    [[node]]\nrole = \"anchor\"\nposition_m = [0, 5, 2]\n\
    [[node]]\nrole = \"tag\"\nheight_m = 1.2\nsimulation = { path_m = [[2, 2, 1.2], [4, 3, 1.2]] }\n\
    [simulation]\nseconds = 2\n";

fn folder() -> Folder {
    Folder::with(&[("hall.toml", SCENARIO)])
}

#[test]
fn without_arguments_positions_move_and_a_summary_ends_it() {
    let run = folder().run("simulate").ok();
    assert!(run.stderr.starts_with("2 tags, 6 anchors, 10 s: "), "{}", run.stderr);
    let x = run.numbers("x_m");
    assert!(x.len() > 1000);
    let found = || x.iter().copied().filter(|x| x.is_finite());
    let (least, greatest) = (found().fold(f64::INFINITY, f64::min), found().fold(f64::NEG_INFINITY, f64::max));
    assert!(greatest - least > 5.0, "from {least} to {greatest} m");
    let reasons = run.column("reason");
    assert!(x.iter().zip(reasons).all(|(x, reason)| x.is_nan() != reason.is_empty()), "a position or a reason");
}

#[test]
fn json_has_the_keys_of_the_contract_and_nothing_else_is_printed() {
    let run = folder().run("simulate --json --seconds 1 --anchors 5 --tags 1").ok();
    let keys = [
        "tags",
        "anchors",
        "seconds",
        "fixes",
        "fixes_per_s",
        "rmse_m",
        "p50_m",
        "p90_m",
        "mae_m",
        "inside_1_sigma",
        "nees",
        "frames_sent",
        "frames_lost",
        "collisions",
        "airtime_share",
        "airtime_share_max",
        "tags_joined",
        "joined_s",
        "tag_mean_current_ma",
        "charge_per_fix_uc",
    ];
    const PARTS: &str = "tag_currents_ma";
    let json = run.object();
    let object = json.as_object().expect("an object");
    // Greedy tags have no number of slots to compare with, these tell no position, nobody sends them messages, and nobody
    // attacks them.
    let none = [
        "slots_with_fix",
        "uplink_share",
        "uplink_p99_s",
        "data_share",
        "message_share",
        "message_p99_s",
        "forged_frames",
        "forged_accepted",
    ];
    assert!(none.iter().all(|key| object[*key].is_null()));
    assert_eq!(object.len(), keys.len() + none.len() + 1);
    let currents = object[PARTS].as_object().expect("currents by what they go for");
    let sum: f64 = currents.values().filter_map(serde_json::Value::as_f64).sum();
    // Eight values, each rounded to a millionth.
    assert!((sum - object["tag_mean_current_ma"].as_f64().unwrap()).abs() < 4.1e-6, "{object:?}");
    assert!(keys.iter().all(|key| object.get(*key).is_some_and(serde_json::Value::is_number)), "{object:?}");
    assert_eq!((&object["tags"], &object["anchors"], &object["seconds"]), (&1.into(), &5.into(), &1.0.into()));
    assert_eq!(run.stderr, "");
}

#[test]
fn a_solver_is_what_the_tags_records_say() {
    let folder = folder();
    let run = |arguments: &str| folder.run(&format!("simulate --scenario hall.toml {arguments}"));
    for name in ["robust", "b-wls", "b-wls-r", "bounding-box"] {
        let by_solver = run(&format!("--solver {name}")).ok();
        assert!(by_solver.column("method").iter().all(|method| *method == name), "{name}");
        assert_eq!(by_solver.stdout, run(&format!("--method {name}")).ok().stdout);
    }
    let track = run("--solver track").ok();
    assert_eq!(track.stdout, run("").ok().stdout);
    assert!(track.column("method").iter().all(|method| *method == "track"));
    assert_ne!(run("--solver nls").code, Some(0), "no node holds that method");
    let listening = folder.run("simulate --mode listening --solver b-wls");
    assert_eq!(listening.code, Some(2));
    assert!(listening.stderr.starts_with("--solver: tags that only listen "), "{}", listening.stderr);
}

#[test]
fn the_site_that_provision_prints_is_simulated_with_a_picture_and_provisioned() {
    let folder = Folder::with(&[]);
    folder.run("provision --example --out site.toml").ok();
    let run = folder.run("simulate --site site.toml --plot site.svg --json --seconds 5").ok();
    let summary = run.object();
    assert_eq!((&summary["tags"], &summary["anchors"]), (&1.into(), &4.into()));
    // Ten positions a second, as the tag's record asks for, once it has joined.
    assert!(summary["fixes"].as_u64().is_some_and(|fixes| fixes > 30), "{summary}");
    assert!(summary["p50_m"].as_f64().is_some_and(|p50_m| p50_m < 0.3), "{summary}");
    assert_eq!(summary["bluetooth"]["beacons"], 1);
    let picture = String::from_utf8(folder.read("site.svg")).expect("text");
    assert!(picture.contains("0x0104") && picture.contains("<polyline"), "the anchors and the walk");
    // The older name of the flag, and the default walk with a table of a simulation.
    let table = b"\n[simulation]\nseconds = 5\n";
    folder.write("longer.toml", &[&folder.read("site.toml"), &table[..]].concat());
    assert_eq!(folder.run("simulate --scenario longer.toml --json").ok().stdout, run.stdout);
    for site in ["site.toml", "longer.toml"] {
        folder.run(&format!("provision --config {site} --all --out records --force")).ok();
        let check = folder.run("provision --check records/tag-1.bin").ok();
        assert!(check.stdout.contains("good: tag 0x0201 of network 0xBA11"), "{}", check.stdout);
    }
}

#[test]
fn what_only_a_simulation_has_is_not_provisioned_and_an_incomplete_site_is_refused() {
    let folder = folder();
    let run = folder.run("provision --config hall.toml --all --board dwm1001 --out records");
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), "hall.toml:1: network is missing\n"));
    let neighbour = "[[node]]\nrole = \"anchor\"\naddress = 9\nsimulation = { network = 1 }\nposition_m = [9, 9, 2]\n";
    let more = "[[simulation.network]]\npan = 7\n[network]\npan = 6\nregion = \"none\"\n";
    let named = ["a", "b", "c", "d", "t"].into_iter().zip(1..).fold(SCENARIO.to_owned(), |text, (name, address)| {
        text.replacen("[[node]]\nrole", &format!("[[node]]\nname = \"{name}\"\naddress = {address}\nrole"), 1)
    });
    folder.write("two.toml", format!("{named}{neighbour}{more}").as_bytes());
    folder.run("provision --config two.toml --all --board dwm1001 --out records").ok();
    assert_eq!(std::fs::read_dir(folder.path("records")).expect("a folder").count(), 5);
    let summary = folder.run("simulate --site two.toml --fidelity air --json").ok().object();
    assert_eq!((&summary["anchors"], &summary["tags"]), (&5.into(), &1.into()));
}

/// Beacons in the corners instead of anchors.
fn beacons() -> String {
    let site = SCENARIO.replace("\"anchor\"", "\"beacon\"").replace("seconds = 2", "seconds = 4\nfidelity = \"air\"");
    site.replace("height_m = 1.2", "height_m = 1.2\nscan_interval_ms = 1000")
}

#[test]
fn beacons_alone_give_positions_a_summary_of_theirs_and_files_for_ble_solve() {
    let folder = folder();
    folder.write("beacons.toml", beacons().as_bytes());
    let run = folder.run("simulate --scenario beacons.toml --json").ok();
    let bluetooth = &run.object()["bluetooth"];
    assert_eq!((&bluetooth["beacons"], &bluetooth["by_anchors"]["fixes"]), (&4.into(), &0.into()));
    let fixes = bluetooth["by_beacons"]["fixes"].as_u64().expect("a number");
    // Two positions a second.
    assert!((6..=8).contains(&fixes), "{fixes}");
    let run = folder.run("simulate --scenario beacons.toml --out out --plot room.svg").ok();
    assert!(run.stderr.contains("by beacons alone: "), "{}", run.stderr);
    assert!(String::from_utf8_lossy(&folder.read("room.svg")).contains("beacons"));
    let files = "--beacons out/beacons.csv --rssi out/rssi.csv --truth out/truth.csv";
    let solved = folder.run(&format!("ble solve {files} --json")).ok();
    assert!(solved.json()[0]["fixed"].as_u64().is_some_and(|fixed| fixed >= 6), "{}", solved.stdout);
}

#[test]
fn equal_arguments_print_equal_bytes_and_another_seed_others() {
    let bytes = |seed: u8| {
        let folder = folder();
        let arguments =
            format!("simulate --scenario hall.toml --loss 0.1 --seed {seed} --out out --pcap air.pcap --plot a.svg");
        let run = folder.run(&arguments).ok();
        let files = ["out/ranges.csv", "out/truth.csv", "out/positions.csv", "out/telemetry.bin", "air.pcap", "a.svg"];
        (run.stdout, run.stderr, files.map(|file| folder.read(file)))
    };
    let first = bytes(1);
    assert!(first == bytes(1));
    let printed = |seed: u8| folder().run(&format!("simulate --scenario hall.toml --seed {seed}")).ok().stdout;
    assert!(first.2 != bytes(2).2 && printed(1) == printed(1) && printed(1) != printed(2));
}

#[test]
fn solve_reads_what_was_simulated_and_finds_what_the_tag_found() {
    let folder = folder();
    let simulated = folder.run("simulate --scenario hall.toml --method nls").ok();
    let run = folder.run("simulate --scenario hall.toml --method nls --out out").ok();
    assert_eq!(run.stdout, "", "the positions are in the folder");
    let expected = without_flags(&simulated.stdout, 11);
    assert_eq!(String::from_utf8(folder.read("out/positions.csv")).expect("text"), expected);
    let files = "--anchors out/anchors.csv --ranges out/ranges.csv --truth out/truth.csv";
    let solved = folder.run(&format!("solve {files} --dims 2 --height-m 1.2 --method nls")).ok();
    // The tag solves the same ranges with the same code, and this method does not use weights. The files have four
    // decimals.
    let by_epoch = |run: &crate::support::Run| -> Vec<(String, f64, f64)> {
        let (x, y) = (run.numbers("x_m"), run.numbers("y_m"));
        let rows = run.column("epoch").into_iter().map(str::to_owned).zip(x).zip(y);
        rows.map(|((epoch, x), y)| (epoch, x, y)).filter(|row| row.1.is_finite()).collect()
    };
    let (tag, host) = (by_epoch(&simulated), by_epoch(&solved));
    assert!(tag.len() > 500);
    // In the first rounds, ranges of one round may be used in another.
    for (tag, host) in tag.iter().zip(&host).skip(50) {
        assert_eq!(tag.0, host.0);
        assert!((tag.1 - host.1).abs() < 0.005 && (tag.2 - host.2).abs() < 0.005, "{tag:?} {host:?}");
    }
}

#[test]
fn telemetry_of_a_simulation_is_read_as_that_of_boards() {
    let folder = folder();
    folder.run("simulate --scenario hall.toml --out out").ok();
    let simulated = String::from_utf8(folder.read("out/positions.csv")).expect("text");
    let columns = ["t_s", "x_m", "y_m", "z_m", "sigma_x_m", "sigma_y_m", "sigma_z_m", "used", "reason"];
    // The comparison leaves out the epoch's number, which counts the epochs of all tags, and values that a real node
    // does not have.
    let positions = |text: &str| -> Vec<Vec<String>> {
        let mut rows = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let header = rows.next().expect("a header");
        let at = columns.map(|name| header.iter().position(|column| column == name).expect("a column"));
        rows.map(|row| at.iter().map(|place| row[*place].clone()).collect()).collect()
    };
    let expected = positions(&simulated);
    assert!(expected.len() > 500, "{}", expected.len());
    let decoded = folder.run("decode out/telemetry.bin --format csv").ok();
    assert_eq!(positions(&decoded.stdout), expected);
    let replayed = folder.run("replay out --speed 1000000 --format csv").ok();
    assert_eq!(positions(&replayed.stdout), expected);
    let monitored = folder.run("monitor --file out/telemetry.bin --format csv").ok();
    assert_eq!(positions(&monitored.stdout), expected);
    let ranges = folder.run("decode out/telemetry.bin --format csv --table ranges").ok();
    let recorded = String::from_utf8(folder.read("out/ranges.csv")).expect("text");
    assert_eq!(ranges.stdout.lines().count(), recorded.lines().count());
    // Every node reports who it is.
    let summary = folder.run("decode out/telemetry-0x0003.bin --json").ok().object();
    assert_eq!(
        (&summary["node"]["role"], &summary["node"]["address"]),
        (&"anchor".into(), &"0x0003".into()),
        "{summary:?}"
    );
}

#[test]
fn a_tag_that_listens_leaves_its_differences_beside_the_truth() {
    let folder = folder();
    folder.run("simulate --mode tdoa --tags 1 --anchors 6 --fidelity air --seconds 3 --out out").ok();
    let text = String::from_utf8(folder.read("out/differences.csv")).expect("text");
    let mut rows = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().expect("a header");
    let place = |name: &str| header.iter().position(|column| *column == name).expect("a column");
    let [difference, truth, reference, anchor] = ["difference_m", "truth_m", "reference", "anchor"].map(place);
    let (mut references, mut close, mut all) = (0, 0, 0);
    for row in rows {
        let metres = |place: usize| row[place].parse::<f64>().expect("a number");
        let off = (metres(difference) - metres(truth)).abs();
        references += usize::from(row[reference] == row[anchor]);
        assert!(row[reference] != row[anchor] || off == 0.0, "{row:?}");
        all += 1;
        close += usize::from(off < 0.5);
    }
    // Every round has a row for its reference anchor. A wall makes some differences longer.
    assert!(references > 20 && all > 3 * references && close * 10 > all * 8, "{references} {close} {all}");
}

#[test]
fn what_is_wrong_is_told_in_one_line_and_nothing_is_written() {
    let folder = folder();
    folder.write("loss.toml", b"[simulation]\nloss = 3\n");
    folder.write("old.toml", b"# A room.\nseconds = 1\n[[anchor]]\nat = [0, 0, 2]\n");
    folder.write("file", b"");
    let cases = [
        ("--scenario loss.toml", "loss.toml:2: loss is 3: it must be a probability from 0 to 1\n"),
        ("--site old.toml", "old.toml:2: seconds is a key of older files: write seconds in [simulation]\n"),
        ("--scenario none.toml", "none.toml: cannot open it"),
        ("--loss 2", "invalid value '2' for '--loss <P>'"),
        ("--seconds -1", "invalid value '-1' for '--seconds <S>': \"-1\" is not a number from 0.001 to "),
        ("--tags 0", "invalid value '0' for '--tags <N>'"),
        ("--scenario hall.toml --tags 2", "the argument '--site <FILE>' cannot be used with"),
        ("--dims 3 --height-m 1", "--height-m: only with --dims 2\n"),
        ("--plot room.gif", "--plot: room.gif ends in neither .svg nor .png\n"),
        ("--pcap none/air.pcap", "--pcap: the folder none does not exist\n"),
        ("--out file", "--out: file is not a folder\n"),
        ("--mode listening --rate 0.1", "--rate: node 0x1001: tag.rate_hz is 0.1: it must be 0.13 to 1000\n"),
    ];
    let before = folder.names();
    for (arguments, said) in cases {
        let run = folder.run(&format!("simulate {arguments}"));
        assert_eq!((run.code, run.stdout.as_str()), (Some(2), ""), "{arguments}: {run:?}");
        assert!(run.stderr.starts_with(said) && run.stderr.lines().count() == 1, "{arguments}: {}", run.stderr);
    }
    assert_eq!(folder.names(), before);
}

/// A room with a wall before one of the anchors, and a classifier that asks for impulse responses.
fn walled() -> Folder {
    use positioning_core::nlos::{Kind, Model, Platt, Skewness};
    let wall = "[[simulation.wall]]\nfrom_m = [4.5, 3]\nto_m = [4.5, 5]\nmaterial = \"concrete\"\n";
    let folder = Folder::with(&[("hall.toml", &format!("{SCENARIO}{wall}"))]);
    let mut buffer = [0; 64];
    let model = Model { kind: Kind::Skewness(Skewness::default()), calibration: Platt::NONE };
    folder.write("nlos.model", model.encode(&mut buffer).expect("it fits"));
    folder
}

#[test]
fn tags_with_a_classifier_read_impulse_responses_and_the_recording_trains_others() {
    let folder = walled();
    let plain = folder.run("simulate --scenario hall.toml --json").ok().object();
    let with = folder.run("simulate --scenario hall.toml --model nlos.model --out spi --json").ok().object();
    // At most four anchors in 150 ms, each of which takes 0.8 ms.
    let share = with["fixes"].as_f64().unwrap() / plain["fixes"].as_f64().unwrap();
    assert!((0.95..=1.0).contains(&share), "{share} of the positions");
    let ranges = String::from_utf8(folder.read("spi/ranges.csv")).unwrap();
    let mut rows = ranges.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().unwrap();
    let at = |name| header.iter().position(|column| *column == name).unwrap();
    let (anchor, skewness) = (at("anchor"), at("skewness_near"));
    let mut sounded = std::collections::BTreeMap::<String, usize>::new();
    for row in rows.filter(|row| !row[skewness].is_empty()) {
        *sounded.entry(row[anchor].to_owned()).or_default() += 1;
    }
    // After the tag has joined, at least 1.6 s of the two seconds are left: ten rounds of 150 ms.
    assert_eq!(sounded.len(), 4, "{sounded:?}");
    assert!(sounded.values().all(|count| (8..=14).contains(count)), "{sounded:?}");
    // The simulation without SPI also has accumulators.
    folder.run("simulate --scenario hall.toml --fidelity air --model nlos.model --out air --json").ok();
    folder.run("nlos train --ranges spi/ranges.csv --classifiers logistic --out own.model").ok();
    folder.run("nlos eval --ranges air/ranges.csv --model own.model").ok();
    let track =
        "track --anchors spi/anchors.csv --ranges spi/ranges.csv --truth spi/truth.csv --dims 2 --height-m 1.2 --json";
    let run = folder.run(&format!("{track} --model nlos.model")).ok();
    // The result agrees with the tag's own, because the same engine uses the same ranges.
    let (found, simulated) = (
        run.json()[0]["rmse_m"].as_f64().unwrap(),
        folder.run("simulate --scenario hall.toml --model nlos.model --json").ok().object(),
    );
    assert!((found / simulated["rmse_m"].as_f64().unwrap() - 1.0).abs() < 0.1, "{found} against {simulated}");
    let run = folder.run(&format!("{track} --model own.model"));
    assert_eq!(run.code, Some(2));
    assert!(
        run.stderr.starts_with("own.model: it has several classifiers, name one of logistic:1 ("),
        "{}",
        run.stderr
    );
}

#[test]
fn files_that_are_no_classifiers_are_refused() {
    let folder = walled();
    let run = folder.run("simulate --model hall.toml");
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), "hall.toml: not a model\n"));
    let run = folder.run("simulate --model nlos.model --classifier logistic");
    assert_eq!(run.stderr, "nlos.model: it has no classifier logistic; it has skewness (skewness_near)\n");
    assert_eq!(folder.run("simulate --classifier skewness").code, Some(2));
}

#[test]
fn airtime_is_the_share_of_each_networks_air() {
    // Three rooms of sixteen tags, each with a network of its own, and each network's list full.
    let run = folder().run("simulate --fidelity air --tags 48 --anchors 12 --seconds 3 --json").ok();
    let json = run.object();
    let (mean, max) = (json["airtime_share"].as_f64().unwrap(), json["airtime_share_max"].as_f64().unwrap());
    assert!(0.1 < mean && mean <= max && max < 1.0, "{mean} {max}");
    // One network alone has the air of one of them, and its mean is its maximum.
    let json = folder().run("simulate --fidelity air --tags 16 --anchors 4 --seconds 3 --json").ok().object();
    assert_eq!(json["airtime_share"], json["airtime_share_max"]);
    assert!((json["airtime_share"].as_f64().unwrap() / mean - 1.0).abs() < 0.2, "{json} {mean}");
}

#[test]
fn the_modes_of_the_help_are_those_of_the_documents() {
    let help = folder().run("simulate --help").ok().stdout;
    assert!(help.contains("- tdoa:") && help.contains("called listening"), "{help}");
    let run =
        |mode: &str| folder().run(&format!("simulate --mode {mode} --tags 1 --fidelity air --seconds 1")).ok().stdout;
    assert_eq!(run("tdoa"), run("listening"));
}

#[test]
fn walls_are_in_the_recording_and_in_its_pictures() {
    let folder = walled();
    folder.run("simulate --scenario hall.toml --seconds 1 --out run").ok();
    let walls = String::from_utf8(folder.read("run/walls.csv")).unwrap();
    assert_eq!(walls, "x1_m,y1_m,x2_m,y2_m\n4.5000,3.0000,4.5000,5.0000\n");
    folder.run("plot run --out with.svg").ok();
    std::fs::remove_file(folder.path("run/walls.csv")).unwrap();
    folder.run("plot run --out without.svg").ok();
    let lines = |name: &str| String::from_utf8(folder.read(name)).unwrap().matches("<polyline").count();
    assert!(lines("with.svg") > lines("without.svg"), "{} {}", lines("with.svg"), lines("without.svg"));
    // A run without walls leaves none of an earlier one.
    folder.run("simulate --scenario hall.toml --seconds 1 --out run --force").ok();
    folder.write("none.toml", SCENARIO.as_bytes());
    folder.run("simulate --scenario none.toml --seconds 1 --out run --force").ok();
    assert!(!folder.path("run/walls.csv").exists());
}

#[test]
fn tags_that_a_full_network_refuses_are_counted() {
    // A network has 16 places for greedy tags; 22 want one.
    let tag =
        |x: f64| format!("[[node]]\nrole = \"tag\"\nheight_m = 1.2\nsimulation = {{ path_m = [[{x}, 2, 1.2]] }}\n");
    let tags: String = (0..22).map(|n| tag(0.1 * f64::from(n))).collect();
    let anchor = |at: &str| format!("[[node]]\nrole = \"anchor\"\nposition_m = [{at}]\n");
    let anchors = ["0, 0, 2", "6, 0, 2", "3, 5, 2"].map(anchor).concat();
    let text = format!("{anchors}{tags}[simulation]\nseconds = 4\nfidelity = \"air\"\n");
    let folder = Folder::with(&[("crowd.toml", &text)]);
    let run = folder.run("simulate --scenario crowd.toml --out run").ok();
    let refused = "warning: 6 of the tags had no place, for the reason network-full: a network has 16 places ";
    assert!(run.stderr.contains(refused), "{}", run.stderr);
    // One of them: its own telemetry counts it.
    let full = (0x1001..=0x1016).filter(|address: &u16| {
        let file = if *address == 0x1001 { "telemetry.bin".into() } else { format!("telemetry-0x{address:04X}.bin") };
        let run = folder.run(&format!("decode run/{file} --json")).ok().object();
        run["network_full"].as_u64().unwrap() > 0 && run["positions"] == 0
    });
    assert_eq!(full.count(), 6);
}
