//! What holds for the paths of all commands: an output is none of the inputs, nor another output.
//!
//! Arguments of the type `PathBuf` are inputs, but those that are called as in `OUTPUTS`.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use clap::{Arg, ArgMatches, Command, ValueHint};
use node_link::provision::SITE;
use node_link::recorder::folders;
use recording::UserError;
use recording::inputs::identity;
use recording::output::STANDARD;

use crate::simulate::is_of_simulation;

/// The flags of outputs, by name and as the user writes them.
const OUTPUTS: [(&str, &str); 5] =
    [("out", "--out"), ("plot", "--plot"), ("pcap", "--pcap"), ("survey", "--survey"), ("record", "--record")];

/// Refuses paths that cannot be used together.
///
/// # Errors
/// An output is an input or another output, or two paths stand for the same standard stream.
pub fn check(command: &Command, matches: &ArgMatches) -> Result<(), UserError> {
    if let Some((name, matches)) = matches.subcommand() {
        return command.find_subcommand(name).map_or(Ok(()), |command| check(command, matches));
    }
    let given: Vec<_> = command.get_arguments().flat_map(|argument| paths(argument, matches)).collect();
    let outputs = || given.iter().filter_map(|given| Some((flag_of(given)?, given.path)));
    for (at, (flag, output)) in outputs().enumerate() {
        for input in given.iter().filter(|given| flag_of(given).is_none()) {
            if is_at_risk(output, input.path, has_flag(matches, "force")) {
                let what = format!("{} is the input {}; name another file", output.display(), input.name);
                return Err(UserError::flag(flag, what));
            }
        }
        if let Some((other, _)) = outputs().take(at).find(|(_, other)| is_same(output, other)) {
            return Err(UserError::flag(flag, format!("{} is also {other}", output.display())));
        }
        let prints_more = flag != "--out" || has_flag(matches, "json");
        if output.as_os_str() == STANDARD && prints_more {
            return Err(UserError::flag(flag, "standard output has something else already; name a file"));
        }
    }
    let standard = given.iter().filter(|given| flag_of(given).is_none() && given.path.as_os_str() == STANDARD);
    if standard.count() > 1 {
        return Err(UserError::flag("-", "standard input can be one file only"));
    }
    Ok(())
}

/// A path among the arguments.
struct Given<'a> {
    id: &'a str,
    /// As the user writes it.
    name: String,
    path: &'a Path,
}

fn paths<'a>(argument: &'a Arg, matches: &'a ArgMatches) -> Vec<Given<'a>> {
    // Clap gives this hint to every argument of the type `PathBuf`.
    if argument.get_value_hint() != ValueHint::AnyPath {
        return Vec::new();
    }
    let id = argument.get_id().as_str();
    let name = argument.get_long().map_or_else(|| id.to_uppercase(), |long| format!("--{long}"));
    let values = matches.get_raw(id).into_iter().flatten();
    values.map(|path: &OsStr| Given { id, name: name.clone(), path: Path::new(path) }).collect()
}

fn flag_of(given: &Given) -> Option<&'static str> {
    OUTPUTS.iter().find(|(id, _)| *id == given.id).map(|(_, flag)| *flag)
}

fn has_flag(matches: &ArgMatches, id: &str) -> bool {
    matches.try_get_one::<bool>(id).is_ok_and(|flag| flag == Some(&true))
}

/// Whether writing to `output` would change `input`: both are one file, or the output is, by whatever name, a file of
/// the recording in the folder that is the input, or the input is a file of the recording that the output replaces.
fn is_at_risk(output: &Path, input: &Path, replaces: bool) -> bool {
    let is_in = |file: &Path, folder: &Path, is_meant: fn(&str) -> bool| {
        let Some(file) = identity(file).filter(|_| folder.is_dir()) else { return false };
        let entries = folders(folder).into_iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten().flatten();
        let mut files = entries.filter(|entry| entry.file_name().to_str().is_some_and(is_meant));
        files.any(|entry| identity(&entry.path()).as_ref() == Some(&file))
    };
    let is_read = |name: &str| is_of_simulation(name) || name == SITE;
    is_same(output, input) || is_in(output, input, is_read) || replaces && is_in(input, output, is_of_simulation)
}

/// Whether two paths lead to one file or folder.
fn is_same(one: &Path, other: &Path) -> bool {
    match (one.exists(), identity(one)) {
        (true, identity_of_one) => identity_of_one.is_some() && identity_of_one == identity(other),
        // A file that does not exist yet is the same by its name only.
        (false, _) => one.as_os_str() != STANDARD && one == other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_paths_of_all_commands_are_found() {
        fn ids(command: &Command) -> Vec<String> {
            let own = command.get_arguments().filter(|argument| argument.get_value_hint() == ValueHint::AnyPath);
            let own = own.map(|argument| argument.get_id().to_string());
            own.chain(command.get_subcommands().flat_map(ids)).collect()
        }
        let ids = ids(&crate::cli::Arguments::command());
        for (id, _) in OUTPUTS {
            assert!(ids.iter().any(|found| found == id), "no command has the output {id}");
        }
        assert!(["ranges", "config", "site", "stream"].iter().all(|id| ids.iter().any(|found| found == id)));
    }
}
