//! Runs all test programs again and again, several at once and beside programs that keep every core busy. A test that
//! depends on the clock, a free port, load or order fails in some of the runs.

use std::fs::{self, File};
use std::hint;
use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use crate::target_directory;
use crate::test_programs::{self, TestProgram};

/// A test program that runs for longer hangs.
const HANGS: Duration = Duration::from_secs(1800);
/// The interval between two looks at a running program.
const LOOK: Duration = Duration::from_millis(50);

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
        (0..arguments.times).flat_map(|time| programs.iter().map(move |program| (time, program))).collect();
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let busy = arguments.busy.unwrap_or(cores);
    println!("{} programs, {} times, {} at once, {busy} busy loops", programs.len(), arguments.times, arguments.jobs);
    let (next, failed, over) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicBool::new(false));
    let logs = target_directory().join("soak");
    fs::create_dir_all(&logs).with_context(|| format!("cannot make {}", logs.display()))?;
    thread::scope(|scope| {
        for _ in 0..busy {
            scope.spawn(|| {
                while !over.load(Ordering::Relaxed) {
                    (0..10_000).for_each(|_| hint::spin_loop());
                }
            });
        }
        let workers: Vec<_> = (0..arguments.jobs)
            .map(|job| {
                let (runs, next, failed, log) = (&runs, &next, &failed, logs.join(format!("{job}.log")));
                scope.spawn(move || {
                    while let Some((time, program)) = runs.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if let Err(error) = once(program, &log) {
                            failed.fetch_add(1, Ordering::Relaxed);
                            println!("=== {}, run {}: {error:#}", program.name, time + 1);
                        }
                    }
                })
            })
            .collect();
        let ended = workers.into_iter().map(|worker| worker.join().is_ok()).collect::<Vec<_>>();
        over.store(true, Ordering::Relaxed);
        if ended.contains(&false) { bail!("a worker has panicked") } else { Ok(()) }
    })?;
    let failed = failed.into_inner();
    println!("{} runs, {failed} failed", runs.len());
    if failed > 0 {
        bail!("{failed} runs failed");
    }
    Ok(())
}

/// Runs a program once; its output goes into `log`.
///
/// # Errors
/// It fails or hangs: its output.
fn once(program: &TestProgram, log: &Path) -> Result<()> {
    let output = File::create(log).with_context(|| format!("cannot make {}", log.display()))?;
    let mut command = program.command();
    command.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output);
    let mut child = command.spawn().with_context(|| format!("cannot run {}", program.name))?;
    let begun = Instant::now();
    let verdict = loop {
        if let Some(status) = child.try_wait()? {
            break if status.success() { return Ok(()) } else { status.to_string() };
        }
        if begun.elapsed() > HANGS {
            child.kill()?;
            child.wait()?;
            break format!("still running after {} s", HANGS.as_secs());
        }
        thread::sleep(LOOK);
    };
    let said = fs::read(log).with_context(|| format!("cannot read {}", log.display()))?;
    bail!("{verdict}\n{}", String::from_utf8_lossy(&said))
}
