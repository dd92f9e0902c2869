//! Converts a message to a JSON object, and to a row of a table.

use std::string::String;
use std::{format, vec::Vec};

use serde_json::{Value, json};

/// A table of one kind of message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Table {
    /// Its name: the file name without `.csv`.
    pub name: &'static str,
    /// The name of its rows where they are counted.
    pub rows: &'static str,
    /// The same name for a person.
    pub counted: &'static str,
    /// Its purpose, for a user who chooses a table.
    pub about: &'static str,
    /// The columns after `epoch` and `t_s`.
    pub columns: &'static [&'static str],
}

impl Table {
    /// All columns.
    pub fn header(&self) -> Vec<&'static str> {
        ["epoch", "t_s"].iter().chain(self.columns).copied().collect()
    }
}

/// A message as an object.
pub(crate) fn object(kind: &str, t_us: u64, keys: Value) -> Value {
    joined(json!({ "type": kind, "t_s": t_us as f64 / 1e6 }), keys)
}

/// The keys of one object, then those of the other.
pub(crate) fn joined(mut first: Value, then: Value) -> Value {
    if let (Value::Object(first), Value::Object(then)) = (&mut first, then) {
        first.extend(then);
    }
    first
}

/// A length with the resolution of the wire format.
pub fn metres(value: f64) -> String {
    format!("{value:.4}")
}

/// Rounded to multiples of 1 / `parts`.
pub(crate) fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}
