//! Everything that continuous integration checks, as a list of commands.

use std::collections::VecDeque;
use std::env;
use std::io::{self, BufRead, BufReader, PipeReader};
use std::process::Command;
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use baliza_report::MarkdownTable;

use crate::promises::Made;
use crate::root;

/// The name of the check, its command, and additions to its environment.
type Step = (&'static str, &'static [&'static str], &'static [(&'static str, &'static str)]);

const STEPS: [Step; 19] = [
    ("lock file", &["cargo", "fetch", "--locked"], &[]),
    ("tests", &["cargo", "test"], &[]),
    ("formatting", &["cargo", "fmt", "--all", "--check"], &[]),
    ("lints", &["cargo", "clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], &[]),
    ("lean program", &["cargo", "check", "-p", "host-tools", "--lib", "--bins"], &[]),
    ("documentation", &["cargo", "doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")]),
    ("first command", &FIRST_COMMAND, &[]),
    // The same inputs each time: what random ones find is for those who look for it, not for the next change.
    ("fuzzing", &["cargo", "xtask", "fuzz", "--seconds", "5", "--seed", "1"], &[]),
    ("licences and advisories", &["cargo", "xtask", "deny"], &[]),
    ("Python package", &["cargo", "xtask", "python"], &[]),
    ("station", &["cargo", "xtask", "station"], &[]),
    ("oldest Rust", &["cargo", "xtask", "oldest-rust"], &[]),
    ("bare-metal builds", &["cargo", "xtask", "no-std"], &[]),
    ("firmware", &["cargo", "xtask", "firmware"], &[]),
    ("lints of the boards", &["cargo", "xtask", "firmware", "--lint"], &[]),
    ("tag in QEMU", &["cargo", "xtask", "qemu", "tag"], &[]),
    ("network in QEMU", &["cargo", "xtask", "qemu", "network", "--seconds", "3"], &[]),
    ("promises", &["cargo", "xtask", "promises", "--check", "--quick"], &[]),
    ("cost on the chip", &["cargo", "xtask", "promises", "--check", "chip"], &[]),
];

/// The first command of the README, exactly as there.
const FIRST_COMMAND: [&str; 11] =
    ["cargo", "run", "--release", "-p", "host-tools", "--bin", "baliza", "--", "simulate", "--plot", "room.png"];

/// Lines of output of a failed step that are printed again at the end: a reader of a long log looks there first.
const KEPT_LINES: usize = 100;

/// Time for the last lines to arrive after a step has ended. A process that the step left behind may hold the pipe
/// open for ever.
const LAST_LINES: Duration = Duration::from_secs(5);

/// Runs every step, even after one has failed. It ends with the last lines of each that failed and a list of the
/// results.
///
/// # Errors
/// A step fails, or its command cannot be started.
pub fn run() -> Result<()> {
    let mut summary = String::new();
    let mut failures = String::new();
    let mut failed = 0;
    for (name, words, environment) in STEPS {
        let line = words.join(" ");
        println!("\n=== {name}: {line}");
        let start = Instant::now();
        let mut step = command(words);
        step.envs(environment.iter().copied()).current_dir(root());
        let (passed, last_lines) = shown(step)?;
        if !passed {
            failed += 1;
            failures += &format!("\n=== {name}, which failed: its last lines\n{last_lines}");
        }
        let verdict = if passed { "passed" } else { "FAILED" };
        summary += &format!("{verdict}  {name:20} {line} ({} s)\n", start.elapsed().as_secs());
    }
    println!("{failures}\n{summary}");
    if failed > 0 {
        bail!("{failed} of {} checks failed", STEPS.len());
    }
    println!("all {} checks passed", STEPS.len());
    Ok(())
}

/// The list of the checks, for the document.
///
/// # Errors
/// None; other tables' makers have some.
pub fn made() -> Result<Made> {
    let mut table = MarkdownTable::new(["check", "command"]);
    for (name, words, environment) in STEPS {
        let environment = environment.iter().map(|(name, value)| format!("{name}=\"{value}\" "));
        table.row(format_args!("{name} | `{}{}`", environment.collect::<String>(), words.join(" ")));
    }
    Ok(Made::one("checks", table.into_text()))
}

/// Runs a command and prints its output as it comes. Returns whether it succeeded, and the last [`KEPT_LINES`].
fn shown(mut command: Command) -> Result<(bool, String)> {
    let (output, writer) = io::pipe()?;
    let mut child = command.stdout(writer.try_clone()?).stderr(writer).spawn()?;
    // It holds ends of the pipe: while these are open, the output has no end.
    drop(command);
    let kept = Arc::new(Mutex::new(VecDeque::with_capacity(KEPT_LINES)));
    let (at_end, ended) = mpsc::channel();
    let lines = Arc::clone(&kept);
    thread::spawn(move || {
        relay(output, &lines);
        // Nobody waits any more where the step has left a process behind.
        _ = at_end.send(());
    });
    let passed = child.wait()?.success();
    _ = ended.recv_timeout(LAST_LINES);
    let kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
    Ok((passed, kept.iter().map(String::as_str).collect()))
}

/// Prints each line, and keeps the last.
fn relay(output: PipeReader, kept: &Mutex<VecDeque<String>>) {
    let mut output = BufReader::new(output);
    let mut bytes = Vec::new();
    while output.read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
        let line = String::from_utf8_lossy(&bytes).into_owned();
        print!("{line}");
        let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() == KEPT_LINES {
            kept.pop_front();
        }
        kept.push_back(line);
        bytes.clear();
    }
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
