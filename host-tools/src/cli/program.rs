//! The frame of a program: it reads the arguments, runs the command, and reports an error.
//!
//! Data goes to standard output or to files, diagnostics go to standard error. Exit code 0: success. Exit code 2: the
//! input or the arguments are wrong, and one line says how. Exit code 1: any other error, with its causes.

use std::error::Error;
use std::io::{self, Write};
use std::process::ExitCode;

use anyhow::Result;
use clap::error::ErrorKind;
use clap::{Command, FromArgMatches};
use node_link::probe::NoDriver;
use recording::{Interrupted, UserError};

use super::verbosity::Verbosity;
use super::{companion, json, paths};

/// The command line of a program.
pub trait Program: FromArgMatches {
    /// The program's commands, in groups.
    fn grouped() -> Command;

    /// How much goes to standard error.
    fn verbosity(&self) -> Verbosity;

    /// Runs the given command.
    ///
    /// # Errors
    /// The command returns an error.
    fn run(&self) -> Result<()>;
}

/// Runs a program with the arguments of the process. A command of another program is handed over to that one.
pub fn program<P: Program>() -> ExitCode {
    if let Some(code) = companion::hand_over::<P>() {
        return code;
    }
    let mut command = P::grouped();
    let called = called(&command);
    json::begin(&called);
    let parsed = command.try_get_matches_from_mut(std::env::args_os());
    let parsed = parsed.and_then(|matches| Ok((P::from_arg_matches(&matches)?, matches)));
    let (arguments, matches) = match parsed {
        Ok(parsed) => parsed,
        Err(error) => return refuse(&error, &called),
    };
    arguments.verbosity().apply();
    let checked = paths::check(&command, &matches).map_err(anyhow::Error::from);
    match checked.and_then(|()| arguments.run()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<NoDriver>() => companion::start(&companion::PROBE),
        Err(error) => report(&error),
    }
}

fn report(error: &anyhow::Error) -> ExitCode {
    if wants_json() {
        // If standard output is closed, the line on standard error is left.
        let _ = json::print_error(error);
    }
    match user_error(error) {
        Some(wrong) => complain(2, &wrong.to_string()),
        None if error.is::<Interrupted>() => complain(130, &format!("baliza: {error}")),
        None => complain(1, &format!("baliza: {error:#}")),
    }
}

/// The mistake of the user that an error is, also where a file could not be opened or written for it.
pub(super) fn user_error<'e>(error: &'e anyhow::Error) -> Option<&'e UserError> {
    let within = |cause: &'e (dyn Error + 'static)| cause.downcast_ref::<io::Error>()?.get_ref()?.downcast_ref();
    error.downcast_ref().or_else(|| error.chain().find_map(within))
}

/// Whether errors are JSON too. The arguments may be wrong, so they are read as they are.
fn wants_json() -> bool {
    std::env::args_os().any(|argument| argument == "--json")
}

/// Prints help and version unchanged, and an error in the arguments on one line, without the usage.
fn refuse(error: &clap::Error, called: &str) -> ExitCode {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            match error.print().and_then(|()| std::io::stdout().flush()) {
                // If the reader closed its end, the help is not needed.
                Err(unwritten) if unwritten.kind() != io::ErrorKind::BrokenPipe => {
                    complain(1, &format!("baliza: cannot write to standard output: {unwritten}"))
                }
                Ok(()) | Err(_) if error.use_stderr() => ExitCode::from(2),
                Ok(()) | Err(_) => ExitCode::SUCCESS,
            }
        }
        _ => {
            let text = error.render().to_string();
            let said = text.split("\n\nUsage:").next().unwrap_or(&text);
            let said = said.split("\n\nFor more information").next().unwrap_or(said);
            let said = said.trim_start_matches("error: ").split_whitespace().collect::<Vec<_>>().join(" ");
            if wants_json() {
                let _ = json::print_argument_error(&said);
            }
            complain(2, &format!("{said}; see {} --help", format!("baliza {called}").trim_end()))
        }
    }
}

/// The command that the arguments name, such as `ble solve`.
fn called(mut command: &clap::Command) -> String {
    let mut words = Vec::new();
    for argument in std::env::args_os().skip(1) {
        let Some(sub) = command.find_subcommand(argument) else { continue };
        words.push(sub.get_name());
        command = sub;
    }
    words.join(" ")
}

pub(super) fn complain(code: u8, line: &str) -> ExitCode {
    // If standard error is closed, there is no way to report the error.
    let _ = writeln!(std::io::stderr(), "{line}");
    ExitCode::from(code)
}

#[cfg(test)]
mod tests {
    use super::Program as _;
    use crate::cli::Arguments;

    #[test]
    fn the_arguments_are_consistent() {
        Arguments::grouped().debug_assert();
    }
}
