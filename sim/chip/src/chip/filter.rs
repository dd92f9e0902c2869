//! The frame filter (user manual, 5.2), which selects the frames that a receiver with FFEN keeps.
//!
//! It reads the MAC header only. The frame type must be allowed, the version known, and the destination the receiver or
//! everyone.

const COORDINATOR: u32 = 1 << 1;
const BROADCAST: u16 = 0xFFFF;

/// The receiver's identity, and the frames that it accepts.
pub(super) struct Filter {
    /// SYS_CFG.
    pub(super) config: u32,
    pub(super) pan: u16,
    pub(super) short: u16,
    pub(super) eui: [u8; 8],
}

impl Filter {
    /// Whether the frame passes. The bytes may be shorter than any header.
    pub(super) fn passes(&self, frame: &[u8]) -> bool {
        let &[low, high, ..] = frame else { return false };
        let kind = low & 7;
        // FFAB, FFAD, FFAA, FFAM for types 0 to 3, FFA4, FFA5, and FFAR for the rest.
        let allowed = match kind {
            0..=3 => 1 << (2 + kind),
            4 => 1 << 7,
            5 => 1 << 8,
            _ => 1 << 6,
        };
        if self.config & allowed == 0 {
            return false;
        }
        // Other types have no header that the filter knows.
        if kind > 3 {
            return true;
        }
        if (high >> 4) & 3 > 1 {
            return false;
        }
        if kind == 2 {
            return frame.len() == 5;
        }
        self.addressed(kind, low & 0x40 != 0, (high >> 2) & 3, high >> 6, frame)
    }

    fn addressed(&self, kind: u8, compressed: bool, to: u8, from: u8, frame: &[u8]) -> bool {
        let word = |at: usize| frame.get(at..at + 2).map(|w| u16::from_le_bytes([w[0], w[1]]));
        let coordinator = self.config & COORDINATOR != 0;
        match to {
            0 => {
                // A frame without a destination: a beacon frame of our network, or data for its coordinator.
                let ours = match from {
                    0 => false,
                    _ => word(3).is_some_and(|pan| pan == self.pan || (kind == 0 && self.pan == BROADCAST)),
                };
                ours && !compressed && (kind == 0 || coordinator)
            }
            2 | 3 => {
                let pan = word(3).is_some_and(|pan| pan == self.pan || pan == BROADCAST);
                let us = if to == 2 {
                    word(5).is_some_and(|short| short == self.short || short == BROADCAST)
                } else {
                    frame.get(5..13).is_some_and(|eui| eui == self.eui)
                };
                pan && us
            }
            _ => false,
        }
    }
}

/// The number of bytes of a frame's header after which the filter has decided.
pub(super) fn header_length(frame: &[u8]) -> usize {
    let &[low, high, ..] = frame else { return frame.len() };
    if low & 7 > 3 {
        return 2;
    }
    let address = |mode: u8| match mode {
        2 => 2,
        3 => 8,
        _ => 0,
    };
    let (to, from) = ((high >> 2) & 3, high >> 6);
    let pans = 2 * (usize::from(to > 1) + usize::from(from > 1 && low & 0x40 == 0));
    3 + pans + address(to) + address(from)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FFEN: u32 = 1;
    const DATA: u32 = 1 << 3;

    fn filter(config: u32) -> Filter {
        Filter { config: FFEN | config, pan: 0xDECA, short: 0x1234, eui: [1, 2, 3, 4, 5, 6, 7, 8] }
    }

    /// Data, intra-PAN, short addresses: 0x8841.
    fn data_to(pan: u16, short: u16) -> [u8; 12] {
        let ([p0, p1], [s0, s1]) = (pan.to_le_bytes(), short.to_le_bytes());
        [0x41, 0x88, 7, p0, p1, s0, s1, 0x01, 0x00, 0x99, 0, 0]
    }

    #[test]
    fn data_for_us_and_for_all_passes() {
        let f = filter(DATA);
        assert!(f.passes(&data_to(0xDECA, 0x1234)));
        assert!(f.passes(&data_to(0xDECA, 0xFFFF)));
        assert!(f.passes(&data_to(0xFFFF, 0xFFFF)));
        assert!(!f.passes(&data_to(0xDECA, 0x1235)));
        assert!(!f.passes(&data_to(0xDEC0, 0x1234)));
        assert!(!filter(1 << 4).passes(&data_to(0xDECA, 0x1234)));
    }

    #[test]
    fn long_address_blink_and_beacon() {
        let mut long = vec![0x41, 0x8C, 7, 0xCA, 0xDE, 1, 2, 3, 4, 5, 6, 7, 8, 1, 0, 0, 0];
        assert!(filter(DATA).passes(&long));
        long[6] ^= 1;
        assert!(!filter(DATA).passes(&long));
        // A blink, 0xC5: type 5.
        let blink = [0xC5, 1, 1, 2, 3, 4, 5, 6, 7, 8, 0, 0];
        assert!(!filter(DATA).passes(&blink));
        assert!(filter(1 << 8).passes(&blink));
        // A beacon frame has only a source. Its PAN must be ours.
        let beacon = |pan: u8| [0x00, 0x80, 1, pan, 0xDE, 1, 0, 0, 0];
        assert!(filter(1 << 2).passes(&beacon(0xCA)));
        assert!(!filter(1 << 2).passes(&beacon(0xCB)));
    }

    #[test]
    fn nonsense_is_rejected() {
        let f = filter(0x1FC);
        assert!(!f.passes(&[]));
        assert!(!f.passes(&[0x41]));
        assert!(!f.passes(&[0x41, 0x88, 7, 0xCA]));
        // Version 2, and the reserved address mode 1.
        assert!(!f.passes(&[0x41, 0xA8, 7, 0xCA, 0xDE, 0x34, 0x12, 1, 0, 0, 0]));
        assert!(!f.passes(&[0x41, 0x84, 7, 0xCA, 0xDE, 0x34, 0x12, 1, 0, 0, 0]));
    }

    #[test]
    fn header_lengths_by_hand() {
        // FC 2, sequence 1, PAN 2, to 2, from 2.
        assert_eq!(header_length(&data_to(0, 0)), 9);
        // PANs 2 + 2, to 8, from 2.
        assert_eq!(header_length(&[0x01, 0x8C, 0]), 17);
        assert_eq!(header_length(&[0xC5, 0]), 2);
    }
}
