//! AES-128 by a table, for boards without a block cipher of their own (FIPS 197; the table of J. Daemen and V. Rijmen, "AES
//! Proposal: Rijndael", 1999, 5.2.1).
//!
//! The crate `aes` computes bit by bit, so that its time shows nothing of the key to programs that share a cache. Nodes
//! share theirs with nobody, and must answer at once: there the code of a response takes 26,400 instructions by that crate,
//! its key included.

/// The S-box's value s of a byte, times 2, 1, 1 and 3 in GF(2⁸), from the highest byte on.
const TABLE: [u32; 256] = table();
const ROUNDS: usize = 10;

/// The keys of the rounds, four words each.
pub struct TableAes([[u32; 4]; ROUNDS + 1]);

// Small functions that must be inlined even where code is optimised for size: each runs a hundred times a frame.
impl TableAes {
    /// Expands a key.
    #[inline]
    pub fn new(key: &[u8; 16]) -> Self {
        let mut keys = [words(key); ROUNDS + 1];
        let (mut last, mut constant) = (keys[0], 1);
        for key in &mut keys[1..] {
            let d = last[3].rotate_left(8);
            let turned = column([d; 4], 0, s_box);
            last[0] ^= turned ^ u32::from(constant) << 24;
            last[1] ^= last[0];
            last[2] ^= last[1];
            last[3] ^= last[2];
            *key = last;
            constant = double(constant);
        }
        Self(keys)
    }

    /// Encrypts a block.
    #[inline]
    pub fn encrypt(&self, block: &mut [u8; 16]) {
        let [first, between @ .., last] = &self.0;
        let mut state = add(words(block), first);
        for key in between {
            let mixed = |byte: u8, row: u32| TABLE[usize::from(byte)].rotate_right(8 * row);
            state = add(round(state, mixed), key);
        }
        let state = add(round(state, s_box), last);
        for (bytes, word) in block.as_chunks_mut().0.iter_mut().zip(state) {
            *bytes = word.to_be_bytes();
        }
    }
}

#[inline(always)]
fn words(bytes: &[u8; 16]) -> [u32; 4] {
    let mut words = [0; 4];
    words.iter_mut().zip(bytes.as_chunks().0).for_each(|(word, bytes)| *word = u32::from_be_bytes(*bytes));
    words
}

#[inline(always)]
fn add([a, b, c, d]: [u32; 4], key: &[u32; 4]) -> [u32; 4] {
    [a ^ key[0], b ^ key[1], c ^ key[2], d ^ key[3]]
}

/// Each column of a state with its rows shifted, of which `map` maps each byte, given its row.
#[inline(always)]
fn round(state: [u32; 4], map: impl Fn(u8, u32) -> u32 + Copy) -> [u32; 4] {
    [column(state, 0, map), column(state, 1, map), column(state, 2, map), column(state, 3, map)]
}

#[inline(always)]
fn column(state: [u32; 4], first: usize, map: impl Fn(u8, u32) -> u32) -> u32 {
    let byte = |row: usize| (state[(first + row) % 4] >> (24 - 8 * row)) as u8;
    map(byte(0), 0) ^ map(byte(1), 1) ^ map(byte(2), 2) ^ map(byte(3), 3)
}

/// The S-box's value of a byte, in its row of a word.
#[inline(always)]
fn s_box(byte: u8, row: u32) -> u32 {
    (TABLE[usize::from(byte)] >> 8 & 0xFF) << (24 - 8 * row)
}

const fn double(byte: u8) -> u8 {
    byte << 1 ^ if byte & 0x80 == 0 { 0 } else { 0x1B }
}

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    // Powers of 3, and of its inverse 0xF6: so each byte with its own inverse.
    let (mut power, mut inverse) = (1_u8, 1_u8);
    loop {
        // The affine map of FIPS 197, 5.1.1. Zero has no inverse: it is mapped as zero.
        let s = inverse
            ^ inverse.rotate_left(1)
            ^ inverse.rotate_left(2)
            ^ inverse.rotate_left(3)
            ^ inverse.rotate_left(4)
            ^ 0x63;
        table[power as usize] = multiples(s);
        power ^= double(power);
        // Division by 3: multiplication by 0xF6, in shifts.
        inverse ^= inverse << 1;
        inverse ^= inverse << 2;
        inverse ^= inverse << 4;
        if inverse & 0x80 != 0 {
            inverse ^= 0x09;
        }
        if power == 1 {
            break;
        }
    }
    table[0] = multiples(0x63);
    table
}

const fn multiples(s: u8) -> u32 {
    u32::from_be_bytes([double(s), s, s, double(s) ^ s])
}

#[cfg(test)]
mod tests {
    use aes::Aes128;
    use aes::cipher::{BlockCipherEncrypt, KeyInit};
    use hex_literal::hex;
    use rand::{Rng, SeedableRng};

    use super::*;

    #[test]
    fn the_example_of_the_standard_is_encrypted() {
        // FIPS 197, appendix C.1.
        let mut block = hex!("00112233445566778899aabbccddeeff");
        TableAes::new(&hex!("000102030405060708090a0b0c0d0e0f")).encrypt(&mut block);
        assert_eq!(block, hex!("69c4e0d86a7b0430d8cdb78070b4c55a"));
    }

    #[test]
    fn random_blocks_are_encrypted_as_by_the_crate() {
        let mut random = rand_pcg::Pcg64::seed_from_u64(1);
        for _ in 0..1000 {
            let (key, mut block): ([u8; 16], [u8; 16]) = (random.random(), random.random());
            let mut expected = block.into();
            Aes128::new(&key.into()).encrypt_block(&mut expected);
            TableAes::new(&key).encrypt(&mut block);
            assert_eq!(block, <[u8; 16]>::from(expected));
        }
    }
}
