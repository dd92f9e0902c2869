//! Programs of their own behind the one name `baliza`: what is heavy is built by those who use it only.
//!
//! `baliza serve …` starts `baliza-station serve …`, found beside this program or on the path, as git and cargo do. Help,
//! completions and manual pages ask the program for its commands ([`whole`]); without it, they have its names.

use std::env;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, ExitCode, Stdio};

use clap::{Command, CommandFactory as _};

use anyhow::{Context as _, Result};

use super::program::{Program, complain};
use super::{Arguments, help};
use description::Description;

mod description;

/// A program that `baliza` starts.
#[derive(Clone, Copy, Debug)]
pub struct Companion {
    /// Its name.
    pub program: &'static str,
    /// Where its source is.
    folder: &'static str,
    /// Its commands, each with what it does.
    commands: &'static [(&'static str, &'static str)],
}

/// The station.
pub const STATION: Companion = Companion {
    program: "baliza-station",
    folder: "host-tools/station",
    commands: &[
        ("serve", "Serve a live map, a store and an API of the positions of tags"),
        ("live", "Show a live map of the positions of tags in this terminal"),
        ("forward", "Send the telemetry of the nodes at this computer to a station elsewhere"),
        ("station", "Back up, restore and export what the station has stored"),
    ],
};

/// Debug probes. Its commands are those of `baliza`, with a driver.
pub const PROBE: Companion = Companion { program: "baliza-probe", folder: "host-tools/probe", commands: &[] };

/// Re-enacted papers and the accuracy protocol.
pub const BENCH: Companion = Companion {
    program: "baliza-bench",
    folder: "qa/bench",
    commands: &[("bench", "Benchmarks on simulated ranges and RSSI values")],
};

/// All of them.
const COMPANIONS: [Companion; 3] = [STATION, PROBE, BENCH];

/// The argument that makes a program print its commands, for the completions of `baliza`.
const DESCRIBE: &str = "--describe-commands";

impl Companion {
    /// The program's file: beside this program, else on the path.
    ///
    /// # Errors
    /// It is not there. The error says how to install it.
    pub fn find(&self) -> Result<PathBuf> {
        let name = format!("{}{}", self.program, env::consts::EXE_SUFFIX);
        let beside = env::current_exe().ok().and_then(|this| this.parent().map(Path::to_owned));
        let on_path = env::var_os("PATH").map(|path| env::split_paths(&path).collect::<Vec<_>>()).unwrap_or_default();
        beside
            .into_iter()
            .chain(on_path)
            .map(|folder| folder.join(&name))
            .find(|file| file.is_file())
            .with_context(|| format!("the program {} is not here: cargo install --path {}", self.program, self.folder))
    }

    /// Its commands as its own program describes them; the names alone where it is not there.
    fn commands(&self) -> Vec<Command> {
        let described = self.find().ok().and_then(|file| {
            let output = Process::new(file).arg(DESCRIBE).stdin(Stdio::null()).output().ok()?;
            serde_json::from_slice::<Vec<Description>>(&output.stdout).ok()
        });
        let of_this = |command: &Command| self.commands.iter().any(|(name, _)| *name == command.get_name());
        let described = described.unwrap_or_default().into_iter().map(Description::into_command).filter(of_this);
        let described: Vec<_> = described.collect();
        if described.len() == self.commands.len() { described } else { self.names() }
    }

    fn names(&self) -> Vec<Command> {
        self.commands.iter().map(|(name, about)| Command::new(*name).about(*about)).collect()
    }
}

/// The command line with the names of the companions' commands, for the list of commands.
pub fn with_names(command: Command) -> Command {
    command.subcommands(COMPANIONS.iter().flat_map(Companion::names))
}

/// The command line of `baliza` with all arguments of the companions' commands, for completions and manual pages.
pub fn whole() -> Command {
    help::grouped(Arguments::command().subcommands(COMPANIONS.iter().flat_map(Companion::commands)))
}

/// Hands the process over to another program where the arguments name a command of it; or prints the commands, where
/// another program asks for them. Else there is nothing to do.
pub fn hand_over<P: Program>() -> Option<ExitCode> {
    let mut words = env::args_os().skip(1);
    let first = words.find(|word| !is_flag(word) || word == DESCRIBE)?;
    if first == DESCRIBE {
        let commands: Vec<_> = P::grouped().get_subcommands().map(Description::of).collect();
        let described = serde_json::to_vec(&commands).map_err(anyhow::Error::from);
        return Some(match described.and_then(|text| super::print(&text)) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => complain(1, &format!("baliza: {error:#}")),
        });
    }
    // `baliza help serve` is `baliza serve --help`.
    let (name, is_help) = if first == "help" { (words.find(|word| !is_flag(word))?, true) } else { (first, false) };
    let own = P::grouped();
    let has = |companion: &&Companion| companion.commands.iter().any(|(command, _)| name == *command);
    let companion = COMPANIONS.iter().find(has)?;
    if own
        .find_subcommand(&name)
        .is_some_and(|command| command.get_arguments().next().is_some() || command.has_subcommands())
    {
        return None;
    }
    let arguments: Vec<OsString> = if is_help { vec![name, "--help".into()] } else { env::args_os().skip(1).collect() };
    Some(run(companion, &arguments))
}

fn is_flag(word: &OsString) -> bool {
    word.to_str().is_some_and(|word| word.starts_with('-'))
}

/// Hands the process over to a program, with the same arguments.
pub fn start(companion: &Companion) -> ExitCode {
    run(companion, &env::args_os().skip(1).collect::<Vec<_>>())
}

fn run(companion: &Companion, arguments: &[OsString]) -> ExitCode {
    let file = match companion.find() {
        Ok(file) => file,
        Err(error) => return complain(1, &format!("baliza {}: {error}", env::args().nth(1).unwrap_or_default())),
    };
    match replace(Process::new(&file).args(arguments)) {
        Ok(code) => code,
        Err(error) => complain(1, &format!("baliza: cannot start {}: {error}", file.display())),
    }
}

/// Runs a process in place of this one.
#[cfg(unix)]
fn replace(process: &mut Process) -> std::io::Result<ExitCode> {
    use std::os::unix::process::CommandExt as _;
    Err(process.exec())
}

/// Runs a process and ends as it ends.
#[cfg(not(unix))]
fn replace(process: &mut Process) -> std::io::Result<ExitCode> {
    let code = process.status()?.code().and_then(|code| u8::try_from(code).ok());
    Ok(ExitCode::from(code.unwrap_or(1)))
}

#[cfg(test)]
mod tests {
    use super::COMPANIONS;

    #[test]
    fn each_program_has_its_source_in_the_project() {
        for companion in COMPANIONS {
            let manifest =
                std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(companion.folder).join("Cargo.toml");
            let manifest = std::fs::read_to_string(manifest).expect(companion.folder);
            assert!(manifest.contains(&format!("name = \"{}\"", companion.program)), "{companion:?}");
        }
    }
}
