//! `baliza`: positions from recorded ranges, and the commands around them.
//!
//! Data goes to standard output or to files, diagnostics go to standard error. Exit code 0: success. Exit code 2: the
//! input or the arguments are wrong, and one line says how. Exit code 1: any other error, with its causes.
#![forbid(unsafe_code)]

mod cli;

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;
use host_tools::UserError;

/// Positions from UWB ranges and the RSSI values of Bluetooth beacons, with honest uncertainty.
#[derive(Parser)]
#[command(name = "baliza", version, max_term_width = 120, after_help = EXIT_CODES)]
struct Arguments {
    #[command(subcommand)]
    command: cli::Command,
}

const EXIT_CODES: &str = "Exit code: 0 done; 2 the input or the arguments are wrong, one line on standard error says where and \
                          how; 1 anything else.";

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return refuse(&error),
    };
    match cli::run(&arguments.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => match error.downcast_ref::<UserError>() {
            Some(wrong) => complain(2, &wrong.to_string()),
            None => complain(1, &format!("baliza: {error:#}")),
        },
    }
}

/// Prints help and version unchanged, and an error in the arguments on one line, without the usage.
fn refuse(error: &clap::Error) -> ExitCode {
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
            complain(2, &said.trim_start_matches("error: ").split_whitespace().collect::<Vec<_>>().join(" "))
        }
    }
}

fn complain(code: u8, line: &str) -> ExitCode {
    // If standard error is closed, there is no way to report the error.
    let _ = writeln!(std::io::stderr(), "{line}");
    ExitCode::from(code)
}

#[cfg(test)]
mod tests {
    use super::Arguments;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_consistent() {
        Arguments::command().debug_assert();
    }
}
