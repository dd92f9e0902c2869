//! The names of topics.
//!
//! A name of a site, tag or node becomes one level of a topic: `/`, `+`, `#`, `%`, spaces, control characters and a `$`
//! are written as `%` and two hexadecimal digits for each byte, as in a URL.

use std::fmt::Write as _;

/// The most bytes of a prefix.
const LONGEST: usize = 64;

/// A prefix cannot begin topics.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} cannot begin topics: it is 1 to 64 letters, digits, -, _, . and / (not at the ends)")]
pub struct NoPrefix(String);

/// The topics of a station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topics {
    prefix: String,
}

impl Topics {
    /// Topics that begin with `prefix`.
    ///
    /// # Errors
    /// The prefix has characters that topics must not have.
    pub fn new(prefix: &str) -> Result<Self, NoPrefix> {
        let is_level = |level: &str| {
            let is_fine = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.');
            !level.is_empty() && level.bytes().all(is_fine)
        };
        if prefix.len() <= LONGEST && prefix.split('/').all(is_level) {
            Ok(Self { prefix: prefix.to_owned() })
        } else {
            Err(NoPrefix(prefix.to_owned()))
        }
    }

    /// What all topics begin with.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// `online` or `offline`.
    pub fn status(&self) -> String {
        format!("{}/status", self.prefix)
    }

    /// A tag's position.
    pub fn position(&self, site: &str, tag: &str) -> String {
        self.of(site, "tags", tag, "position")
    }

    /// A tag's room.
    pub fn room(&self, site: &str, tag: &str) -> String {
        self.of(site, "tags", tag, "room")
    }

    /// What happens to a tag.
    pub fn tag_events(&self, site: &str, tag: &str) -> String {
        self.of(site, "tags", tag, "events")
    }

    /// Data of a tag's user.
    pub fn data(&self, site: &str, tag: &str) -> String {
        self.of(site, "tags", tag, "data")
    }

    /// A node's health.
    pub fn health(&self, site: &str, node: &str) -> String {
        self.of(site, "nodes", node, "health")
    }

    /// What happens to a node.
    pub fn node_events(&self, site: &str, node: &str) -> String {
        self.of(site, "nodes", node, "events")
    }

    /// The rooms of all tags, as a filter.
    pub fn all_rooms(&self) -> String {
        format!("{}/+/tags/+/room", self.prefix)
    }

    /// Site and tag of a topic of [`Topics::room`].
    pub fn tag_of_room(&self, topic: &str) -> Option<(String, String)> {
        let rest = topic.strip_prefix(&self.prefix)?.strip_prefix('/')?;
        let levels: Vec<&str> = rest.split('/').collect();
        let [site, "tags", tag, "room"] = levels[..] else { return None };
        Some((name(site)?, name(tag)?))
    }

    fn of(&self, site: &str, kind: &str, name: &str, what: &str) -> String {
        format!("{}/{}/{kind}/{}/{what}", self.prefix, level(site), level(name))
    }
}

/// A name as a level of a topic.
pub fn level(name: &str) -> String {
    let mut level = String::with_capacity(name.len());
    for character in name.chars() {
        let is_special = matches!(character, '/' | '+' | '#' | '%' | '$') || character.is_whitespace();
        if is_special || character.is_control() {
            let mut bytes = [0; 4];
            for byte in character.encode_utf8(&mut bytes).bytes() {
                // Writing to a text cannot fail.
                let _ = write!(level, "%{byte:02X}");
            }
        } else {
            level.push(character);
        }
    }
    level
}

/// The name of a level, if [`level`] can have made it.
fn name(level: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(level.len());
    let mut rest = level.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(if byte == b'%' {
            let mut digit = || char::from(rest.next()?).to_digit(16);
            u8::try_from(16 * digit()? + digit()?).ok()?
        } else {
            byte
        });
    }
    String::from_utf8(bytes).ok()
}

/// A text of letters, digits, `_` and `-` alone, which differs where names differ: any other byte, and `_`, becomes `_`
/// and two hexadecimal digits. So `__` separates names.
pub fn identifier(names: &[&str]) -> String {
    let mut text = String::new();
    for (index, name) in names.iter().enumerate() {
        if index > 0 {
            text.push_str("__");
        }
        for byte in name.bytes() {
            if byte.is_ascii_alphanumeric() || byte == b'-' {
                text.push(char::from(byte));
            } else {
                // Writing to a text cannot fail.
                let _ = write!(text, "_{byte:02x}");
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards_and_separators_in_names_stay_within_their_level() {
        let topics = Topics::new("baliza").expect("a prefix");
        // ASCII: space 20, # 23, $ 24, % 25, + 2B, / 2F.
        let topic = topics.position("my house", "a/b+c#d%e$f\0");
        assert_eq!(topic, "baliza/my%20house/tags/a%2Fb%2Bc%23d%25e%24f%00/position");
        assert_eq!(topics.room("casa", "niño"), "baliza/casa/tags/niño/room");
    }

    #[test]
    fn names_come_back_from_their_topics() {
        let topics = Topics::new("home/baliza").expect("a prefix");
        for (site, tag) in [("site", "0x1001"), ("my house", "a/b+c#d%e$f"), ("ni\u{a0}ño", "%2F")] {
            let topic = topics.room(site, tag);
            assert_eq!(topics.tag_of_room(&topic), Some((site.to_owned(), tag.to_owned())), "{topic}");
        }
        for other in ["home/baliza/status", "home/baliza/a/tags/%2/room", "home/balizas/a/tags/b/room", ""] {
            assert_eq!(topics.tag_of_room(other), None, "{other}");
        }
    }

    #[test]
    fn a_prefix_cannot_have_wildcards_or_empty_levels() {
        for wrong in ["", "a//b", "/a", "a/", "+", "a/#", "$SYS", "a b", &"a".repeat(65)] {
            assert_eq!(Topics::new(wrong), Err(NoPrefix(wrong.to_owned())));
        }
        assert_eq!(Topics::new("home/baliza").expect("a prefix").status(), "home/baliza/status");
    }

    #[test]
    fn identifiers_have_no_special_characters_and_differ() {
        assert_eq!(identifier(&["baliza", "my house", "0x1001"]), "baliza__my_20house__0x1001");
        // The separator cannot be part of a name.
        assert_ne!(identifier(&["a", "b__c"]), identifier(&["a__b", "c"]));
        assert!(identifier(&["niño", "a+b"]).bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_'));
    }
}
