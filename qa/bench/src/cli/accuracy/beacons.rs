//! Positions by fingerprints, as `baliza ble fingerprint` computes them, and their errors.

use std::path::Path;

use accuracy::ScoredEpoch;
use analysis::survey::fingerprint::{Comparison, Making, Maps, Setup, Survey, held_out};
use anyhow::{Context, Result};
use recording::beacons::{Capture, read_captures, read_stays};
use recording::{Coordinates, Solved};

/// The compared methods: that of a node, and the nearest neighbours beside it.
pub const METHODS: [Comparison; 2] = [Comparison::Walk, Comparison::Nearest { k: 5, weighted: true }];

/// Which captures of a folder are positioned.
enum Asked {
    /// Those of a file of targets.
    Targets,
    /// Each point of the survey, by all others.
    EachPoint,
    /// Every fifth block of a hundred points, by the other blocks.
    Blocks,
    /// Walks after the survey: the files of RSSI values and of true positions.
    Walks(&'static [(&'static str, [&'static str; 2])]),
}

/// A site: its name, folder, survey and captures.
const SITES: [(&str, &str, &str, Asked); 4] = [
    ("linde, room", "linde_room", "fingerprints.csv", Asked::Targets),
    ("linde, floor", "linde_floor", "fingerprints.csv", Asked::EachPoint),
    ("kolakowski", "kolakowski", "fingerprints.csv", Asked::Blocks),
    (
        "danis",
        "danis",
        "survey/fingerprints.csv",
        Asked::Walks(&[
            ("straight_01", ["straight_01/rssi.csv", "straight_01/truth.csv"]),
            ("straight_04", ["straight_04/rssi.csv", "straight_04/truth.csv"]),
            ("straight_05", ["straight_05/rssi.csv", "straight_05/truth.csv"]),
            ("straight_01, 0.5 s", ["straight_01/rssi_500.csv", "straight_01/truth_500.csv"]),
            ("straight_04, 0.5 s", ["straight_04/rssi_500.csv", "straight_04/truth_500.csv"]),
            ("straight_05, 0.5 s", ["straight_05/rssi_500.csv", "straight_05/truth_500.csv"]),
        ]),
    ),
];
/// One of this number of blocks is held out, and the points of a block.
const HELD_OUT: [usize; 2] = [5, 100];

/// The errors on one recording.
pub struct Beaconed {
    /// Its site.
    pub site: &'static str,
    /// Its name.
    pub name: String,
    /// The errors of each of [`METHODS`].
    pub scored: Vec<Vec<ScoredEpoch>>,
}

/// The errors at all sites of a data folder that exist; `done` is called after each site.
///
/// # Errors
/// The first line of a file that is wrong, or a survey makes no map.
pub fn recorded(data: &Path, done: impl Fn()) -> Result<Vec<Beaconed>> {
    let mut all = Vec::new();
    for (site, folder, survey, asked) in &SITES {
        let folder = data.join(folder);
        if folder.is_dir() {
            let of_site = of_site(site, &folder, survey, asked);
            all.extend(of_site.with_context(|| format!("the site {site}"))?);
        }
        done();
    }
    Ok(all)
}

/// How many sites there are.
pub fn sites() -> usize {
    SITES.len()
}

fn of_site(site: &'static str, folder: &Path, survey: &str, asked: &Asked) -> Result<Vec<Beaconed>> {
    let (stays, setup, making) = (read_stays(&folder.join(survey))?, Setup::default(), Making::default());
    let beaconed = |name: &str, captures: &[Capture], solved: &[Vec<Solved>]| Beaconed {
        site,
        name: name.to_owned(),
        scored: solved.iter().map(|solved| scored(captures, solved)).collect(),
    };
    let held = |fold_of: &dyn Fn(usize) -> Option<usize>| {
        let held = held_out(&stays, making, &setup, &METHODS, fold_of, || ())?;
        let captures: Vec<_> = held.stays.into_iter().map(|stay| Capture::from(stays[stay].clone())).collect();
        Ok(vec![beaconed(site, &captures, &held.solved)])
    };
    let by_survey = |rssi: &str, truth: Option<&str>| -> Result<(Vec<Capture>, Vec<Vec<Solved>>)> {
        let maps = Maps::of(&Survey::of(&stays, setup.average), making, &METHODS, None)?;
        let truth = truth.map(|truth| folder.join(truth));
        let tags = read_captures(&folder.join(rssi), truth.as_deref())?;
        let captures: Vec<_> = tags.into_iter().flat_map(|of| of.captures).collect();
        let solver = analysis::survey::fingerprint::Solver { maps: &maps, setup: &setup };
        let solved = METHODS.iter().map(|method| solver.solve(*method, &captures)).collect::<Result<_, _>>()?;
        Ok((captures, solved))
    };
    match asked {
        Asked::Targets => {
            let (captures, solved) = by_survey("targets.csv", None)?;
            Ok(vec![beaconed(site, &captures, &solved)])
        }
        Asked::EachPoint => held(&Some),
        Asked::Blocks => {
            let [every, block] = HELD_OUT;
            held(&|stay| (stay / block % every == every - 1).then_some(0))
        }
        Asked::Walks(walks) => {
            let walk = |(name, [rssi, truth]): &(&str, [&str; 2])| {
                let (captures, solved) = by_survey(rssi, Some(truth))?;
                Ok(beaconed(name, &captures, &solved))
            };
            walks.iter().map(walk).collect()
        }
    }
}

/// The errors of captures with a known true position, in the order of the file.
fn scored(captures: &[Capture], solved: &[Solved]) -> Vec<ScoredEpoch> {
    let score = |(capture, solved): (&Capture, &Solved)| {
        let [x_m, y_m] = capture.truth_m?;
        let (truth, position) = (Coordinates { x_m, y_m, z_m: None }, solved.outcome.ok());
        Some(ScoredEpoch {
            t_s: capture.t_s,
            error_m: position.map(|position| position.place.horizontal_m(&truth)),
            normalised_square: position.map(|position| position.normalised_square(&truth)).filter(|s| s.is_finite()),
        })
    };
    captures.iter().zip(solved).filter_map(score).collect()
}
