//! A trained classifier as bytes: what a desktop writes and a node reads from its flash.
//!
//! Layout: that of [`crate::stored`], with the letters `NL`: the [`Kind`] and its [`Platt`]. Several models follow each other without
//! gap. Weights stay where they are: a model borrows the bytes it was read from.

use packed::{Packed, Reader, Writer, packed};

use super::{
    Classifier, Feature, Features, Logistic, Nearest, Perceptron, Platt, PowerDifference, Quantised, Skewness,
};
pub use crate::stored::Fault;
use crate::stored::{self, Content, Stored};

/// The version of the layout; a reader takes no other.
pub const VERSION: u8 = 1;

/// A classifier. The numbers are those of stored models: new ones go to the end.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "there is no heap to box the small perceptron on")]
pub enum Kind<'a> {
    /// The likelihood ratio of the skewness.
    Skewness(Skewness),
    /// The difference of powers.
    PowerDifference(PowerDifference),
    /// Logistic regression.
    Logistic(Logistic),
    /// The k nearest neighbours.
    Nearest(Nearest<'a>),
    /// A perceptron.
    Perceptron(Perceptron<'a>),
    /// A perceptron in bytes.
    Quantised(Quantised),
}

/// A classifier that a node holds: the others are too large for it, and would take 3 kB of its image. Stored alike.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a node has one model")]
#[allow(missing_docs, reason = "they are those of `Kind`")]
pub enum NodeKind {
    Skewness(Skewness),
    PowerDifference(PowerDifference),
    Logistic(Logistic),
    Quantised(Quantised),
}

packed!(enum Kind<'a> {
    0 = Skewness(kind), 1 = PowerDifference(kind), 2 = Logistic(kind), 3 = Nearest(kind), 4 = Perceptron(kind), 5 = Quantised(kind)
});
packed!(enum NodeKind { 0 = Skewness(kind), 1 = PowerDifference(kind), 2 = Logistic(kind), 5 = Quantised(kind) });

/// One of several classifiers.
pub trait Choice {
    /// That which was chosen.
    fn classifier(&self) -> &dyn Classifier;

    /// Whether its numbers make a classifier.
    fn is_sane(&self) -> bool;
}

impl Choice for Kind<'_> {
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

    fn is_sane(&self) -> bool {
        match self {
            Self::Skewness(kind) => kind.is_sane(),
            Self::PowerDifference(kind) => kind.is_sane(),
            Self::Logistic(kind) => kind.is_sane(),
            Self::Nearest(kind) => kind.is_sane(),
            Self::Perceptron(kind) => kind.is_sane(),
            Self::Quantised(kind) => kind.is_sane(),
        }
    }
}

impl Choice for NodeKind {
    fn classifier(&self) -> &dyn Classifier {
        match self {
            Self::Skewness(kind) => kind,
            Self::PowerDifference(kind) => kind,
            Self::Logistic(kind) => kind,
            Self::Quantised(kind) => kind,
        }
    }

    fn is_sane(&self) -> bool {
        match self {
            Self::Skewness(kind) => kind.is_sane(),
            Self::PowerDifference(kind) => kind.is_sane(),
            Self::Logistic(kind) => kind.is_sane(),
            Self::Quantised(kind) => kind.is_sane(),
        }
    }
}

/// A classifier and its calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained<K> {
    /// The classifier.
    pub kind: K,
    /// What makes a probability of its score.
    pub calibration: Platt,
}

/// Any classifier, trained.
pub type Model<'a> = Trained<Kind<'a>>;
/// A classifier that a node holds, trained.
pub type NodeModel = Trained<NodeKind>;

impl<'a, K: Packed<'a>> Packed<'a> for Trained<K> {
    fn write(&self, writer: &mut Writer<'_>) {
        let Self { kind, calibration } = self;
        kind.write(writer);
        calibration.write(writer);
    }

    fn read(reader: &mut Reader<'a>) -> Self {
        Self { kind: K::read(reader), calibration: Platt::read(reader) }
    }
}

impl<'a, K: Choice + Packed<'a>> Trained<K> {
    /// Writes the model to the beginning of `buffer` and returns those bytes.
    ///
    /// # Errors
    /// The model is invalid, or the buffer too small.
    pub fn encode<'b>(&self, buffer: &'b mut [u8]) -> Result<&'b [u8], Fault> {
        stored::encode(self, buffer)
    }

    /// Reads a model from the beginning of `bytes`; returns it and what follows.
    ///
    /// # Errors
    /// The bytes are no model, or not one that can be trusted.
    pub fn decode(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), Fault> {
        stored::decode(bytes)
    }
}

impl<K: Choice> Stored for Trained<K> {
    const CONTENT: Content = Content { magic: *b"NL", version: VERSION };

    fn is_sane(&self) -> bool {
        self.kind.is_sane() && self.calibration.is_sane()
    }
}

impl<K: Choice> Classifier for Trained<K> {
    fn name(&self) -> &'static str {
        self.kind.classifier().name()
    }

    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        self.kind.classifier().for_each_feature(visit);
    }

    fn nlos_probability(&self, features: &Features) -> Option<f32> {
        self.kind.classifier().nlos_probability(features).map(|p| self.calibration.apply(p))
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
            let (read, after) =
                NodeModel::decode(rest).map_or((None, None), |(model, after)| (Some(model), Some(after)));
            let same = match (&model.kind, read.map(|read| read.kind)) {
                (Kind::Skewness(kind), Some(NodeKind::Skewness(read))) => *kind == read,
                (Kind::PowerDifference(kind), Some(NodeKind::PowerDifference(read))) => *kind == read,
                (Kind::Logistic(kind), Some(NodeKind::Logistic(read))) => *kind == read,
                (Kind::Quantised(kind), Some(NodeKind::Quantised(read))) => *kind == read,
                (Kind::Nearest(_) | Kind::Perceptron(_), None) => true,
                _ => false,
            };
            assert!(same, "a node takes its own kinds, and refuses the others: {}", model.name());
            rest = after.unwrap_or_else(|| Model::decode(rest).expect("a model").1);
        }
        assert_eq!(Model::decode(rest), Err(Fault::Missing));
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
        assert_eq!(Model::decode(&bytes), Err(Fault::Version { found: 0, read: 1 }));
        assert_eq!(std::format!("{}", Fault::Version { found: 0, read: 1 }), "a model of version 0, where 1 is read");
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
            Err(Fault::Invalid)
        );
        let nearest = |neighbours, los| Kind::Nearest(Nearest { inputs: inputs(), neighbours, los, nlos: &[] });
        assert_eq!(encode(nearest(1, &[0; 3])), Err(Fault::Invalid), "not whole");
        assert_eq!(encode(nearest(2, &[0; 4])), Err(Fault::Invalid), "fewer than neighbours");
        assert_eq!(encode(nearest(1, &[0; 4])), Ok(()));
        let one_short =
            Perceptron { inputs: inputs(), hidden: [1].into_iter().collect(), outputs: 2, weights: &[0; 24] };
        assert_eq!(encode(Kind::Perceptron(one_short)), Err(Fault::Invalid));
        assert_eq!(skewness().encode(&mut [0; 20]), Err(Fault::TooLong));
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
            // Kinds in range, so that what is behind them is read.
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
