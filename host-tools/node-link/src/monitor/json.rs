//! The output of a node as JSON: messages in the format of `decode`, and the log's lines.

use serde::Serialize;

use super::session::NodeOutput;
use crate::decode::object;

/// One item of a node's output as one line of JSON, without the line end. Its `type` is the message's kind, or `log`,
/// `text` (a line of the boot loader) or `unreadable` (the log cannot be read from here on). `node`: the address of the
/// node, where there are several.
///
/// # Errors
/// The serializer returns an error.
pub fn json(output: &NodeOutput, node: Option<&str>) -> serde_json::Result<Vec<u8>> {
    let object = match output {
        NodeOutput::Message(_, message) => return serde_json::to_vec(&object(message, node)),
        NodeOutput::Log(line) => Object::Log {
            t_s: line.t_us.map(|t_us| t_us as f64 / 1e6),
            level: line.level.map(defmt_parser::Level::as_str),
            text: &line.text,
            file: line.place.as_ref().map(|place| place.file.as_str()),
            line: line.place.as_ref().map(|place| place.line),
        },
        NodeOutput::Text(text) => Object::Text { text },
        NodeOutput::Unreadable => Object::Unreadable,
    };
    serde_json::to_vec(&object)
}

#[derive(Serialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
enum Object<'a> {
    Log { t_s: Option<f64>, level: Option<&'static str>, text: &'a str, file: Option<&'a str>, line: Option<u64> },
    Text { text: &'a str },
    Unreadable,
}
