//! Documents with tables that are made: between `<!-- made: NAME -->` and `<!-- end: NAME -->`.

use std::ops::Range;

use anyhow::{Context, Result};

/// The text of the table of this name.
///
/// # Errors
/// The document has no such place.
pub fn table<'d>(document: &'d str, name: &str) -> Result<&'d str> {
    Ok(&document[place(document, name)?])
}

/// The document with another table of this name.
///
/// # Errors
/// The document has no such place.
pub fn with_table(document: &str, name: &str, table: &str) -> Result<String> {
    let mut text = document.to_owned();
    text.replace_range(place(document, name)?, table);
    Ok(text)
}

fn place(document: &str, name: &str) -> Result<Range<usize>> {
    let [begin, end] = [format!("<!-- made: {name} -->\n"), format!("<!-- end: {name} -->")];
    let found = || {
        let from = document.find(&begin)? + begin.len();
        Some(from..from + document[from..].find(&end)?)
    };
    found().with_context(|| format!("has no place <!-- made: {name} --> … <!-- end: {name} -->"))
}

#[cfg(test)]
mod tests {
    use super::{table, with_table};

    const TEXT: &str = "a\n<!-- made: x -->\nold\n<!-- end: x -->\nb\n<!-- made: y -->\n<!-- end: y -->\n";

    #[test]
    fn only_the_named_table_changes() {
        assert_eq!(table(TEXT, "x").unwrap(), "old\n");
        assert_eq!(with_table(TEXT, "x", "new\n").unwrap(), TEXT.replace("old", "new"));
    }

    #[test]
    fn a_place_without_end_is_refused() {
        assert!(table("<!-- made: x -->\nold\n", "x").is_err());
        assert!(table(TEXT, "z").is_err());
    }
}
