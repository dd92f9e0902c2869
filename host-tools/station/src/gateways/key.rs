//! The key of a gateway, which a station has, too: a number and a secret, in a file that both read.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Write};
use std::path::Path;

use anyhow::{Context, Result};
use hmac::{Hmac, KeyInit, Mac};
use recording::{UserError, read_text};
use serde::Deserialize;
use sha2::Sha256;
use wire::datagram::{CODE_BYTES, MAX_DATAGRAM};

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
    pub(super) secret: [u8; SECRET],
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
            let made = Self::random(name)?;
            return made.write(file).map(|()| (made, true));
        }
        let mut keys = Self::read_all(file)?;
        match (keys.pop(), keys.is_empty()) {
            (Some(key), true) => Ok((key, false)),
            _ => Err(UserError::file(file, "a gateway has its own key only: one [[gateway]]").into()),
        }
    }

    fn random(name: &str) -> Result<Self> {
        let mut bytes = [0; 8 + SECRET];
        getrandom::fill(&mut bytes).context("the system has no random numbers")?;
        let (id, secret) = bytes.split_at(8);
        let (gateway, secret) = (u64::from_be_bytes(id.try_into()?), secret.try_into()?);
        Ok(Self { name: name.to_owned(), gateway, site: None, secret })
    }

    /// Writes a new file that others cannot read.
    fn write(&self, file: &Path) -> Result<()> {
        let mut options = OpenOptions::new();
        options.write(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let secret: String = self.secret.iter().map(|byte| format!("{byte:02x}")).collect();
        let text = format!(
            "[[gateway]]\nname = {}\nid = \"0x{:016x}\"\nkey = \"{secret}\"\n",
            toml::Value::from(&*self.name),
            self.gateway
        );
        let written = options.open(file).and_then(|mut made| made.write_all(text.as_bytes()));
        written.map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => anyhow::anyhow!("{} has just been made by another program", file.display()),
            _ => anyhow::Error::from(error).context(format!("cannot write {}", file.display())),
        })
    }

    fn mac(&self, signed: &[u8]) -> Hmac<Sha256> {
        // HMAC fills a key up to a block with zeros.
        let mut block = [0; 64];
        block[..SECRET].copy_from_slice(&self.secret);
        let mut mac = <Hmac<Sha256> as KeyInit>::new(&block.into());
        mac.update(signed);
        mac
    }

    /// The code of a datagram's other bytes.
    pub fn code(&self, signed: &[u8]) -> [u8; CODE_BYTES] {
        let whole = self.mac(signed).finalize().into_bytes();
        std::array::from_fn(|i| whole[i])
    }

    /// Whether this is the code of a datagram's other bytes.
    pub fn is_code(&self, signed: &[u8], code: &[u8]) -> bool {
        code.len() == CODE_BYTES && self.mac(signed).verify_truncated_left(code).is_ok()
    }
}

/// Puts the code behind a datagram of `length` bytes, if there is a key. Returns the whole datagram.
pub fn sealed<'o>(key: Option<&GatewayKey>, length: usize, out: &'o mut [u8; MAX_DATAGRAM]) -> &'o [u8] {
    let mut end = length;
    if let (Some(key), Some((signed, rest))) = (key, out.split_at_mut_checked(length))
        && let Some(code) = rest.first_chunk_mut::<CODE_BYTES>()
    {
        *code = key.code(signed);
        end += CODE_BYTES;
    }
    out.get(..end).unwrap_or_default()
}

fn number(text: &str) -> Option<u64> {
    hexadecimal::bytes(text.strip_prefix("0x")?).map(u64::from_be_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_that_of_a_published_example() {
        // RFC 4231, test case 1, with its key of 20 bytes of 0x0B: HMAC pads a key with zeros.
        let mut secret = [0; SECRET];
        secret[..20].fill(0x0B);
        let key = GatewayKey { name: String::new(), gateway: 1, site: None, secret };
        let expected = [0xB0, 0x34, 0x4C, 0x61, 0xD8, 0xDB, 0x38, 0x53, 0x5C, 0xA8, 0xAF, 0xCE, 0xAF, 0x0B, 0xF1, 0x2B];
        assert_eq!(key.code(b"Hi There"), expected);
        assert!(key.is_code(b"Hi There", &expected) && !key.is_code(b"Hi there", &expected));
        assert!(!key.is_code(b"Hi There", &expected[..8]) && !key.is_code(b"Hi There", &[]));
    }

    #[test]
    fn a_file_is_made_once_and_read_by_both() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("gateway.toml");
        let (made, is_new) = GatewayKey::read_or_make(&file, "hall \"2\"").expect("made");
        let (read, is_newer) = GatewayKey::read_or_make(&file, "another").expect("read");
        assert!(is_new && !is_newer && made == read && read.name == "hall \"2\"");
        let (other, _) = GatewayKey::read_or_make(&folder.path().join("other.toml"), "hall").expect("made");
        assert!(other.gateway != made.gateway && other.code(b"") != made.code(b""));
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = std::fs::metadata(&file).expect("a file").permissions().mode();
            assert_eq!(mode & 0o77, 0);
        }
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
