//! Everything that continuous integration checks, as a list of commands.

use std::collections::VecDeque;
use std::env;
use std::io::{self, BufRead, BufReader, PipeReader};
use std::panic::resume_unwind;
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
    ("shape of the sources", &["cargo", "xtask", "shape"], &[]),
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
    ("network in QEMU", &["cargo", "xtask", "qemu", "network", "--seconds", "3"], &[]),
    ("promises", &["cargo", "xtask", "promises", "--check", "--quick"], &[]),
    ("cost on the chip", &["cargo", "xtask", "promises", "--check", "chip"], &[]),
];

/// Steps that run beside the others, one after the other: they build into folders of their own, so that no cargo waits
/// for another one. A core that one row leaves idle (a link, a test that waits, QEMU) works for the other row.
const BESIDE: [&str; 9] = [
    "first command",
    "fuzzing",
    "oldest Rust",
    "bare-metal builds",
    "firmware",
    "lints of the boards",
    "network in QEMU",
    "promises",
    "cost on the chip",
];

/// The first command of the README, exactly as there.
const FIRST_COMMAND: [&str; 11] =
    ["cargo", "run", "--release", "-p", "host-tools", "--bin", "baliza", "--", "simulate", "--plot", "room.png"];

/// Lines of output of a failed step that are printed again at the end: a reader of a long log looks there first.
const KEPT_LINES: usize = 100;

/// Time for the last lines to arrive after a step has ended. A process that the step left behind may hold the pipe
/// open for ever.
const LAST_LINES: Duration = Duration::from_secs(5);

/// The result of a step.
struct Outcome {
    name: &'static str,
    passed: bool,
    took: Duration,
    /// The last lines of its output.
    last_lines: String,
}

/// Runs every step, even after one has failed. It ends with the last lines of each that failed and a list of the
/// results.
///
/// # Errors
/// A step fails, or its command cannot be started.
pub fn run() -> Result<()> {
    let [fetch, steps @ ..] = STEPS;
    // Whatever runs side by side needs the crates.
    let mut outcomes = vec![outcome(fetch, Output::Live)?];
    let (beside, before): (Vec<_>, Vec<_>) = steps.into_iter().partition(|(name, ..)| BESIDE.contains(name));
    outcomes.extend(thread::scope(|scope| {
        let beside = scope.spawn(|| beside.into_iter().map(|step| outcome(step, Output::AtEnd)).collect());
        let before: Result<Vec<_>> = before.into_iter().map(|step| outcome(step, Output::Live)).collect();
        let beside: Result<Vec<_>> = beside.join().unwrap_or_else(|panic| resume_unwind(panic));
        before.and_then(|before| Ok(before.into_iter().chain(beside?).collect::<Vec<_>>()))
    })?);
    println!();
    for Outcome { name, last_lines, .. } in outcomes.iter().filter(|outcome| !outcome.passed) {
        println!("=== {name}, which failed: its last lines\n{last_lines}");
    }
    for (name, words, _) in STEPS {
        for Outcome { passed, took, .. } in outcomes.iter().filter(|outcome| outcome.name == name) {
            let verdict = if *passed { "passed" } else { "FAILED" };
            println!("{verdict}  {name:20} {} ({} s)", words.join(" "), took.as_secs());
        }
    }
    let failed = outcomes.iter().filter(|outcome| !outcome.passed).count();
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

/// When the output of a step is printed.
#[derive(Clone, Copy)]
enum Output {
    /// As it comes.
    Live,
    /// As a whole, when the step has ended: another step prints meanwhile.
    AtEnd,
}

/// Runs a step.
fn outcome((name, words, environment): Step, output: Output) -> Result<Outcome> {
    let title = format!("\n=== {name}: {}", words.join(" "));
    match output {
        Output::Live => println!("{title}"),
        Output::AtEnd => println!("\n=== beside it begins: {name}"),
    }
    let start = Instant::now();
    let mut step = command(words);
    step.envs(environment.iter().copied()).current_dir(root());
    let (passed, lines) = ran(step, output)?;
    if let Output::AtEnd = output {
        // In one piece, between the lines of the other row.
        print!("{title} (beside)\n{}=== {name} has ended\n", lines.iter().map(String::as_str).collect::<String>());
    }
    let last_lines = lines.iter().skip(lines.len().saturating_sub(KEPT_LINES)).map(String::as_str).collect();
    Ok(Outcome { name, passed, took: start.elapsed(), last_lines })
}

/// Runs a command. Returns whether it succeeded, and its output: if that is printed as it comes, the last
/// [`KEPT_LINES`], else all of it.
fn ran(mut command: Command, output_is: Output) -> Result<(bool, VecDeque<String>)> {
    let (output, writer) = io::pipe()?;
    let mut child = command.stdout(writer.try_clone()?).stderr(writer).spawn()?;
    // It holds ends of the pipe: while these are open, the output has no end.
    drop(command);
    let kept = Arc::new(Mutex::new(VecDeque::with_capacity(KEPT_LINES)));
    let (at_end, ended) = mpsc::channel();
    let lines = Arc::clone(&kept);
    thread::spawn(move || {
        relay(output, &lines, output_is);
        // Nobody waits any more where the step has left a process behind.
        _ = at_end.send(());
    });
    let passed = child.wait()?.success();
    _ = ended.recv_timeout(LAST_LINES);
    let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
    Ok((passed, std::mem::take(&mut *kept)))
}

/// Prints each line and keeps the last ones, or keeps all lines.
fn relay(output: PipeReader, kept: &Mutex<VecDeque<String>>, output_is: Output) {
    let mut output = BufReader::new(output);
    let mut bytes = Vec::new();
    while output.read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
        let line = String::from_utf8_lossy(&bytes).into_owned();
        let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Output::Live = output_is {
            print!("{line}");
            if kept.len() == KEPT_LINES {
                kept.pop_front();
            }
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
