//! The choice of settings that leaves a site out.

use accuracy::{Figures, LEAST_ANSWERED, choices};

use super::ranges::track;
use super::results::geometric_mean;
use super::sites::Ranged;
use super::variations::VARIATIONS;

/// The costs of all variations on one recording.
pub struct Tried {
    site: String,
    /// The root mean square error of each variation, metres.
    rmse_m: Vec<f64>,
}

/// Tracks a recording with every variation. `default` has the figures of the first one. `None` where the default has
/// hardly a position. `done` is called after each variation.
pub fn tried(ranged: &Ranged, default: &Figures, done: impl Fn()) -> Option<Tried> {
    let answered = default.fixed as f64 >= LEAST_ANSWERED * default.epochs as f64;
    let default_m = default.rmse_m.filter(|_| answered)?;
    let rmse_m = VARIATIONS.iter().skip(1).map(|(_, change)| {
        let figures = Figures::of(&track(ranged, change));
        done();
        // A variation without positions has no advantage.
        figures.rmse_m.unwrap_or(f64::INFINITY)
    });
    let rmse_m: Vec<f64> = rmse_m.collect();
    Some(Tried { site: ranged.site.clone(), rmse_m: std::iter::once(default_m).chain(rmse_m).collect() })
}

/// The settings chosen for one site.
#[derive(Debug, serde::Serialize)]
pub struct LeftOutSite {
    pub site: String,
    /// The error with the default settings: a geometric mean over the site's recordings, metres.
    pub default_rmse_m: f64,
    /// The variation that is best at all other sites, and its error here.
    pub elsewhere: &'static str,
    pub elsewhere_rmse_m: f64,
    /// The variation that is best here, and its error, which is not to be believed.
    pub here: &'static str,
    pub here_rmse_m: f64,
}

/// A variation over all sites.
#[derive(Debug, serde::Serialize)]
pub struct Varied {
    pub variation: &'static str,
    /// The geometric mean over sites of the error, relative to the default.
    pub ratio: f64,
    /// At how many sites it is better and worse than the default, at all.
    pub better: usize,
    pub worse: usize,
}

/// The variations over all sites, and the choice for each site.
pub fn left_out(tried: &[Tried]) -> (Vec<Varied>, Vec<LeftOutSite>) {
    let mut sites: Vec<&str> = Vec::new();
    for of in tried {
        if !sites.contains(&of.site.as_str()) {
            sites.push(&of.site);
        }
    }
    let error_m = |variation: usize, site: &str| {
        let here = tried.iter().filter(|of| of.site == site);
        geometric_mean(here.filter_map(|of| of.rmse_m.get(variation).copied())).unwrap_or(f64::INFINITY)
    };
    // The cost of a variation: the mean log error relative to the default.
    let cost = |variation: usize, site: &str| (error_m(variation, site) / error_m(0, site)).ln();
    let costs: Vec<Vec<f64>> =
        (0..VARIATIONS.len()).map(|variation| sites.iter().map(|site| cost(variation, site)).collect()).collect();
    let varied = VARIATIONS.iter().zip(&costs).skip(1).map(|((variation, _), costs)| Varied {
        variation,
        ratio: baliza_report::mean(costs.iter().copied()).exp(),
        better: costs.iter().filter(|cost| **cost < 0.0).count(),
        worse: costs.iter().filter(|cost| **cost > 0.0).count(),
    });
    let chosen = choices(&costs);
    let of = |(site, choice): (&&str, &accuracy::Choice)| LeftOutSite {
        site: (*site).to_owned(),
        default_rmse_m: error_m(0, site),
        elsewhere: VARIATIONS[choice.elsewhere].0,
        elsewhere_rmse_m: error_m(choice.elsewhere, site),
        here: VARIATIONS[choice.here].0,
        here_rmse_m: error_m(choice.here, site),
    };
    let varied = if sites.is_empty() { Vec::new() } else { varied.collect() };
    (varied, sites.iter().zip(&chosen).map(of).collect())
}
