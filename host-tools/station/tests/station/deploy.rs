//! The files of `deploy/`: what can be checked without root and network. The dashboards' SQL is tested with the store,
//! their metrics with the API.
#![cfg(target_os = "linux")]

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::support::{Folder, root};

fn text(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Whether a program is here. One that is not is said.
fn is_here(program: &str) -> bool {
    let is_here = Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
    if !is_here {
        let _ = writeln!(std::io::stderr(), "a test of deploy/ is left out: there is no {program}");
    }
    is_here
}

/// Asserts that the program takes the arguments of a line for `baliza`, by `--help` behind them.
fn assert_taken(arguments: &[&str]) {
    let output = Command::new(crate::PROGRAM).args(arguments).arg("--help").output().expect("it runs");
    assert!(output.status.success(), "{arguments:?}: {output:?}");
}

/// The value of a setting of a unit or of a file of variables.
fn setting<'a>(text: &'a str, name: &str) -> &'a str {
    let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
    value.unwrap_or_else(|| panic!("there is no {name}")).trim_matches('"')
}

#[test]
fn the_unit_starts_the_program_with_flags_that_it_has() {
    let unit = text("deploy/baliza.service");
    let arguments: Vec<_> = setting(&unit, "ExecStart").split_whitespace().collect();
    assert_eq!(arguments[0], "/usr/bin/baliza");
    let flags = text("deploy/baliza.default");
    let flags = setting(&flags, "BALIZA_SERVE");
    let arguments: Vec<_> = arguments[1..].iter().filter(|argument| **argument != "$BALIZA_SERVE").copied().collect();
    assert_taken(&[arguments, flags.split_whitespace().collect()].concat());
}

#[test]
fn systemd_takes_the_unit() {
    if !is_here("systemd-analyze") {
        return;
    }
    let folder = Folder::with(&[]);
    // The program and its manual page are not installed here.
    let unit = text("deploy/baliza.service").replace("/usr/bin/baliza", "/bin/true");
    let unit: String =
        unit.lines().filter(|line| !line.starts_with("Documentation=")).flat_map(|line| [line, "\n"]).collect();
    folder.write("baliza.service", unit.as_bytes());
    let verify = Command::new("systemd-analyze").arg("verify").arg(folder.path("baliza.service")).output();
    let verify = verify.expect("it runs");
    let said = String::from_utf8_lossy(&verify.stderr);
    assert!(!said.contains("baliza.service"), "{said}");
}

#[test]
fn all_files_of_the_package_are_there_or_made_by_dist() {
    let manifest: toml::Table = text("host-tools/Cargo.toml").parse().expect("TOML");
    let package = &manifest["package"]["metadata"]["deb"];
    let conffiles = package["conf-files"].as_array().expect("a list");
    let assets = package["assets"].as_array().expect("a list");
    let field = |asset: &toml::Value, at: usize| asset[at].as_str().expect("a text").to_owned();
    assert!(conffiles.iter().all(|conffile| {
        assets.iter().any(|asset| format!("/{}", field(asset, 1)) == conffile.as_str().expect("a text"))
    }));
    for asset in assets {
        let from = field(asset, 0);
        let made = from.starts_with("target/release/")
            || from.starts_with("../target/release/")
            || from.starts_with("../target/dist/");
        let file =
            root().join("host-tools").join(from.replace("*.json", "prometheus.json").replace("*.md", "README.md"));
        assert!(made || file.is_file(), "{from}");
    }
    let installed = |name: &str| assets.iter().any(|asset| field(asset, 1).starts_with(name));
    let unit = text("deploy/baliza.service");
    assert!(installed(&setting(&unit, "EnvironmentFile").replace("-/", "")), "the unit's variables");
}

#[test]
fn the_containers_start_the_program_with_flags_that_it_has() {
    let file = text("deploy/Containerfile");
    let command = file.lines().find_map(|line| line.strip_prefix("CMD ")).expect("a command");
    let command: Vec<String> = serde_json::from_str(command).expect("a list in JSON");
    assert_taken(&command.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(file.lines().any(|line| line.starts_with("USER ") && line != "USER root"));
    if !is_here("python3") {
        return;
    }
    // There is no reader of YAML among the packages; Debian's Python often has one.
    let script = "import json, sys, yaml; print(json.dumps(yaml.safe_load(open(sys.argv[1]))))";
    let file = root().join("deploy/compose.yaml");
    let read = Command::new("python3").args(["-c", script]).arg(&file).output().expect("python3 runs");
    if String::from_utf8_lossy(&read.stderr).contains("No module named") {
        let _ = writeln!(std::io::stderr(), "a test of deploy/compose.yaml is left out: Python has no yaml");
        return;
    }
    let compose: serde_json::Value = serde_json::from_slice(&read.stdout).unwrap_or_else(|_| panic!("{read:?}"));
    let services = compose["services"].as_object().expect("services");
    let command = services["station"]["command"].as_array().expect("a list");
    let command: Vec<_> = command.iter().map(|word| word.as_str().expect("a text")).collect();
    assert_taken(&command);
    for service in services["station"]["depends_on"].as_object().expect("names").keys() {
        assert!(services.contains_key(service), "{service}");
    }
    for (name, service) in services {
        for volume in service["volumes"].as_array().into_iter().flatten() {
            let from = volume.as_str().and_then(|volume| volume.split(':').next()).expect("a name");
            let is_known = compose["volumes"].get(from).is_some()
                || ["tokens.toml", "gateways.toml"].iter().any(|made| Path::new(from).ends_with(made));
            assert!(is_known || root().join("deploy").join(from).is_file(), "{name}: {from}");
        }
    }
}
