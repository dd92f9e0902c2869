//! Selects one classifier from a file of them, for a track, a simulation or a node.

use std::path::{Path, PathBuf};

use positioning_core::nlos::{Classifier, Model};

use super::{features_of, models};
use recording::UserError;
use recording::{DOCUMENT_BYTES, read_limited};

/// A selected model.
#[derive(Clone, Debug)]
pub struct Chosen {
    file: PathBuf,
    bytes: Vec<u8>,
}

impl Chosen {
    /// The classifier of this name in the file, of several `NAME:1`, `NAME:2`; without a name, the only one.
    ///
    /// # Errors
    /// The file cannot be read, is no file of models, has none of this name, or several where none is named.
    pub fn read(file: &Path, name: Option<&str>) -> Result<Self, UserError> {
        let all = read_limited(file, DOCUMENT_BYTES)?;
        Self::of(file, &all, name)
    }

    /// The same for the bytes of a file.
    ///
    /// # Errors
    /// As for [`read`](Self::read).
    pub fn of(file: &Path, all: &[u8], name: Option<&str>) -> Result<Self, UserError> {
        let models = models(all).map_err(|fault| UserError::file(file, fault.to_string()))?;
        let names = numbered(&models);
        let index = match name {
            Some(name) => names.iter().position(|known| known == name),
            None if models.len() == 1 => Some(0),
            None => None,
        };
        let Some(index) = index else {
            let named = names.iter().zip(&models).map(|(name, model)| format!("{name} ({})", features_of(model)));
            let named: Vec<String> = named.collect();
            let what = match name {
                Some(name) if models.iter().any(|model| model.name() == name) => {
                    format!("it has several classifiers {name}; name one of {}", named.join(", "))
                }
                Some(name) => format!("it has no classifier {name}; it has {}", named.join(", ")),
                None => format!("it has several classifiers, name one of {}", named.join(", ")),
            };
            return Err(UserError::file(file, what));
        };
        // The models follow each other without a gap: the bytes of a model are those that its successor does not
        // have.
        let rest = |count: usize| {
            (0..count).try_fold(all, |bytes, _| Model::decode(bytes).map(|(_, rest)| rest)).unwrap_or_default()
        };
        let (from, to) = (all.len() - rest(index).len(), all.len() - rest(index + 1).len());
        Ok(Self { file: file.to_owned(), bytes: all[from..to].to_vec() })
    }

    /// The classifier.
    ///
    /// # Errors
    /// None in practice, because the model has been read before.
    pub fn model(&self) -> Result<Model<'_>, UserError> {
        match Model::decode(&self.bytes) {
            Ok((model, _)) => Ok(model),
            Err(fault) => Err(UserError::file(&self.file, fault.to_string())),
        }
    }

    /// Its bytes, as a node reads them.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// The names of a file's models. Those of one name are numbered in their order: `logistic:1`, `logistic:2`.
fn numbered(models: &[Model<'_>]) -> Vec<String> {
    let number = |at: usize, model: &Model<'_>| {
        let alike = |models: &[Model<'_>]| models.iter().filter(|other| other.name() == model.name()).count();
        if alike(models) == 1 { model.name().to_owned() } else { format!("{}:{}", model.name(), alike(&models[..=at])) }
    };
    models.iter().enumerate().map(|(at, model)| number(at, model)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use positioning_core::nlos::{Kind, Platt, PowerDifference, Skewness};

    fn file() -> Vec<u8> {
        let kinds = [Kind::PowerDifference(PowerDifference::default()), Kind::Skewness(Skewness::default())];
        let encoded = kinds.map(|kind| {
            let mut buffer = [0; 64];
            Model { kind, calibration: Platt::NONE }.encode(&mut buffer).expect("it fits").to_vec()
        });
        encoded.concat()
    }

    #[test]
    fn a_classifier_is_chosen_by_its_name() {
        let all = file();
        let chosen = Chosen::of("x".as_ref(), &all, Some("skewness")).expect("it is there");
        assert_eq!(chosen.model().expect("whole").name(), "skewness");
        // Header 6, kind and feature 1 each, five numbers 4 each, checksum 2: the last 30 bytes.
        assert_eq!(chosen.bytes(), &all[all.len() - 30..]);
        let only = Chosen::of("x".as_ref(), chosen.bytes(), None).expect("there is one");
        assert_eq!(only.bytes(), chosen.bytes());
    }

    #[test]
    fn what_is_not_there_or_not_said_is_named() {
        let said = |name| Chosen::of("x".as_ref(), &file(), name).expect_err("it is not there").to_string();
        let both = "power-difference (power_difference_db), skewness (skewness_near)";
        assert_eq!(said(Some("logistic")), format!("x: it has no classifier logistic; it has {both}"));
        assert_eq!(said(None), format!("x: it has several classifiers, name one of {both}"));
        let twice = [file(), file()].concat();
        let of_two = |name| Chosen::of("x".as_ref(), &twice, Some(name));
        let said = of_two("skewness").expect_err("there are two").to_string();
        assert!(said.starts_with("x: it has several classifiers skewness; name one of power-difference:1 ("), "{said}");
        assert_eq!(of_two("skewness:2").expect("the second").bytes(), of_two("skewness:1").expect("the first").bytes());
        assert!(of_two("skewness:3").is_err());
        let none = Chosen::of("x".as_ref(), b"BLZR", None).expect_err("no model").to_string();
        assert_eq!(none, "x: not a model");
    }
}
