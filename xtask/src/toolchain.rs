//! A compiler for bare metal: one that has the target's `core`, or one that has the source of `core` to build it from.
//!
//! With rustup the first is a `rustup target add` away. Debian's `rustc-web` has no bare-metal targets but, with
//! `rust-web-src`, the source: `-Zbuild-std`, which a stable compiler takes under `RUSTC_BOOTSTRAP=1`, does the rest.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Result, bail};

use crate::chip::Chip;
use crate::{root, target_directory};

/// The cargo profile of whatever runs on a chip.
const PROFILE: &str = "firmware";

/// A compiler with its cargo.
#[derive(Clone, Debug)]
pub struct Toolchain {
    cargo: &'static str,
    rustc: &'static str,
    core: Core,
}

/// Where `core` comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Core {
    /// It came with the compiler.
    Compiled,
    /// It is built from source, and linked with the linker of this name where the compiler brings none.
    Source { linker: Option<&'static str> },
}

impl Toolchain {
    /// The first toolchain that can build for `chip`: the one on PATH, or else the system's.
    pub fn find(chip: Chip) -> Result<Self> {
        let installed = [("cargo", "rustc"), ("/usr/bin/cargo", "/usr/bin/rustc")];
        let with = |core| move |&(cargo, rustc): &_| Self { cargo, rustc, core };
        if let Some(toolchain) =
            installed.iter().find(|(_, rustc)| has_compiled_core(rustc, chip)).map(with(Core::Compiled))
        {
            return Ok(toolchain);
        }
        let Some((cargo, rustc)) = installed.into_iter().find(|(_, rustc)| has_core_source(rustc)) else {
            bail!(
                "no Rust compiler here can build for {target}. Either `rustup target add {target}`, or on Debian \
                 `apt-get install rustc-web cargo-web rust-web-src lld`; `.ci/setup` does whichever works",
                target = chip.triple()
            );
        };
        let linker = if brings_linker(rustc) {
            None
        } else if answers("ld.lld") {
            Some("ld.lld")
        } else {
            bail!("{rustc} brings no linker for bare metal, and there is no ld.lld: `apt-get install lld`");
        };
        Ok(Self { cargo, rustc, core: Core::Source { linker } })
    }

    /// `cargo <subcommand>` for `chip`, in the repository's root, with its own target directory: a different compiler must
    /// not make the desktop's builds stale.
    pub fn cargo(&self, subcommand: &str, chip: Chip) -> Command {
        let mut command = Command::new(self.cargo);
        // RUSTFLAGS, if set, were meant for the desktop.
        command.current_dir(root()).env("RUSTC", self.rustc).env_remove("RUSTFLAGS");
        command.args([subcommand, "--profile", PROFILE, "--target", chip.triple(), "--target-dir"]);
        command.arg(build_directory());
        match self.core {
            Core::Compiled => {}
            Core::Source { linker } => {
                command.env("RUSTC_BOOTSTRAP", "1").arg("-Zbuild-std=core,alloc");
                if let Some(linker) = linker {
                    let triple = chip.triple().replace('-', "_").to_uppercase();
                    command.env(format!("CARGO_TARGET_{triple}_LINKER"), linker);
                }
            }
        }
        command
    }

    /// Where [`cargo`](Self::cargo) leaves the binary `name`.
    pub fn binary(chip: Chip, name: &str) -> PathBuf {
        build_directory().join(chip.triple()).join(PROFILE).join(name)
    }

    /// The compiler's version.
    pub fn version(&self) -> Option<String> {
        output(self.rustc, &["--version"])
    }
}

fn build_directory() -> PathBuf {
    target_directory().join("bare-metal")
}

fn has_compiled_core(rustc: &str, chip: Chip) -> bool {
    let libraries = output(rustc, &["--print", "target-libdir", "--target", chip.triple()]);
    let entries = libraries.and_then(|path| std::fs::read_dir(path).ok());
    entries.is_some_and(|entries| {
        entries.flatten().any(|entry| entry.file_name().to_string_lossy().starts_with("libcore-"))
    })
}

fn has_core_source(rustc: &str) -> bool {
    sysroot(rustc).is_some_and(|sysroot| sysroot.join("lib/rustlib/src/rust/library/core/src/lib.rs").is_file())
}

/// Whether the compiler comes with LLVM's linker.
fn brings_linker(rustc: &str) -> bool {
    let host = output(rustc, &["--print", "host-tuple"]);
    sysroot(rustc)
        .zip(host)
        .is_some_and(|(sysroot, host)| sysroot.join("lib/rustlib").join(host).join("bin/rust-lld").is_file())
}

fn sysroot(rustc: &str) -> Option<PathBuf> {
    output(rustc, &["--print", "sysroot"]).map(PathBuf::from)
}

fn answers(program: &str) -> bool {
    Command::new(program)
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success())
}

/// What a program prints, without the line's end; nothing where it fails.
fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(Path::new(program)).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
