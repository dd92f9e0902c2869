//! What `--json` prints: one object with the schema's number, the command, and its results or its error.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use anyhow::{Context, Result};
use recording::UserError;
use serde_json::{Value, json};

use super::program::user_error;

/// The number of the schema. A change that a reader of the former one would misunderstand gets the next number.
const SCHEMA: u32 = 1;

/// The running command, `ble solve` for example.
static COMMAND: OnceLock<String> = OnceLock::new();

/// Whether a document was printed: there is one at most. Results may be followed by an error, which is then only on
/// standard error.
static PRINTED: AtomicBool = AtomicBool::new(false);

/// What the user was warned of, which the document has too.
static WARNINGS: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Notes a warning for the document.
pub fn warned(warning: &str) {
    WARNINGS.lock().unwrap_or_else(PoisonError::into_inner).push(warning.to_owned());
}

/// Notes which command runs: its words without `baliza`.
pub fn begin(command: &str) {
    // It is set once.
    let _ = COMMAND.set(command.to_owned());
}

/// Prints results: a list, or one object, which becomes a list of one. Numbers have six decimals, because a micrometre
/// is finer than any error.
///
/// # Errors
/// Standard output cannot be written.
pub fn print_results(results: &impl serde::Serialize) -> Result<()> {
    let mut results = serde_json::to_value(results).context("cannot write JSON")?;
    round(&mut results);
    if !results.is_array() {
        results = Value::Array(vec![results]);
    }
    print(json!({ "schema": SCHEMA, "command": command(), "results": results }))
}

/// Prints an error.
///
/// # Errors
/// Standard output cannot be written.
pub fn print_error(error: &anyhow::Error) -> Result<()> {
    let (file, line, message) = match user_error(error) {
        Some(UserError::Line { file, line, what }) => (Some(file.display().to_string()), Some(*line), what.clone()),
        Some(UserError::File { file, what }) => (Some(file.display().to_string()), None, what.clone()),
        Some(flag @ UserError::Flag { .. }) => (None, None, flag.to_string()),
        None => (None, None, format!("{error:#}")),
    };
    print_error_of(file, line, &message)
}

/// Prints an error of the arguments.
///
/// # Errors
/// Standard output cannot be written.
pub fn print_argument_error(message: &str) -> Result<()> {
    print_error_of(None, None, message)
}

fn print_error_of(file: Option<String>, line: Option<u64>, message: &str) -> Result<()> {
    let error = json!({ "file": file, "line": line, "message": message });
    print(json!({ "schema": SCHEMA, "command": command(), "error": error }))
}

/// The command as it was called, with its arguments.
pub fn arguments() -> String {
    let arguments = std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned());
    ["baliza".to_owned()].into_iter().chain(arguments).collect::<Vec<_>>().join(" ")
}

fn command() -> &'static str {
    COMMAND.get().map_or("", String::as_str)
}

fn print(mut document: Value) -> Result<()> {
    if PRINTED.swap(true, Ordering::Relaxed) {
        return Ok(());
    }
    let warnings = std::mem::take(&mut *WARNINGS.lock().unwrap_or_else(PoisonError::into_inner));
    if let (Some(fields), false) = (document.as_object_mut(), warnings.is_empty()) {
        fields.insert("warnings".to_owned(), warnings.into());
    }
    let mut text = serde_json::to_vec_pretty(&document).context("cannot write JSON")?;
    text.push(b'\n');
    super::print(&text)
}

fn round(value: &mut Value) {
    match value {
        Value::Number(number) if number.is_f64() => {
            let rounded = number.as_f64().map(|exact| (exact * 1e6).round() / 1e6);
            *value = rounded.into();
        }
        Value::Array(values) => values.iter_mut().for_each(round),
        Value::Object(fields) => fields.values_mut().for_each(round),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use serde_json::Value;

    use crate::cli::{Arguments, Program as _};

    /// The names of the commands that have `--json`, below a command with these words.
    fn with_json(command: &clap::Command, words: &str) -> Vec<String> {
        let own = command.get_arguments().any(|argument| argument.get_long() == Some("json"));
        let below = command.get_subcommands().flat_map(|sub| with_json(sub, &format!("{words} {}", sub.get_name())));
        own.then(|| words.trim_start().to_owned()).into_iter().chain(below).collect()
    }

    #[test]
    fn every_command_with_json_has_a_schema() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/reference/schema");
        let files = fs::read_dir(folder).expect("the folder of schemas").map(|file| file.expect("an entry").path());
        let files = files.filter(|path| path.extension().is_some_and(|extension| extension == "json"));
        let mut described: Vec<String> = files
            .flat_map(|path| {
                let schema: Value = serde_json::from_slice(&fs::read(path).expect("a file")).expect("JSON");
                let commands = schema["properties"]["command"]["enum"].as_array().cloned().unwrap_or_default();
                commands.into_iter().filter_map(|command| command.as_str().map(str::to_owned))
            })
            .collect();
        // The tests of that program check its documents.
        described.retain(|command| !command.starts_with("bench "));
        let mut commands = with_json(&Arguments::grouped(), "");
        described.sort();
        commands.sort();
        assert_eq!(described, commands);
    }
}
