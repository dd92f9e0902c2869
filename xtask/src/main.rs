//! The project's own tasks: `cargo xtask --help`.

mod air;
mod baliza;
mod bench_boards;
mod changelog;
mod chip;
mod ci;
mod deny;
mod dist;
mod firmware;
mod fuzz;
mod network;
mod onchip;
mod promises;
mod protocol;
mod python;
mod qemu;
mod recipes;
mod shape;
mod sizes;
mod soak;
mod station;
mod tables;
mod target;
mod test_programs;
mod toolchain;
mod tour;
mod workspace;

use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::{Parser, Subcommand};

use chip::Chip;
use toolchain::Toolchain;
use workspace::Package;

/// The project's own tasks. `cargo xtask ci` runs exactly what continuous integration runs.
#[derive(Parser)]
#[command(bin_name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// Run all checks of continuous integration, one after the other, and say which passed. `.ci/setup` installs what
    /// they need.
    Ci,
    /// Measure lines, names, functions and files, and compare them with the budgets in xtask/src/shape/budgets.rs.
    Shape(shape::Arguments),
    /// Apply each patch of examples/recipes to a copy of the sources, count the files that it touches, and build it.
    Recipes,
    /// Run all test programs again and again, several at once on a busy computer, and print what failed: tests that
    /// depend on time, load or order show themselves.
    Soak(soak::Arguments),
    /// Compile the crates that need no operating system for bare-metal Cortex-M4F and RISC-V, with and without their
    /// logging.
    NoStd,
    /// Check each crate that builds with an older Rust than the others with the one that its manifest names,
    /// where rustup has it.
    OldestRust,
    /// Build the images of all roles, boards and variants into target/firmware, check what boards, bootloaders and
    /// probes look for in them, and compare their sizes with their budgets.
    Firmware(firmware::Arguments),
    /// Make the folder of a release: images, `baliza`, manual, licences, parts lists and sums.
    Dist(dist::Arguments),
    /// Join the fragments of changes/ into CHANGELOG.md as the changes of a version, and remove them.
    Changelog(changelog::Arguments),
    /// Check licences, sources and advisories of third-party crates by deny.toml.
    Deny,
    /// Print what the flash of images is spent on: driver, exchanges, engine, solvers, telemetry, Bluetooth and so on.
    Sizes(sizes::Arguments),
    /// Run nodes' images in QEMU.
    #[command(subcommand)]
    Qemu(Qemu),
    /// Build the wheel of the Python package, and run its tests and its example.
    Python,
    /// Build the station's page, compare it with the committed build, test it in Chromium against a real station, test
    /// the store against a PostgreSQL, which is killed in the end, and make requests at random.
    Station(station::Arguments),
    /// Compare the accuracy of solver, track and fingerprints with an earlier version, over all recordings and a
    /// simulated set: qa/accuracy/README.md.
    Accuracy(protocol::Arguments),
    /// Fuzz what comes from the air, wires, flash and files.
    Fuzz(fuzz::Arguments),
    /// Remake the figures that documents print, or check that they still hold: promises.toml lists them.
    ///
    /// Recordings are looked for in the folder that BALIZA_DATA names, else in ../shared/data; figures of recordings
    /// that are not there stay as they are. All together take some twenty minutes, those of --quick two.
    Promises(promises::Arguments),
    /// Go through the steps of docs/use/hardware.md with boards on the desk: flash, provision, listen, and report.
    BenchBoards(bench_boards::Arguments),
}

/// What runs in QEMU.
#[derive(Subcommand)]
enum Qemu {
    /// A tag and four anchors on simulated DW1000s: they range as often, and come as late, as in `baliza simulate`.
    Network(network::Arguments),
}

fn main() -> ExitCode {
    match run(&Arguments::parse().chore) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(chore: &Chore) -> Result<()> {
    match chore {
        Chore::Ci => ci::run(),
        Chore::Shape(arguments) => shape::run(arguments),
        Chore::Recipes => recipes::run(),
        Chore::Soak(arguments) => soak::run(arguments),
        Chore::NoStd => no_std(),
        Chore::OldestRust => oldest_rust(),
        Chore::Firmware(arguments) => firmware::run(arguments),
        Chore::Dist(arguments) => dist::run(arguments),
        Chore::Changelog(arguments) => changelog::run(arguments),
        Chore::Deny => deny::run(),
        Chore::Sizes(arguments) => sizes::run(arguments),
        Chore::Qemu(Qemu::Network(arguments)) => network::run(arguments),
        Chore::Python => python::run(),
        Chore::Station(arguments) => station::run(arguments),
        Chore::Accuracy(arguments) => protocol::run(arguments),
        Chore::Fuzz(arguments) => fuzz::run(arguments),
        Chore::Promises(arguments) => promises::run(arguments),
        Chore::BenchBoards(arguments) => bench_boards::run(arguments),
    }
}

fn no_std() -> Result<()> {
    let packages = workspace::packages()?;
    for chip in Chip::ALL {
        let toolchain = Toolchain::find(chip.target())?;
        // The images of a board build what the board needs.
        let is_library = |package: &&Package| package.is_no_std() && !package.name.starts_with(firmware::BOARDS);
        for Package { name, features, .. } in packages.iter().filter(is_library) {
            // The images are made of them; here they need not become code.
            succeed(toolchain.cargo("check").args(["--package", name]))?;
            if features.contains_key("defmt") {
                succeed(toolchain.cargo("check").args(["--package", name, "--features", "defmt"]))?;
            }
        }
    }
    Ok(())
}

fn oldest_rust() -> Result<()> {
    let packages = workspace::packages()?;
    let usual =
        packages.iter().find(|package| package.name == "xtask").and_then(|package| package.rust_version.clone());
    for Package { name, rust_version, .. } in packages.iter().filter(|package| package.rust_version != usual) {
        let Some(version) = rust_version else { bail!("{name} names no Rust version") };
        let mut rustup = Command::new("rustup");
        rustup.args(["run", version, "cargo", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
        if rustup.status().is_ok_and(|status| status.success()) {
            let mut check = Command::new("rustup");
            check.args(["run", version, "cargo", "check", "--quiet", "--package", name, "--target-dir"]);
            succeed(check.arg(target_directory().join("oldest-rust")).env_remove("RUSTC").current_dir(root()))?;
            println!("{name} builds with Rust {version}");
        } else {
            println!("Rust {version} is not here: {name} is not tried with it");
        }
    }
    Ok(())
}

/// The root of the repository.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("xtask is in the repository")
}

/// The folder of build outputs.
fn target_directory() -> PathBuf {
    root().join(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

/// The cargo that runs this program, in the root of the repository.
fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root());
    command
}

/// The standard output of a command; an error where it fails.
fn printed(command: &mut Command) -> Result<String> {
    let output = command.stderr(Stdio::inherit()).output().with_context(|| format!("cannot run {command:?}"))?;
    if !output.status.success() {
        bail!("{command:?}: {}", output.status);
    }
    Ok(String::from_utf8(output.stdout)?)
}

/// Runs a command in the foreground; an error where it fails.
fn succeed(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("cannot run {command:?}"))?;
    if !status.success() {
        bail!("{command:?}: {status}");
    }
    Ok(())
}

/// Waits for a program, which is killed after `patience`. Returns its status; `None` where it was killed.
fn ended(child: &mut Child, patience: Duration) -> Result<Option<ExitStatus>> {
    let begun = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if begun.elapsed() > patience {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        thread::sleep(Duration::from_millis(20));
    }
}

/// Does work on each item, on this many at once. Returns the results in the order of the items.
fn in_parallel<T: Sync, R: Send>(jobs: usize, items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let worker = || {
        let taken = std::iter::repeat_with(|| next.fetch_add(1, Ordering::Relaxed));
        taken.map_while(|at| Some((at, work(items.get(at)?)))).collect::<Vec<_>>()
    };
    let mut done: Vec<_> = thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs).map(|_| scope.spawn(worker)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    done.sort_by_key(|(at, _)| *at);
    done.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::in_parallel;

    #[test]
    fn work_in_parallel_keeps_the_order() {
        let items: Vec<u64> = (0..100).collect();
        let squares: Vec<u64> = (0..100).map(|item| item * item).collect();
        assert_eq!(in_parallel(4, &items, |item| item * item), squares);
    }
}
