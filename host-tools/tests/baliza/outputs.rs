//! Outputs of all commands: never an input, whole or not at all, and nothing of an earlier run beside them.

use std::io::Write;
use std::process::Stdio;

use crate::support::{Folder, root, without_flags};

/// A folder with the example recording as `room`, and a site as `site.toml`.
fn folder() -> Folder {
    let folder = Folder::with(&[]);
    folder.run("example --out room").ok();
    folder.run("provision --example --out site.toml").ok();
    folder
}

const SOLVE: &str = "solve --anchors room/anchors.csv --ranges room/ranges.csv";

fn names(folder: &Folder, of: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path(of)).expect("a folder");
    let mut names: Vec<_> =
        entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8")).collect();
    names.sort();
    names
}

#[cfg(unix)]
#[test]
fn an_output_is_never_an_input_however_its_path_is_written() {
    let folder = folder();
    std::fs::hard_link(folder.path("room/ranges.csv"), folder.path("hard")).expect("linked");
    std::os::unix::fs::symlink("room/ranges.csv", folder.path("soft")).expect("linked");
    let (ranges, site) = (folder.read("room/ranges.csv"), folder.read("site.toml"));
    for same in ["room/ranges.csv", "room/../room/./ranges.csv", "hard", "soft"] {
        let run = folder.run(&format!("{SOLVE} --out {same}"));
        let said = format!("--out: {same} is the input --ranges; name another file\n");
        assert_eq!((run.code, run.stdout.as_str(), run.stderr), (Some(2), "", said));
    }
    let cases = [
        (
            "provision --config site.toml --node tag-1 --board dwm1001 --out site.toml",
            "--out: site.toml is the input --config",
        ),
        ("plot --positions room/truth.csv --out room/truth.csv", "--out: room/truth.csv is the input --positions"),
        (&format!("{SOLVE} --out new.svg --plot new.svg"), "--plot: new.svg is also --out"),
        (&format!("{SOLVE} --json --out -"), "--out: standard output has something else already"),
        (&format!("{SOLVE} --plot -"), "--plot: standard output has something else already"),
        ("solve --anchors - --ranges -", "-: standard input can be one file only"),
    ];
    for (arguments, said) in cases {
        let run = folder.run(arguments);
        assert_eq!(
            (run.code, run.stdout.is_empty(), run.stderr.lines().count()),
            (Some(2), !arguments.contains("--json"), 1),
            "{arguments}: {run:?}"
        );
        assert!(run.stderr.starts_with(said), "{arguments}: {run:?}");
    }
    assert!(folder.read("room/ranges.csv") == ranges && folder.read("site.toml") == site);
    // A device may be both.
    folder.run(&format!("{SOLVE} --out /dev/null")).ok();
}

/// Whatever leads to a file that a command reads: a link, a folder, a name in another file, or the usual name of an
/// output.
#[cfg(unix)]
#[test]
fn no_command_replaces_a_file_that_it_reads() {
    type Link = fn(&std::path::Path, &std::path::Path) -> std::io::Result<()>;
    let links: [(&str, Link); 2] = [
        ("symlink", |file, link| std::os::unix::fs::symlink(file, link)),
        ("hard link", |file, link| std::fs::hard_link(file, link)),
    ];
    // The link, the file that it leads to, and the command that would replace the file.
    let cases = [
        ("room/p.csv", "room/anchors.csv", "solve room --out room/p.csv"),
        ("p.csv", "room/ranges.csv", "track room --out p.csv"),
        ("p.jsonl", "room/truth.csv", "solve room --out p.jsonl"),
        ("p.parquet", "room/recording.toml", "track room --out p.parquet"),
        ("p.csv", "room/walls.csv", "solve room --out p.csv"),
        ("q.png", "room/ranges.csv", "solve room --plot q.png"),
        ("q.svg", "room/site.toml", "track room --plot q.svg"),
        ("q.png", "room/positions.csv", "plot room --out q.png"),
        ("room/picture.png", "room/truth.csv", "plot room"),
        ("room.mcap", "room/ranges.csv", "convert room --out room.mcap"),
        ("room.mcap", "room/telemetry.bin", "convert room/telemetry.bin --out room.mcap"),
        ("out.jsonl", "room/telemetry.bin", "decode room --out out.jsonl"),
        ("air.pcap", "site.toml", "simulate --site site.toml --seconds 1 --pcap air.pcap"),
        (
            "air.pcap",
            "examples/fingerprints.map",
            "simulate --scenario examples/fingerprints.toml --seconds 1 --pcap air.pcap",
        ),
        ("q.svg", "plan.png", "solve room --plan plan.png --plan-scale 0.02 --plot q.svg"),
    ];
    let folder = folder();
    folder.run("simulate --seconds 1 --tags 1 --out room --force -q").ok();
    folder.run("plot room --out plan.png -q").ok();
    folder.run("provision --example --out room/site.toml -q").ok();
    folder.write("room/walls.csv", b"x1_m,y1_m,x2_m,y2_m\n0,0,1,0\n");
    std::fs::create_dir(folder.path("examples")).expect("made");
    for name in ["toml", "map", "rooms", "outlines.csv"].map(|end| format!("fingerprints.{end}")) {
        std::fs::copy(root().join("examples").join(&name), folder.path("examples").join(name)).expect("copied");
    }
    for (kind, link) in links {
        for (from, to, command) in cases {
            link(&folder.path(to), &folder.path(from)).expect("linked");
            let before = folder.read(to);
            let run = folder.run(command);
            assert!(run.code == Some(2) && folder.read(to) == before, "{kind}: {command}: {run:?}");
            assert!(folder.read(from) == before, "{kind}: {command}");
            let said = run.stderr.lines().last().unwrap_or_default();
            assert!(said.contains("input"), "{kind}: {command}: {said}");
            // The usual output is no input, and is replaced.
            std::fs::remove_file(folder.path(from)).expect("removed");
            folder.write(from, b"an earlier output");
            let run = folder.run(command);
            assert!(run.code == Some(0) && folder.read(from) != b"an earlier output", "{command}: {run:?}");
            std::fs::remove_file(folder.path(from)).expect("removed");
        }
    }
}

#[test]
fn a_record_is_not_written_over_a_file_that_is_none() {
    let folder = folder();
    folder.write("nlos.model", b"a model that the site names");
    let make = "provision --config site.toml --node tag-1 --board dwm1001 --out";
    let run = folder.run(&format!("{make} nlos.model"));
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), "--out: nlos.model is no record; --force replaces it\n"));
    assert_eq!(folder.read("nlos.model"), b"a model that the site names");
    folder.run(&format!("{make} nlos.model --force")).ok();
    // A record replaces a record.
    folder.run(&format!("{make} nlos.model")).ok();
}

#[test]
fn a_folder_with_a_recording_is_replaced_as_a_whole_and_only_with_force() {
    let folder = folder();
    folder.write("notes.txt", b"mine");
    std::fs::rename(folder.path("notes.txt"), folder.path("room/notes.txt")).expect("moved");
    let run = folder.run("simulate --seconds 1 --out room");
    assert_eq!(
        (run.code, run.stderr.as_str()),
        (Some(2), "--out: room has anchors.csv already; --force replaces it\n")
    );
    let recording =
        ["anchors.csv", "notes.txt", "positions.csv", "ranges.csv", "recording.toml", "telemetry-0x0001.bin"];
    let beacons = root().join("examples/beacons.toml").display().to_string();
    folder.run(&format!("simulate --seconds 1 --scenario {beacons} --out room --force --json")).ok();
    assert!(names(&folder, "room").contains(&"rssi.csv".to_owned()));
    // Nothing of the beacons is left, and nothing of other nodes.
    let run = folder.run("simulate --seconds 1 --tags 1 --anchors 1 --out room --force --json");
    assert_eq!(run.code, Some(1), "there is no position: {run:?}");
    let expected = [&recording[..], &["telemetry.bin", "truth.csv", "walls.csv"]].concat();
    assert_eq!(names(&folder, "room"), expected);
    assert_eq!(folder.read("room/notes.txt"), b"mine");
    let run = folder.run("example --out room");
    assert_eq!(
        (run.code, run.stderr.as_str()),
        (Some(2), "--out: room has anchors.csv already; --force replaces it\n")
    );
    folder.run("example --out room --force").ok();
    assert_eq!(names(&folder, "room"), ["anchors.csv", "notes.txt", "ranges.csv", "truth.csv"]);
    assert_eq!(folder.names(), ["room", "site.toml"], "nothing hidden is left");
}

#[test]
fn records_of_a_site_replace_those_of_the_same_nodes_only_with_force() {
    let folder = folder();
    let make = "provision --config site.toml --all --out records";
    folder.run(make).ok();
    let before = names(&folder, "records");
    std::fs::write(folder.path("records/dump.bin"), b"mine").expect("written");
    let run = folder.run(make);
    assert_eq!(run.code, Some(2));
    assert_eq!(run.stderr, "--out: records has anchor-1.bin already; --force replaces it\n");
    // As Intel HEX: the records as bytes are gone.
    folder.run(&format!("{make} --format hex --force")).ok();
    let hex: Vec<_> = before.iter().map(|name| name.replace(".bin", ".hex")).collect();
    let mut expected = [&hex[..], &["dump.bin".to_owned()]].concat();
    expected.sort();
    assert_eq!(names(&folder, "records"), expected);
}

#[cfg(unix)]
#[test]
fn a_record_with_a_key_is_for_its_owner_only() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder();
    let site = String::from_utf8(folder.read("site.toml")).expect("UTF-8");
    let keyed = site.replacen("[network]", "[network]\nbeacon_key = \"00112233445566778899aabbccddeeff\"", 1);
    assert!(keyed != site);
    folder.write("keyed.toml", keyed.as_bytes());
    let mode = |file: &str| std::fs::metadata(folder.path(file)).expect("it is there").permissions().mode() & 0o777;
    folder.run("provision --config keyed.toml --node tag-1 --board dwm1001 --out tag.bin").ok();
    folder.run("provision --config keyed.toml --all --out keyed").ok();
    folder.run("provision --config site.toml --node tag-1 --board dwm1001 --out plain.bin").ok();
    assert_eq!((mode("tag.bin"), mode("keyed/tag-1.bin")), (0o600, 0o600));
    assert_eq!(mode("plain.bin"), mode("site.toml") | 0o600);
    let keyed = keyed.replace("beacon_key", "key");
    folder.write("keyed.toml", keyed.as_bytes());
    folder.run("provision --config keyed.toml --node tag-1 --board dwm1001 --out tag.bin --force").ok();
    assert_eq!(mode("tag.bin"), 0o600);
}

#[test]
fn a_dash_is_standard_output_and_standard_input() {
    let folder = folder();
    let positions = folder.run(SOLVE).ok();
    let dashed = folder.run(&format!("{SOLVE} --out -")).ok();
    assert_eq!((&dashed.stdout, &dashed.stderr), (&positions.stdout, &positions.stderr));
    let mut command = folder.command("solve --anchors room/anchors.csv --ranges -");
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("baliza runs");
    child.stdin.take().expect("piped").write_all(&folder.read("room/ranges.csv")).expect("it reads");
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(without_flags(&String::from_utf8(output.stdout).expect("UTF-8"), 14), positions.stdout);
    assert_eq!(folder.names(), ["room", "site.toml"]);
    let run = folder.run("simulate --out -");
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), "--out: a folder is needed, not standard output\n"));
}

/// The name of the temporary file means nothing to the user.
#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_cannot_be_written_is_an_error_without_the_temporary_s_name() {
    let folder = folder();
    // Nobody can create files in this folder, not even the administrator.
    let run = folder.run(&format!("{SOLVE} --out /proc/self/new.csv"));
    assert_eq!(run.code, Some(1));
    assert!(run.stderr.starts_with("baliza: cannot write /proc/self/new.csv: "), "{run:?}");
    assert!(!run.stderr.contains(".baliza"), "{run:?}");
}
