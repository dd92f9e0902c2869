//! The methods by name, and one function to call any of them.

use crate::{Constraints, Fix, RangeSample, Real, SolveError};

/// How ranges become a position. The names are those of the command line and of the thesis they come from
/// (P. M. de Rojas Malpartida, *Evaluación de un sistema UWB frente a medidas sin línea de visión directa*, 2021).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Method {
    /// Centre of the intersection of the squares around the anchors (6-3, 6-4).
    BoundingBox,
    /// Linear least squares about the reference anchor (6-8 to 6-10).
    Lls,
    /// Nonlinear least squares (6-5).
    Nls,
    /// Nonlinear least squares that knows which ranges are blocked (6-17): an oracle.
    NlsCcv,
    /// Linear least squares weighted by the bounding box (6-12 to 6-16).
    BWls,
    /// B-WLS with equal weights for the ranges classified as direct (6.2.2.2).
    BWlsC,
    /// B-WLS repeated with the weights of its own result (6.2.3.2, 6-21).
    BWlsR,
    /// Nonlinear least squares weighted by the bounding box (6-18, 6-19).
    BbNls,
    /// BB-NLS with equal weights for the ranges classified as direct (6-20).
    BbNlsC,
    /// Nonlinear least squares weighted by B-WLS (6-21).
    BbNlsR,
    /// Posterior mean under a mixture of direct and blocked ranges: the default.
    Robust,
}

impl Method {
    /// Every method, in the order of the documents.
    pub const ALL: [Self; 11] = [
        Self::BoundingBox,
        Self::Lls,
        Self::Nls,
        Self::NlsCcv,
        Self::BWls,
        Self::BWlsC,
        Self::BWlsR,
        Self::BbNls,
        Self::BbNlsC,
        Self::BbNlsR,
        Self::Robust,
    ];

    /// The name on the command line and in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::BoundingBox => "bounding-box",
            Self::Lls => "lls",
            Self::Nls => "nls",
            Self::NlsCcv => "nls-ccv",
            Self::BWls => "b-wls",
            Self::BWlsC => "b-wls-c",
            Self::BWlsR => "b-wls-r",
            Self::BbNls => "bb-nls",
            Self::BbNlsC => "bb-nls-c",
            Self::BbNlsR => "bb-nls-r",
            Self::Robust => "robust",
        }
    }

    /// Whether the method reads the ground truth in [`RangeSample::los`].
    pub fn is_oracle(self) -> bool {
        self == Self::NlsCcv
    }
}

impl core::fmt::Display for Method {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.as_str())
    }
}

impl core::str::FromStr for Method {
    type Err = UnknownMethod;

    fn from_str(name: &str) -> Result<Self, UnknownMethod> {
        Self::ALL.into_iter().find(|method| method.as_str() == name).ok_or(UnknownMethod)
    }
}

/// The name is not one of [`Method::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnknownMethod;

impl core::fmt::Display for UnknownMethod {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("unknown method; one of")?;
        Method::ALL.iter().try_for_each(|method| write!(f, " {method}"))
    }
}

impl core::error::Error for UnknownMethod {}

/// A method as a function of samples and constraints.
pub type Solver<T, const D: usize> = fn(&[RangeSample<T, D>], &Constraints<T, D>) -> Result<Fix<T, D>, SolveError>;

impl Method {
    /// The method's function.
    pub fn solver<T: Real, const D: usize>(self) -> Solver<T, D> {
        match self {
            Self::BoundingBox => crate::bounding_box,
            Self::Lls => crate::lls,
            Self::Nls => crate::nls,
            Self::NlsCcv => crate::nls_ccv,
            Self::BWls => crate::b_wls,
            Self::BWlsC => crate::b_wls_c,
            Self::BWlsR => crate::b_wls_r,
            Self::BbNls => crate::bb_nls,
            Self::BbNlsC => crate::bb_nls_c,
            Self::BbNlsR => crate::bb_nls_r,
            Self::Robust => crate::robust,
        }
    }
}

/// The position that explains `samples` (in any order) best by `method`. It does not panic on any input.
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn solve<T: Real, const D: usize>(
    method: Method,
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    method.solver()(samples, constraints)
}
