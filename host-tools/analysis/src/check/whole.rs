//! Questions that the whole recording answers: whether its ranges contradict the site, and what explains that.

use baliza_report::percentile;
use recording::{Epochs, Height, Recording, Solved, Space, round_s, rounds};

use super::contradiction::{CENTIMETRE_M, Contradiction, FOOT_M, INCH_M, MILLIMETRE_M, NANOSECOND_M, contradiction};
use super::joint_fit::{Assumption, Fit, FitRound, Rounds};
use super::{Finding, FindingCode, row_values};
use crate::Setup;
use crate::locate::middle_m;

/// The most rounds that are fitted, at equal intervals.
const MOST_ROUNDS: usize = 100;
/// The fewest rounds that say anything.
const FEWEST_ROUNDS: usize = 5;
/// The tag is outside of the given area where more of its places are farther outside than this, metres.
const OUTSIDE: f64 = 0.2;
const OUTSIDE_M: f64 = 0.5;
/// No tag is carried faster, metres a second.
const FASTEST_M_S: f64 = 60.0;
/// Places that are farther apart are apart in spite of their errors, metres.
const APART_M: f64 = 1.0;

/// What the whole recording says.
#[derive(Clone, Debug, Default)]
pub struct Whole {
    /// What is odd.
    pub findings: Vec<Finding>,
    /// Where the ranges prefer an anchor, by its number, metres.
    pub preferred_m: Vec<(usize, [f64; 2])>,
    /// The root mean square of the residuals as the files say, but for the tenth that is largest, metres; `None` where
    /// too few epochs have more ranges than a position needs.
    pub residual_m: Option<f64>,
    /// How wrong the positions are at least, by a contradiction, metres; `None` without one.
    pub wrong_m: Option<f64>,
    /// Where the tag is by the explanation, by the numbers of epochs, metres; none where single ranges made rounds.
    pub explained_m: Vec<(usize, [f64; 3])>,
    /// Where the ranges meet in the epochs that were asked, as the files say, metres.
    pub places_m: Vec<[f64; 2]>,
    /// The magnitudes of their residuals, metres.
    pub residuals_m: Vec<f64>,
}

impl Whole {
    /// Lets the deviations of positions reach as far as a contradiction makes them wrong: root mean square along each
    /// axis.
    pub fn widen(&self, solved: &mut [Solved]) {
        let Some(least_m) = self.wrong_m else { return };
        let both =
            self.explained_m.iter().filter_map(|(at, right_m)| Some((solved.get(*at)?.outcome.ok()?.place, right_m)));
        let (mut squares, mut count) = ([0.0; 3], 0.0_f64);
        for (place, right_m) in both {
            count += 1.0;
            let given = [place.x_m, place.y_m, place.z_m.unwrap_or(right_m[2])];
            squares
                .iter_mut()
                .zip(given)
                .zip(right_m)
                .for_each(|((square, given), right)| *square += (given - right).powi(2));
        }
        let [x_m, y_m, z_m] = squares.map(|square| (square / count.max(1.0)).sqrt().max(least_m));
        for position in solved.iter_mut().filter_map(|solved| solved.outcome.as_mut().ok()) {
            let sigma = &mut position.sigma;
            sigma.x_m = sigma.x_m.hypot(x_m);
            sigma.y_m = sigma.y_m.hypot(y_m);
            sigma.z_m = sigma.z_m.map(|sigma_m| sigma_m.hypot(z_m));
        }
    }
}

/// What a whole recording says about its site. Its epochs have their true positions, if heights come from these.
pub fn of_whole(recording: &Recording, setup: &Setup) -> Whole {
    let origin = middle_m(&recording.anchors);
    let Some(rounds) = of(recording, setup, origin) else {
        return Whole { findings: row_values::unit(recording).into_iter().collect(), ..Whole::default() };
    };
    let (as_given, contradiction) = contradiction(&rounds);
    let mut whole = Whole {
        residual_m: Some(as_given.residual_m),
        places_m: as_given.places_m.iter().map(|place| [place[0] + origin[0], place[1] + origin[1]]).collect(),
        residuals_m: as_given.residuals_m.clone(),
        ..Whole::default()
    };
    match contradiction {
        Some(Contradiction { explanations }) if !explanations.is_empty() => {
            whole.wrong_m = Some(as_given.residual_m);
            let places_m = explanations.first().map_or(&[][..], |fit| &fit.places_m);
            let by_epoch = rounds.rounds.iter().zip(places_m).filter_map(|(round, place)| Some((round.epoch?, place)));
            let global = |place: &[f64; 3]| std::array::from_fn(|axis| place[axis] + origin[axis]);
            whole.explained_m = by_epoch.map(|(epoch, place)| (epoch, global(place))).collect();
            whole.findings.push(said(recording, &rounds, origin, &as_given, &explanations));
            whole.preferred_m = explanations.iter().flat_map(|fit| preferred(&rounds, origin, fit)).collect();
        }
        unexplained => {
            whole.wrong_m = unexplained.is_some().then_some(2.0 * as_given.residual_m);
            let nothing = || unexplained.is_some().then(|| unknown(&as_given));
            whole.findings.extend(row_values::unit(recording).or_else(nothing));
        }
    }
    if whole.findings.is_empty() {
        whole.findings.extend(outside(setup, origin, &as_given));
        whole.findings.extend(too_fast(&rounds, &as_given));
    }
    whole
}

/// Rounds that have more ranges than their position needs, relative to the origin.
fn of(recording: &Recording, setup: &Setup, origin: [f64; 3]) -> Option<Rounds> {
    let (dims, height) = match setup.space {
        Space::Full(_) => (3, None),
        Space::Plane(height) => (2, Some(height)),
    };
    let of_singles = round_s(&recording.epochs).map(|longest_s| rounds(&recording.epochs, longest_s));
    let epochs: &Epochs = of_singles.as_ref().unwrap_or(&recording.epochs);
    let usable: Vec<usize> =
        (0..epochs.len()).filter(|at| epochs.get(*at).is_some_and(|epoch| epoch.ranges.len() > dims)).collect();
    let flat = height == Some(Height::Unknown);
    let anchors_m = recording.anchors.iter().map(|anchor| {
        let z_m = if flat { 0.0 } else { anchor.place.z_m.map_or(0.0, |z_m| z_m - origin[2]) };
        [anchor.place.x_m - origin[0], anchor.place.y_m - origin[1], z_m]
    });
    let step = usable.len().div_ceil(MOST_ROUNDS).max(1);
    let mut chosen = Vec::new();
    for (at, epoch) in usable.into_iter().step_by(step).filter_map(|at| Some((at, epochs.get(at)?))) {
        let height_m = match height {
            Some(Height::Fixed(z_m)) => z_m - origin[2],
            Some(Height::FromTruth) => match epoch.truth.and_then(|truth| truth.z_m) {
                Some(z_m) => z_m - origin[2],
                None => continue,
            },
            Some(Height::Unknown) | None => 0.0,
        };
        let known =
            |anchor: usize| recording.anchors.get(anchor).is_some_and(|anchor| flat || anchor.place.z_m.is_some());
        let ranges = epoch.ranges.iter().filter(|range| known(range.anchor)).map(|range| (range.anchor, range.range_m));
        let own = of_singles.is_none().then_some(at);
        chosen.push(FitRound { ranges: ranges.collect(), height_m, t_s: epoch.t_s, epoch: own });
    }
    let height_is_known = matches!(height, Some(Height::Fixed(_)));
    let rounds = Rounds { anchors_m: anchors_m.collect(), rounds: chosen, dims, height_is_known };
    (rounds.rounds.len() >= FEWEST_ROUNDS).then_some(rounds)
}

/// The explanations that cannot be told apart, in one sentence. The first one gives the code.
fn said(recording: &Recording, rounds: &Rounds, origin: [f64; 3], as_given: &Fit, fits: &[Fit]) -> Finding {
    let name = |anchor: usize| recording.anchors.get(anchor).map_or_else(String::new, |anchor| anchor.name.clone());
    let each: Vec<Explained> = fits.iter().map(|fit| Explained::of(rounds, origin, fit, name)).collect();
    let (before_m, after_m) = (as_given.residual_m, fits.first().map_or(0.0, |fit| fit.residual_m));
    let looks: Vec<&str> = each.iter().map(|one| one.looks.as_str()).collect();
    let mut remedies: Vec<&str> = Vec::new();
    each.iter().for_each(|one| {
        if !remedies.contains(&one.remedy) {
            remedies.push(one.remedy)
        }
    });
    let which = if each.len() > 1 { " (the ranges cannot tell which)" } else { "" };
    let message = format!(
        "{}{which}: residuals fall from {before_m:.2} to {after_m:.2} m if that is taken into account; {}",
        looks.join(", or "),
        remedies.join(", or ")
    );
    let code = each.first().map_or(FindingCode::Contradiction, |one| one.code);
    let mut subjects: Vec<String> = Vec::new();
    for subject in each.iter().flat_map(|one| &one.subjects) {
        if !subjects.contains(subject) {
            subjects.push(subject.clone());
        }
    }
    let mut finding = Finding::new(code, message).about(subjects);
    if let Some(first) = each.first() {
        finding.evidence.extend(first.evidence.iter().copied());
    }
    finding.with("residual_m", before_m).with("residual_explained_m", after_m)
}

/// An explanation in words.
struct Explained {
    code: FindingCode,
    looks: String,
    remedy: &'static str,
    subjects: Vec<String>,
    evidence: Vec<(&'static str, f64)>,
}

impl Explained {
    fn of(rounds: &Rounds, origin: [f64; 3], fit: &Fit, name: impl Fn(usize) -> String) -> Self {
        let [common_m, value_m, _, _] = fit.values_m;
        let (code, looks, remedy, subjects, evidence) = match fit.assumption {
            Assumption::Sound => (FindingCode::Contradiction, String::new(), "", Vec::new(), Vec::new()),
            Assumption::Unit(unit_m) => {
                let (code, unit) = unit_of(unit_m);
                let looks = format!("the ranges look like {unit}");
                (code, looks, "convert them to metres", Vec::new(), vec![("unit_m", unit_m)])
            }
            Assumption::Exchanged(one, other) => {
                let looks = format!("the anchors {} and {} look exchanged", name(one), name(other));
                let remedy = "exchange their places in the file of anchors, or the boards on the wall";
                (FindingCode::AnchorsExchanged, looks, remedy, vec![name(one), name(other)], Vec::new())
            }
            Assumption::AllLong => {
                let looks = format!("all ranges are about {:.1} m {}", common_m.abs(), long(common_m));
                let remedy = "set the antenna delays (baliza calibrate antenna-delay)";
                (FindingCode::AllRangesLong, looks, remedy, Vec::new(), vec![("offset_m", common_m)])
            }
            Assumption::LinkLong(anchor) => {
                let looks = format!(
                    "the ranges of anchor {} are about {:.1} m {} everywhere",
                    name(anchor),
                    value_m.abs(),
                    long(value_m)
                );
                let (code, remedy) = if value_m > 0.0 {
                    let remedy = "its link is blocked, or its antenna delay is wrong: move the anchor, calibrate it, or leave \
                                  it out";
                    (FindingCode::LinkBlocked, remedy)
                } else {
                    (FindingCode::AnchorDelay, "calibrate its antenna delay, or survey its place again")
                };
                (code, looks, remedy, vec![name(anchor)], vec![("offset_m", value_m)])
            }
            Assumption::Moved(anchor) => {
                let at_m = rounds.anchors_m.get(anchor).copied().unwrap_or_default();
                let [x_m, y_m, z_m] = std::array::from_fn(|axis| at_m[axis] + fit.values_m[axis + 1] + origin[axis]);
                let up = if rounds.dims == 3 { format!(", {z_m:.1}") } else { String::new() };
                let by_m = fit.moved_m();
                let looks = format!(
                    "anchor {} is about {by_m:.1} m from where the file has it, towards ({x_m:.1}, {y_m:.1}{up})",
                    name(anchor)
                );
                let mut evidence = vec![("moved_m", by_m), ("x_m", x_m), ("y_m", y_m)];
                evidence.extend((rounds.dims == 3).then_some(("z_m", z_m)));
                (FindingCode::AnchorMoved, looks, "survey its place again", vec![name(anchor)], evidence)
            }
            Assumption::Height => {
                let given_m = rounds.rounds.first().map_or(0.0, |round| round.height_m) + origin[2];
                let height_m = given_m + value_m;
                let looks = format!("the tag is at a height of about {height_m:.2} m and not of {given_m:.2} m");
                let remedy = "correct --height-m, or height_m in recording.toml or site.toml";
                (
                    FindingCode::HeightWrong,
                    looks,
                    remedy,
                    Vec::new(),
                    vec![("height_m", height_m), ("given_m", given_m)],
                )
            }
        };
        Self { code, looks, remedy, subjects, evidence }
    }
}

fn long(value_m: f64) -> &'static str {
    if value_m > 0.0 { "long" } else { "short" }
}

fn unit_of(unit_m: f64) -> (FindingCode, &'static str) {
    [
        (FOOT_M, FindingCode::UnitFeet, "feet"),
        (NANOSECOND_M, FindingCode::UnitNanoseconds, "nanoseconds"),
        (INCH_M, FindingCode::UnitInches, "inches"),
        (CENTIMETRE_M, FindingCode::UnitCentimetres, "centimetres"),
        (MILLIMETRE_M, FindingCode::UnitMillimetres, "millimetres"),
    ]
    .into_iter()
    .find(|(of_m, _, _)| *of_m == unit_m)
    .map_or((FindingCode::Contradiction, "another unit"), |(_, code, unit)| (code, unit))
}

fn unknown(as_given: &Fit) -> Finding {
    let rest = if as_given.moves() { "" } else { "; a walk tells more than a tag at rest" };
    let message = format!(
        "the ranges contradict the anchors, residuals are {:.2} m, and no single mistake explains it: check the names and \
         places of the anchors, the unit, and the antenna delays{rest}",
        as_given.residual_m
    );
    Finding::new(FindingCode::Contradiction, message).with("residual_m", as_given.residual_m)
}

/// Where the ranges prefer the anchors that an explanation moves, metres.
fn preferred(rounds: &Rounds, origin: [f64; 3], fit: &Fit) -> Vec<(usize, [f64; 2])> {
    let at = |anchor: usize| rounds.anchors_m.get(anchor).copied().unwrap_or_default();
    let flat = |at_m: [f64; 3]| [at_m[0] + origin[0], at_m[1] + origin[1]];
    match fit.assumption {
        Assumption::Exchanged(one, other) => vec![(one, flat(at(other))), (other, flat(at(one)))],
        Assumption::Moved(anchor) => {
            let [_, x_m, y_m, _] = fit.values_m;
            let [from_x_m, from_y_m] = flat(at(anchor));
            vec![(anchor, [from_x_m + x_m, from_y_m + y_m])]
        }
        Assumption::Sound
        | Assumption::Unit(_)
        | Assumption::AllLong
        | Assumption::LinkLong(_)
        | Assumption::Height => Vec::new(),
    }
}

fn outside(setup: &Setup, origin: [f64; 3], as_given: &Fit) -> Option<Finding> {
    let [least, greatest] = setup.area_m?;
    let is_outside = |place: &&[f64; 3]| {
        (0..2).any(|axis| {
            let at_m = place[axis] + origin[axis];
            at_m < least[axis] - OUTSIDE_M || at_m > greatest[axis] + OUTSIDE_M
        })
    };
    let outside = as_given.places_m.iter().filter(is_outside).count();
    let share = outside as f64 / as_given.places_m.len().max(1) as f64;
    (share > OUTSIDE).then(|| {
        let message = format!(
            "the area leaves out where the ranges meet in {:.0} % of the epochs: correct --area, or leave it out",
            100.0 * share
        );
        Finding::new(FindingCode::AreaExcludes, message).with("share", share)
    })
}

/// Where the tag is faster than anything that carries it, its times have another unit.
fn too_fast(rounds: &Rounds, as_given: &Fit) -> Option<Finding> {
    let placed: Vec<_> = rounds.rounds.iter().zip(&as_given.places_m).collect();
    let mut speeds_m_s: Vec<f64> = placed
        .windows(2)
        .filter_map(|pair| {
            let [(before, from_m), (after, to_m)] = pair else { return None };
            let (from_s, to_s) = before.t_s.zip(after.t_s)?;
            let apart_m = (to_m[0] - from_m[0]).hypot(to_m[1] - from_m[1]);
            (apart_m > APART_M && to_s > from_s).then(|| apart_m / (to_s - from_s))
        })
        .collect();
    speeds_m_s.sort_by(f64::total_cmp);
    let speed_m_s = if speeds_m_s.len() < FEWEST_ROUNDS { 0.0 } else { percentile(&speeds_m_s, 0.5) };
    (speed_m_s > FASTEST_M_S).then(|| {
        let message = format!(
            "the tag moves at {speed_m_s:.0} m/s: does t_s count kiloseconds, or minutes? Seconds are expected"
        );
        Finding::new(FindingCode::TimeUnit, message).with("speed_m_s", speed_m_s)
    })
}
