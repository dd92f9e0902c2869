//! `baliza survey`: what is measured on the spot, with a person.

mod fingerprints;

super::commands! {
    /// Surveys: a person is led from point to point
    enum Arguments {
        Fingerprints(fingerprints),
    }
}
