//! What a receiver reads too loud or too soft, alike from all beacons: another telephone than the one that calibrated errs by 0.3 to
//! 0.4 m more in the thesis (tables 4.4 and 4.5). Learnt while positions are found.
//!
//! What each scan says of the offset flows in, with what was known before ([`Posterior`](super::posterior::Posterior), or the RSSI values at a known
//! place); out flows the offset in dB with its deviation. A scalar Kalman filter whose gain the posterior has: one receiver has
//! one offset, that wanders hardly at all.

use crate::Real;

/// What is believed of a receiver before anything is heard, dB.
const PRIOR_DB: f64 = 4.0;
/// By how much an offset wanders, dB² a scan: a hand, a pocket.
const WANDER: f64 = 0.05;
/// An offset that is off by more deviations than this is no more surprising.
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

    /// By how much the receiver's RSSI values are too loud, dB.
    pub fn offset(&self) -> T {
        self.offset
    }

    /// The offset's standard deviation, dB.
    pub fn deviation(&self) -> T {
        self.variance.sqrt()
    }

    /// Takes what a scan says: it is `more` dB louder than is known, of this variance, dB², [`deviation`](Self::deviation) having been known before.
    /// The beacons' shadows stay as long as the tag stays, so that scans count once in some metres of way. What is no number
    /// teaches nothing.
    pub fn learn(&mut self, more: T, variance: T) {
        if !(more.is_finite() && variance > T::ZERO && variance.is_finite()) {
            return;
        }
        // The posterior says v = P R ⁄ (P + R), and K z of an innovation z: gain K = 1 − v ⁄ P, innovations of variance P ⁄ K.
        let gain = T::ONE - variance / self.variance.at_least(T::EPSILON);
        let most = T::of(SURPRISE) * (gain.at_least(T::ZERO) * self.variance).sqrt();
        self.offset += more.at_least(-most).at_most(most);
        self.variance = variance.at_most(self.variance) + T::of(WANDER);
    }

    /// Takes the offset out of an RSSI.
    pub fn correct(&self, rssi: T) -> T {
        rssi - self.offset
    }
}

#[cfg(test)]
mod tests {
    use super::ReceiverOffset;

    #[test]
    fn what_a_scan_says_is_believed_as_far_as_it_is_no_wonder() {
        // Known to 4 dB; a scan of variance 16 beside it halves that: 8 dB², and 6 dB louder than expected moves by 3.
        let mut receiver = ReceiverOffset::<f64>::default();
        receiver.learn(3.0, 8.0);
        assert!((receiver.offset() - 3.0).abs() < 1e-12 && (receiver.deviation() - 8.05_f64.sqrt()).abs() < 1e-12);
        // 60 dB louder would move by 30; a wonder of three deviations is √(16 + 16) · 3 = 16.97 dB, half of which is 8.485.
        let mut receiver = ReceiverOffset::<f64>::default();
        receiver.learn(30.0, 8.0);
        assert!((receiver.offset() - 8.485_281).abs() < 1e-5, "{receiver:?}");
    }

    #[test]
    fn scans_after_each_other_go_to_the_mean() {
        // Scans of variance 4 dB² that all read 6 dB too loud, each with what is known before: K = P ⁄ (P + 4).
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
