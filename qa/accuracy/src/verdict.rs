//! Whether a change counts.

use super::LogRatio;

/// A change that answers fewer epochs than this share of those before is worse, however small its errors are.
const ANSWERED: f64 = 0.99;
/// Errors of a method that answers less than this share of the epochs are not compared.
pub const LEAST_ANSWERED: f64 = 0.05;

/// The effect of a change at a site.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SiteOutcome {
    /// Better by more than one standard error.
    Better,
    /// Within one standard error.
    Undecided,
    /// Worse by more than one standard error, or positions are missing.
    Worse,
}

/// The verdict over all sites.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct ChangeVerdict {
    /// Number of sites.
    pub sites: usize,
    /// Those that are better.
    pub better: usize,
    /// Those that are worse.
    pub worse: usize,
    /// Whether the change counts: more than half of the sites are better.
    pub counts: bool,
}

/// The effect of a change at a site, by the ratio of its errors and by the shares of epochs with a position, new and
/// old. Where errors cannot be compared, more positions are better.
pub fn outcome(ratio: Option<LogRatio>, [new, old]: [f64; 2]) -> SiteOutcome {
    match ratio {
        _ if new < ANSWERED * old => SiteOutcome::Worse,
        Some(LogRatio { value, deviation }) if value < -deviation => SiteOutcome::Better,
        Some(LogRatio { value, deviation }) if value > deviation => SiteOutcome::Worse,
        None if old < ANSWERED * new => SiteOutcome::Better,
        Some(_) | None => SiteOutcome::Undecided,
    }
}

/// The verdict over sites.
pub fn verdict(outcomes: &[SiteOutcome]) -> ChangeVerdict {
    let count = |which| outcomes.iter().filter(|outcome| **outcome == which).count();
    let (sites, better) = (outcomes.len(), count(SiteOutcome::Better));
    ChangeVerdict { sites, better, worse: count(SiteOutcome::Worse), counts: 2 * better > sites }
}

#[cfg(test)]
mod tests {
    use super::{ChangeVerdict, LogRatio, SiteOutcome, outcome, verdict};

    #[test]
    fn a_site_is_better_beyond_one_standard_error() {
        let of = |value, deviation| outcome(Some(LogRatio { value, deviation }), [1.0, 1.0]);
        assert_eq!(of(-0.11, 0.1), SiteOutcome::Better);
        assert_eq!(of(-0.09, 0.1), SiteOutcome::Undecided);
        assert_eq!(of(0.11, 0.1), SiteOutcome::Worse);
        assert_eq!(of(-0.5, f64::INFINITY), SiteOutcome::Undecided);
        assert_eq!(of(0.0, 0.0), SiteOutcome::Undecided);
    }

    #[test]
    fn missing_positions_are_worse_and_first_ones_better() {
        let halved = Some(LogRatio { value: -0.7, deviation: 0.1 });
        assert_eq!(outcome(halved, [0.9, 1.0]), SiteOutcome::Worse);
        assert_eq!(outcome(halved, [0.995, 1.0]), SiteOutcome::Better);
        assert_eq!(outcome(None, [0.5, 0.001]), SiteOutcome::Better);
        assert_eq!(outcome(None, [0.0, 0.0]), SiteOutcome::Undecided);
        assert_eq!(outcome(None, [0.0, 0.5]), SiteOutcome::Worse);
    }

    #[test]
    fn a_change_counts_if_most_sites_are_better() {
        use SiteOutcome::{Better, Undecided, Worse};
        let of = |outcomes: &[SiteOutcome]| verdict(outcomes);
        assert_eq!(
            of(&[Better, Better, Worse, Undecided]),
            ChangeVerdict { sites: 4, better: 2, worse: 1, counts: false }
        );
        assert!(of(&[Better, Better, Worse]).counts);
        assert!(!of(&[]).counts);
    }
}
