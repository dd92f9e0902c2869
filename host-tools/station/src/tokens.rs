//! The file of tokens: who may use the station.

use std::path::Path;

use serde::Deserialize;
use station_core::api::{Access, Token, UserRole};

use node_link::hexadecimal;
use recording::UserError;
use recording::read_text;

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    token: Vec<Entry>,
}

/// `[[token]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    role: UserRole,
    sha256: String,
}

/// Reads the tokens of a file: `[[token]]` with `name`, `role` and `sha256`, the SHA-256 of the secret in hexadecimal.
///
/// # Errors
/// The file cannot be read, or something in it is wrong.
pub fn read_tokens(file: &Path) -> Result<Access, UserError> {
    let wrong = |what: String| UserError::file(file, what);
    let text = read_text(file)?;
    let File { token } = toml::from_str(&text).map_err(|error| {
        let needs = "a token is [[token]] with name, role (view, operate, administer) and sha256";
        UserError::secret_toml(file, &text, &error, needs)
    })?;
    let mut tokens: Vec<Token> = Vec::new();
    for Entry { name, role, sha256 } in token {
        let Some(hash) = hexadecimal::bytes(&sha256) else {
            return Err(wrong(format!(
                "{name}: sha256 is 64 hexadecimal digits, as `printf %s SECRET | sha256sum` prints them"
            )));
        };
        if tokens.iter().any(|token| token.name == name || token.sha256 == hash) {
            return Err(wrong(format!("{name}: this name or this secret is there twice")));
        }
        tokens.push(Token { name, role, sha256: hash });
    }
    if tokens.is_empty() { Err(wrong("there is no [[token]]".to_owned())) } else { Ok(Access::Tokens(tokens)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FIPS 180-2, appendix B.1: the SHA-256 of "abc".
    const ABC: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

    fn read(text: &str) -> Result<Access, UserError> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("tokens.toml");
        std::fs::write(&file, text).expect("written");
        read_tokens(&file)
    }

    #[test]
    fn a_hash_is_that_of_its_secret() {
        let text = format!("[[token]]\nname = \"wall\"\nrole = \"view\"\nsha256 = \"{ABC}\"\n");
        assert_eq!(read(&text).expect("a token"), Access::Tokens(vec![Token::new("wall", UserRole::View, "abc")]));
    }

    #[test]
    fn wrong_files_are_refused_with_what_to_do() {
        let entry = |sha256: &str| format!("[[token]]\nname = \"a\"\nrole = \"view\"\nsha256 = \"{sha256}\"\n");
        for (text, expected) in [
            (String::new(), "missing field `token`"),
            ("token = []".to_owned(), "no [[token]]"),
            (entry("abc"), "sha256sum"),
            (entry(&"é".repeat(32)), "sha256sum"),
            (entry(ABC) + &entry(ABC), "twice"),
            (entry(ABC).replace("view", "root"), "view, operate, administer"),
        ] {
            let error = read(&text).expect_err(&text).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
