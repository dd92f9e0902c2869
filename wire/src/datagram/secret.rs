//! The code of a datagram: HMAC-SHA-256 (RFC 2104), of which the first bytes are sent.

use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

use super::{CODE_BYTES, MAX_DATAGRAM};

/// What a gateway and its station know, and nobody else.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Secret(pub [u8; Secret::BYTES]);

impl Secret {
    /// Its bytes.
    pub const BYTES: usize = 32;

    fn mac(&self, signed: &[u8]) -> Hmac<Sha256> {
        // HMAC fills a key up to a block with zeros.
        let mut block = [0; 64];
        block[..Self::BYTES].copy_from_slice(&self.0);
        let mut mac = <Hmac<Sha256> as KeyInit>::new(&block.into());
        mac.update(signed);
        mac
    }

    /// The code of a datagram's other bytes.
    pub fn code(&self, signed: &[u8]) -> [u8; CODE_BYTES] {
        let whole = self.mac(signed).finalize().into_bytes();
        core::array::from_fn(|i| whole[i])
    }

    /// Whether this is the code of a datagram's other bytes.
    pub fn is_code(&self, signed: &[u8], code: &[u8]) -> bool {
        code.len() == CODE_BYTES && self.mac(signed).verify_truncated_left(code).is_ok()
    }
}

/// Puts the code behind a datagram of `length` bytes, if there is a secret. Returns the whole datagram.
pub fn sealed<'o>(secret: Option<&Secret>, length: usize, out: &'o mut [u8; MAX_DATAGRAM]) -> &'o [u8] {
    let mut end = length;
    if let (Some(secret), Some((signed, rest))) = (secret, out.split_at_mut_checked(length))
        && let Some(code) = rest.first_chunk_mut::<CODE_BYTES>()
    {
        *code = secret.code(signed);
        end += CODE_BYTES;
    }
    out.get(..end).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_that_of_a_published_example() {
        // RFC 4231, test case 1, with its key of 20 bytes of 0x0B: HMAC pads a key with zeros.
        let mut secret = Secret([0; Secret::BYTES]);
        secret.0[..20].fill(0x0B);
        let expected = [0xB0, 0x34, 0x4C, 0x61, 0xD8, 0xDB, 0x38, 0x53, 0x5C, 0xA8, 0xAF, 0xCE, 0xAF, 0x0B, 0xF1, 0x2B];
        assert_eq!(secret.code(b"Hi There"), expected);
        assert!(secret.is_code(b"Hi There", &expected) && !secret.is_code(b"Hi there", &expected));
        assert!(!secret.is_code(b"Hi There", &expected[..8]) && !secret.is_code(b"Hi There", &[]));
    }

    #[test]
    fn a_code_goes_behind_a_datagram_that_has_room_for_it() {
        let secret = Secret([7; Secret::BYTES]);
        let mut out = [1; MAX_DATAGRAM];
        assert_eq!(sealed(None, 40, &mut out).len(), 40);
        let code = secret.code(&[1; 40]);
        let whole = sealed(Some(&secret), 40, &mut out);
        assert_eq!((whole.len(), &whole[40..]), (40 + CODE_BYTES, &code[..]));
        assert_eq!(sealed(Some(&secret), MAX_DATAGRAM, &mut out).len(), MAX_DATAGRAM);
        assert!(sealed(Some(&secret), MAX_DATAGRAM + 1, &mut out).is_empty());
    }
}
