//! A compiler for bare metal: one that has the target's `core`, or one that has the source of `core` to build it from.
//!
//! With rustup, `rustup target add` gives the first. Debian's `rustc-web` has no bare-metal targets. Its package
//! `rust-web-src` has the source, and a stable compiler builds it with `-Zbuild-std` under `RUSTC_BOOTSTRAP=1`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use anyhow::{Context, Result, bail};

use crate::target::Target;
use crate::{root, target_directory};

/// The cargo profile of code that runs on a chip.
const PROFILE: &str = "firmware";

/// A compiler with its cargo, for one target.
#[derive(Clone, Debug)]
pub struct Toolchain {
    target: Target,
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
    /// The first toolchain that can build for `target`: the one on PATH, or else the system's.
    ///
    /// # Errors
    /// No compiler can build for the target, or there is no linker for it.
    pub fn find(target: Target) -> Result<Self> {
        let installed = [("cargo", "rustc"), ("/usr/bin/cargo", "/usr/bin/rustc")];
        let with = |core| move |&(cargo, rustc): &_| Self { target, cargo, rustc, core };
        if let Some(toolchain) =
            installed.iter().find(|(_, rustc)| has_compiled_core(rustc, target)).map(with(Core::Compiled))
        {
            return Ok(toolchain);
        }
        let Some((cargo, rustc)) = installed.into_iter().find(|(_, rustc)| has_core_source(rustc)) else {
            bail!(
                "no Rust compiler here can build for {target}. Either `rustup target add {target}`, or on Debian \
                 `apt-get install rustc-web cargo-web rust-web-src lld`; `.ci/setup` does whichever works",
                target = target.triple()
            );
        };
        let linker = if brings_linker(rustc) {
            None
        } else if is_installed("ld.lld") {
            Some("ld.lld")
        } else {
            bail!("{rustc} brings no linker for bare metal, and there is no ld.lld: `apt-get install lld`");
        };
        Ok(Self { target, cargo, rustc, core: Core::Source { linker } })
    }

    /// `cargo <subcommand>` for the target, in the repository's root, with its own target directory, so that a
    /// different compiler does not invalidate the desktop's builds.
    pub fn cargo(&self, subcommand: &str) -> Command {
        let mut command = Command::new(self.cargo);
        command.current_dir(root()).env("RUSTC", self.rustc);
        // RUSTFLAGS, if set, are for the desktop. The paths in an image's panic messages must not name a folder of
        // this machine.
        command.env("CARGO_ENCODED_RUSTFLAGS", remapped());
        if let (Some(headers), None) = (clang_headers(), env::var_os("BINDGEN_EXTRA_CLANG_ARGS")) {
            // libclang makes the bindings of Nordic's Bluetooth controller. It does not find its own headers where
            // the compiler of the same package is not installed.
            command.env("BINDGEN_EXTRA_CLANG_ARGS", format!("-isystem {} -ffreestanding", headers.display()));
        }
        command.args([subcommand, "--profile", PROFILE, "--target", self.target.triple(), "--target-dir"]);
        command.arg(build_directory());
        match self.core {
            Core::Compiled => {}
            Core::Source { linker } => {
                command.env("RUSTC_BOOTSTRAP", "1").arg("-Zbuild-std=core,alloc");
                if let Some(linker) = linker {
                    command.env(linker_variable(self.target), linker);
                }
            }
        }
        command
    }

    /// [`cargo`](Self::cargo) for an image that is flashed: on a Cortex-M, flip-link, where it is installed, puts the
    /// stack below the variables, so that an overflow faults.
    ///
    /// # Errors
    /// The PATH with a linker for flip-link cannot be made.
    pub fn cargo_image(&self, subcommand: &str) -> Result<Command> {
        let mut command = self.cargo(subcommand);
        if self.target.is_cortex_m() && is_installed("flip-link") {
            command.env(linker_variable(self.target), "flip-link");
            if !brings_linker(self.rustc) {
                command.env("PATH", path_with_linker()?);
            }
        }
        Ok(command)
    }

    /// The file of the binary `name` that [`cargo`](Self::cargo) builds.
    pub fn binary(&self, name: &str) -> PathBuf {
        build_directory().join(self.target.triple()).join(PROFILE).join(name)
    }

    /// Whether the compiler came with the target's `core`, as rustup's do.
    pub fn is_rustups(&self) -> bool {
        self.core == Core::Compiled
    }

    /// Whether clippy can check code for the target: only rustup's compilers have it.
    pub fn has_clippy(&self) -> bool {
        self.is_rustups() && output(self.cargo, &["clippy", "--version"]).is_some()
    }

    /// The compiler's version.
    pub fn version(&self) -> Option<String> {
        output(self.rustc, &["--version"])
    }
}

fn build_directory() -> PathBuf {
    target_directory().join("bare-metal")
}

fn linker_variable(target: Target) -> String {
    format!("CARGO_TARGET_{}_LINKER", target.variable())
}

/// Flags that make the paths of sources start at the root of the repository or of the registry, without folders of
/// this machine.
pub fn remapped() -> OsString {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| env::home_dir().map(|home| home.join(".cargo")));
    let registry = home.map(|home| home.join("registry/src")).and_then(|sources| fs::read_dir(sources).ok());
    let registries = registry.into_iter().flatten().flatten().map(|entry| entry.path());
    let mut flags = OsString::new();
    for directory in registries.chain([root().to_owned()]) {
        flags.push(if flags.is_empty() { "" } else { "\u{1f}" });
        flags.push("--remap-path-prefix=");
        flags.push(directory);
        flags.push("/=");
    }
    flags
}

/// The folder of the headers of Debian's newest libclang.
fn clang_headers() -> Option<PathBuf> {
    let below = |directory: PathBuf| fs::read_dir(directory).into_iter().flatten().flatten().map(|entry| entry.path());
    let llvms = below("/usr/lib".into()).filter(|path| path.to_string_lossy().contains("/llvm-"));
    let clangs = llvms.flat_map(|llvm| below(llvm.join("lib/clang"))).map(|clang| clang.join("include"));
    clangs.filter(|include| include.join("stdint.h").is_file()).max()
}

/// PATH with LLVM's linker under the name that flip-link calls.
fn path_with_linker() -> Result<OsString> {
    let directory = build_directory().join("linker");
    fs::create_dir_all(&directory)?;
    let name = directory.join("rust-lld");
    let path = env::var_os("PATH").unwrap_or_default();
    if !name.exists() {
        let Some(linker) = env::split_paths(&path).map(|entry| entry.join("ld.lld")).find(|file| file.is_file()) else {
            bail!("flip-link needs LLVM's linker, and there is no ld.lld: `apt-get install lld`");
        };
        std::os::unix::fs::symlink(linker, &name).with_context(|| format!("cannot make {}", name.display()))?;
    }
    Ok(env::join_paths([directory].into_iter().chain(env::split_paths(&path)))?)
}

fn has_compiled_core(rustc: &str, target: Target) -> bool {
    let libraries = output(rustc, &["--print", "target-libdir", "--target", target.triple()]);
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

/// Whether a program is on PATH. Some programs do not print a version.
pub fn is_installed(program: &str) -> bool {
    let path = env::var_os("PATH").unwrap_or_default();
    let file = format!("{program}{}", env::consts::EXE_SUFFIX);
    env::split_paths(&path).any(|directory| directory.join(&file).is_file())
}

/// The output of a program, without the line's end; `None` where it fails.
fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(Path::new(program)).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
