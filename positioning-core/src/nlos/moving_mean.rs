//! The mean of the last five values of one link. Barral et al. classify by the mean of ranges and the mean of
//! received powers.

/// The number of values in the mean (Barral et al., 3).
const LENGTH: usize = 5;

/// The mean of the last five values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MovingMean {
    values: [f32; LENGTH],
    /// The number of values present.
    count: u8,
    /// The index for the next value.
    next: u8,
}

impl MovingMean {
    /// A mean without a value yet.
    pub const fn new() -> Self {
        Self { values: [0.0; LENGTH], count: 0, next: 0 }
    }

    /// Takes a value and returns the mean of it and of up to four values before it. A value that is not finite is
    /// skipped. Returns `None` as long as there has been no value.
    pub fn push(&mut self, value: f32) -> Option<f32> {
        if value.is_finite() {
            if let Some(place) = self.values.get_mut(usize::from(self.next)) {
                *place = value;
            }
            self.next = (self.next + 1) % LENGTH as u8;
            self.count = (LENGTH as u8).min(self.count + 1);
        }
        // Summed anew each time, so that a rounding error does not stay.
        let sum: f32 = self.values.iter().take(self.count.into()).sum();
        let mean = sum / f32::from(self.count);
        mean.is_finite().then_some(mean)
    }
}

#[cfg(test)]
mod tests {
    use super::MovingMean;

    #[test]
    fn five_values_make_the_mean() {
        let mut mean = MovingMean::new();
        assert_eq!(mean.push(f32::NAN), None);
        // 2; (2 + 4)/2 = 3; (2 + 4 + 6)/3 = 4; 20/4 = 5; 30/5 = 6; without the 2 and with 12: 40/5 = 8.
        for (value, expected) in [(2.0, 2.0), (4.0, 3.0), (6.0, 4.0), (8.0, 5.0), (10.0, 6.0), (12.0, 8.0)] {
            assert_eq!(mean.push(value), Some(expected));
        }
        assert_eq!(mean.push(f32::INFINITY), Some(8.0), "passed over");
        // The huge value leaves no trace: 4 left the window first, then 3e38 leaves it.
        assert_eq!(mean.push(3.0e38).map(|mean| mean > 1.0e37), Some(true));
        for _ in 0..4 {
            mean.push(1.0);
        }
        assert_eq!(mean.push(1.0), Some(1.0));
    }
}
