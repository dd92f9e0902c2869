//! A digest of positions to their last bit, for the comparison of two runs of a tag: telemetry rounds to 0.1 mm.

use core::cell::RefCell;

use crate::{Observer, RoundOutcome};

/// FNV-1a (64 bits; Fowler, Noll, Vo) of the positions so far, of their covariances, and of the reasons for missing
/// positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest(u64);

impl Digest {
    /// The digest of nothing.
    pub const fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    /// Adds this epoch.
    pub fn take(&mut self, epoch: &RoundOutcome<'_>) {
        match &epoch.outcome {
            Ok(position) => {
                let covariance = position.covariance_m2.as_flattened().iter();
                for number in position.position_m.iter().chain(covariance) {
                    self.bytes(&number.to_bits().to_le_bytes());
                }
            }
            Err(reason) => self.bytes(reason.as_str().as_bytes()),
        }
    }

    /// The value of the digest.
    pub const fn value(self) -> u64 {
        self.0
    }

    fn bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
}

impl Observer for &RefCell<Digest> {
    async fn epoch(&self, epoch: &RoundOutcome<'_>) {
        self.borrow_mut().take(epoch);
    }
}

impl Default for Digest {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_have_the_published_digests() {
        // draft-eastlake-fnv, appendix C: FNV-1a of 64 bits of "", "a" and "foobar".
        let of = |text: &str| {
            let mut digest = Digest::new();
            digest.bytes(text.as_bytes());
            digest.value()
        };
        assert_eq!(of(""), 0xCBF2_9CE4_8422_2325);
        assert_eq!(of("a"), 0xAF63_DC4C_8601_EC8C);
        assert_eq!(of("foobar"), 0x8594_4171_F739_67E8);
    }
}
