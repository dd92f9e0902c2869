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

/// The tests have built the programs. A build of one package would build third-party crates again, with other features.
const BUILT: [(&str, &str); 1] = [("BALIZA_BUILT", "1")];

const STEPS: [Step; 20] = [
    ("lock file", &["cargo", "fetch", "--locked"], &[]),
    ("tests", &["cargo", "test"], &[]),
    ("formatting", &["cargo", "fmt", "--all", "--check"], &[]),
    ("shape of the sources", &["cargo", "xtask", "shape"], &[]),
    ("lints", &["cargo", "clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], &[]),
    ("lean program", &["cargo", "check", "-p", "host-tools", "--lib", "--bins"], &[]),
    // After those two: third-party crates are checked already.
    ("recipes", &["cargo", "xtask", "recipes"], &[]),
    ("documentation", &["cargo", "doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")]),
    ("first command", &FIRST_COMMAND, &[]),
    // The same inputs each time: what random ones find is for those who look for it, not for the next change.
    ("fuzzing", &["cargo", "xtask", "fuzz", "--seconds", "2", "--seed", "1"], &[]),
    ("licences and advisories", &["cargo", "xtask", "deny"], &[]),
    // After the tests, which build the program that it is compared with.
    ("Python package", &["cargo", "xtask", "python"], &BUILT),
    ("oldest Rust", &["cargo", "xtask", "oldest-rust"], &[]),
    ("bare-metal builds", &["cargo", "xtask", "no-std"], &[]),
    ("firmware", &["cargo", "xtask", "firmware"], &[]),
    ("lints of the boards", &["cargo", "xtask", "firmware", "--lint"], &[]),
    // The DWM1001 at full rate drops rounds while it solves: 9.6 to 10.3 % in this run.
    ("network in QEMU", &["cargo", "xtask", "qemu", "network", "--seconds", "3", "--tolerance", "12"], &[]),
    ("promises", &["cargo", "xtask", "promises", "--check", "--quick"], &[]),
    ("cost on the chip", &["cargo", "xtask", "promises", "--check", "chip"], &[]),
    // The tests have built its program by then, and most of the time it waits: for a browser, and for a database.
    ("station", &["cargo", "xtask", "station"], &BUILT),
];

/// Steps that run beside the others, one after the other: they build into folders of their own, so that no cargo waits
/// for another one; the last one finds built what it needs. A core that one row leaves idle (a link, a test that waits,
/// QEMU) works for the other row.
const BESIDE: [&str; 10] = [
    "first command",
    "fuzzing",
    "oldest Rust",
    "bare-metal builds",
    "firmware",
    "lints of the boards",
    "network in QEMU",
    "promises",
    "cost on the chip",
    "station",
];

/// The first command of the README, exactly as there.
const FIRST_COMMAND: [&str; 11] =
    ["cargo", "run", "--release", "-p", "host-tools", "--bin", "baliza", "--", "simulate", "--plot", "room.png"];

/// Lines of output of a failed step that are printed again at the end: a reader of a long log looks there first.
const KEPT_LINES: usize = 100;

/// Lines of a failed step that name a cause and are printed after the results. Those of any more are further up.
const MOST_CAUSES: usize = 20;

/// Time for the last lines to arrive after a step has ended. A process that the step left behind may hold the pipe
/// open for ever.
const LAST_LINES: Duration = Duration::from_secs(5);

/// The result of a step.
struct Checked {
    name: &'static str,
    passed: bool,
    took: Duration,
    /// The last lines of its output.
    last_lines: String,
    /// The lines of its output that name causes of a failure.
    causes: Vec<String>,
}

/// Runs every step, even after one has failed. It ends with the last lines of each that failed, a list of the results,
/// and the causes of failures.
///
/// # Errors
/// A step fails, or its command cannot be started.
pub fn run() -> Result<()> {
    let [fetch, steps @ ..] = STEPS;
    // Whatever runs side by side needs the crates.
    let mut checked = vec![check(fetch, Output::Live)?];
    let (beside, before): (Vec<_>, Vec<_>) = steps.into_iter().partition(|(name, ..)| BESIDE.contains(name));
    checked.extend(thread::scope(|scope| {
        let beside = scope.spawn(|| beside.into_iter().map(|step| check(step, Output::AtEnd)).collect());
        let before: Result<Vec<_>> = before.into_iter().map(|step| check(step, Output::Live)).collect();
        let beside: Result<Vec<_>> = beside.join().unwrap_or_else(|panic| resume_unwind(panic));
        before.and_then(|before| Ok(before.into_iter().chain(beside?).collect::<Vec<_>>()))
    })?);
    println!();
    let failed: Vec<_> = checked.iter().filter(|step| !step.passed).collect();
    for Checked { name, last_lines, .. } in &failed {
        println!("=== {name}, which failed: its last lines\n{last_lines}");
    }
    for (name, words, _) in STEPS {
        for Checked { passed, took, .. } in checked.iter().filter(|step| step.name == name) {
            let verdict = if *passed { "passed" } else { "FAILED" };
            println!("{verdict}  {name:20} {} ({} s)", words.join(" "), took.as_secs());
        }
    }
    for Checked { name, causes, .. } in &failed {
        println!("=== {name} failed\n{}", causes.concat());
    }
    if !failed.is_empty() {
        let names: Vec<_> = failed.iter().map(|step| step.name).collect();
        bail!("{} of {} checks failed: {}", failed.len(), STEPS.len(), names.join(", "));
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
fn check((name, words, environment): Step, output: Output) -> Result<Checked> {
    let title = format!("\n=== {name}: {}", words.join(" "));
    match output {
        Output::Live => println!("{title}"),
        Output::AtEnd => println!("\n=== beside it begins: {name}"),
    }
    let start = Instant::now();
    let mut step = command(words);
    step.envs(environment.iter().copied()).current_dir(root());
    let (passed, Kept { lines, causes }) = ran(step, output)?;
    if let Output::AtEnd = output {
        // In one piece, between the lines of the other row.
        print!("{title} (beside)\n{}=== {name} has ended\n", lines.iter().map(String::as_str).collect::<String>());
    }
    let last_lines = lines.iter().skip(lines.len().saturating_sub(KEPT_LINES)).map(String::as_str).collect();
    Ok(Checked { name, passed, took: start.elapsed(), last_lines, causes })
}

/// What is kept of a step's output.
#[derive(Default)]
struct Kept {
    /// All lines, or the last [`KEPT_LINES`] where they are printed as they come.
    lines: VecDeque<String>,
    /// The first lines that name causes of a failure.
    causes: Vec<String>,
}

impl Kept {
    fn push(&mut self, line: String, output: Output) {
        if names_cause(&line) && self.causes.len() < MOST_CAUSES {
            self.causes.push(line.clone());
        }
        match output {
            Output::Live if self.lines.len() == KEPT_LINES => drop(self.lines.pop_front()),
            Output::Live | Output::AtEnd => {}
        }
        self.lines.push_back(line);
    }
}

/// Whether a line of output names a cause of a failure: a failed test, a panic, or an error.
fn names_cause(line: &str) -> bool {
    let line = line.trim();
    let is_failed_test = line.starts_with("test ") && line.ends_with("FAILED");
    is_failed_test || line.contains("panicked at") || line.starts_with("error:") || line.starts_with("error[")
}

/// Runs a command. Returns whether it succeeded, and what is kept of its output.
fn ran(mut command: Command, output_is: Output) -> Result<(bool, Kept)> {
    let (output, writer) = io::pipe()?;
    let mut child = command.stdout(writer.try_clone()?).stderr(writer).spawn()?;
    // It holds ends of the pipe: while these are open, the output has no end.
    drop(command);
    let kept = Arc::new(Mutex::new(Kept::default()));
    let (at_end, ended) = mpsc::channel();
    let shared = Arc::clone(&kept);
    thread::spawn(move || {
        relay(output, &shared, output_is);
        // Nobody waits any more where the step has left a process behind.
        _ = at_end.send(());
    });
    let passed = child.wait()?.success();
    _ = ended.recv_timeout(LAST_LINES);
    let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
    Ok((passed, std::mem::take(&mut *kept)))
}

/// Keeps the lines, and prints them as they come where that is asked for.
fn relay(output: PipeReader, kept: &Mutex<Kept>, output_is: Output) {
    let mut output = BufReader::new(output);
    let mut bytes = Vec::new();
    while output.read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
        let line = String::from_utf8_lossy(&bytes).into_owned();
        if let Output::Live = output_is {
            print!("{line}");
        }
        kept.lock().unwrap_or_else(PoisonError::into_inner).push(line, output_is);
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

#[cfg(test)]
mod tests {
    use super::{Kept, MOST_CAUSES, Output};

    #[test]
    fn failed_tests_panics_and_errors_are_kept_from_a_long_output() {
        let mut kept = Kept::default();
        let causes = [
            "test frames::a_cut_frame_is_refused ... FAILED\n",
            "thread 'frames::a_cut_frame_is_refused' (7) panicked at wire/src/uwb/mod.rs:12:5:\n",
            "error[E0308]: mismatched types\n",
            "error: 1 target failed:\n",
        ];
        for cause in causes {
            kept.push(cause.to_owned(), Output::Live);
            for line in ["test frames::error_is_named ... ok\n", "   Compiling anyhow v1\n"].repeat(100) {
                kept.push(line.to_owned(), Output::Live);
            }
        }
        assert_eq!(kept.causes, causes);
    }

    #[test]
    fn causes_beyond_the_first_are_left_out() {
        let mut kept = Kept::default();
        (0..=MOST_CAUSES).for_each(|number| kept.push(format!("error: {number}\n"), Output::AtEnd));
        assert_eq!((kept.causes.len(), kept.lines.len()), (MOST_CAUSES, MOST_CAUSES + 1));
    }
}
