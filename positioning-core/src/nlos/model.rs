//! A trained classifier as bytes: a desktop writes it and a node reads it from its flash.
//!
//! Layout: that of [`crate::stored`], with the letters `NL`: the [`Kind`] and its [`Platt`]. Several models follow
//! each other without a gap. A model borrows the bytes from which it was read, so weights are not copied.

use serde::{Deserialize, Serialize};

use super::{
    Classifier, Feature, Features, Logistic, Nearest, Perceptron, Platt, PowerDifference, Quantised, Skewness,
};
pub use crate::stored::StoredError;
use crate::stored::{self, Content, Stored};

/// The version of the layout. A reader accepts no other version.
pub const VERSION: u8 = 1;

/// A classifier. N and P are the types of the two kinds that are too large for a node. The order is that of stored
/// models: add new ones at the end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "there is no heap to box the small perceptron on")]
pub enum Kind<N, P> {
    /// The likelihood ratio of the skewness.
    Skewness(Skewness),
    /// The chip maker's rule.
    PowerDifference(PowerDifference),
    /// Logistic regression.
    Logistic(Logistic),
    /// The k nearest neighbours.
    Nearest(N),
    /// A perceptron.
    Perceptron(P),
    /// A perceptron in 8-bit integers.
    Quantised(Quantised),
}

/// A classifier and its calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trained<N, P> {
    /// The classifier.
    pub kind: Kind<N, P>,
    /// The conversion of its score to a probability.
    pub calibration: Platt,
}

/// Any trained classifier.
pub type Model<'a> = Trained<Nearest<'a>, Perceptron<'a>>;
/// A trained classifier on a node: without the large kinds, which would take 3 kB of its image. It is stored in the
/// same way.
pub type NodeModel = Trained<LeftOut, LeftOut>;

/// A classifier that is left out: the type has no values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum LeftOut {}

impl Classifier for LeftOut {
    fn name(&self) -> &'static str {
        match *self {}
    }

    fn for_each_feature(&self, _: &mut dyn FnMut(Feature)) {
        match *self {}
    }

    fn nlos_probability(&self, _: &Features) -> Option<f32> {
        match *self {}
    }

    fn is_sane(&self) -> bool {
        match *self {}
    }
}

impl<N: Classifier, P: Classifier> Kind<N, P> {
    fn classifier(&self) -> &dyn Classifier {
        match self {
            Self::Skewness(kind) => kind,
            Self::PowerDifference(kind) => kind,
            Self::Logistic(kind) => kind,
            Self::Nearest(kind) => kind,
            Self::Perceptron(kind) => kind,
            Self::Quantised(kind) => kind,
        }
    }
}

impl<'a, N, P> Trained<N, P>
where
    N: Classifier + Serialize + Deserialize<'a>,
    P: Classifier + Serialize + Deserialize<'a>,
{
    /// Writes the model to the beginning of `buffer` and returns those bytes.
    ///
    /// # Errors
    /// The model is invalid, or the buffer is too small.
    pub fn encode<'b>(&self, buffer: &'b mut [u8]) -> Result<&'b [u8], StoredError> {
        stored::encode(self, buffer)
    }

    /// Reads a model from the beginning of `bytes`. Returns the model and the bytes after it.
    ///
    /// # Errors
    /// The bytes are not a model, or the model is not valid.
    pub fn decode(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), StoredError> {
        stored::decode(bytes)
    }
}

impl<N: Classifier + Serialize, P: Classifier + Serialize> Stored for Trained<N, P> {
    const CONTENT: Content = Content { magic: *b"NL", version: VERSION };

    fn is_sane(&self) -> bool {
        Classifier::is_sane(self)
    }
}

impl<N: Classifier, P: Classifier> Classifier for Trained<N, P> {
    fn name(&self) -> &'static str {
        self.kind.classifier().name()
    }

    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        self.kind.classifier().for_each_feature(visit);
    }

    fn nlos_probability(&self, features: &Features) -> Option<f32> {
        self.kind.classifier().nlos_probability(features).map(|p| self.calibration.apply(p))
    }

    fn is_sane(&self) -> bool {
        self.kind.classifier().is_sane() && self.calibration.is_sane()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nlos::{Input, Inputs};
    use crate::stored::{CHECKSUM, HEADER};

    fn skewness() -> Model<'static> {
        let kind = Skewness { feature: Feature::SkewnessNear, los_mean: 1.5, nlos_mean: 1.0, deviation: 0.25 };
        Model { kind: Kind::Skewness(kind), calibration: Platt { slope: 0.5, offset: -1.0 } }
    }

    fn inputs() -> Inputs {
        let input = |feature| Input { feature, mean: 1.0, deviation: 2.0 };
        Inputs([input(Feature::SkewnessNear), input(Feature::PowerDifference)].into_iter().collect())
    }

    #[test]
    fn the_bytes_of_a_model_are_these() {
        // By the postcard specification: variant 0, feature 2, then three f32 and two of the calibration,
        // little-endian. 1.5 = 3FC00000, 1.0 = 3F800000, 0.25 = 3E800000, 0.5 = 3F000000, −1.0 = BF800000. Length 22.
        let mut expected = std::vec![b'N', b'L', 1, 22, 0, 0, 0, 2];
        for bits in [0x3FC0_0000_u32, 0x3F80_0000, 0x3E80_0000, 0x3F00_0000, 0xBF80_0000] {
            expected.extend(bits.to_le_bytes());
        }
        let mut buffer = [0; 64];
        let bytes = skewness().encode(&mut buffer).expect("it fits");
        assert_eq!(bytes.split_last_chunk::<2>().expect("a checksum").0, expected);
    }

    #[test]
    fn every_kind_comes_back_and_several_follow_each_other() {
        let weights: std::vec::Vec<u8> =
            (0..Perceptron::weights_of(2, &[3], 2)).flat_map(|i| (i as f32 * 0.25 - 2.0).to_le_bytes()).collect();
        let quantised = {
            use crate::nlos::quantised::Neuron;
            let neuron = |bias| Neuron::round(bias, &[0.5, -1.0]).expect("two");
            let output = Neuron::round(0.25, &[1.0, -0.5]).expect("two");
            Quantised { inputs: inputs(), hidden: [neuron(0.1), neuron(0.3)].into_iter().collect(), output }
        };
        let kinds = [
            skewness().kind,
            Kind::PowerDifference(PowerDifference::default()),
            Kind::Logistic(Logistic { inputs: inputs(), weights: [0.5, -1.5].into_iter().collect(), intercept: 2.0 }),
            Kind::Nearest(Nearest { inputs: inputs(), neighbours: 2, los: &[1, 0, 2, 0], nlos: &[3, 0, 4, 1] }),
            Kind::Perceptron(Perceptron {
                inputs: inputs(),
                hidden: [3].into_iter().collect(),
                outputs: 2,
                weights: &weights,
            }),
            Kind::Quantised(quantised),
        ];
        let models: std::vec::Vec<_> = kinds.map(|kind| Model { kind, calibration: Platt::NONE }).into_iter().collect();
        let mut file = std::vec::Vec::new();
        for model in &models {
            let mut buffer = [0; 512];
            file.extend_from_slice(model.encode(&mut buffer).expect("it fits"));
        }
        let mut rest = file.as_slice();
        for model in &models {
            let (read, after) = Model::decode(rest).expect("a model");
            assert_eq!(&read, model);
            rest = after;
        }
        assert_eq!(rest, []);
        let mut rest = file.as_slice();
        for model in &models {
            let read = NodeModel::decode(rest);
            let same = match (&model.kind, read.as_ref().map(|(read, _)| &read.kind)) {
                (Kind::Skewness(kind), Ok(Kind::Skewness(read))) => kind == read,
                (Kind::PowerDifference(kind), Ok(Kind::PowerDifference(read))) => kind == read,
                (Kind::Logistic(kind), Ok(Kind::Logistic(read))) => kind == read,
                (Kind::Quantised(kind), Ok(Kind::Quantised(read))) => kind == read,
                (Kind::Nearest(_) | Kind::Perceptron(_), Err(StoredError::Invalid)) => true,
                _ => false,
            };
            assert!(same, "a node takes its own kinds, and refuses the others: {}", model.name());
            rest = Model::decode(rest).expect("a model").1;
        }
        assert_eq!(Model::decode(rest), Err(StoredError::Missing));
    }

    #[test]
    fn a_probability_is_calibrated() {
        let mut features = Features::default();
        features.set(Feature::SkewnessNear, 1.25);
        // On the threshold: logit 0, and σ(−1) = 0.268941.
        let p = skewness().nlos_probability(&features).expect("known");
        assert!((p - 0.268_941).abs() < 1.0e-5, "{p}");
        assert_eq!(skewness().name(), "skewness");
    }

    #[test]
    fn no_single_damaged_byte_passes() {
        let mut buffer = [0; 64];
        let bytes = skewness().encode(&mut buffer).expect("it fits").to_vec();
        for place in 0..bytes.len() {
            for damage in 1..=255 {
                let mut damaged = bytes.clone();
                damaged[place] ^= damage;
                assert!(Model::decode(&damaged).is_err(), "byte {place} ^ {damage}");
            }
            assert!(Model::decode(&bytes[..place]).is_err(), "cut at {place}");
        }
    }

    #[test]
    fn other_versions_are_named() {
        let mut buffer = [0; 64];
        let mut bytes = skewness().encode(&mut buffer).expect("it fits").to_vec();
        bytes[2] = 0;
        assert_eq!(Model::decode(&bytes), Err(StoredError::Version { found: 0, read: 1 }));
        assert_eq!(
            std::format!("{}", StoredError::Version { found: 0, read: 1 }),
            "a model of version 0, where 1 is read"
        );
    }

    #[test]
    fn numbers_that_make_no_classifier_are_refused() {
        let mut buffer = [0; 256];
        let mut encode = |kind| Model { kind, calibration: Platt::NONE }.encode(&mut buffer).map(|_| ());
        assert_eq!(
            encode(Kind::Skewness(Skewness {
                feature: Feature::Skewness,
                los_mean: f32::NAN,
                nlos_mean: 0.0,
                deviation: 1.0
            })),
            Err(StoredError::Invalid)
        );
        let nearest = |neighbours, los| Kind::Nearest(Nearest { inputs: inputs(), neighbours, los, nlos: &[] });
        assert_eq!(encode(nearest(1, &[0; 3])), Err(StoredError::Invalid), "not whole");
        assert_eq!(encode(nearest(2, &[0; 4])), Err(StoredError::Invalid), "fewer than neighbours");
        assert_eq!(encode(nearest(1, &[0; 4])), Ok(()));
        let one_short =
            Perceptron { inputs: inputs(), hidden: [1].into_iter().collect(), outputs: 2, weights: &[0; 24] };
        assert_eq!(encode(Kind::Perceptron(one_short)), Err(StoredError::Invalid));
        assert_eq!(skewness().encode(&mut [0; 20]), Err(StoredError::TooLong));
    }

    #[test]
    fn arbitrary_bytes_with_a_right_checksum_are_no_panic() {
        use rand::{Rng, SeedableRng};
        let mut random = rand_pcg::Pcg32::seed_from_u64(7);
        let mut refused = 0;
        for _ in 0..20_000 {
            let length = random.random_range(0..80_u8);
            let mut bytes = std::vec![b'N', b'L', VERSION, length, 0, 0];
            bytes.extend((0..length).map(|_| random.random::<u8>()));
            // Kinds in range, so that the rest of the bytes is read.
            if let Some(kind) = bytes.get_mut(HEADER) {
                *kind %= 6;
            }
            bytes.extend(CHECKSUM.checksum(&bytes).to_le_bytes());
            match Model::decode(&bytes) {
                Ok((model, _)) => {
                    let mut features = Features::default();
                    Feature::ALL.iter().for_each(|&feature| features.set(feature, 1.0));
                    let p = model.nlos_probability(&features);
                    assert!(p.is_none_or(|p| (0.0..=1.0).contains(&p)), "{model:?}");
                }
                Err(_) => refused += 1,
            }
        }
        assert!(refused > 15_000);
    }
}
