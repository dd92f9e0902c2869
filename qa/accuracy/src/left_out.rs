//! The choice of settings without the site on which they are judged.

/// The variation of the settings for one site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The variation that is best at all other sites.
    pub elsewhere: usize,
    /// The variation that is best at the site itself. It is not to be believed: it was chosen in view of its result.
    pub here: usize,
}

/// The choice for each site. `costs[v][s]` is the cost of variation `v` at site `s`, relative to the default, which is
/// variation 0: the mean log error, or minus the mean log evidence. Where two are equal, the first counts.
pub fn choices(costs: &[Vec<f64>]) -> Vec<Choice> {
    let sites = costs.iter().map(Vec::len).min().unwrap_or(0);
    let least = |cost: &dyn Fn(&[f64]) -> f64| {
        let costs = costs.iter().map(|of| cost(of)).enumerate();
        costs.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(variation, _)| variation)
    };
    let elsewhere =
        |site: usize| least(&|of| of.iter().enumerate().filter(|(at, _)| *at != site).map(|(_, cost)| cost).sum());
    (0..sites).map(|site| Choice { elsewhere: elsewhere(site), here: least(&|of| of[site]) }).collect()
}

#[cfg(test)]
mod tests {
    use super::{Choice, choices};

    #[test]
    fn a_site_does_not_choose_its_own_settings() {
        // The second variation is much better at the first site and a little worse at the others. The third is a little
        // better at the second and third site.
        let costs = [vec![0.0, 0.0, 0.0], vec![-0.9, 0.1, 0.1], vec![0.3, -0.1, -0.2]];
        let expected =
            [Choice { elsewhere: 2, here: 1 }, Choice { elsewhere: 1, here: 2 }, Choice { elsewhere: 1, here: 2 }];
        assert_eq!(choices(&costs), expected);
        assert_eq!(choices(&[]), []);
    }
}
