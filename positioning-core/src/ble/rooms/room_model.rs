//! A classifier of rooms as bytes: a desktop writes it and a node reads it from its flash.
//!
//! Layout: that of [`crate::stored`], with the letters `RM`: the [`Kind`]. The names of rooms and beacons stay on the
//! desktop. A node numbers them in the order in which the model was trained.

use serde::{Deserialize, Serialize};

use super::{Classifier, Nearest, Probabilities, Svm};
pub use crate::stored::StoredError;
use crate::stored::{self, Content, Stored};

/// The version of the layout. A reader accepts no other version.
pub const MODEL_VERSION: u8 = 1;

/// A classifier. The order is that of stored models: add new ones at the end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Kind<'a> {
    /// A support vector machine.
    #[serde(borrow)]
    Svm(Svm<'a>),
    /// The k nearest fingerprints.
    Nearest(Nearest<'a>),
}

/// A stored classifier.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Model<'a> {
    /// The classifier.
    #[serde(borrow)]
    pub kind: Kind<'a>,
}

impl<'a> Model<'a> {
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

impl Model<'_> {
    /// The number of beacons of a scan.
    pub fn beacons(&self) -> usize {
        match &self.kind {
            Kind::Svm(kind) => kind.fallback_dbm.len() / 4,
            Kind::Nearest(kind) => kind.fallback.len(),
        }
    }
}

/// A classifier as a node holds it. Of the kinds of [`Model`] it has the support vector machine alone, so that an
/// image has no code for the others. Its bytes are those of the same [`Model`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum NodeModel<'a> {
    /// A support vector machine.
    #[serde(borrow)]
    Svm(Svm<'a>),
}

impl<'a> NodeModel<'a> {
    /// Reads a model from the beginning of `bytes`. Returns the model and the bytes after it.
    ///
    /// # Errors
    /// The bytes are not a model, or the model is not valid. A model of another kind is [`StoredError::Invalid`].
    pub fn decode(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), StoredError> {
        stored::decode(bytes)
    }

    /// The number of beacons of a scan.
    pub fn beacons(&self) -> usize {
        let Self::Svm(svm) = self;
        svm.fallback_dbm.len() / 4
    }
}

impl Stored for NodeModel<'_> {
    const CONTENT: Content = Model::CONTENT;

    fn is_sane(&self) -> bool {
        let Self::Svm(svm) = self;
        svm.is_sane()
    }
}

impl Classifier for NodeModel<'_> {
    type Evidence = [Option<f32>];

    fn rooms(&self) -> usize {
        let Self::Svm(svm) = self;
        svm.rooms()
    }

    fn probabilities(&self, scan: &[Option<f32>]) -> Option<Probabilities> {
        let Self::Svm(svm) = self;
        svm.probabilities(scan)
    }
}

impl Stored for Model<'_> {
    const CONTENT: Content = Content { magic: *b"RM", version: MODEL_VERSION };

    fn is_sane(&self) -> bool {
        match &self.kind {
            Kind::Svm(kind) => kind.is_sane(),
            Kind::Nearest(kind) => kind.is_sane(),
        }
    }
}

impl Classifier for Model<'_> {
    type Evidence = [Option<f32>];

    fn rooms(&self) -> usize {
        match &self.kind {
            Kind::Svm(kind) => kind.rooms(),
            Kind::Nearest(kind) => kind.rooms(),
        }
    }

    fn probabilities(&self, scan: &[Option<f32>]) -> Option<Probabilities> {
        match &self.kind {
            Kind::Svm(kind) => kind.probabilities(scan),
            Kind::Nearest(kind) => kind.probabilities(scan),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;
    use crate::stored::{CHECKSUM, HEADER};

    fn svm(bytes: &[u8]) -> Model<'_> {
        let (fallback_dbm, planes) = bytes.split_at(4);
        Model { kind: Kind::Svm(Svm { rooms: 2, slope: 5.0, fallback_dbm, planes }) }
    }

    fn numbers() -> Vec<u8> {
        [-90.0_f32, 1.5, -0.25].iter().flat_map(|number| number.to_le_bytes()).collect()
    }

    #[test]
    fn the_bytes_of_a_model_are_these() {
        // By the postcard specification: variant 0, two rooms, then 5.0 = 40A00000, four bytes −90.0 = C2B40000 and
        // eight bytes 1.5 = 3FC00000, −0.25 = BE800000, all little-endian. Length 1 + 1 + 4 + 1 + 4 + 1 + 8 = 20.
        let mut expected = std::vec![b'R', b'M', 1, 20, 0, 0, 0, 2];
        expected.extend(0x40A0_0000_u32.to_le_bytes());
        expected.push(4);
        expected.extend(0xC2B4_0000_u32.to_le_bytes());
        expected.push(8);
        expected.extend(0x3FC0_0000_u32.to_le_bytes());
        expected.extend(0xBE80_0000_u32.to_le_bytes());
        let (mut buffer, numbers) = ([0; 64], numbers());
        let bytes = svm(&numbers).encode(&mut buffer).expect("it fits");
        assert_eq!(bytes.split_last_chunk::<2>().expect("a checksum").0, expected);
        assert_eq!(Model::decode(bytes), Ok((svm(&numbers), &[][..])));
    }

    #[test]
    fn a_node_reads_a_machine_and_no_fingerprints() {
        let (mut buffer, numbers) = ([0; 64], numbers());
        let bytes = svm(&numbers).encode(&mut buffer).expect("it fits").to_vec();
        let (node, rest) = NodeModel::decode(&bytes).expect("a machine");
        assert_eq!((node.beacons(), node.rooms(), rest), (1, 2, &[][..]));
        let scan = [Some(-60.0)];
        assert_eq!(node.probabilities(&scan), svm(&numbers).probabilities(&scan));
        let nearest = Nearest { rooms: 2, neighbours: 1, fallback: &[76], fingerprints: &[1, 99] };
        let bytes = Model { kind: Kind::Nearest(nearest) }.encode(&mut buffer).expect("it fits").to_vec();
        assert_eq!(NodeModel::decode(&bytes), Err(StoredError::Invalid));
    }

    #[test]
    fn numbers_that_make_no_classifier_are_refused() {
        let (mut buffer, numbers) = ([0; 64], numbers());
        let mut encode = |kind| Model { kind }.encode(&mut buffer).map(|_| ());
        let Kind::Svm(good) = svm(&numbers).kind else { panic!("it is one") };
        assert_eq!(encode(Kind::Svm(Svm { rooms: 3, ..good })), Err(StoredError::Invalid), "planes are missing");
        assert_eq!(encode(Kind::Svm(Svm { slope: f32::NAN, ..good })), Err(StoredError::Invalid));
        let nearest =
            |neighbours, fingerprints| Kind::Nearest(Nearest { rooms: 2, neighbours, fallback: &[76], fingerprints });
        assert_eq!(encode(nearest(1, &[1, 99])), Ok(()));
        assert_eq!(encode(nearest(1, &[2, 99])), Err(StoredError::Invalid), "a room that is not there");
        assert_eq!(encode(nearest(2, &[1, 99])), Err(StoredError::Invalid), "fewer than neighbours");
        assert_eq!(encode(nearest(1, &[1, 99, 0])), Err(StoredError::Invalid), "not whole");
        assert_eq!(svm(&numbers).encode(&mut [0; 20]), Err(StoredError::TooLong));
    }

    #[test]
    fn no_single_damaged_byte_passes() {
        let (mut buffer, numbers) = ([0; 64], numbers());
        let bytes = svm(&numbers).encode(&mut buffer).expect("it fits").to_vec();
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
    fn changed_bytes_with_a_right_checksum_are_no_panic() {
        use rand::{Rng, SeedableRng};
        let (mut random, mut buffer, numbers) = (rand_pcg::Pcg32::seed_from_u64(7), [0; 64], numbers());
        let nearest = Nearest { rooms: 2, neighbours: 1, fallback: &[76, 70], fingerprints: &[1, 99, 0, 0, 80, 90] };
        let models = [svm(&numbers), Model { kind: Kind::Nearest(nearest) }];
        let whole = models.map(|model| model.encode(&mut buffer).expect("it fits").to_vec());
        let (mut read, mut refused) = (0, 0);
        for round in 0..20_000 {
            let mut bytes = whole[round % 2].clone();
            bytes.truncate(bytes.len() - 2);
            for _ in 0..random.random_range(1..4) {
                let place = random.random_range(HEADER..bytes.len());
                bytes[place] = random.random();
            }
            bytes.extend(CHECKSUM.checksum(&bytes).to_le_bytes());
            match Model::decode(&bytes) {
                Ok((model, _)) => {
                    read += 1;
                    let p = model.probabilities(&[Some(-60.0); 4]);
                    assert!(p.is_none_or(|p| p.iter().all(|p| (0.0..=1.0).contains(p))), "{model:?}");
                }
                Err(_) => refused += 1,
            }
        }
        assert!(read > 1000 && refused > 1000, "{read} {refused}");
    }
}
