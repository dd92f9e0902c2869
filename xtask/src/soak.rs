//! Runs all test programs again and again, several at once and beside programs that keep every core busy. A test that
//! depends on the clock, a free port, load or order fails in some of the runs.

use std::fs::{self, File};
use std::hint;
use std::path::Path;
use std::process::Stdio;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail};

use crate::test_programs::{self, TestProgram};
use crate::{ended, in_parallel, target_directory};

/// A test program that runs for longer hangs.
const HANGS: Duration = Duration::from_secs(1800);

/// What is run, how often and under which load.
#[derive(clap::Args)]
pub struct Arguments {
    /// How often each program runs
    #[arg(long, value_name = "N", default_value_t = 10)]
    times: usize,
    /// How many programs run at once
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..))]
    jobs: u16,
    /// Loops that only use a core [default: as many as there are cores]
    #[arg(long, value_name = "N")]
    busy: Option<usize>,
    /// Only programs with this in their name, such as `station` or `host_tools`
    #[arg(value_name = "NAME")]
    only: Option<String>,
}

/// Builds the test programs and runs them.
///
/// # Errors
/// They do not build, or one of the runs fails.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut programs = test_programs::all()?;
    programs.retain(|program| arguments.only.as_ref().is_none_or(|only| program.name.contains(only.as_str())));
    let runs: Vec<_> =
        (1..=arguments.times).flat_map(|time| programs.iter().map(move |program| (time, program))).collect();
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let busy = arguments.busy.unwrap_or(cores);
    println!("{} programs, {} times, {} at once, {busy} busy loops", programs.len(), arguments.times, arguments.jobs);
    let logs = target_directory().join("soak");
    fs::create_dir_all(&logs).with_context(|| format!("cannot make {}", logs.display()))?;
    for _ in 0..busy {
        // It ends with this program.
        thread::spawn(|| {
            loop {
                hint::spin_loop();
            }
        });
    }
    let verdicts = in_parallel(arguments.jobs.into(), &runs, |(time, program)| {
        let log = logs.join(format!("{}-{time}.log", program.name.replace(['/', ' '], "-")));
        let verdict = once(program, &log);
        if let Err(error) = &verdict {
            println!("=== {}, run {time}: {error:#}", program.name);
        }
        verdict
    });
    // A reader of a long log looks at its end.
    let failed: Vec<_> =
        runs.iter().zip(verdicts).filter(|(_, verdict)| verdict.is_err()).map(|(run, _)| run).collect();
    for (time, program) in &failed {
        println!("FAILED {}, run {time}", program.name);
    }
    println!("{} programs, {} runs, {} failed", programs.len(), runs.len(), failed.len());
    if !failed.is_empty() {
        bail!("{} of {} runs failed", failed.len(), runs.len());
    }
    Ok(())
}

/// Runs a program once; its output goes into `log`, which stays where it fails.
///
/// # Errors
/// It fails or hangs: its output.
fn once(program: &TestProgram, log: &Path) -> Result<()> {
    let output = File::create(log).with_context(|| format!("cannot make {}", log.display()))?;
    let mut command = program.command();
    command.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output);
    let mut child = command.spawn().with_context(|| format!("cannot run {}", program.name))?;
    let verdict = match ended(&mut child, HANGS)? {
        Some(status) if status.success() => {
            return fs::remove_file(log).with_context(|| format!("cannot remove {}", log.display()));
        }
        Some(status) => status.to_string(),
        None => format!("still running after {} s", HANGS.as_secs()),
    };
    let said = fs::read(log).with_context(|| format!("cannot read {}", log.display()))?;
    bail!("{verdict}\n{}", String::from_utf8_lossy(&said))
}
