//! Hashes of secrets, and their comparison.

use sha2::{Digest, Sha256};

/// SHA-256 of a secret.
pub fn sha256(text: &str) -> [u8; 32] {
    Sha256::digest(text).into()
}

/// Compares without an early end.
pub fn same(one: &[u8], other: &[u8]) -> bool {
    one.len() == other.len() && one.iter().zip(other).fold(0, |different, (one, other)| different | (one ^ other)) == 0
}
