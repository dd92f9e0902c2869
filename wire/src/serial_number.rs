//! Serial number arithmetic (RFC 1982): numbers that go on from their greatest value to zero.
//!
//! Such numbers are only comparable within a window, which depends on what they count. So each comparison names its
//! window, or the caller says why a whole turn cannot have passed.

/// A number whose successor wraps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialNumber<T>(pub T);

macro_rules! serial_numbers {
    ($($number:ty: $signed:ty),*) => {$(
        impl SerialNumber<$number> {
            /// Steps from `earlier` to this number. Less than a whole turn must have passed.
            pub const fn steps_from(self, earlier: $number) -> $number {
                self.0.wrapping_sub(earlier)
            }

            /// Whether this number is `other` or at most `window` steps behind it.
            pub const fn is_within(self, window: $number, other: $number) -> bool {
                other.wrapping_sub(self.0) <= window
            }

            /// Steps from `other` to this number, negative if this number is earlier. They must be less than half a turn
            /// apart.
            pub const fn minus(self, other: $number) -> $signed {
                self.steps_from(other) as $signed
            }
        }
    )*};
}

serial_numbers!(u8: i8, u16: i16, u32: i32);

#[cfg(test)]
mod tests {
    use super::SerialNumber;

    /// RFC 1982, section 5.2: for eight bits, 1 > 0, 44 > 0, 100 > 0, 100 > 44, 200 > 100, 255 > 200, 0 > 255,
    /// 100 > 255, 0 > 200 and 44 > 200.
    #[test]
    fn order_is_that_of_the_rfc() {
        let pairs =
            [(1, 0), (44, 0), (100, 0), (100, 44), (200, 100), (255, 200), (0, 255), (100, 255), (0, 200), (44, 200)];
        for (later, earlier) in pairs {
            let steps = SerialNumber::<u8>(later).minus(earlier);
            assert!(steps > 0 && SerialNumber(earlier).minus(later) == -steps, "{later} after {earlier}: {steps}");
        }
        // 0 − 255 and 100 − 255 by hand, modulo 256; and 2 − 65 535 modulo 65 536.
        assert_eq!([SerialNumber(0_u8).steps_from(255), SerialNumber(100_u8).steps_from(255)], [1, 101]);
        assert_eq!(SerialNumber(2_u16).minus(u16::MAX), 3);
    }

    #[test]
    fn a_window_has_its_length_at_every_number() {
        for at in 0..=u16::MAX {
            let is_within = |behind: u16| SerialNumber(at.wrapping_sub(behind)).is_within(16, at);
            assert!(
                is_within(0) && is_within(16) && !is_within(17) && !is_within(0x8000) && !is_within(u16::MAX),
                "{at}"
            );
        }
    }
}
