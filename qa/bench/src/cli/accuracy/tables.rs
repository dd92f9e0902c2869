//! The tables of the protocol.

use std::fmt::Write as _;

use accuracy::{ChangeVerdict, Excursion, Figures, SiteOutcome, verdict};
use baliza_report::MarkdownTable;

use super::results::{Compared, MethodScore, geometric_mean};
use super::settings::{LeftOutSite, Varied};

/// The methods that recorded ranges go through.
pub const RANGES: [&str; 2] = ["solve", "track"];

/// A row a recording, and a row a group of simulated cases: the figures of solver and track.
pub fn recordings(scores: &[MethodScore]) -> String {
    let titles = ["RMSE (P90), m:", "inside 1σ; NEES; after 1 s:", "longest excursion:"];
    let titles = RANGES.into_iter().flat_map(|method| titles.map(|title| format!("`{method}`: {title}")));
    let mut table = MarkdownTable::new(["recording", "epochs:"].map(str::to_owned).into_iter().chain(titles));
    for (name, of_method) in rows(scores) {
        let [Some(first), _] = &of_method else { continue };
        let cells = of_method.iter().map(|figures| figures.as_ref().map_or_else(|| " |  | ".to_owned(), cells));
        let epochs = first.iter().map(|figures| figures.epochs).sum::<usize>();
        table.row(format_args!("{name} | {epochs} | {}", cells.collect::<Vec<_>>().join(" | ")));
    }
    table.into_text()
}

type Row<'s> = (String, [Option<Vec<&'s Figures>>; 2]);

/// Rows in the order of the scores: the figures of both methods on one recording or on a group of cases.
fn rows(scores: &[MethodScore]) -> Vec<Row<'_>> {
    let mut rows: Vec<Row<'_>> = Vec::new();
    for score in scores {
        let Some(method) = RANGES.iter().position(|method| *method == score.method) else { continue };
        let name = if score.simulated { &score.site } else { &score.recording };
        let at = rows.iter().position(|(row, _)| row == name).unwrap_or_else(|| {
            rows.push((name.clone(), [None, None]));
            rows.len() - 1
        });
        rows[at].1[method].get_or_insert_default().push(&score.figures);
    }
    rows
}

/// Three cells: errors, consistency and excursion; geometric means over several cases.
fn cells(figures: &Vec<&Figures>) -> String {
    let mean = |of: fn(&Figures) -> Option<f64>| geometric_mean(figures.iter().filter_map(|figures| of(figures)));
    let number = |value: Option<f64>, digits: usize| value.map_or_else(|| "–".to_owned(), |v| format!("{v:.digits$}"));
    let [epochs, fixed] = [|of: &Figures| of.epochs, |of: &Figures| of.fixed]
        .map(|of: fn(&Figures) -> usize| figures.iter().map(|figures| of(figures)).sum::<usize>());
    if fixed == 0 {
        return "no position |  | ".to_owned();
    }
    let missing = match 100.0 * (epochs - fixed) as f64 / epochs.max(1) as f64 {
        share if share < 0.05 => String::new(),
        share => format!(", {share:.1} % without"),
    };
    let inside = baliza_report::mean(figures.iter().filter_map(|figures| figures.inside_1_sigma));
    let excursion = figures.iter().filter_map(|figures| figures.excursion).max_by_key(|excursion| excursion.epochs);
    let excursion = excursion
        .map_or_else(|| "–".to_owned(), |Excursion { epochs, worst_m }| format!("{epochs} epochs, {worst_m:.1} m"));
    format!(
        "{} ({}){missing} | {:.0} %; {}; {} | {excursion}",
        number(mean(|of| of.rmse_m), 3),
        number(mean(|of| of.p90_m), 3),
        100.0 * inside,
        number(mean(|of| of.nees), 1),
        number(mean(|of| of.nees_settled), 1),
    )
}

/// A row a recording of beacons, with all methods.
pub fn beacons(scores: &[MethodScore], methods: &[String]) -> String {
    let titles = methods.iter().map(|method| format!("`{method}`: MAE (RMSE), m; NEES:"));
    let titles = ["recording", "epochs:"].map(str::to_owned).into_iter().chain(titles);
    let mut table = MarkdownTable::new(titles);
    let first = methods.first();
    for score in scores.iter().filter(|score| Some(&score.method) == first) {
        let cell = |method: &String| {
            let same = |other: &&MethodScore| {
                [&other.site, &other.recording, &other.method] == [&score.site, &score.recording, method]
            };
            scores.iter().find(same).map_or_else(String::new, |score| {
                let metres = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |metres| format!("{metres:.2}"));
                let Figures { mae_m, rmse_m, nees, .. } = score.figures;
                format!("{} ({}); {}", metres(mae_m), metres(rmse_m), metres(nees))
            })
        };
        let name = if score.site == score.recording {
            score.site.clone()
        } else {
            format!("{}, {}", score.site, score.recording)
        };
        let cells = methods.iter().map(cell).collect::<Vec<_>>().join(" | ");
        table.row(format_args!("{name} | {} | {cells}", score.figures.epochs));
    }
    table.into_text()
}

/// A row a site: one error over the other.
pub fn comparison(compared: &[Compared], [new, old]: [&str; 2]) -> String {
    let titles = [format!("{old}, m:"), format!("{new}, m:"), format!("{new} ÷ {old}:")];
    let titles = ["site", "method"].map(str::to_owned).into_iter().chain(titles);
    let mut table = MarkdownTable::new(titles.chain(["standard error:", ""].map(str::to_owned)));
    for Compared { site, method, errors_m, ratio, outcome, .. } in compared {
        let metres = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |metres| format!("{metres:.3}"));
        let [ratio, error] = ratio.map_or_else(Default::default, |ratio| {
            let error = if ratio.deviation.is_finite() {
                format!("{:.1} %", 100.0 * ratio.deviation)
            } else {
                "–".to_owned()
            };
            [format!("{:.3}", ratio.value.exp()), error]
        });
        let outcome = word(*outcome);
        let [first, second] = [metres(errors_m[1]), metres(errors_m[0])];
        table.row(format_args!("{site} | `{method}` | {first} | {second} | {ratio} | {error} | {outcome}"));
    }
    table.into_text()
}

fn word(outcome: SiteOutcome) -> &'static str {
    match outcome {
        SiteOutcome::Better => "better",
        SiteOutcome::Undecided => "",
        SiteOutcome::Worse => "worse",
    }
}

/// The verdict on each method, over all sites and over the recorded ones.
pub fn verdicts(compared: &[Compared]) -> Vec<(String, [ChangeVerdict; 2])> {
    let mut methods: Vec<&str> = Vec::new();
    for of in compared {
        if !methods.contains(&of.method.as_str()) {
            methods.push(&of.method);
        }
    }
    let over = |method: &str, with_simulated: bool| {
        let sites = compared.iter().filter(|of| of.method == method && (with_simulated || !of.simulated));
        verdict(&sites.map(|of| of.outcome).collect::<Vec<_>>())
    };
    methods.into_iter().map(|method| (method.to_owned(), [over(method, true), over(method, false)])).collect()
}

/// The verdicts as text.
pub fn verdict_lines(verdicts: &[(String, [ChangeVerdict; 2])]) -> String {
    let mut text = String::new();
    for (method, [all, recorded]) in verdicts {
        let counts = if all.counts { "the change counts" } else { "the change does not count" };
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "`{method}`: better at {} of {} sites (beyond one standard error), worse at {}; of {} recorded ones better at \
             {}, worse at {}: {counts}.",
            all.better, all.sites, all.worse, recorded.sites, recorded.better, recorded.worse
        );
    }
    text
}

/// A row a variation of the settings, and a row a site: the settings chosen without it.
pub fn settings(varied: &[Varied], left_out: &[LeftOutSite]) -> String {
    let mut variations = MarkdownTable::new(["settings", "RMSE ÷ default:", "sites better:", "worse:"]);
    for Varied { variation, ratio, better, worse } in varied {
        variations.row(format_args!("{variation} | {ratio:.3} | {better} | {worse}"));
    }
    let titles = [
        "site left out",
        "default, m:",
        "best elsewhere",
        "RMSE here, m:",
        "best here",
        "RMSE, not to be believed, m:",
    ];
    let mut table = MarkdownTable::new(titles);
    for LeftOutSite { site, default_rmse_m, elsewhere, elsewhere_rmse_m, here, here_rmse_m } in left_out {
        table.row(format_args!(
            "{site} | {default_rmse_m:.3} | {elsewhere} | {elsewhere_rmse_m:.3} | {here} | ({here_rmse_m:.3})"
        ));
    }
    let better = left_out.iter().filter(|of| of.elsewhere_rmse_m < of.default_rmse_m).count();
    let sites = left_out.len();
    let (variations, table) = (variations.into_text(), table.into_text());
    format!(
        "{variations}\n{table}\nThe settings chosen at other sites are better than the default at {better} of {sites} sites.\n"
    )
}

#[cfg(test)]
mod tests {
    use accuracy::{LogRatio, SiteOutcome};

    use super::{Compared, comparison, verdict_lines, verdicts};

    fn compared(site: &str, simulated: bool, outcome: SiteOutcome) -> Compared {
        let ratio = Some(LogRatio { value: 0.5_f64.ln(), deviation: 0.05 });
        Compared {
            site: site.into(),
            simulated,
            method: "track".into(),
            errors_m: [Some(0.1), Some(0.2)],
            ratio,
            outcome,
        }
    }

    #[test]
    fn the_verdict_says_at_how_many_sites_a_change_is_better() {
        let compared = [
            compared("here", false, SiteOutcome::Better),
            compared("there", false, SiteOutcome::Worse),
            compared("drawn", true, SiteOutcome::Better),
        ];
        let expected = "`track`: better at 2 of 3 sites (beyond one standard error), worse at 1; of 2 recorded ones better at \
                        1, worse at 1: the change counts.\n";
        assert_eq!(verdict_lines(&verdicts(&compared)), expected);
        let table = comparison(&compared, ["new", "old"]);
        assert_eq!(table.lines().nth(2), Some("| here | `track` | 0.200 | 0.100 | 0.500 | 5.0 % | better |"));
    }
}
