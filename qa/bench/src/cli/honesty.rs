//! `baliza bench honesty`: whether the deviations of positions are as large as their errors, by kinds of geometry.

use accuracy::honesty::{CLASSES, SiteClass, draw};
use analysis::locate::track::{Tracker, Weighting, settings};
use analysis::{Setup, Solver};
use anyhow::Result;
use baliza_report::{MarkdownTable, Statistics, mean};
use clap::builder::PossibleValuesParser;
use host_tools::cli::progress::Progress;
use positioning_core::Method;
use recording::{Height, Recording, Solved, Space};
use serde::Serialize;

use super::accuracy::sites::drawn;
use super::{MOST_DEVIATIONS, Output, on_all_processors};

const METHODS: [&str; 2] = ["solve", "track"];

/// Errors beyond four deviations, and NEES, by kinds of geometry
///
/// Sites are drawn: anchors on a line, in the plane, in space, with blocked links, and tags outside of the anchors.
/// Deviations and errors are those of all unknown coordinates together, so that a NEES of 1 is right.
///
/// As JSON: an object a class and method with class, method, sites, fixed (share of the epochs), flagged (share of the
/// positions), wrong (share of the positions beyond four deviations and without a flag), nees_p50 and nees_p90 (of the
/// sites).
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench honesty\n  baliza bench honesty --class line --sites 200 --seed 7")]
pub struct Arguments {
    /// Sites of each class
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    sites: u32,
    /// Only this class
    #[arg(long, value_name = "CLASS", value_parser = PossibleValuesParser::new(CLASSES.map(|class| class.name)))]
    class: Option<String>,
    /// Only this method
    #[arg(long, value_name = "METHOD", value_parser = PossibleValuesParser::new(METHODS))]
    method: Option<String>,
    /// Seed of the random numbers: equal seeds give equal figures
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON: results has an object a class and method
    #[arg(long)]
    json: bool,
}

/// What the sites of a class show of a method.
#[derive(Debug, Serialize)]
struct MethodHonesty {
    class: &'static str,
    method: &'static str,
    sites: usize,
    fixed: f64,
    flagged: f64,
    wrong: f64,
    nees_p50: Option<f64>,
    nees_p90: Option<f64>,
}

/// A method on a site.
struct SiteHonesty {
    epochs: usize,
    positions: usize,
    flagged: usize,
    wrong: usize,
    nees: f64,
}

/// Runs `baliza bench honesty`.
///
/// # Errors
/// The output cannot be printed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let classes = || CLASSES.into_iter().filter(|class| arguments.class.as_ref().is_none_or(|name| name == class.name));
    let progress = Progress::new(classes().count() * arguments.sites as usize);
    let scores = classes().flat_map(|class| score(class, arguments.sites as usize, arguments.seed, &progress));
    let is_asked = |score: &MethodHonesty| arguments.method.as_ref().is_none_or(|name| name == score.method);
    let scores: Vec<_> = scores.filter(is_asked).collect();
    drop(progress);
    Output { json: arguments.json, picture: None }.print(&scores, || table(&scores))
}

fn score(class: SiteClass, sites: usize, seed: u64, progress: &Progress) -> [MethodHonesty; 2] {
    let scores = on_all_processors(0..sites as u64, |number| site(class, number as usize, seed, progress));
    let (solved, tracked): (Vec<_>, Vec<_>) = scores.into_iter().unzip();
    [MethodHonesty::of([class.name, METHODS[0]], &solved), MethodHonesty::of([class.name, METHODS[1]], &tracked)]
}

/// Solves and tracks the ranges of a site.
fn site(class: SiteClass, number: usize, seed: u64, progress: &Progress) -> (SiteHonesty, SiteHonesty) {
    let site = draw(class, number, seed);
    let recording = drawn(&site.anchors_m, &site.epochs);
    let space = if class.in_space { Space::Full(None) } else { Space::Plane(Height::FromTruth) };
    let setup = Setup::of(space);
    let solved = Solver::new(&recording.anchors, setup).solve_all(Method::Robust, &recording.epochs, |_| ());
    let mut tracker = Tracker::new(&recording.anchors, setup, settings(&setup, Weighting::Weigh), None);
    let tracked = tracker.follow_all(&recording.epochs, || ());
    progress.step();
    (SiteHonesty::of(&recording, &solved), SiteHonesty::of(&recording, &tracked))
}

impl SiteHonesty {
    fn of(recording: &Recording, solved: &[Solved]) -> Self {
        let mut honesty = Self { epochs: solved.len(), positions: 0, flagged: 0, wrong: 0, nees: 0.0 };
        for (epoch, solved) in recording.epochs.iter().zip(solved) {
            let (Ok(position), Some(truth)) = (&solved.outcome, epoch.truth) else { continue };
            let sigma = &position.sigma;
            let variance = sigma.x_m.powi(2) + sigma.y_m.powi(2) + sigma.z_m.map_or(0.0, |z_m| z_m.powi(2));
            let square = position.place.distance_m(&truth).powi(2) / variance;
            honesty.positions += 1;
            honesty.flagged += usize::from(position.flag.is_some());
            honesty.wrong += usize::from(position.flag.is_none() && square > MOST_DEVIATIONS * MOST_DEVIATIONS);
            honesty.nees += square;
        }
        honesty
    }
}

impl MethodHonesty {
    fn of([class, method]: [&'static str; 2], sites: &[SiteHonesty]) -> Self {
        let fixed = mean(sites.iter().map(|site| site.positions as f64 / site.epochs.max(1) as f64));
        let solved = || sites.iter().filter(|site| site.positions > 0);
        let share = |of: fn(&SiteHonesty) -> usize| mean(solved().map(|site| of(site) as f64 / site.positions as f64));
        let nees: Vec<f64> = solved().map(|site| site.nees / site.positions as f64).collect();
        let nees = Statistics::of(&nees);
        Self {
            class,
            method,
            sites: sites.len(),
            fixed,
            flagged: share(|site| site.flagged),
            wrong: share(|site| site.wrong),
            nees_p50: nees.map(|of| of.p50),
            nees_p90: nees.map(|of| of.p90),
        }
    }
}

fn table(scores: &[MethodHonesty]) -> String {
    let titles = ["sites, method", "with position:", "flagged:", "wrong:", "NEES P50:", "NEES P90:"];
    let mut table = MarkdownTable::new(titles);
    for of in scores {
        let [fixed, flagged, wrong] = [of.fixed, of.flagged, of.wrong].map(|share| 100.0 * share);
        let [half, most] = [of.nees_p50, of.nees_p90].map(|nees| nees.unwrap_or(f64::NAN));
        let (class, method) = (of.class, of.method);
        table.row(format_args!(
            "{class}, {method} | {fixed:.1} % | {flagged:.1} % | {wrong:.2} % | {half:.1} | {most:.1}"
        ));
    }
    table.into_text()
}
