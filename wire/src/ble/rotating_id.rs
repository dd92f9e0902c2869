//! Identities that rotate: others see a new beacon each time, and a node with the key sees the same one.
//!
//! The proximity UUID is one block of AES-128 under the beacons' common key:
//!
//! | byte of the block | what |
//! |---|---|
//! | 0–7 | [`MARK`], by which a reader knows that its key fits |
//! | 8–9, 10–11 | the true major and minor number, big-endian |
//! | 12–15 | random, new at each rotation |
//!
//! Major and minor number on the air are random. A reader decrypts the UUID of every iBeacon that it receives: if the
//! result has the mark, the beacon belongs to this site. There is no clock and no list of expected identities. A random
//! UUID is mistaken for one of the site with a probability of 2⁻⁶⁴.
//!
//! # What it does and what it does not
//!
//! - Without the key, two identifiers of a beacon have nothing in common but the measured power, which stays as it is,
//!   since phones need it. If that matters, give all beacons of a site the same measured power.
//! - **The Bluetooth address must change at the same time**, or it reveals what the UUID hides: use a new
//!   non-resolvable private address at each rotation. Between two rotations anyone can recognise a beacon.
//! - With 32 random bits, a beacon repeats an identifier after about 2¹⁶ rotations (at one a minute, six weeks). A
//!   receiver of both learns that it was the same beacon, and nothing more.
//! - It hides the identity, it does not prove it: a recorded identifier can be sent again elsewhere until the key is
//!   changed, and a reader without a clock cannot detect this. Positions that matter must not depend on beacons alone.
//! - A beacon can still be recognised by properties outside its bytes: its position, its power, the offset of its
//!   crystal.
//! - All nodes of a site share the key: the key can be read from any node that is taken apart.

use aes::Aes128;
use aes::cipher::{Block, BlockCipherDecrypt, BlockCipherEncrypt, KeyInit};

use crate::ble::IBeacon;

/// Shows a reader that its key fits: the bytes 0 to 7 of the block.
const MARK: [u8; 8] = *b"BALIZA\x00\x01";

/// The key that beacons and tags of a site share.
#[derive(Clone)]
pub struct RotatingId(Aes128);

/// The random part of each identifier. It must come from a good source of random numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fresh {
    /// The salt in the block.
    pub salt: [u8; 4],
    /// The major number on the air.
    pub major: u16,
    /// The minor number on the air.
    pub minor: u16,
}

impl Fresh {
    /// From random bytes.
    pub fn new(random: [u8; 8]) -> Self {
        let [a, b, c, d, e, f, g, h] = random;
        Self { salt: [a, b, c, d], major: u16::from_be_bytes([e, f]), minor: u16::from_be_bytes([g, h]) }
    }
}

/// The identity behind a rotating identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Revealed {
    /// The true major number.
    pub major: u16,
    /// The true minor number.
    pub minor: u16,
    /// RSSI at 1 m, dBm.
    pub measured_power_dbm: i8,
}

impl RotatingId {
    /// From the key of the config record.
    pub fn new(key: &[u8; 16]) -> Self {
        Self(Aes128::new(&(*key).into()))
    }

    /// What `beacon` advertises until the next rotation. Its own UUID is not sent: a reader learns major and minor
    /// number.
    pub fn rotate(&self, beacon: &IBeacon, fresh: Fresh) -> IBeacon {
        let mut block = [0; 16];
        block[..8].copy_from_slice(&MARK);
        block[8..10].copy_from_slice(&beacon.major.to_be_bytes());
        block[10..12].copy_from_slice(&beacon.minor.to_be_bytes());
        block[12..].copy_from_slice(&fresh.salt);
        IBeacon {
            uuid: self.encrypt(block),
            major: fresh.major,
            minor: fresh.minor,
            measured_power_dbm: beacon.measured_power_dbm,
        }
    }

    /// The identity behind a received identifier; `None`: not a beacon of this site, or not a rotating identifier.
    pub fn reveal(&self, heard: &IBeacon) -> Option<Revealed> {
        let block = self.decrypt(heard.uuid);
        let (mark, rest) = block.split_first_chunk()?;
        let &[a, b, c, d, ..] = rest else { return None };
        (*mark == MARK).then_some(Revealed {
            major: u16::from_be_bytes([a, b]),
            minor: u16::from_be_bytes([c, d]),
            measured_power_dbm: heard.measured_power_dbm,
        })
    }

    fn encrypt(&self, block: [u8; 16]) -> [u8; 16] {
        let mut block = Block::<Aes128>::from(block);
        self.0.encrypt_block(&mut block);
        block.into()
    }

    fn decrypt(&self, block: [u8; 16]) -> [u8; 16] {
        let mut block = Block::<Aes128>::from(block);
        self.0.decrypt_block(&mut block);
        block.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hex_literal::hex;
    use proptest::prelude::*;

    const KEY: [u8; 16] = hex!("000102030405060708090a0b0c0d0e0f");

    fn beacon(major: u16, minor: u16) -> IBeacon {
        IBeacon { uuid: [0xEE; 16], major, minor, measured_power_dbm: -59 }
    }

    /// FIPS-197, appendix C.1.
    #[test]
    fn the_cipher_is_aes_128() {
        let rotating_id = RotatingId::new(&KEY);
        let plain = hex!("00112233445566778899aabbccddeeff");
        let cipher = hex!("69c4e0d86a7b0430d8cdb78070b4c55a");
        assert_eq!(rotating_id.encrypt(plain), cipher);
        assert_eq!(rotating_id.decrypt(cipher), plain);
    }

    /// The UUID is the output of `openssl enc -aes-128-ecb -nopad -K 000102030405060708090a0b0c0d0e0f` for the block
    /// 42414c495a410001 0007 0102 a0a1a2a3.
    #[test]
    fn a_rotating_identifier_byte_by_byte() {
        let fresh = Fresh::new(hex!("a0a1a2a3 1234 5678"));
        let worn = RotatingId::new(&KEY).rotate(&beacon(7, 0x0102), fresh);
        let expected = IBeacon {
            uuid: hex!("739f67598908ead74ee2aca247a6b14d"),
            major: 0x1234,
            minor: 0x5678,
            measured_power_dbm: -59,
        };
        assert_eq!(worn, expected);
    }

    #[test]
    fn without_the_key_it_is_a_stranger() {
        let worn = RotatingId::new(&KEY).rotate(&beacon(7, 9), Fresh::new([5; 8]));
        assert_eq!(RotatingId::new(&[1; 16]).reveal(&worn), None);
    }

    #[test]
    fn an_open_beacon_has_no_rotating_identifier() {
        assert_eq!(RotatingId::new(&KEY).reveal(&beacon(7, 9)), None);
    }

    proptest! {
        #[test]
        fn with_the_key_it_is_always_the_same(
            key in any::<[u8; 16]>(),
            major in any::<u16>(),
            minor in any::<u16>(),
            power in any::<i8>(),
            random in any::<[u8; 8]>(),
        ) {
            let rotating_id = RotatingId::new(&key);
            let worn = rotating_id.rotate(&IBeacon { measured_power_dbm: power, ..beacon(major, minor) }, Fresh::new(random));
            let heard = IBeacon::parse(&worn.emit()).expect("an iBeacon");
            prop_assert_eq!(rotating_id.reveal(&heard), Some(Revealed { major, minor, measured_power_dbm: power }));
        }

        /// Half of the bits of the UUID change with one bit of salt: 64 ± 6 of 128; 20 to 108 is ± 7.8 deviations.
        #[test]
        fn a_rotation_leaves_no_trace_of_the_last(major in any::<u16>(), random in any::<[u8; 8]>(), bit in 0_usize..32) {
            let rotating_id = RotatingId::new(&KEY);
            let mut other = random;
            other[bit / 8] ^= 1 << (bit % 8);
            let [one, two] = [random, other].map(|r| rotating_id.rotate(&beacon(major, 1), Fresh::new(r)).uuid);
            let changed: u32 = one.iter().zip(two).map(|(a, b)| (a ^ b).count_ones()).sum();
            prop_assert!((20..108).contains(&changed), "{}", changed);
        }
    }
}
