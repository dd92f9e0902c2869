//! How scans are compared with a survey: names and options. The thesis is that of A. Linde Cerezo (Universitat Oberta
//! de Catalunya, 2024).

use positioning_core::ble::fingerprint::MAX_NEIGHBOURS;

/// How a scan is compared with a survey.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Comparison {
    /// With the K nearest points (equation 7 of the thesis).
    Nearest {
        /// K, 1 to [`MAX_NEIGHBOURS`].
        k: usize,
        /// Weighted by the inverse square of their distances, or all alike.
        weighted: bool,
    },
    /// With a Gaussian process on a lattice, each scan by itself.
    Process,
    /// With the same process, from scan to scan.
    Walk,
}

impl Comparison {
    /// The neighbours of the thesis, weighted and plain, and both uses of the process.
    pub fn all() -> Vec<Self> {
        let nearest = [true, false].into_iter().flat_map(|weighted| [3, 4, 5].map(|k| Self::Nearest { k, weighted }));
        nearest.chain([Self::Process, Self::Walk]).collect()
    }

    /// Its name; those of neighbours are the names in the thesis (table 4.4).
    pub fn name(self) -> String {
        match self {
            Self::Nearest { k, weighted: true } => format!("w{k}nn"),
            Self::Nearest { k, weighted: false } => format!("{k}nn"),
            Self::Process => "gp".to_owned(),
            Self::Walk => "gp-walk".to_owned(),
        }
    }

    /// K, where there is one.
    pub fn k(self) -> Option<usize> {
        match self {
            Self::Nearest { k, .. } => Some(k.clamp(1, MAX_NEIGHBOURS)),
            Self::Process | Self::Walk => None,
        }
    }

    /// Whether it reads the lattice of a process, or the surveyed points.
    pub fn wants_lattice(self) -> bool {
        match self {
            Self::Nearest { .. } => false,
            Self::Process | Self::Walk => true,
        }
    }
}
