//! A command line as data, so that one program can complete and document the commands of another.

use clap::builder::PossibleValuesParser;
use clap::{Arg, ArgAction, Command, ValueHint};
use serde::{Deserialize, Serialize};

/// A command.
#[derive(Debug, Deserialize, Serialize)]
pub struct Description {
    name: String,
    about: Option<String>,
    long_about: Option<String>,
    after_help: Option<String>,
    aliases: Vec<String>,
    arguments: Vec<Argument>,
    commands: Vec<Description>,
}

#[derive(Debug, Deserialize, Serialize)]
struct Argument {
    id: String,
    long: Option<String>,
    short: Option<char>,
    help: Option<String>,
    long_help: Option<String>,
    heading: Option<String>,
    values: Vec<String>,
    possible: Vec<String>,
    defaults: Vec<String>,
    takes_values: bool,
    is_path: bool,
    is_required: bool,
    is_repeated: bool,
}

/// Clap keeps names for as long as the program runs. A description is read once, by a program that prints it and ends.
fn kept(text: String) -> &'static str {
    text.leak()
}

impl Description {
    /// A command's description.
    pub fn of(command: &Command) -> Self {
        let text = |text: Option<&clap::builder::StyledStr>| text.map(ToString::to_string);
        Self {
            name: command.get_name().to_owned(),
            about: text(command.get_about()),
            long_about: text(command.get_long_about()),
            after_help: text(command.get_after_help()),
            aliases: command.get_all_aliases().map(str::to_owned).collect(),
            arguments: command.get_arguments().filter(|argument| !argument.is_hide_set()).map(Argument::of).collect(),
            commands: command.get_subcommands().map(Self::of).collect(),
        }
    }

    /// The command.
    pub fn into_command(self) -> Command {
        let mut command = Command::new(kept(self.name));
        if let Some(about) = self.about {
            command = command.about(kept(about));
        }
        if let Some(about) = self.long_about {
            command = command.long_about(kept(about));
        }
        if let Some(help) = self.after_help {
            command = command.after_help(kept(help));
        }
        command
            .aliases(self.aliases.into_iter().map(kept))
            .args(self.arguments.into_iter().map(Argument::into_arg))
            .subcommands(self.commands.into_iter().map(Self::into_command))
    }
}

impl Argument {
    fn of(argument: &Arg) -> Self {
        Self {
            id: argument.get_id().to_string(),
            long: argument.get_long().map(str::to_owned),
            short: argument.get_short(),
            help: argument.get_help().map(ToString::to_string),
            long_help: argument.get_long_help().map(ToString::to_string),
            heading: argument.get_help_heading().map(str::to_owned),
            values: argument.get_value_names().unwrap_or_default().iter().map(ToString::to_string).collect(),
            possible: argument.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect(),
            defaults: argument.get_default_values().iter().map(|value| value.to_string_lossy().into_owned()).collect(),
            takes_values: argument.get_action().takes_values(),
            is_path: argument.get_value_hint() == ValueHint::AnyPath,
            is_required: argument.is_required_set(),
            is_repeated: matches!(argument.get_action(), ArgAction::Append | ArgAction::Count),
        }
    }

    fn into_arg(self) -> Arg {
        let mut arg =
            Arg::new(kept(self.id)).required(self.is_required).action(match (self.takes_values, self.is_repeated) {
                (true, true) => ArgAction::Append,
                (true, false) => ArgAction::Set,
                (false, true) => ArgAction::Count,
                (false, false) => ArgAction::SetTrue,
            });
        if let Some(long) = self.long {
            arg = arg.long(kept(long));
        }
        if let Some(short) = self.short {
            arg = arg.short(short);
        }
        if let Some(help) = self.help {
            arg = arg.help(kept(help));
        }
        if let Some(help) = self.long_help {
            arg = arg.long_help(kept(help));
        }
        if let Some(heading) = self.heading {
            arg = arg.help_heading(kept(heading));
        }
        if !self.takes_values {
            return arg;
        }
        if self.is_path {
            arg = arg.value_hint(ValueHint::AnyPath);
        }
        if !self.possible.is_empty() {
            arg = arg.value_parser(PossibleValuesParser::new(self.possible.into_iter().map(kept)));
        }
        arg.value_names(self.values.into_iter().map(kept)).default_values(self.defaults.into_iter().map(kept))
    }
}
