//! The key of a gateway, which a station has, too: a number and a secret, in a file that both read.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Write};
use std::path::Path;

use anyhow::{Context, Result};
use recording::{UserError, read_text};
use serde::Deserialize;

use crate::hexadecimal;

/// Bytes of a secret.
const SECRET: usize = 32;

/// A gateway with its secret.
#[derive(Clone, PartialEq, Eq)]
pub struct GatewayKey {
    /// What notes call it.
    pub name: String,
    /// Its number.
    pub gateway: u64,
    /// The site of its nodes, where it is not that of the station.
    pub site: Option<String>,
    /// What only the gateway and its stations know.
    pub secret: [u8; SECRET],
}

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    gateway: Vec<Entry>,
}

/// `[[gateway]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    id: String,
    site: Option<String>,
    key: String,
}

impl GatewayKey {
    /// The gateways of a file: `[[gateway]]` with `name`, `id` and `key`, and optionally `site`.
    ///
    /// # Errors
    /// The file cannot be read, or something in it is wrong.
    pub fn read_all(file: &Path) -> Result<Vec<Self>, UserError> {
        let wrong = |what: String| UserError::file(file, what);
        let text = read_text(file)?;
        let File { gateway } = toml::from_str(&text).map_err(|error| {
            UserError::secret_toml(file, &text, &error, "a gateway is [[gateway]] with name, id, key and perhaps site")
        })?;
        let mut keys: Vec<Self> = Vec::new();
        for Entry { name, id, site, key } in gateway {
            let (Some(gateway), Some(secret)) = (number(&id), hexadecimal::bytes(&key)) else {
                return Err(wrong(format!(
                    "{name}: id is 0x and 16 hexadecimal digits, key is 64 of them; `baliza forward --key FILE` makes both"
                )));
            };
            if keys.iter().any(|known| known.gateway == gateway || known.name == name) {
                return Err(wrong(format!("{name}: this name or this id is there twice")));
            }
            keys.push(Self { name, gateway, site, secret });
        }
        if keys.is_empty() { Err(wrong("there is no [[gateway]]".to_owned())) } else { Ok(keys) }
    }

    /// The gateway of a file, which is made with a new one, called `name`, if it does not exist. Returns whether it was
    /// made.
    ///
    /// # Errors
    /// The file has more than one gateway, is wrong, or cannot be made.
    pub fn read_or_make(file: &Path, name: &str) -> Result<(Self, bool)> {
        if !file.exists() {
            return Self::make(file, name, OpenOptions::new().write(true).create_new(true)).map(|made| (made, true));
        }
        let mut keys = Self::read_all(file)?;
        match (keys.pop(), keys.is_empty()) {
            (Some(key), true) => Ok((key, false)),
            _ => Err(UserError::file(file, "a gateway has its own key only: one [[gateway]]").into()),
        }
    }

    /// The gateways of these names in a file that may have others. Those that it does not have are made, and are added to
    /// it. Returns also the names of those that were made.
    ///
    /// # Errors
    /// The file is wrong, or cannot be made or written.
    pub fn read_and_make(file: &Path, names: &[String]) -> Result<(Vec<Self>, Vec<String>)> {
        let mut keys = if file.exists() { Self::read_all(file)? } else { Vec::new() };
        let is_new = |name: &&String| !keys.iter().any(|key| key.name == **name);
        let new: Vec<_> = names.iter().filter(is_new).cloned().collect();
        for name in &new {
            keys.push(Self::make(file, name, OpenOptions::new().append(true).create(true))?);
        }
        let of = |name: &String| keys.iter().find(|key| key.name == *name).cloned();
        Ok((names.iter().filter_map(of).collect(), new))
    }

    fn random(name: &str) -> Result<Self> {
        let mut bytes = [0; 8 + SECRET];
        getrandom::fill(&mut bytes).context("the system has no random numbers")?;
        let (id, secret) = bytes.split_at(8);
        let (gateway, secret) = (u64::from_be_bytes(id.try_into()?), secret.try_into()?);
        Ok(Self { name: name.to_owned(), gateway, site: None, secret })
    }

    /// Writes a new gateway to a file that is opened so. A file that is made is for its owner only.
    fn make(file: &Path, name: &str, options: &mut OpenOptions) -> Result<Self> {
        let made = Self::random(name)?;
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(options, 0o600);
        let secret: String = made.secret.iter().map(|byte| format!("{byte:02x}")).collect();
        let text = format!(
            "[[gateway]]\nname = {}\nid = \"0x{:016x}\"\nkey = \"{secret}\"\n",
            toml::Value::from(&*made.name),
            made.gateway
        );
        let written = options.open(file).and_then(|mut opened| {
            // The last line of a file that people write may have no end.
            let separator = if opened.metadata()?.len() > 0 { "\n" } else { "" };
            opened.write_all(format!("{separator}{text}").as_bytes())
        });
        written.map(|()| made).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => anyhow::anyhow!("{} has just been made by another program", file.display()),
            _ => anyhow::Error::from(error).context(format!("cannot write {}", file.display())),
        })
    }
}

fn number(text: &str) -> Option<u64> {
    hexadecimal::bytes(text.strip_prefix("0x")?).map(u64::from_be_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_made_once_and_read_by_both() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("gateway.toml");
        let (made, is_new) = GatewayKey::read_or_make(&file, "hall \"2\"").expect("made");
        let (read, is_newer) = GatewayKey::read_or_make(&file, "another").expect("read");
        assert!(is_new && !is_newer && made == read && read.name == "hall \"2\"");
        let (other, _) = GatewayKey::read_or_make(&folder.path().join("other.toml"), "hall").expect("made");
        assert!(other.gateway != made.gateway && other.secret != made.secret);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = std::fs::metadata(&file).expect("a file").permissions().mode();
            assert_eq!(mode & 0o77, 0);
        }
    }

    #[test]
    fn keys_of_nodes_are_made_once_beside_those_of_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("gateways.toml");
        let (roof, _) = GatewayKey::read_or_make(&file, "roof").expect("made");
        // As an editor may leave it.
        let text = std::fs::read_to_string(&file).expect("text");
        std::fs::write(&file, text.trim_end()).expect("written");
        let names = |names: [&str; 2]| names.map(str::to_owned);
        let (first, new) = GatewayKey::read_and_make(&file, &names(["anchor-1", "roof"])).expect("made");
        assert_eq!((&*first[0].name, first[1] == roof, &new[..]), ("anchor-1", true, &["anchor-1".to_owned()][..]));
        let (second, new) = GatewayKey::read_and_make(&file, &names(["anchor-2", "anchor-1"])).expect("made");
        assert_eq!((second[1] == first[0], &new[..]), (true, &["anchor-2".to_owned()][..]));
        let all = GatewayKey::read_all(&file).expect("three");
        assert_eq!(all.iter().map(|key| key.name.as_str()).collect::<Vec<_>>(), ["roof", "anchor-1", "anchor-2"]);
    }

    #[test]
    fn wrong_files_are_refused_with_what_to_do_and_without_the_key() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("gateways.toml");
        let key = "ab".repeat(SECRET);
        let entry = |id: &str, key: &str| format!("[[gateway]]\nname = \"a\"\nid = \"{id}\"\nkey = \"{key}\"\n");
        let right = entry("0x0123456789abcdef", &key);
        for (text, expected) in [
            (String::new(), "missing field `gateway`"),
            ("gateway = []".to_owned(), "no [[gateway]]"),
            (entry("12", &key), "--key FILE"),
            (entry("0x0123456789abcdef", &key[1..]), "--key FILE"),
            (entry("0x0123456789abcdef", &"é".repeat(SECRET)), "--key FILE"),
            (right.clone() + &right, "twice"),
            (right.clone() + "keys = 1\n", "name, id, key"),
        ] {
            std::fs::write(&file, &text).expect("written");
            let error = GatewayKey::read_all(&file).err().expect(&text).to_string();
            assert!(error.contains(expected) && !error.contains(&key), "{error}");
        }
        std::fs::write(&file, right.clone() + &right.replace("\"a\"", "\"b\"").replace("0x0", "0x1")).expect("written");
        assert_eq!(GatewayKey::read_all(&file).expect("two").len(), 2);
        assert!(GatewayKey::read_or_make(&file, "a").is_err(), "a gateway has one");
    }
}
