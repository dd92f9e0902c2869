//! Figures within sentences. A sentence is a template ([`Template`]): its words are looked for in the document, over the
//! ends of lines, and its keys stand for the numbers there.

use std::ops::Range;

use anyhow::{Result, bail};
use serde_json::Value;

use super::compare;
use super::runs::{Piece, Template};

/// A sentence in a document.
#[derive(Debug, PartialEq)]
pub struct Place {
    /// Where its numbers stand.
    numbers: Vec<Range<usize>>,
}

/// Finds a sentence.
///
/// # Errors
/// It is not there, or several times.
pub fn find(document: &str, sentence: &Template) -> Result<Place> {
    let starts = document.char_indices().map(|(start, _)| start);
    let mut places = starts.filter_map(|start| matches_at(document, start, sentence));
    match (places.next(), places.next()) {
        (Some(place), None) => Ok(place),
        (None, _) => bail!("does not say \"{}\"", words(sentence)),
        (Some(_), Some(_)) => bail!("says \"{}\" several times", words(sentence)),
    }
}

/// The sentence with `#` for its numbers.
fn words(sentence: &Template) -> String {
    let piece = |piece: &Piece| match piece {
        Piece::Text(text) => text.clone(),
        Piece::Key { .. } => "#".to_owned(),
    };
    sentence.0.iter().map(piece).collect()
}

fn matches_at(document: &str, start: usize, sentence: &Template) -> Option<Place> {
    let (mut at, mut numbers) = (start, Vec::new());
    for piece in &sentence.0 {
        match piece {
            Piece::Text(text) => at += text_length(&document[at..], text)?,
            Piece::Key { .. } => {
                let length = compare::number_length(&document[at..])?;
                numbers.push(at..at + length);
                at += length;
            }
        }
    }
    Some(Place { numbers })
}

/// The bytes at the beginning of a document that are this text. Any white space of the text is any of the document.
fn text_length(document: &str, text: &str) -> Option<usize> {
    let mut at = 0;
    let mut characters = text.chars().peekable();
    while let Some(character) = characters.next() {
        let rest = &document[at..];
        if character.is_whitespace() {
            while characters.next_if(|next| next.is_whitespace()).is_some() {}
            let length = rest.len() - rest.trim_start().len();
            if length == 0 {
                return None;
            }
            at += length;
        } else {
            rest.strip_prefix(character)?;
            at += character.len_utf8();
        }
    }
    Some(at)
}

impl Place {
    /// The numbers as the document has them.
    pub fn promised<'d>(&self, document: &'d str) -> Vec<&'d str> {
        self.numbers.iter().map(|range| &document[range.clone()]).collect()
    }

    /// The document with other numbers.
    pub fn replaced(&self, document: &str, numbers: &[String]) -> String {
        let mut text = document.to_owned();
        for (range, number) in self.numbers.iter().zip(numbers).rev() {
            text.replace_range(range.clone(), number);
        }
        text
    }
}

/// The numbers of a sentence for a result, in the sentence's order; without a percent sign, which is a word of it.
///
/// # Errors
/// The result lacks a key.
pub fn numbers(sentence: &Template, result: &Value) -> Result<Vec<String>> {
    let keys = sentence.0.iter().filter(|piece| matches!(piece, Piece::Key { .. }));
    let text = |piece: &Piece| Template(vec![piece.clone()]).fill(result);
    keys.map(|piece| Ok(text(piece)?.trim_end_matches(" %").to_owned())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "An EVK1000 gets\n108 positions so, 78 if not. At 30 % loss a range comes.\n";

    fn template(text: &str) -> Template {
        Template::try_from(text.to_owned()).expect("a template")
    }

    #[test]
    fn a_sentence_is_found_over_the_end_of_a_line_and_its_numbers_are_replaced() {
        let sentence = template("EVK1000 gets {fixes_per_s:0} positions so,");
        let place = find(TEXT, &sentence).expect("there");
        assert_eq!(place.promised(TEXT), ["108"]);
        let numbers = numbers(&sentence, &serde_json::json!({ "fixes_per_s": 91.3 })).expect("a key");
        assert_eq!(place.replaced(TEXT, &numbers), TEXT.replace("108", "91"));
    }

    #[test]
    fn a_percentage_keeps_its_sign() {
        let sentence = template("At {loss:%} % loss");
        let numbers = numbers(&sentence, &serde_json::json!({ "loss": 0.25 })).expect("a key");
        let place = find(TEXT, &sentence).expect("there");
        assert_eq!(place.replaced(TEXT, &numbers), TEXT.replace("30 %", "25 %"));
    }

    #[test]
    fn a_sentence_that_is_not_there_or_twice_is_an_error() {
        let missing = find(TEXT, &template("gets {x:0} fixes")).unwrap_err().to_string();
        assert_eq!(missing, "does not say \"gets # fixes\"");
        let twice = format!("{TEXT}{TEXT}");
        assert!(find(&twice, &template("gets {x:0} positions")).unwrap_err().to_string().contains("several times"));
    }
}
