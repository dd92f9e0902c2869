//! `baliza`: positions from recorded ranges, and the commands around them.
//!
//! Data goes to standard output or to files, diagnostics go to standard error. Exit code 0: success. Exit code 2: the
//! input or the arguments are wrong, and one line says how. Exit code 1: any other error, with its causes.
#![forbid(unsafe_code)]

mod cli;

use std::io::Write;
use std::process::ExitCode;

use clap::FromArgMatches;
use clap::error::ErrorKind;
use host_tools::{Interrupted, UserError};

fn main() -> ExitCode {
    let mut command = cli::Arguments::grouped();
    let called = called(&command);
    cli::json::begin(&called);
    let parsed = command.try_get_matches_from_mut(std::env::args_os());
    let parsed = parsed.and_then(|matches| Ok((cli::Arguments::from_arg_matches(&matches)?, matches)));
    let (arguments, matches) = match parsed {
        Ok(parsed) => parsed,
        Err(error) => return refuse(&error, &called),
    };
    arguments.verbosity.apply();
    let checked = cli::paths::check(&command, &matches).map_err(anyhow::Error::from);
    match checked.and_then(|()| cli::run(&arguments.command)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if wants_json() {
                // If standard output is closed, the line on standard error is left.
                let _ = cli::json::print_error(&error);
            }
            match error.downcast_ref::<UserError>() {
                Some(wrong) => complain(2, &wrong.to_string()),
                None if error.is::<Interrupted>() => complain(130, &format!("baliza: {error}")),
                None => complain(1, &format!("baliza: {error:#}")),
            }
        }
    }
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
                Err(unwritten) if unwritten.kind() != std::io::ErrorKind::BrokenPipe => {
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
                let _ = cli::json::print_argument_error(&said);
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

fn complain(code: u8, line: &str) -> ExitCode {
    // If standard error is closed, there is no way to report the error.
    let _ = writeln!(std::io::stderr(), "{line}");
    ExitCode::from(code)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_arguments_are_consistent() {
        crate::cli::Arguments::grouped().debug_assert();
    }
}
