//! What a receiver reads too loud or too soft, alike from all beacons: another telephone than the one that calibrated errs by 0.3 to
//! 0.4 m more in the thesis (tables 4.4 and 4.5). Learnt while positions are found.
//!
//! Scans and what was expected where the tag was found to be flow in; out flows the offset in dB with its deviation. A scalar
//! Kalman filter: one receiver has one offset, that wanders hardly at all.

use crate::Real;

/// What is believed of a receiver before anything is heard, dB.
const PRIOR_DB: f64 = 4.0;
/// By how much an offset wanders, dB² a scan: a hand, a pocket. A thousandth of a dB² is a dB in a thousand scans.
const WANDER: f64 = 1.0e-3;
/// A mean residual that is off by more deviations than this is no more surprising.
const SURPRISE: f64 = 3.0;

/// The offset of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReceiverOffset<T> {
    offset: T,
    variance: T,
}

impl<T: Real> Default for ReceiverOffset<T> {
    /// A receiver of which nothing is known: as the calibration's, give or take 4 dB.
    fn default() -> Self {
        Self::new(T::of(PRIOR_DB))
    }
}

impl<T: Real> ReceiverOffset<T> {
    /// A receiver that is as the calibration's, give or take `deviation` dB.
    pub fn new(deviation: T) -> Self {
        Self { offset: T::ZERO, variance: deviation.squared() }
    }

    /// By how much the receiver's levels are too loud, dB.
    pub fn offset(&self) -> T {
        self.offset
    }

    /// The offset's standard deviation, dB.
    pub fn deviation(&self) -> T {
        self.variance.sqrt()
    }

    /// Takes a scan, and what was expected of it where the tag is, both in dBm by the beacons' order. `deviation` is that of one level
    /// about what is expected, dB. The mean of what they differ by counts; the beacons' shadows stay as long as the tag stays, so that
    /// one scan a metre of way, or a second, teaches what there is to learn. Says how many beacons were compared: fewer than
    /// three teach nothing, because a position is bent to two of them.
    pub fn learn(&mut self, scan: &[Option<T>], expected: &[Option<T>], deviation: T) -> usize {
        let (mut sum, mut count) = (T::ZERO, 0);
        for (heard, expected) in scan.iter().zip(expected) {
            if let (Some(heard), Some(expected)) = (*heard, *expected)
                && (heard - expected).is_finite()
            {
                sum += heard - expected;
                count += 1;
            }
        }
        if count < 3 || !(deviation > T::ZERO && deviation.is_finite()) {
            return count;
        }
        // A position in the plane has eaten two of the residuals.
        let noise = deviation.squared() / T::count(count - 2);
        let predicted = self.variance + T::of(WANDER);
        let most = T::of(SURPRISE) * (predicted + noise).sqrt();
        let innovation = (sum / T::count(count) - self.offset).at_least(-most).at_most(most);
        let gain = predicted / (predicted + noise);
        self.offset += gain * innovation;
        self.variance = gain * noise;
        count
    }

    /// Takes the offset out of a scan.
    pub fn correct(&self, scan: &mut [Option<T>]) {
        for level in scan.iter_mut().flatten() {
            *level -= self.offset;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::ReceiverOffset;

    #[test]
    fn one_scan_moves_the_offset_as_calculated_by_hand() {
        // Mean of 5, 7, 6, 6 is 6; noise 4² ⁄ 2 = 8, predicted 16.001: gain 16.001 ⁄ 24.001 = 0.666681, offset 4.000083, variance
        // 5.333445, deviation 2.309425.
        let mut receiver = ReceiverOffset::<f64>::default();
        let scan = [Some(-55.0), Some(-63.0), None, Some(-74.0), Some(-54.0)];
        let expected = [Some(-60.0), Some(-70.0), Some(-50.0), Some(-80.0), Some(-60.0)];
        assert_eq!(receiver.learn(&scan, &expected, 4.0), 4);
        assert!((receiver.offset() - 4.000_083).abs() < 1e-6, "{receiver:?}");
        assert!((receiver.deviation() - 2.309_425).abs() < 1e-6, "{receiver:?}");
        let mut corrected = [Some(-50.0), None];
        receiver.correct(&mut corrected);
        assert!((corrected[0].expect("heard") + 54.000_083).abs() < 1e-6 && corrected[1].is_none());
    }

    #[test]
    fn two_beacons_and_nonsense_teach_nothing() {
        let mut receiver = ReceiverOffset::<f32>::default();
        let before = receiver;
        receiver.learn(&[Some(-50.0), Some(-50.0)], &[Some(-60.0), Some(-60.0)], 4.0);
        receiver.learn(&[Some(f32::NAN); 4], &[Some(-60.0); 4], 4.0);
        receiver.learn(&[Some(-50.0); 4], &[Some(-60.0); 4], f32::NAN);
        receiver.learn(&[Some(-50.0); 4], &[None; 4], 4.0);
        assert_eq!(receiver, before);
    }

    #[test]
    fn a_receiver_that_is_six_too_loud_is_found_and_one_wild_scan_forgiven() {
        let mut receiver = ReceiverOffset::<f32>::default();
        for scan in 0..200_u16 {
            let noise = f32::from(scan % 5) - 2.0;
            receiver.learn(
                &[Some(-54.0 + noise), Some(-64.0 - noise), Some(-74.0)],
                &[Some(-60.0), Some(-70.0), Some(-80.0)],
                4.0,
            );
        }
        assert!((receiver.offset() - 6.0).abs() < 0.1 && receiver.deviation() < 0.5, "{receiver:?}");
        receiver.learn(&[Some(-1.0); 3], &[Some(-100.0); 3], 4.0);
        assert!((receiver.offset() - 6.0).abs() < 0.5, "{receiver:?}");
    }
}
