//! The texts of messages: the same through `defmt` on a node and `core::fmt` on a desktop.
//!
//! Numbers in the log are integers: `defmt` prints all digits of a float.

/// Defines a type's text, once for both: a match whose arms are a format and its arguments.
macro_rules! text {
    ($type:ty, |$this:ident| $subject:expr; $($pattern:pat => ($($text:tt)*),)+) => {
        impl core::fmt::Display for $type {
            fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                let $this = self;
                match $subject { $($pattern => write!(out, $($text)*),)+ }
            }
        }

        #[cfg(feature = "defmt")]
        impl defmt::Format for $type {
            fn format(&self, out: defmt::Formatter<'_>) {
                let $this = self;
                match $subject { $($pattern => defmt::write!(out, $($text)*),)+ }
            }
        }
    };
}
pub(crate) use text;

/// A length in hundredths of a metre.
pub(crate) struct Centimetres(i32);

impl Centimetres {
    /// From a length in 0.1 mm, rounded.
    pub(crate) fn of_tenth_mm(tenth_mm: i32) -> Self {
        let half = if tenth_mm < 0 { -50 } else { 50 };
        Self(tenth_mm.saturating_add(half) / 100)
    }

    fn parts(&self) -> (&'static str, u32, u32) {
        let size = self.0.unsigned_abs();
        (if self.0 < 0 { "-" } else { "" }, size / 100, size % 100)
    }
}

text!(Centimetres, |this| this.parts();
    (sign, metres, hundredths) => ("{}{}.{:02}", sign, metres, hundredths),
);

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::Centimetres;

    #[test]
    fn lengths_are_rounded_and_never_overflow() {
        let shown = |value| Centimetres::of_tenth_mm(value).to_string();
        assert_eq!([149, 150, -149, -150].map(shown), ["0.01", "0.02", "-0.01", "-0.02"]);
        assert_eq!([49, -49].map(shown), ["0.00", "0.00"]);
        // 2 147 483 647 · 0.1 mm, without the last digits.
        assert_eq!([i32::MAX, i32::MIN].map(shown), ["214748.36", "-214748.36"]);
    }
}
