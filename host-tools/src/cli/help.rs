//! The list of commands in `baliza --help`, in groups by what a person wants to do.

use std::fmt::Write;

use clap::Command;
use clap::builder::StyledStr;

/// Each group's title, and its commands.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Simulate", &["simulate", "example"]),
    ("Set up a site", &["plan-anchors", "coverage", "survey", "calibrate", "provision", "flash"]),
    ("Run", &["serve", "live", "forward", "station", "monitor", "record", "replay", "decode", "import", "convert"]),
    ("Analyse", &["solve", "track", "check", "ble", "classify-rooms", "plot"]),
    ("Research", &["nlos", "bench"]),
    ("This program", &["completions", "man"]),
];

/// The command with its subcommands in groups. A negative number is the value of the flag before it, so that the error
/// says which values the flag takes, and not that there is no flag `-1`.
pub fn grouped(command: Command) -> Command {
    let command = with_negative_numbers(command);
    let template = template(&command);
    command.help_template(template)
}

fn with_negative_numbers(command: Command) -> Command {
    let command = command.mut_args(|argument| {
        let is_flag_with_value = !argument.is_positional() && argument.get_action().takes_values();
        if is_flag_with_value { argument.allow_negative_numbers(true) } else { argument }
    });
    command.mut_subcommands(with_negative_numbers)
}

fn template(command: &Command) -> StyledStr {
    let (header, literal) = (*command.get_styles().get_header(), *command.get_styles().get_literal());
    let width = command.get_subcommands().map(|sub| sub.get_name().len()).max().unwrap_or(0);
    let mut text = "{about-with-newline}\n{usage-heading} {usage}\n".to_owned();
    for (title, names) in GROUPS {
        let _ = write!(text, "\n{header}{title}:{header:#}\n");
        for sub in names.iter().filter_map(|name| command.find_subcommand(name)) {
            let (name, about) = (sub.get_name(), sub.get_about().map(ToString::to_string).unwrap_or_default());
            let _ = writeln!(text, "  {literal}{name:width$}{literal:#}  {about}");
        }
    }
    let _ = write!(text, "\n{header}Options:{header:#}\n{{options}}{{after-help}}");
    text.into()
}

#[cfg(test)]
mod tests {
    use super::GROUPS;
    use crate::cli::{Arguments, Program as _};

    #[test]
    fn each_command_is_in_one_group() {
        let command = Arguments::grouped();
        let mut all: Vec<_> = command.get_subcommands().map(|sub| sub.get_name()).collect();
        let mut grouped: Vec<_> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        all.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(grouped, all);
    }
}
