//! `baliza bench accuracy`: the protocol by which a change of solver, track, fingerprints or settings is accepted
//! (`qa/accuracy/README.md`).
//!
//! Recorded sites and groups of simulated cases go through the code of `baliza solve`, `track` and `ble fingerprint`.
//! The output are figures, the comparison with an earlier run, and settings that are chosen without the site on which
//! they are judged.

mod beacons;
mod ranges;
mod results;
mod settings;
pub(super) mod sites;
mod tables;
mod variations;

use std::path::{Path, PathBuf};

use accuracy::prior::{self, Case, Group};
use accuracy::{ChangeVerdict, Figures, Measure};
use anyhow::{Context, Result};
use recording::UserError;
use recording::output;

use host_tools::cli::progress::Progress;
use results::{Compared, Earlier, MethodScore, Pair};
use settings::{LeftOutSite, Tried, Varied};
use sites::Ranged;
use variations::VARIATIONS;

/// With --quick this number of cases of each group, and no variations of settings.
const QUICK: usize = 2;

/// Solver, track and fingerprints over all recordings and a simulated set; the comparison of two versions
///
/// Each version writes its errors with --out; --against compares them with those of an earlier one: the ratio of
/// errors at each site, its standard error by blocks of five seconds, and at how many sites the new version is better.
/// Settings of the engine are varied: for each site the variation is chosen that is best at all other sites.
///
/// As JSON: an object with recordings (site, recording, method, offset_s, epochs, fixed, rmse_m, mae_m, p90_m,
/// inside_1_sigma, nees, nees_settled, excursion), variations (variation, ratio, better, worse), settings (site,
/// default_rmse_m, elsewhere, elsewhere_rmse_m, here, here_rmse_m), track_to_solve and comparison (site, method, new_m,
/// old_m, log_ratio, standard_error, outcome), and verdicts (method, sites, better, worse, counts).
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench accuracy --data ../shared/data --out before.csv\n  \
                        baliza bench accuracy --data ../shared/data --against before.csv\n  \
                        baliza bench accuracy --quick\n  baliza bench accuracy --write-prior cases")]
pub struct Arguments {
    /// The folder of recordings; without it, only the simulated set
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Write the errors of each block here
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Compare with the errors that an earlier version wrote with --out
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Two simulated cases of each group, and no variations of settings
    #[arg(long)]
    quick: bool,
    /// Only write the cases of the simulated set into this folder, a recording each, and cases.csv, a list of their
    /// conditions
    #[arg(long, value_name = "DIR", conflicts_with_all = ["data", "out", "against", "quick", "json"])]
    write_prior: Option<PathBuf>,
    /// Cases of the simulated set; groups take turns
    #[arg(long, default_value_t = prior::CASES as u32, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    cases: u32,
    /// Seed of the simulated set
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON: results has one object, with a list a table
    #[arg(long)]
    json: bool,
}

/// Runs `baliza bench accuracy`.
///
/// # Errors
/// A file cannot be read or written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let count = if arguments.quick { QUICK * Group::ALL.len() } else { arguments.cases as usize };
    let cases = (0..count).map(|number| prior::draw(number, arguments.seed));
    if let Some(folder) = &arguments.write_prior {
        return write_prior(folder, &cases.collect::<Vec<_>>());
    }
    if let Some(file) = &arguments.out {
        output::check("--out", file)?;
    }
    if let Some(folder) = arguments.data.as_ref().filter(|folder| !folder.is_dir()) {
        return Err(UserError::flag("--data", format!("the folder {} does not exist", folder.display())).into());
    }
    let earlier = arguments.against.as_deref().map(Earlier::read).transpose()?;
    let mut ranged = arguments.data.as_deref().map(sites::recorded).transpose()?.unwrap_or_default();
    ranged.extend(cases.map(|case| sites::simulated(&case, arguments.seed)));
    let results = Results::of(arguments, ranged, earlier.as_ref())?;
    if let Some(file) = &arguments.out {
        host_tools::cli::write(file, results::to_csv(&results.scores).as_bytes())?;
    }
    if arguments.json {
        host_tools::cli::print_json(&results.document(earlier.as_ref()))
    } else {
        host_tools::cli::print(results.tables(earlier.as_ref()).as_bytes())
    }
}

fn write_prior(folder: &Path, cases: &[Case]) -> Result<()> {
    let make =
        |folder: &Path| std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()));
    for case in cases {
        let folder = folder.join(case.name());
        make(&folder)?;
        for (name, text) in prior::texts(case) {
            host_tools::cli::write(&folder.join(name), text.as_bytes())?;
        }
    }
    host_tools::cli::write(&folder.join("cases.csv"), prior::index(cases).as_bytes())
}

/// All results of a run.
struct Results {
    scores: Vec<MethodScore>,
    varied: Vec<Varied>,
    left_out: Vec<LeftOutSite>,
}

impl Results {
    fn of(arguments: &Arguments, ranged: Vec<Ranged>, earlier: Option<&Earlier>) -> Result<Self> {
        let varied = if arguments.quick { 0 } else { VARIATIONS.len() - 1 };
        let progress = Progress::new(ranged.len() * (tables::RANGES.len() + varied) + beacons::sites());
        let (mut scores, mut tried): (Vec<MethodScore>, Vec<Tried>) = (Vec::new(), Vec::new());
        for mut ranged in ranged {
            let known_s = earlier.and_then(|earlier| earlier.offset_s(&ranged.name));
            let offset_s = ranges::join_truth(&mut ranged, known_s);
            for (method, scored) in
                tables::RANGES.into_iter().zip([ranges::solve(&ranged), ranges::track(&ranged, |_| ())])
            {
                let score = MethodScore::of([&ranged.site, &ranged.name, method], Measure::Rmse, scored);
                scores.push(MethodScore { simulated: ranged.simulated, offset_s, ..score });
                progress.step();
            }
            if let (false, Some(track)) = (arguments.quick, scores.last()) {
                tried.extend(settings::tried(&ranged, &track.figures, || progress.step()));
            }
        }
        if let Some(data) = &arguments.data {
            for beacons::Beaconed { site, name, scored } in beacons::recorded(data, || progress.step())? {
                let methods = beacons::METHODS.map(|method| method.name());
                let of = methods.iter().zip(scored);
                scores.extend(of.map(|(method, scored)| MethodScore::of([site, &name, method], Measure::Mean, scored)));
            }
        }
        let (varied, left_out) = settings::left_out(&tried);
        Ok(Self { scores, varied, left_out })
    }

    /// The track against the solver, at all sites.
    fn track_to_solve<'r>(&'r self) -> Vec<Compared> {
        let [solve, track] = tables::RANGES;
        let of = |method| self.scores.iter().filter(move |score| score.method == method);
        let pair = |score: &'r MethodScore| {
            let solved = of(solve).find(|other| other.recording == score.recording);
            Some(Pair::with_other(score, solved?))
        };
        results::compare(of(track).filter_map(pair))
    }

    /// This version against an earlier one, at all sites.
    fn comparison<'r>(&'r self, earlier: &'r Earlier) -> Vec<Compared> {
        let pair =
            |score: &'r MethodScore| Some(Pair::with_earlier(score, earlier.blocks(&score.recording, &score.method)?));
        results::compare(self.scores.iter().filter_map(pair))
    }

    fn tables(&self, earlier: Option<&Earlier>) -> String {
        let [solve, track] = tables::RANGES;
        let methods = beacons::METHODS.map(|method| method.name());
        let mut parts =
            vec![tables::recordings(&self.scores), tables::comparison(&self.track_to_solve(), [track, solve])];
        if self.scores.iter().any(|score| methods.contains(&score.method)) {
            parts.push(tables::beacons(&self.scores, &methods));
        }
        if !self.left_out.is_empty() {
            parts.push(tables::settings(&self.varied, &self.left_out));
        }
        if let Some(earlier) = earlier {
            let compared = self.comparison(earlier);
            parts.push(tables::comparison(&compared, ["new", "old"]));
            parts.push(tables::verdict_lines(&tables::verdicts(&compared)));
        }
        parts.join("\n")
    }

    fn document<'r>(&'r self, earlier: Option<&'r Earlier>) -> Document<'r> {
        let compared = earlier.map(|earlier| self.comparison(earlier)).unwrap_or_default();
        let verdicts = tables::verdicts(&compared).into_iter();
        Document {
            recordings: self.scores.iter().map(RecordingFigures::of).collect(),
            variations: &self.varied,
            settings: &self.left_out,
            track_to_solve: self.track_to_solve().iter().map(SiteRatio::of).collect(),
            verdicts: verdicts.map(|(method, [verdict, _])| MethodVerdict { method, verdict }).collect(),
            comparison: compared.iter().map(SiteRatio::of).collect(),
        }
    }
}

/// What `--json` prints.
#[derive(serde::Serialize)]
struct Document<'r> {
    recordings: Vec<RecordingFigures<'r>>,
    variations: &'r [Varied],
    settings: &'r [LeftOutSite],
    track_to_solve: Vec<SiteRatio>,
    comparison: Vec<SiteRatio>,
    verdicts: Vec<MethodVerdict>,
}

#[derive(serde::Serialize)]
struct RecordingFigures<'r> {
    site: &'r str,
    recording: &'r str,
    method: &'r str,
    offset_s: f64,
    #[serde(flatten)]
    figures: Figures,
}

impl<'r> RecordingFigures<'r> {
    fn of(score: &'r MethodScore) -> Self {
        let MethodScore { site, recording, method, offset_s, figures, .. } = score;
        Self { site, recording, method, offset_s: *offset_s, figures: *figures }
    }
}

#[derive(serde::Serialize)]
struct SiteRatio {
    site: String,
    method: String,
    new_m: Option<f64>,
    old_m: Option<f64>,
    log_ratio: Option<f64>,
    standard_error: Option<f64>,
    outcome: accuracy::SiteOutcome,
}

impl SiteRatio {
    fn of(compared: &Compared) -> Self {
        let Compared { site, method, errors_m: [new_m, old_m], ratio, outcome, .. } = compared.clone();
        let standard_error = ratio.map(|ratio| ratio.deviation).filter(|deviation| deviation.is_finite());
        Self { site, method, new_m, old_m, log_ratio: ratio.map(|ratio| ratio.value), standard_error, outcome }
    }
}

#[derive(serde::Serialize)]
struct MethodVerdict {
    method: String,
    #[serde(flatten)]
    verdict: ChangeVerdict,
}
