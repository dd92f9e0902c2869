//! Explains an error in a TOML file from the messages of `toml` and `serde`: the line, the key, the found value and
//! the expected one.

use std::ops::Range;

/// An error in a text, and its line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Explained {
    /// The line, from 1.
    pub line: usize,
    /// What is wrong, in one line.
    pub message: String,
}

/// Explains an error of `toml`, from its span in the text and its message. For an unknown key or name, the
/// explanation has the nearest known one, if one is near. For a value of the wrong kind, it has the key, the value
/// and the expected kind.
pub fn explain(text: &str, span: Option<Range<usize>>, message: &str) -> Explained {
    let span = span.unwrap_or(0..0);
    let (key, value) =
        (key_before(text, span.start), text.get(span.clone()).unwrap_or("").lines().next().unwrap_or(""));
    // What is expected stands last; the name before it is the file's, with any text in it.
    let (found, expected) = match message.rsplit_once(", expected ") {
        Some((found, expected)) => (found, Some(expected)),
        None => (message, None),
    };
    let name = found.split_once('`').and_then(|(_, name)| name.rsplit_once('`')).map_or("", |(name, _)| name);
    let known: Vec<&str> = expected.unwrap_or("").split('`').skip(1).step_by(2).collect();
    let (name, expected) = (&name.escape_debug().to_string(), expected.map(must_be));
    let message = match (message.split(' ').next(), expected) {
        (Some("missing"), _) => format!("{name} is missing"),
        (Some("unknown"), _) if message.starts_with("unknown field") => {
            let hint = nearest(name, &known).map(|near| format!("{near} is near it"));
            format!("unknown key {name}; {}", hint.unwrap_or_else(|| format!("there are {}", known.join(", "))))
        }
        (Some("unknown"), Some(_)) => {
            let hint = nearest(name, &known).map_or_else(String::new, |near| format!("; {near} is near it"));
            format!("{key} is \"{name}\": it must be one of \"{}\"{hint}", known.join("\", \""))
        }
        (Some("invalid"), Some(expected)) if value.starts_with('[') && message.contains("type: map") => {
            match expected {
                LIST => format!("there may be several of {value}: put it in two brackets"),
                _ => format!("{value} begins a table: it must be {expected}, as a key"),
            }
        }
        (Some("invalid"), Some(expected)) => format!("{key} is {value}: it must be {expected}"),
        (Some("string"), Some(_)) => {
            format!("{key} is {value}: it must be true or false, a number, or text in quotation marks")
        }
        (_, _) => message.lines().collect::<Vec<_>>().join(", "),
    };
    Explained { line: line_of(text, span.start), message }
}

/// The line, from 1, of an offset into the text.
pub fn line_of(text: &str, offset: usize) -> usize {
    1 + text.as_bytes().iter().take(offset).filter(|byte| **byte == b'\n').count()
}

/// The known name that is nearest to an unknown one, if one is near.
pub fn nearest<'w>(unknown: &str, known: &[&'w str]) -> Option<&'w str> {
    let score = |word: &str| strsim::jaro_winkler(&unknown.to_lowercase(), word);
    let near = known.iter().copied().max_by(|a, b| score(a).total_cmp(&score(b)))?;
    (score(near) > 0.75).then_some(near)
}

/// The key whose value begins at this offset.
fn key_before(text: &str, offset: usize) -> &str {
    let before = text.get(..offset).and_then(|text| text.rsplit_once('=')).map_or("", |(before, _)| before.trim_end());
    before.rsplit(|c: char| c.is_whitespace() || matches!(c, ',' | '{' | '.')).next().unwrap_or("")
}

/// What is expected where several tables may stand.
const LIST: &str = "a list";

/// The expectation of `serde`, in plain terms.
fn must_be(expected: &str) -> &str {
    match expected {
        "u8" => "a whole number, 0 to 255",
        "u16" => "a whole number, 0 to 65535",
        "u32" => "a whole number, 0 to 4294967295",
        "i8" => "a whole number, -128 to 127",
        "f32" | "f64" => "a number",
        "a boolean" => "true or false",
        "a string" => "text in quotation marks",
        "an array of length 2" => "two numbers, [x, y], with decimal points",
        "an array of length 3" => "three numbers, [x, y, z], with decimal points",
        "a sequence" => LIST,
        structure if structure.starts_with("struct ") => "a table, { … }",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "a = 1\nchanel = 5\nsize = { wide = \"x\" }\n";

    fn said(part: &str, message: &str) -> (usize, String) {
        let start = TEXT.find(part).expect("it is there");
        let Explained { line, message } = explain(TEXT, Some(start..start + part.len()), message);
        (line, message)
    }

    #[test]
    fn unknown_keys_and_names_get_the_nearest_known_one() {
        let (line, message) = said("chanel", "unknown field `chanel`, expected one of `pan`, `channel`");
        assert_eq!((line, message.as_str()), (2, "unknown key chanel; channel is near it"));
        let (_, message) = said("chanel", "unknown field `chanel`, expected `x` or `y`");
        assert_eq!(message, "unknown key chanel; there are x, y");
        let (line, message) = said("\"x\"", "unknown variant `x`, expected `eu` or `us`");
        assert_eq!((line, message.as_str()), (3, "wide is \"x\": it must be one of \"eu\", \"us\""));
        let (_, message) = said("\"x\"", "unknown variant `a`b\n, expected c`, expected `eu` or `us`");
        assert_eq!(message, "wide is \"a`b\\n, expected c\": it must be one of \"eu\", \"us\"");
    }

    #[test]
    fn a_value_is_named_with_its_key_and_what_it_must_be() {
        let (_, message) = said("\"x\"", "invalid type: string \"x\", expected u16");
        assert_eq!(message, "wide is \"x\": it must be a whole number, 0 to 65535");
        assert_eq!(said("size", "missing field `high`"), (3, "high is missing".to_owned()));
        assert_eq!(said("size", "a check that failed"), (3, "a check that failed".to_owned()));
    }
}
