//! A folder is the unit: each command takes all tags of a simulation's folder, and folders that have beacons only.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use serde_json::Value;

use crate::support::{Folder, Run, root};

/// A table of a folder, by the names of its columns.
fn table(folder: &Folder, name: &str) -> Run {
    let text = fs::read_to_string(folder.path(name)).unwrap_or_default();
    Run { code: Some(0), stdout: text, stderr: String::new() }
}

/// How many of these each tag has.
fn by_tag<'t>(tags: impl IntoIterator<Item = &'t str>) -> BTreeMap<String, usize> {
    tags.into_iter().fold(BTreeMap::new(), |mut counts, tag| {
        *counts.entry(tag.to_owned()).or_default() += 1;
        counts
    })
}

/// How many rows each tag has in a table.
fn rows_by_tag(table: &Run) -> BTreeMap<String, usize> {
    if table.stdout.lines().count() < 2 { BTreeMap::new() } else { by_tag(table.column("tag")) }
}

/// How many epochs each tag has in a table of measurements.
fn epochs_by_tag(table: &Run) -> BTreeMap<String, usize> {
    if table.stdout.lines().count() < 2 {
        return BTreeMap::new();
    }
    let epochs: BTreeSet<_> = table.column("tag").into_iter().zip(table.column("epoch")).collect();
    by_tag(epochs.into_iter().map(|(tag, _)| tag))
}

/// Series that a picture's legend names: the first ones.
const MOST_NAMED: usize = 16;

/// Takes a folder that `simulate --out` made through all commands that read folders, with all its tags and positions.
fn goes_through_all_commands(folder: &Folder, name: &str) {
    let positions = rows_by_tag(&table(folder, &format!("{name}/positions.csv")));
    let rows: usize = positions.values().sum();
    let by_table = |table_name: &str| epochs_by_tag(&table(folder, &format!("{name}/{table_name}.csv")));
    let measured = ["ranges", "differences", "rssi"].map(by_table).into_iter().find(|tags| !tags.is_empty());
    for command in ["solve", "track"] {
        let run = folder.run(&format!("{command} {name}"));
        match &measured {
            Some(measured) => assert_eq!(&rows_by_tag(&run), measured, "{command} {name}: {}", run.stderr),
            None => assert!(run.code == Some(2) && run.stderr.contains("no ranges below the header"), "{run:?}"),
        }
    }
    for command in ["replay --speed 1000000 --format csv", "monitor --format csv --file"] {
        let (command, flags) = command.split_once(' ').expect("two words");
        let run = folder.run(&format!("{command} {flags} {name}")).ok();
        assert_eq!(rows_by_tag(&run), positions, "{command} {name}: {}", run.stderr);
    }
    let run = folder.run(&format!("convert {name} --out {name}.mcap"));
    assert!(rows == 0 || run.stderr.contains(&format!(" {rows} positions, in {name}.mcap")), "{name}: {run:?}");
    let run = folder.run(&format!("plot {name} --out {name}.svg"));
    if rows > 0 {
        assert_eq!(run.code, Some(0), "{name}: {run:?}");
        let picture = String::from_utf8(folder.read(&format!("{name}.svg"))).expect("text");
        // A legend has room for so many.
        let mut named = positions.keys().take(MOST_NAMED);
        let are_named = positions.len() == 1 || named.all(|tag| picture.contains(tag.as_str()));
        assert!(are_named, "{name}: the picture lacks a tag of {positions:?}");
    }
}

#[cfg(feature = "foxglove")]
#[test]
fn every_example_goes_through_all_commands_with_all_its_tags_and_positions() {
    let mut files: Vec<_> = fs::read_dir(root().join("examples")).expect("a folder").flatten().collect();
    files.retain(|file| file.path().extension().is_some_and(|extension| extension == "toml"));
    // Their positions are those of a station: telemetry has none of them.
    files.retain(|file| !["blinks.toml", "scanners.toml"].iter().any(|name| file.file_name() == *name));
    files.sort_by_key(fs::DirEntry::file_name);
    assert!(files.len() > 10, "{files:?}");
    let folder = Folder::with(&[]);
    for file in files {
        let path = file.path();
        let name = path.file_stem().expect("a name").to_str().expect("UTF-8").to_owned();
        let simulated = folder.run(&format!("simulate --scenario {} --seconds 2 --out {name} -q", path.display()));
        assert!(matches!(simulated.code, Some(0 | 1)), "{name}: {simulated:?}");
        goes_through_all_commands(&folder, &name);
    }
    for (name, flags) in [("three", "--tags 3"), ("listening", "--tags 2 --mode tdoa")] {
        folder.run(&format!("simulate {flags} --seconds 2 --out {name} -q")).ok();
        assert!(rows_by_tag(&table(&folder, &format!("{name}/positions.csv"))).len() > 1);
        goes_through_all_commands(&folder, name);
    }
}

#[test]
fn the_walk_with_beacons_alone_is_solved_tracked_and_drawn() {
    let walk = root().join("examples/flat/walk").display().to_string();
    let folder = Folder::with(&[]);
    let beacons = folder.run(&format!("ble solve {walk} --method posterior,engine --height-m 1.2")).ok();
    let rows_of = |method: &str| {
        let rows = beacons.stdout.lines().filter(|row| row.split(',').nth(2) == Some(method));
        rows.map(str::to_owned).collect::<Vec<_>>()
    };
    for (command, method) in [("solve", "posterior"), ("track", "engine")] {
        let run = folder.run(&format!("{command} {walk}")).ok();
        assert_eq!(run.stdout.lines().skip(1).collect::<Vec<_>>(), rows_of(method), "{command}");
        assert!(run.stderr.starts_with("there are no ranges; positions are by beacons"), "{}", run.stderr);
        folder.run(&format!("{command} {walk} --residuals")).refused("--residuals: only for ranges");
        folder.run(&format!("{command} {walk} --json")).ok().json();
    }
    folder.run(&format!("solve {walk} --method nls")).refused("--method: only for ranges");
    folder.run(&format!("plot {walk} --out walk.svg")).ok();
    let picture = String::from_utf8(folder.read("walk.svg")).expect("text");
    assert!(table(&folder, &format!("{walk}/beacons.csv")).column("beacon").iter().all(|name| picture.contains(name)));
}

#[test]
fn the_messages_of_several_nodes_say_of_which_they_are() {
    let folder = Folder::with(&[]);
    folder.run("simulate --tags 3 --anchors 4 --seconds 1 --out run -q").ok();
    let all = ["0x1001", "0x0001", "0x0002", "0x0003", "0x0004", "0x1002", "0x1003"];
    for command in ["replay run --speed 1000000", "monitor --format jsonl --file run"] {
        let run = folder.run(command).ok();
        let lines: Vec<Value> = run.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
        let nodes: BTreeSet<_> = lines.iter().map(|line| line["node"].as_str().expect("a node")).collect();
        assert_eq!(nodes, BTreeSet::from(all), "{command}");
        for line in lines.iter().filter(|line| line["type"] == "hello") {
            assert_eq!(line["node"], line["address"], "{command}");
        }
        if command.starts_with("replay") {
            let times: Vec<_> = lines.iter().map(|line| line["t_s"].as_f64().expect("a time")).collect();
            // A node's clock is some millionths slower or faster than another's, and its messages are in their order.
            assert!(times.windows(2).all(|pair| pair[1] > pair[0] - 0.1), "{times:?}");
        }
    }
    let run = folder.run("monitor --file run").ok();
    assert!(all.iter().all(|node| run.stdout.lines().any(|line| line.starts_with(&format!("{node} ")))), "{run:?}");
    assert_eq!(run.stderr.lines().count(), all.len(), "{}", run.stderr);
    // What is of one node says so, and how to get the others.
    for (command, said) in [
        (
            "replay run --speed 1000000 --raw",
            "a stream of bytes is of one node: run/telemetry.bin; run/telemetry-0x0001.bin",
        ),
        ("decode run", "run has several nodes; this is 0x1001: give the file of another, as run/telemetry-0x0001.bin"),
        ("monitor --file run --record copy", "run has several nodes, and this is the first tag: --file run/telemetry-"),
    ] {
        let output = folder.command(command).output().expect("baliza runs");
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(output.status.success() && stderr.starts_with(said), "{command}: {stderr}");
    }
}
