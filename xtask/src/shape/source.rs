//! A Rust file as the shape is measured: its code without comments and texts, and which of its lines are tests.

/// The text of a file in which comments are blanks and the contents of strings and characters are underscores. Lines
/// stay where they are, so braces can be matched and lines counted.
pub fn bare(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let (length, fill) = token(rest, out.chars().next_back());
        let (skipped, after) = rest.split_at(if length == 0 { first.len_utf8() } else { length });
        match fill {
            Some(fill) if length > 0 => out.extend(skipped.chars().map(|c| if c == '\n' { c } else { fill })),
            _ => out.push_str(skipped),
        }
        rest = after;
    }
    out
}

/// The length of the comment, string or character at the beginning of a text, bytes, and what takes its place; 0 where
/// there is none. `before` is the character before the text.
fn token(text: &str, before: Option<char>) -> (usize, Option<char>) {
    if text.starts_with("//") {
        return (text.find('\n').unwrap_or(text.len()), Some(' '));
    }
    if text.starts_with("/*") {
        return (block_comment(text), Some(' '));
    }
    let is_within_name = before.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let prefix = if is_within_name { 0 } else { text.bytes().take_while(|b| matches!(b, b'b' | b'c' | b'r')).count() };
    let (prefix, after) = if prefix <= 2 { text.split_at(prefix) } else { text.split_at(0) };
    if prefix.ends_with('r') {
        let hashes = after.bytes().take_while(|b| *b == b'#').count();
        if after[hashes..].starts_with('"') {
            let end = format!("\"{}", "#".repeat(hashes));
            let from = prefix.len() + hashes + 1;
            return (text[from..].find(&end).map_or(text.len(), |at| from + at + end.len()), Some('_'));
        }
        return (0, None);
    }
    if after.starts_with('"') {
        return (prefix.len() + quoted(after, '"'), Some('_'));
    }
    // A lifetime has no quote after its first character.
    let mut characters = after.chars();
    let is_character = characters.next() == Some('\'')
        && match characters.next() {
            Some('\\') => true,
            Some(_) => characters.next() == Some('\''),
            None => false,
        };
    if is_character { (prefix.len() + quoted(after, '\''), Some('_')) } else { (0, None) }
}

/// The length of a quoted text with its quotes, bytes.
fn quoted(text: &str, quote: char) -> usize {
    let mut is_escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        if is_escaped {
            is_escaped = false;
        } else if c == '\\' {
            is_escaped = true;
        } else if c == quote {
            return at + c.len_utf8();
        }
    }
    text.len()
}

/// The length of a block comment, which may hold others, bytes.
fn block_comment(text: &str) -> usize {
    let mut depth = 0;
    let mut at = 0;
    while at < text.len() {
        if text[at..].starts_with("/*") {
            (depth, at) = (depth + 1, at + 2);
        } else if text[at..].starts_with("*/") {
            (depth, at) = (depth - 1, at + 2);
            if depth == 0 {
                return at;
            }
        } else {
            at += text[at..].chars().next().map_or(1, char::len_utf8);
        }
    }
    text.len()
}

/// For each line whether it belongs to an item of tests: `#[cfg(test)]` and what follows, to its brace or semicolon.
pub fn tests(bare: &str) -> Vec<bool> {
    let lines: Vec<_> = bare.lines().collect();
    let mut is_test = vec![false; lines.len()];
    let mut line = 0;
    while line < lines.len() {
        let text = lines[line].trim_start();
        if !text.starts_with("#[cfg(test)]") && !text.starts_with("#[cfg(all(test") {
            line += 1;
            continue;
        }
        let (mut depth, mut has_brace) = (0, false);
        while line < lines.len() {
            is_test[line] = true;
            let text = lines[line];
            depth += text.matches('{').count() as i64 - text.matches('}').count() as i64;
            has_brace |= text.contains('{');
            line += 1;
            if has_brace && depth <= 0 || !has_brace && text.trim_end().ends_with(';') {
                break;
            }
        }
    }
    is_test
}

/// The name, first line (from 0) and number of lines of each function that has a body.
pub fn functions(bare: &str) -> Vec<(&str, usize, usize)> {
    let mut found = Vec::new();
    for (at, _) in bare.match_indices("fn ") {
        let is_word = !bare[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let rest = bare[at + 3..].trim_start();
        let name = rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default();
        if !is_word || name.is_empty() {
            continue;
        }
        let (mut brackets, mut braces) = (0_i64, 0_i64);
        for (end, c) in bare[at..].char_indices() {
            match c {
                '(' | '[' => brackets += 1,
                ')' | ']' => brackets -= 1,
                ';' if brackets == 0 && braces == 0 => break,
                '{' => braces += 1,
                '}' => {
                    braces -= 1;
                    if braces == 0 {
                        let lines = bare[at..at + end].matches('\n').count() + 1;
                        found.push((name, bare[..at].matches('\n').count(), lines));
                        break;
                    }
                }
                _ => {}
            }
            if braces < 0 || brackets < 0 {
                break;
            }
        }
    }
    found
}

/// The name and line (from 0) of each type that everyone may use.
pub fn public_types(bare: &str) -> Vec<(&str, usize)> {
    let named = bare.lines().enumerate().filter_map(|(number, line)| {
        let mut words = line.trim_start().strip_prefix("pub ")?.split_whitespace().skip_while(|word| *word == "unsafe");
        let is_type = matches!(words.next()?, "struct" | "enum" | "trait" | "type" | "union");
        let name = words.next()?.split(|c: char| !c.is_alphanumeric() && c != '_').next()?;
        is_type.then_some((name, number))
    });
    named.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r##"//! Says "fn x() {".
/* one /* two */ { */
pub struct Ring<'a>(&'a str);

pub fn braces(text: &str) -> bool {
    let raw = r#"} " {"#;
    text.contains('{') || text.contains('\'') || raw == "}\"{"
}

trait Sink {
    fn take(&mut self, of: [u8; 2]);
}

#[cfg(test)]
mod tests {
    fn inner() {}
}
pub(crate) enum Hidden {}
"##;

    #[test]
    fn comments_and_texts_have_no_braces() {
        let bare = bare(FILE);
        assert_eq!(bare.lines().count(), FILE.lines().count());
        assert_eq!(bare.matches('{').count(), bare.matches('}').count());
        assert!(!bare.contains("Says") && !bare.contains("two") && bare.contains("Ring<'a>(&'a str)"), "{bare}");
    }

    #[test]
    fn functions_tests_and_types_are_found() {
        let bare = bare(FILE);
        assert_eq!(functions(&bare), [("braces", 4, 4), ("inner", 15, 1)]);
        assert_eq!(public_types(&bare), [("Ring", 2)]);
        let is_test = tests(&bare);
        let lines: Vec<_> = is_test.iter().enumerate().filter(|(_, is)| **is).map(|(line, _)| line).collect();
        assert_eq!(lines, [13, 14, 15, 16]);
    }
}
