//! Root mean square errors that the thesis prints, from its own run of 1,000 points, metres.

use positioning_core::Method;

/// The numbers of detected direct paths in the columns of [`Printed::by_ddp`].
pub const DDP_ANCHORS: std::ops::RangeInclusive<usize> = 3..=9;

/// One method's figures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Printed {
    /// Over all points.
    pub all: f64,
    /// With 3, 4, … 9 detected direct paths of 12.
    pub by_ddp: Option<[f64; 7]>,
}

impl Printed {
    /// The figure over all points (`None`) or for a number of detected direct paths.
    pub fn rmse_m(&self, ddp_anchors: Option<usize>) -> Option<f64> {
        match ddp_anchors {
            None => Some(self.all),
            Some(number) => self.by_ddp?.get(number.checked_sub(*DDP_ANCHORS.start())?).copied(),
        }
    }
}

/// Tables 8-1 (LLS, NLS, bounding box, B-WLS), 8-3 (NLS-CCV), 8-5 (BB-NLS), 8-11 (BB-NLS-R) and 8-13 (B-WLS-R). Over
/// all points: the rows "at least 0 UDP" of tables 8-2, 8-4, 8-6, 8-12 and 8-14, and tables 8-7 and 8-10 for the
/// variants with equal weights (table 8-8 prints 0.3158 for the same BB-NLS-C).
pub fn printed(method: Method) -> Option<Printed> {
    let (all, by_ddp) = match method {
        Method::BoundingBox => (0.4322, Some([0.4939, 0.5127, 0.4354, 0.4405, 0.3859, 0.3682, 0.3901])),
        Method::Lls => (0.7409, Some([0.8979, 0.9116, 0.7943, 0.7095, 0.6728, 0.6059, 0.5599])),
        Method::Nls => (0.5656, Some([0.7097, 0.7014, 0.6125, 0.5404, 0.5018, 0.4678, 0.4053])),
        Method::NlsCcv => (0.1247, Some([0.1505, 0.1415, 0.1289, 0.1172, 0.1202, 0.1056, 0.112])),
        Method::BWls => (0.2379, Some([0.3102, 0.3007, 0.2496, 0.2446, 0.1932, 0.195, 0.1665])),
        Method::BWlsC => (0.2578, None),
        Method::BWlsR => (0.2086, Some([0.3111, 0.2665, 0.2191, 0.2147, 0.1635, 0.1561, 0.1321])),
        Method::BbNls => (0.2305, Some([0.3470, 0.2791, 0.2551, 0.2226, 0.1961, 0.1649, 0.1564])),
        Method::BbNlsC => (0.2578, None),
        Method::BbNlsR => (0.1954, Some([0.3005, 0.2505, 0.2153, 0.1849, 0.1628, 0.1352, 0.1244])),
        Method::Robust => return None,
    };
    Some(Printed { all, by_ddp })
}
