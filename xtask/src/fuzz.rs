//! Fuzzing: builds the targets of `qa/fuzz` with the compiler's coverage instrumentation, on stable Rust, and runs them.

use std::num::NonZero;
use std::path::Path;
use std::process::Command;
use std::{env, fs, thread};

use anyhow::{Context, Result, bail};

use crate::{cargo, in_parallel, printed, root, succeed};

/// What makes the compiler instrument the code for libFuzzer.
const INSTRUMENTATION: [&str; 7] = [
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
    "--cfg",
    "fuzzing",
];
/// From how many seconds a target on, optimised binaries gain more than their build takes.
const WORTH_OPTIMISING_S: u32 = 30;
/// The binaries with targets.
const BINARIES: [&str; 2] = ["nodes", "host"];

/// The arguments of `cargo xtask fuzz`.
#[derive(clap::Args)]
pub struct Arguments {
    /// How long each target runs, seconds.
    #[arg(long, value_name = "N", default_value_t = 60)]
    seconds: u32,
    /// What random inputs begin with: equal seeds give equal inputs. 0: another each time.
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u32,
    /// Only this target.
    #[arg(long, value_name = "T")]
    target: Option<String>,
}

/// Runs the targets, one on each processor at a time. Inputs that cover new code stay in `target/fuzz/corpus`, those that fail in
/// `target/fuzz/artifacts`.
///
/// # Errors
/// A target finds something, there is no such target, or a build fails.
pub fn run(arguments: &Arguments) -> Result<()> {
    let triple = host_triple()?;
    let folder = root().join("target/fuzz");
    let profile = if arguments.seconds < WORTH_OPTIMISING_S { "quick" } else { "release" };
    build(&triple, profile)?;
    let mut targets = Vec::new();
    for binary in BINARIES {
        let program = folder.join(&triple).join(profile).join(binary);
        let names = printed(Command::new(&program).env_remove("FUZZ_TARGET"))?;
        let wanted = names.lines().filter(|name| arguments.target.as_deref().is_none_or(|only| only == *name));
        targets.extend(wanted.map(|name| (program.clone(), name.to_owned())));
    }
    if targets.is_empty() {
        bail!("there is no target {}", arguments.target.as_deref().unwrap_or_default());
    }
    let cores = thread::available_parallelism().map_or(1, NonZero::get);
    let passed = in_parallel(cores, &targets, |(program, name)| fuzz(program, name, arguments));
    let passed = passed.into_iter().collect::<Result<Vec<_>>>()?;
    let failed: Vec<_> =
        targets.iter().zip(passed).filter(|(_, passed)| !passed).map(|((_, name), _)| &**name).collect();
    if failed.is_empty() { Ok(()) } else { bail!("found by {}: see target/fuzz/artifacts", failed.join(", ")) }
}

fn build(triple: &str, profile: &str) -> Result<()> {
    // The target is named so that build scripts and macros are not instrumented.
    let arguments =
        "build --locked --manifest-path qa/fuzz/Cargo.toml --features host --target-dir target/fuzz --target";
    let mut build = cargo();
    build.args(arguments.split(' ')).args([triple, "--profile", profile]).env("RUSTFLAGS", INSTRUMENTATION.join(" "));
    succeed(&mut build).context("the fuzz targets do not build")
}

/// Runs a target from its seeds and the corpus of earlier runs; false where it finds something.
fn fuzz(program: &Path, name: &str, &Arguments { seconds, seed, .. }: &Arguments) -> Result<bool> {
    let [corpus, artifacts] = ["corpus", "artifacts"].map(|kind| root().join("target/fuzz").join(kind));
    let corpus = corpus.join(name);
    for folder in [&corpus, &artifacts] {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    printed(Command::new(program).env("FUZZ_TARGET", name).env("FUZZ_SEEDS", &corpus))?;
    println!("{name}: {seconds} s");
    let run = Command::new(program)
        .args([format!("-max_total_time={seconds}"), format!("-seed={seed}")])
        .arg(format!("-artifact_prefix={}/{name}-", artifacts.display()))
        .args(["-timeout=10", "-rss_limit_mb=2048", "-close_fd_mask=1", "-verbosity=0", "-print_final_stats=1"])
        .arg(&corpus)
        .env("FUZZ_TARGET", name)
        .output()?;
    let said = String::from_utf8_lossy(&run.stderr);
    if run.status.success() {
        let executions = said.lines().find_map(|line| line.strip_prefix("stat::number_of_executed_units:"));
        println!("{name}: {} executions", executions.unwrap_or("?").trim());
    } else {
        println!("{said}");
    }
    Ok(run.status.success())
}

fn host_triple() -> Result<String> {
    let version = printed(Command::new(env::var_os("RUSTC").unwrap_or_else(|| "rustc".into())).arg("-vV"))?;
    let host = version.lines().find_map(|line| line.strip_prefix("host: "));
    Ok(host.context("rustc does not say its host")?.to_owned())
}
