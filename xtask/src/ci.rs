//! Everything that continuous integration checks, as a list of commands.

use std::env;
use std::process::Command;
use std::time::Instant;

use anyhow::{Result, bail};

use crate::root;

/// The name of the check, its command, and additions to its environment.
type Step = (&'static str, &'static [&'static str], &'static [(&'static str, &'static str)]);

const STEPS: [Step; 18] = [
    ("lock file", &["cargo", "fetch", "--locked"], &[]),
    ("tests", &["cargo", "test"], &[]),
    ("formatting", &["cargo", "fmt", "--all", "--check"], &[]),
    ("lints", &["cargo", "clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], &[]),
    ("without probes", &["cargo", "check", "-p", "host-tools", "--all-targets", "--no-default-features"], &[]),
    ("documentation", &["cargo", "doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")]),
    ("first command", &FIRST_COMMAND, &[]),
    ("fuzzing", &["cargo", "xtask", "fuzz", "--seconds", "5"], &[]),
    ("licences and advisories", &["cargo", "xtask", "deny"], &[]),
    ("Python package", &["cargo", "xtask", "python"], &[]),
    ("station", &["cargo", "xtask", "station"], &[]),
    ("oldest Rust", &["cargo", "xtask", "oldest-rust"], &[]),
    ("bare-metal builds", &["cargo", "xtask", "no-std"], &[]),
    ("firmware", &["cargo", "xtask", "firmware"], &[]),
    ("lints of the boards", &["cargo", "xtask", "firmware", "--lint"], &[]),
    ("tag in QEMU", &["cargo", "xtask", "qemu", "tag"], &[]),
    ("network in QEMU", &["cargo", "xtask", "qemu", "network", "--seconds", "3"], &[]),
    ("cost on the chip", &["cargo", "xtask", "bench", "--check"], &[]),
];

/// The first command of the README, exactly as there.
const FIRST_COMMAND: [&str; 11] =
    ["cargo", "run", "--release", "-p", "host-tools", "--bin", "baliza", "--", "simulate", "--plot", "room.png"];

/// Runs every step, even after one has failed, and ends with a list of the results.
///
/// # Errors
/// A step fails, or its command cannot be started.
pub fn run() -> Result<()> {
    let mut summary = String::new();
    let mut failed = 0;
    for (name, words, environment) in STEPS {
        let line = words.join(" ");
        println!("\n=== {name}: {line}");
        let start = Instant::now();
        let passed = command(words).envs(environment.iter().copied()).current_dir(root()).status()?.success();
        failed += usize::from(!passed);
        let verdict = if passed { "passed" } else { "FAILED" };
        summary += &format!("{verdict}  {name:20} {line} ({} s)\n", start.elapsed().as_secs());
    }
    println!("\n{summary}");
    if failed > 0 {
        bail!("{failed} of {} checks failed", STEPS.len());
    }
    println!("all {} checks passed", STEPS.len());
    Ok(())
}

/// The command of a step. A subcommand of xtask is run by this same program: cargo could not replace it while it
/// runs.
fn command(words: &[&str]) -> Command {
    match (words, env::current_exe()) {
        (["cargo", "xtask", chore @ ..], Ok(this)) => {
            let mut command = Command::new(this);
            command.args(chore);
            command
        }
        _ => {
            let mut command = Command::new(words[0]);
            command.args(&words[1..]);
            command
        }
    }
}
