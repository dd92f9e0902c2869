//! The code that proves who has sent a frame: AES-CCM* without encryption (IEEE 802.15.4, MIC-64; RFC 3610).
//!
//! A frame of a network with a key has the bit [`AUTHENTICATED`] in its message's code, and ends with the eight bytes of
//! the code. The code covers the frame before it; of a response also the poll's code, so that it answers this poll and no
//! other. The nonce is (lowest byte first): source (2), session (4), superframe (4), sequence number (1), message's code
//! (1), 0.
//!
//! The crate `ccm` computes the same, in 1,200 bytes of flash and six crates where this takes 174 bytes.

use super::table_aes::TableAes;
use crate::uwb::FrameBuffer;

/// Bytes of a code.
pub const CODE_BYTES: usize = 8;
/// The code of a frame.
pub type IntegrityCode = [u8; CODE_BYTES];
/// What no two frames under one key have in common.
pub type Nonce = [u8; 13];

/// Makes the code of bytes, one part after the other, under a key: [`integrity_code`] with the AES of the board.
pub type MakeCode = fn(key: &[u8; 16], nonce: &Nonce, parts: [&[u8]; 2]) -> IntegrityCode;

/// The bit in the message's code of a frame that ends with its integrity code.
pub(super) const AUTHENTICATED: u8 = 0x08;
/// The place of the message's code, behind the header with two addresses of 16 bits.
const MESSAGE_AT: usize = 9;

/// Authenticated data, a code of eight bytes, a length of two bytes (RFC 3610, 2.2).
const FIRST_FLAGS: u8 = 0x59;
/// The flags of the block that encrypts the code.
const KEY_FLAGS: u8 = 0x01;

/// The code of `parts`, one after the other and not empty, by the block cipher `encrypt`: a block for each 16 bytes of the parts and
/// two bytes more, and two blocks beside.
#[inline(never)]
pub fn integrity_code(encrypt: &mut dyn FnMut(&mut [u8; 16]), nonce: &Nonce, parts: [&[u8]; 2]) -> IntegrityCode {
    let mut block = start(FIRST_FLAGS, nonce);
    encrypt(&mut block);
    let length = parts.iter().map(|part| part.len()).sum::<usize>() as u16;
    let [high, low] = length.to_be_bytes();
    block[0] ^= high;
    block[1] ^= low;
    let mut at = 2;
    for mut rest in parts {
        while !rest.is_empty() {
            if at == block.len() {
                encrypt(&mut block);
                at = 0;
            }
            let (bytes, more) = rest.split_at(rest.len().min(block.len() - at));
            block[at..].iter_mut().zip(bytes).for_each(|(sum, byte)| *sum ^= byte);
            at += bytes.len();
            rest = more;
        }
    }
    encrypt(&mut block);
    let mut mask = start(KEY_FLAGS, nonce);
    encrypt(&mut mask);
    core::array::from_fn(|i| block[i] ^ mask[i])
}

/// [`integrity_code`] with AES-128 in software, for boards and computers without a block cipher of their own.
#[inline]
pub fn software_code(key: &[u8; 16], nonce: &Nonce, parts: [&[u8]; 2]) -> IntegrityCode {
    let aes = TableAes::new(key);
    integrity_code(&mut |block| aes.encrypt(block), nonce, parts)
}

fn start(flags: u8, nonce: &Nonce) -> [u8; 16] {
    let mut block = [0; 16];
    block[0] = flags;
    block[1..14].copy_from_slice(nonce);
    block
}

/// The frame without its code, and the code; `None` if it has none.
pub fn split_code(bytes: &[u8]) -> Option<(&[u8], &IntegrityCode)> {
    bytes.get(MESSAGE_AT).filter(|code| **code & AUTHENTICATED != 0)?;
    bytes.split_last_chunk().filter(|(frame, _)| frame.len() > MESSAGE_AT)
}

impl FrameBuffer {
    /// Makes the frame that was written one with a code. `code` gets its bytes.
    pub fn authenticate(&mut self, code: impl FnOnce(&[u8]) -> IntegrityCode) -> IntegrityCode {
        if let Some(message) = self.0.get_mut(MESSAGE_AT) {
            *message |= AUTHENTICATED;
        }
        let code = code(&self.0);
        self.put(&code);
        code
    }
}

#[cfg(test)]
mod tests {
    use aes::Aes128;
    use aes::cipher::KeyInit;
    use ccm::aead::AeadInOut;
    use ccm::consts::{U8, U13};

    use super::*;

    #[test]
    fn codes_are_those_of_ccm() {
        let (key, nonce) = (core::array::from_fn(|i| i as u8 * 7), core::array::from_fn(|i| 0xA0 + i as u8));
        let aes = TableAes::new(&key);
        let reference: ccm::Ccm<Aes128, U8, U13> = KeyInit::new(&key.into());
        let bytes: std::vec::Vec<u8> = (0..=255).collect();
        // One block to the brim (14 and two of the length), and more; cut anywhere.
        for length in [1, 13, 14, 15, 30, 31, 118, 119, 256] {
            let expected: [u8; 8] =
                reference.encrypt_inout_detached(&nonce.into(), &bytes[..length], (&mut [][..]).into()).unwrap().into();
            for cut in [0, length / 3, length] {
                let parts = [&bytes[..cut], &bytes[cut..length]];
                let mut blocks = 0;
                let mut encrypt = |block: &mut [u8; 16]| {
                    blocks += 1;
                    aes.encrypt(block);
                };
                assert_eq!(integrity_code(&mut encrypt, &nonce, parts), expected, "{length} cut at {cut}");
                assert_eq!(blocks, 2 + (length + 2).div_ceil(16));
            }
        }
    }

    #[test]
    fn only_a_marked_frame_with_room_for_a_code_has_one() {
        let mut bytes = [0x30; 18];
        assert_eq!(split_code(&bytes), None);
        bytes[MESSAGE_AT] = 0x38;
        assert_eq!(split_code(&bytes), Some((&bytes[..10], &[0x30; 8])));
        assert_eq!(split_code(&bytes[..17]), None);
        assert_eq!(split_code(&[]), None);
    }
}
