//! The file of a room model: first the bytes that a node reads, then the names of the model's rooms and beacons, for
//! people and for provisioning.
//!
//! The names are one line of JSON, `{"beacons":["1","2"],"rooms":["hall","attic"]}`, in the model's order.

use positioning_core::ble::rooms::{Classifier, Model, StoredError};
use serde::{Deserialize, Serialize};

/// The names of a model's rooms and beacons.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Names {
    /// The beacons, in the order of its scans.
    pub beacons: Vec<String>,
    /// The rooms, in the order of its probabilities.
    pub rooms: Vec<String>,
}

/// A model with its names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelFile {
    /// The model alone, in the format of the node.
    pub model: Vec<u8>,
    /// The names of its rooms and beacons.
    pub names: Names,
}

impl ModelFile {
    /// Parses a file's bytes.
    ///
    /// # Errors
    /// The bytes are no model, or its names are missing, too few or too many; the error is a text.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let (model, rest) = Model::decode(bytes).map_err(|fault: StoredError| fault.to_string())?;
        let names: Names = serde_json::from_slice(rest)
            .map_err(|_| "a model without names of beacons and rooms: make it again by `baliza ble rooms --out`")?;
        if (names.beacons.len(), names.rooms.len()) != (model.beacons(), model.rooms()) {
            return Err("a model with names of other beacons or rooms".to_owned());
        }
        let model = bytes.get(..bytes.len() - rest.len()).unwrap_or(bytes).to_vec();
        Ok(Self { model, names })
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// The names cannot be written as JSON, which no names cause.
    pub fn bytes(&self) -> serde_json::Result<Vec<u8>> {
        let mut bytes = self.model.clone();
        serde_json::to_writer(&mut bytes, &self.names)?;
        bytes.push(b'\n');
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use positioning_core::ble::rooms::{Kind, Nearest};

    fn file(beacons: &[&str], rooms: &[&str]) -> ModelFile {
        let kind = Kind::Nearest(Nearest { rooms: 2, neighbours: 1, fallback: &[76, 70], fingerprints: &[1, 99, 0] });
        let mut buffer = [0; 64];
        let model = Model { kind }.encode(&mut buffer).expect("it fits").to_vec();
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        ModelFile { model, names: Names { beacons: owned(beacons), rooms: owned(rooms) } }
    }

    #[test]
    fn names_go_with_their_model() {
        let whole = file(&["1-7", "a,b"], &["hall", "\"attic\""]);
        let bytes = whole.bytes().expect("JSON");
        assert_eq!(ModelFile::parse(&bytes), Ok(whole.clone()));
        let said = |bytes: &[u8]| ModelFile::parse(bytes).expect_err("it is wrong");
        assert_eq!(said(b"hello"), "not a model");
        assert!(said(&whole.model).starts_with("a model without names"));
        assert!(said(&bytes[..bytes.len() - 3]).starts_with("a model without names"));
        let other = file(&["1"], &["hall", "attic"]).bytes().expect("JSON");
        assert_eq!(said(&other), "a model with names of other beacons or rooms");
    }
}
