//! How a node with Wi-Fi reaches its station: in the page of the config record, behind the room for a classifier.
//!
//! It has a page's header with other letters, as [`decode`](crate::config::decode) reads it for config records, and
//! [`Wifi`] in postcard:
//!
//! | offset | bytes | what |
//! |---|---|---|
//! | 0 | 4 | `BLZW` |
//! | 4 | 1 | [`WIFI_VERSION`] |
//! | 5 | 1 | 0 |
//! | 6 | 2 | length of the settings, bytes |
//! | 8 | 4 | 0 |
//! | 12 | 4 | CRC-32 of the twelve bytes before and of the settings |
//! | 16 | … | the settings |

use embedded_storage::nor_flash::ReadNorFlash;
use heapless::String;
use serde::{Deserialize, Serialize};

use crate::config::page::{Framed, HEADER_BYTES, Letters, MODEL_AT, MODEL_BYTES, parse, seal};
use crate::config::store::page_in_force;
use crate::config::{Invalid, LoadError, Value};

/// The version of [`Wifi`]; a reader accepts no other.
pub const WIFI_VERSION: u8 = 1;
/// The offset of the settings in the page of the config record.
pub const WIFI_AT: usize = MODEL_AT + MODEL_BYTES;
/// Room for the settings, bytes. The longest ones take 223 with their header.
pub const WIFI_BYTES: usize = 240;

const LETTERS: Letters = *b"BLZW";

/// How a node with Wi-Fi reaches its station.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wifi {
    /// The name of the Wi-Fi network.
    pub ssid: String<32>,
    /// Its password; empty: the network is open.
    pub password: String<63>,
    /// The name or the IPv4 address of the station's computer.
    pub host: String<63>,
    /// The UDP port of the station.
    pub port: u16,
    /// What the station knows this gateway by; `None`: it has no key, and its number is its EUI-64.
    pub key: Option<WifiKey>,
}

/// What a station knows a gateway by.
#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct WifiKey {
    /// The gateway's number.
    pub gateway: u64,
    /// Its secret.
    pub secret: [u8; 32],
}

/// Without what others must not read.
impl core::fmt::Debug for Wifi {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { ssid, host, port, key, .. } = self;
        write!(f, "Wifi {{ {ssid:?}, {host:?}:{port}, gateway {:x?} }}", key.map(|key| key.gateway))
    }
}

impl Wifi {
    /// Checks the lengths and the characters.
    ///
    /// # Errors
    /// The first value that a node could not use; the value of a password is its length.
    pub fn validate(&self) -> Result<(), Invalid> {
        let wrong =
            |field, value: usize, must| Err(Invalid { within: None, field, value: Value::Integer(value as u64), must });
        let is_printable = |text: &str| text.bytes().all(|byte| (b' '..=b'~').contains(&byte));
        let passwords = self.password.len();
        if self.ssid.is_empty() {
            return wrong("wifi.ssid", 0, "1 to 32 bytes");
        }
        if passwords != 0 && (passwords < 8 || !is_printable(&self.password)) {
            return wrong("wifi.password", passwords, "8 to 63 letters, digits and signs of ASCII");
        }
        if self.host.is_empty() || !self.host.bytes().all(|byte| byte.is_ascii_graphic() && byte != b':') {
            return wrong("wifi.station", self.host.len(), "a name or an IPv4 address with a port");
        }
        if self.port == 0 { wrong("wifi.station", 0, "a name or an IPv4 address with a port") } else { Ok(()) }
    }
}

/// The settings as they are in a page.
pub fn encode_wifi<'b>(wifi: &Wifi, bytes: &'b mut [u8; WIFI_BYTES]) -> &'b [u8] {
    bytes.fill(0xFF);
    let (_, body) = bytes.split_at_mut(HEADER_BYTES);
    let length = match postcard::to_slice(wifi, body) {
        Ok(written) => written.len(),
        // WIFI_BYTES holds the longest settings: `the_longest_settings_fit`.
        Err(_) => unreachable!(),
    };
    seal(Framed { letters: LETTERS, version: WIFI_VERSION, sequence: 0 }, length, bytes)
}

/// The settings of a page in memory, or of the part of its beginning that was read.
///
/// # Errors
/// [`LoadError::Missing`] if there are none, [`LoadError::Version`] if they are of another version, else
/// [`LoadError::Corrupt`] or [`LoadError::Invalid`].
pub fn wifi_of(page: &[u8]) -> Result<Wifi, LoadError> {
    let bytes = page.get(WIFI_AT..).ok_or(LoadError::Missing)?;
    decode(bytes.get(..WIFI_BYTES).unwrap_or(bytes))
}

fn decode(bytes: &[u8]) -> Result<Wifi, LoadError> {
    let (header, body) = parse(LETTERS, bytes)?;
    if header.version != WIFI_VERSION {
        return Err(LoadError::Version(header.version));
    }
    match postcard::take_from_bytes::<Wifi>(body) {
        Ok((wifi, [])) => wifi.validate().map(|()| wifi).map_err(LoadError::Invalid),
        Ok(_) | Err(_) => Err(LoadError::Corrupt),
    }
}

/// The settings beside the config record in force.
///
/// # Errors
/// As [`wifi_of`], or there is no config record. A flash that cannot be read gives [`LoadError::Corrupt`].
pub fn load_wifi(flash: &mut impl ReadNorFlash, pages: [u32; 2]) -> Result<Wifi, LoadError> {
    let page = page_in_force(flash, pages)?;
    let mut bytes = [0; WIFI_BYTES];
    flash.read(page + WIFI_AT as u32, &mut bytes).map_err(|_| LoadError::Corrupt)?;
    decode(&bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn longest() -> Wifi {
        let key = Some(WifiKey { gateway: u64::MAX, secret: [0xA5; 32] });
        let text = |length: usize| "x".repeat(length);
        Wifi {
            ssid: text(32).parse().unwrap(),
            password: text(63).parse().unwrap(),
            host: text(63).parse().unwrap(),
            port: u16::MAX,
            key,
        }
    }

    fn page(wifi: &Wifi) -> Vec<u8> {
        let mut page = std::vec![0xFF; WIFI_AT];
        page.extend(encode_wifi(wifi, &mut [0; WIFI_BYTES]));
        page
    }

    #[test]
    fn the_longest_settings_fit_beside_record_and_classifier_in_the_smallest_page() {
        let longest = longest();
        // Header 16; texts 1 + 32, 1 + 63 and 1 + 63; port 3; key 1 + 10 + 32.
        assert_eq!(encode_wifi(&longest, &mut [0; WIFI_BYTES]).len(), 16 + 33 + 64 + 64 + 3 + 43);
        const { assert!(WIFI_AT + WIFI_BYTES <= 2048) };
        assert_eq!(wifi_of(&page(&longest)), Ok(longest));
    }

    #[test]
    fn bytes_are_as_the_page_of_formats_has_them() {
        let wifi = Wifi {
            ssid: "hall".parse().unwrap(),
            password: String::new(),
            host: "nas".parse().unwrap(),
            port: 300,
            key: None,
        };
        // 300 = 0b10_0101100: low seven bits with a bit for more, then 2.
        let body = [4, b'h', b'a', b'l', b'l', 0, 3, b'n', b'a', b's', 0xAC, 2, 0];
        let written = page(&wifi);
        assert_eq!(written[WIFI_AT..WIFI_AT + 8], [b'B', b'L', b'Z', b'W', 1, 0, 13, 0]);
        assert_eq!(written[WIFI_AT + 16..], body);
        let digits: Vec<_> = body.iter().map(|byte| std::format!("{byte:02X}")).collect();
        let digits = digits.chunks(4).map(|group| group.concat()).collect::<Vec<_>>().join(" ");
        let page = include_str!("../../../docs/reference/wire-format.md");
        assert!(page.contains(&digits), "{digits}");
    }

    #[test]
    fn damaged_cut_and_missing_settings_are_told_apart() {
        let good = page(&longest());
        assert_eq!(wifi_of(&good[..WIFI_AT]), Err(LoadError::Missing));
        assert_eq!(wifi_of(&[0xFF; 4096]), Err(LoadError::Missing));
        assert_eq!(wifi_of(&[0xFF; 100]), Err(LoadError::Missing));
        for cut in WIFI_AT + 1..good.len() {
            assert!(wifi_of(&good[..cut]).is_err(), "{cut}");
        }
        for bit in 8 * WIFI_AT..8 * good.len() {
            let mut flipped = good.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(wifi_of(&flipped).is_err(), "bit {bit}");
        }
    }

    #[test]
    fn what_cannot_be_used_is_named_and_a_password_is_not_shown() {
        let field = |change: fn(&mut Wifi)| {
            let mut wifi = longest();
            change(&mut wifi);
            wifi.validate().err().map(|invalid| invalid.field)
        };
        assert_eq!(field(|_| ()), None);
        assert_eq!(field(|wifi| wifi.password.clear()), None);
        assert_eq!(field(|wifi| wifi.ssid.clear()), Some("wifi.ssid"));
        assert_eq!(field(|wifi| wifi.password.truncate(7)), Some("wifi.password"));
        assert_eq!(field(|wifi| wifi.password = "pässwort".parse().unwrap()), Some("wifi.password"));
        assert_eq!(field(|wifi| wifi.host.clear()), Some("wifi.station"));
        assert_eq!(field(|wifi| wifi.host = "a b".parse().unwrap()), Some("wifi.station"));
        assert_eq!(field(|wifi| wifi.port = 0), Some("wifi.station"));
        let secret = Wifi { password: "correct horse".parse().unwrap(), ..longest() };
        assert!(!std::format!("{secret:?}").contains("horse"));
    }
}
