//! Runs `baliza-probe` as a user does who has no probe, or names a wrong one.

#[allow(dead_code)]
#[path = "../../tests/baliza/schema_check.rs"]
mod schema_check;
#[allow(dead_code)]
#[path = "../../tests/baliza/support.rs"]
mod support;

use support::{Folder, Run};

/// The program. It has the commands of `baliza`.
const PROGRAM: &str = env!("CARGO_BIN_EXE_baliza-probe");

/// An anchor on a DWM1001.
const ANCHOR: &str = "[network]\npan = 0xDECA\n[[node]]\nname = \"a\"\nrole = \"anchor\"\nboard = \"dwm1001\"\naddress = 0x0101\neui = \"01-23-45-67-89-ab-cd-ef\"\nposition_m = [1, 2.5, -0.5]\n";

fn refused(run: &Run, beginning: &str) {
    assert!(run.code == Some(2) && run.stderr.starts_with(beginning), "{run:?}");
}

#[test]
fn a_missing_probe_or_an_unknown_chip_is_an_error() {
    let folder = Folder::with(&[("site.toml", ANCHOR)]);
    refused(&folder.run("monitor --chip nosuch"), "--chip: probe-rs knows no chip nosuch");
    refused(&folder.run("monitor --probe nonsense"), "--probe: \"nonsense\": ");
    let run = folder.run("provision --config site.toml --write --chip STM32F105XX");
    refused(&run, "--chip: probe-rs knows no chip STM32F105XX; near it are STM32F105");
    // This probe is not connected, whatever else is.
    let run = folder.run("provision --config site.toml --write --probe ffff:ffff:nobody");
    assert!(run.code == Some(1) || run.code == Some(2), "{run:?}");
    let said = ["baliza: no debug probe found: plug in", "--probe: no probe ffff:ffff:nobody; found: "];
    assert!(said.iter().any(|said| run.stderr.starts_with(said)), "{}", run.stderr);
}
