//! `baliza survey`: measurements on site, with a person.

mod fingerprints;

super::commands! {
    /// Surveys: a person is led from point to point
    pub enum Arguments {
        Fingerprints(fingerprints),
    }
}
