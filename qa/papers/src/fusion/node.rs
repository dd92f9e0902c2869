//! Beacons and anchors: what is configured for them, and their state.

use super::window::Window;
use positioning_core::Real;

/// A larger magnitude than this is not a measurement, metres.
const FARTHEST_M: f64 = 1.0e5;
/// Nearer than this a power gives no more information, metres.
const NEAREST_M: f64 = 0.1;
/// ln 10 ⁄ 10.
const PER_DECIBEL: f64 = core::f64::consts::LN_10 / 10.0;

/// How a value relates to the distance, in line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChannelModel<T> {
    /// Received power in dBm: `at_1m` − 10 · `exponent` · log₁₀ d.
    Power {
        /// The power at one metre, dBm.
        at_1m: T,
        /// The path loss exponent n.
        exponent: T,
    },
    /// A delay in any unit, affine in the distance: d = `offset` + `scale` · delay.
    Delay {
        /// The offset, metres.
        offset: T,
        /// The scale, metres a unit of delay.
        scale: T,
    },
}

/// One value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<T> {
    /// The node's number. A node may give both powers and delays.
    pub node: u16,
    /// Its position, metres.
    pub place: [T; 3],
    /// The channel of its values, as well as it is known.
    pub channel: ChannelModel<T>,
    /// The value, in the channel's unit.
    pub value: T,
}

impl<T: Real> ChannelModel<T> {
    /// Delays that are ranges already, metres.
    pub fn range() -> Self {
        Self::Delay { offset: T::ZERO, scale: T::ONE }
    }

    pub(super) fn is_power(&self) -> bool {
        match self {
            Self::Power { .. } => true,
            Self::Delay { .. } => false,
        }
    }

    /// A value in the unit of its kind: dBm, or metres.
    pub(super) fn level(&self, value: T) -> T {
        match *self {
            Self::Power { .. } => value,
            Self::Delay { offset, scale } => offset + scale * value,
        }
    }

    /// The expected value at a squared distance, m².
    #[inline(always)]
    pub(super) fn expected(&self, squared: T) -> T {
        match *self {
            // 10 log₁₀ d = 5 log₁₀ 2 · log₂ d²; its error is less than a hundredth of a decibel.
            Self::Power { at_1m, exponent } => {
                at_1m
                    - exponent
                        * T::of(5.0 * core::f64::consts::LOG10_2)
                        * squared.at_least(T::of(NEAREST_M * NEAREST_M)).log2_about()
            }
            Self::Delay { .. } => squared.sqrt(),
        }
    }

    /// Change of a power with the natural logarithm of the distance, dB.
    pub(super) fn per_neper(&self) -> Option<T> {
        match *self {
            Self::Power { exponent, .. } => Some(exponent * T::of(-10.0 / core::f64::consts::LN_10)),
            Self::Delay { .. } => None,
        }
    }

    /// The distance at which a value is expected, metres; at most [`FARTHEST_M`].
    pub(super) fn distance(&self, level: T) -> T {
        let distance = match *self {
            Self::Power { at_1m, exponent } => (T::of(PER_DECIBEL) * (at_1m - level) / exponent).exp(),
            Self::Delay { .. } => level,
        };
        distance.at_least(T::ZERO).at_most(T::of(FARTHEST_M))
    }

    fn is_sane(&self) -> bool {
        match *self {
            Self::Power { at_1m, exponent } => {
                at_1m.abs() <= T::of(200.0) && exponent > T::of(0.1) && exponent < T::of(20.0)
            }
            Self::Delay { offset, scale } => offset.abs() <= T::of(FARTHEST_M) && scale.is_finite(),
        }
    }
}

impl<T: Real> Observation<T> {
    pub(super) fn is_sane(&self) -> bool {
        let level = self.channel.level(self.value);
        let place = self.place.iter().fold(T::ZERO, |sum, c| sum + c.abs());
        let value = match self.channel {
            // 127 means "unknown", and no receiver reports 0 dBm.
            ChannelModel::Power { .. } => level < T::ZERO && level > T::of(-128.0),
            ChannelModel::Delay { .. } => level.abs() <= T::of(FARTHEST_M),
        };
        value && self.channel.is_sane() && place <= T::of(FARTHEST_M)
    }
}

/// A received node.
#[derive(Clone, Debug)]
pub(super) struct Node<T> {
    pub(super) id: u16,
    pub(super) place: [T; 3],
    pub(super) channel: ChannelModel<T>,
    pub(super) window: Window<T>,
    /// When it was last received.
    pub(super) heard_us: u64,
    /// The index of the state that is its bias.
    pub(super) bias: usize,
    /// For delays, the index of the state that is the slope of the excess.
    pub(super) slope: Option<usize>,
    /// Whether values of it have been used.
    pub(super) known: bool,
}

impl<T: Real> Node<T> {
    pub(super) fn new(observation: &Observation<T>, heard_us: u64, bias: usize, slope: Option<usize>) -> Self {
        Self {
            id: observation.node,
            place: observation.place,
            channel: observation.channel,
            window: Window::new(),
            heard_us,
            bias,
            slope,
            known: false,
        }
    }

    pub(super) fn is(&self, observation: &Observation<T>) -> bool {
        self.id == observation.node && self.channel.is_power() == observation.channel.is_power()
    }

    /// The squared distance to a point, of which the plane's third coordinate is `height`, m².
    #[inline(always)]
    pub(super) fn squared<const D: usize>(&self, point: &[T; D], height: T) -> T {
        let mut sum = if D < 3 { (self.place[2] - height).squared() } else { T::ZERO };
        for (p, a) in point.iter().zip(&self.place) {
            sum += (*p - *a).squared();
        }
        sum
    }
}
