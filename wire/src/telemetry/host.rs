//! A message as an object of JSON, and as a row of a table.

use std::string::String;
use std::{format, vec::Vec};

use serde_json::{Value, json};

/// A table of one kind of message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Table {
    /// Its name: that of its file, without `.csv`.
    pub name: &'static str,
    /// What its rows are called where they are counted.
    pub rows: &'static str,
    /// The same for a person.
    pub counted: &'static str,
    /// What it is for, for whoever chooses a table.
    pub about: &'static str,
    /// The columns behind `epoch` and `t_s`.
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

/// A length as fine as the wire has it.
pub fn metres(value: f64) -> String {
    format!("{value:.4}")
}

/// To so many parts of one.
pub(crate) fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}
