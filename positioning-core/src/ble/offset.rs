//! The offset of a receiver's RSSI, the same for all beacons. In the thesis, a telephone other than the calibrating
//! one errs by 0.3 to 0.4 m more (tables 4.4 and 4.5). The offset is learnt while positions are found.
//!
//! Input: each scan's estimate of the offset, which includes the earlier knowledge
//! ([`Posterior`](super::posterior::Posterior), or the RSSI values at a known position). Output: the offset in dB
//! with its deviation. It is a scalar Kalman filter whose gain the posterior gives: one receiver has one offset,
//! which hardly changes.

use crate::Real;

/// The standard deviation of a receiver's offset before anything is received, dB.
const PRIOR_DB: f64 = 4.0;
/// The growth of the offset's variance, dB² per scan: by a hand, or a pocket.
const WANDER: f64 = 0.05;
/// An innovation of more deviations than this counts as this.
const SURPRISE: f64 = 3.0;

/// The offset of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReceiverOffset<T> {
    offset: T,
    variance: T,
}

impl<T: Real> Default for ReceiverOffset<T> {
    /// A receiver of which nothing is known: its offset from the calibration's receiver has a standard deviation of 4
    /// dB.
    fn default() -> Self {
        Self::new(T::of(PRIOR_DB))
    }
}

impl<T: Real> ReceiverOffset<T> {
    /// A receiver whose offset from the calibration's receiver has the standard deviation `deviation`, dB.
    pub fn new(deviation: T) -> Self {
        Self { offset: T::ZERO, variance: deviation.squared() }
    }

    /// By how much the receiver's RSSI values are too strong, dB.
    pub fn offset(&self) -> T {
        self.offset
    }

    /// The offset's standard deviation, dB.
    pub fn deviation(&self) -> T {
        self.variance.sqrt()
    }

    /// Takes a scan's estimate: the scan is `more` dB stronger than the known offset explains, with the variance
    /// `variance`, dB². [`deviation`](Self::deviation) was the prior of that estimate. The beacons' shadows stay as
    /// long as the tag stays, so scans should be given once in some metres of movement. Values that are not finite
    /// change nothing.
    pub fn learn(&mut self, more: T, variance: T) {
        if !(more.is_finite() && variance > T::ZERO && variance.is_finite()) {
            return;
        }
        // The posterior has the variance v = P R ⁄ (P + R), and the mean K z of an innovation z. The gain is K = 1 −
        // v ⁄ P, the variance of innovations P ⁄ K.
        let gain = T::ONE - variance / self.variance.at_least(T::EPSILON);
        let most = T::of(SURPRISE) * (gain.at_least(T::ZERO) * self.variance).sqrt();
        self.offset += more.at_least(-most).at_most(most);
        self.variance = variance.at_most(self.variance) + T::of(WANDER);
    }

    /// Subtracts the offset from an RSSI.
    pub fn correct(&self, rssi: T) -> T {
        rssi - self.offset
    }
}

#[cfg(test)]
mod tests {
    use super::ReceiverOffset;

    #[test]
    fn what_a_scan_says_is_believed_as_far_as_it_is_no_wonder() {
        // The prior is 4 dB. A scan of variance 16 halves the variance: 8 dB². 6 dB stronger than expected moves the
        // offset by 3.
        let mut receiver = ReceiverOffset::<f64>::default();
        receiver.learn(3.0, 8.0);
        assert!((receiver.offset() - 3.0).abs() < 1e-12 && (receiver.deviation() - 8.05_f64.sqrt()).abs() < 1e-12);
        // 60 dB stronger would move the offset by 30. The limit of three deviations is √(16 + 16) · 3 = 16.97 dB,
        // half of which is 8.485.
        let mut receiver = ReceiverOffset::<f64>::default();
        receiver.learn(30.0, 8.0);
        assert!((receiver.offset() - 8.485_281).abs() < 1e-5, "{receiver:?}");
    }

    #[test]
    fn scans_after_each_other_go_to_the_mean() {
        // Scans of variance 4 dB² that are all 6 dB too strong, each with the prior of the scans before: K = P ⁄ (P +
        // 4).
        let mut receiver = ReceiverOffset::<f32>::default();
        for _ in 0..50 {
            let before = receiver.deviation().powi(2);
            let gain = before / (before + 4.0);
            receiver.learn(gain * (6.0 - receiver.offset()), before - gain * before);
        }
        assert!((receiver.offset() - 6.0).abs() < 0.01 && receiver.deviation() < 0.8, "{receiver:?}");
        assert!((receiver.correct(-54.0) + 60.0).abs() < 0.01);
    }

    #[test]
    fn nonsense_teaches_nothing() {
        let mut receiver = ReceiverOffset::<f32>::default();
        let before = receiver;
        for (more, variance) in [(f32::NAN, 1.0), (1.0, f32::NAN), (f32::INFINITY, 1.0), (1.0, 0.0), (1.0, -1.0)] {
            receiver.learn(more, variance);
        }
        assert_eq!(receiver, before);
    }
}
