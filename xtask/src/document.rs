//! Documents with parts that commands remake.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use crate::extract;

/// Replaces the text between `<!-- made: NAME -->` and `<!-- end: NAME -->` in the file by the extract of the part,
/// if documents have one.
///
/// # Errors
/// The file cannot be read or written, or has no such part.
pub fn remake(file: &Path, name: &str, part: &str) -> Result<()> {
    let Some(part) = extract::of(name, part) else { return Ok(()) };
    let text = fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let remade = replace(&text, name, &part).with_context(|| format!("{}: no part {name}", file.display()))?;
    fs::write(file, remade).with_context(|| format!("cannot write {}", file.display()))
}

fn replace(text: &str, name: &str, part: &str) -> Option<String> {
    let begin = format!("<!-- made: {name} -->\n");
    let end = format!("<!-- end: {name} -->");
    let (before, rest) = text.split_once(&begin)?;
    let (_, after) = rest.split_once(&end)?;
    Some(format!("{before}{begin}{part}{end}{after}"))
}

#[cfg(test)]
mod tests {
    use super::replace;

    #[test]
    fn only_the_named_part_changes() {
        let text = "a\n<!-- made: x -->\nold\n<!-- end: x -->\nb\n<!-- made: y -->\n<!-- end: y -->\n";
        let expected = "a\n<!-- made: x -->\nnew\n<!-- end: x -->\nb\n<!-- made: y -->\n<!-- end: y -->\n";
        assert_eq!(replace(text, "x", "new\n").as_deref(), Some(expected));
    }

    #[test]
    fn a_part_without_end_is_refused() {
        assert_eq!(replace("<!-- made: x -->\nold\n", "x", "new\n"), None);
    }
}
