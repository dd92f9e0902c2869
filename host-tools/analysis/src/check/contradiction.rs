//! What explains that ranges contradict their anchors: of all assumptions, the one under which the whole recording fits
//! together very much better than as it is.

use super::joint_fit::{Assumption, Fit, Rounds};

/// Rounds whose cost is below this fit together.
const SOUND: f64 = 0.2;
/// Below this cost nothing gross is wrong: neither all ranges, nor their unit, nor the names of anchors.
const GROSS: f64 = 0.8;
/// Above this cost the ranges contradict the anchors, even if nothing explains it.
const CONTRADICTORY: f64 = 2.5;
/// An explanation leaves less than this share of the cost.
const LEFT: f64 = 0.75;
/// The same of a moved anchor of which ranges are too short, and of one of which none are, which may be blocked instead;
/// of a height, of which ranges say little; and of a tag at rest, where much explains little.
const LEFT_MOVED: [f64; 3] = [0.7, 0.55, 0.42];
const LEFT_HEIGHT: f64 = 0.8;
const LEFT_AT_REST: f64 = 0.35;
/// An explanation lowers the cost by more than this.
const LOWERS: f64 = 0.05;
/// The factor of the cost for each value that is estimated: of two explanations the simpler one counts.
const A_VALUE: f64 = 1.1;
/// Explanations whose costs differ by less than this factor cannot be told apart.
const ALIKE: f64 = 1.25;
/// The most explanations that are named.
const MOST_NAMED: usize = 3;
/// Errors that are too small to be named, metres: of all ranges, of those of an anchor, of a place, and of the height.
const LEAST_M: [f64; 4] = [0.4, 1.0, 0.6, 0.6];
/// The share of an anchor's ranges that fit under an explanation that is about this anchor. A link that is blocked here
/// and there has less.
const FITTING: f64 = 0.85;
const FITTING_MOVED: f64 = 0.95;
/// A link that is blocked in places fits in the others, and is nowhere short: more of the ranges of a moved anchor are
/// short, or fewer fit.
const SHORT: f64 = 0.1;
const FITTING_AS_GIVEN: f64 = 0.2;
/// The farthest that a moved anchor is looked for, metres.
const FARTHEST_M: f64 = 6.0;

/// The rounds that choose the best explanations, and the number of these that all rounds are asked about.
const FEW: usize = 24;
const BEST: usize = 6;
/// The most anchors that are asked one by one.
const SUSPECTS: usize = 10;
/// An anchor has at least this number of ranges, or nothing is said of it.
const LEAST_RANGES: usize = 5;

/// Metres of a foot.
pub const FOOT_M: f64 = 0.3048;
/// Metres of light in a nanosecond.
pub const NANOSECOND_M: f64 = 0.299_792_458;
/// Centimetres, millimetres and inches, metres.
pub const CENTIMETRE_M: f64 = 0.01;
pub const MILLIMETRE_M: f64 = 0.001;
pub const INCH_M: f64 = 0.0254;
const UNITS_M: [f64; 5] = [FOOT_M, NANOSECOND_M, CENTIMETRE_M, MILLIMETRE_M, INCH_M];

/// Ranges that contradict the site.
#[derive(Clone, Debug)]
pub struct Contradiction {
    /// The explanations that cannot be told apart, the best first; none where nothing alone explains it.
    pub explanations: Vec<Fit>,
}

/// The fit of the rounds as they are given, and the contradiction between them and the site, if there is one.
pub fn contradiction(rounds: &Rounds) -> (Fit, Option<Contradiction>) {
    let as_given = rounds.fit(Assumption::Sound, &[]);
    if as_given.cost < SOUND {
        return (as_given, None);
    }
    let explains = |fit: &Fit| {
        let left = match fit.assumption {
            _ if !fit.moves() => LEFT_AT_REST,
            Assumption::Moved(anchor) => {
                let [fitting, short] = rounds.as_given(anchor, fit);
                let [is_short, is_long, is_often_right] = LEFT_MOVED;
                if short > SHORT {
                    is_short
                } else if fitting < FITTING_AS_GIVEN {
                    is_long
                } else {
                    is_often_right
                }
            }
            Assumption::Height => LEFT_HEIGHT,
            Assumption::Sound
            | Assumption::Unit(_)
            | Assumption::Exchanged(..)
            | Assumption::AllLong
            | Assumption::LinkLong(_) => LEFT,
        };
        fit.cost < left * as_given.cost && fit.cost < as_given.cost - LOWERS
    };
    let score = |fit: &Fit| score(fit, rounds.dims);
    let few = rounds.some(FEW);
    let mut roughly: Vec<Fit> = candidates(rounds, &as_given)
        .into_iter()
        .map(|(assumption, begins_m)| few.fit(assumption, &begins_m))
        .collect();
    roughly.sort_by(|one, other| score(one).total_cmp(&score(other)));
    let finely = roughly.iter().take(BEST).map(|rough| rounds.fit(rough.assumption, &[rough.values_m]));
    let mut fits: Vec<Fit> = finely.filter(explains).collect();
    fits.sort_by(|one, other| score(one).total_cmp(&score(other)));
    // Where the best explanation is too small for a word, a much worse one is none.
    let score_of_best = fits.first().map_or(0.0, score);
    fits.retain(|fit| score(fit) < ALIKE * score_of_best && is_large(rounds, fit));
    fits.truncate(MOST_NAMED);
    let is_contradiction = !fits.is_empty() || as_given.cost > CONTRADICTORY;
    (as_given, is_contradiction.then_some(Contradiction { explanations: fits }))
}

/// The cost of a fit, and of its values. Nothing but a wrong delay of one anchor makes its ranges short, which is rare.
fn score(fit: &Fit, dims: usize) -> f64 {
    let values = match fit.assumption {
        Assumption::Sound | Assumption::Unit(_) | Assumption::Exchanged(..) => 0,
        Assumption::AllLong | Assumption::Height => 1,
        Assumption::LinkLong(_) => {
            if fit.values_m[1] < 0.0 {
                4
            } else {
                1
            }
        }
        Assumption::Moved(_) => dims as i32,
    };
    fit.cost * A_VALUE.powi(values)
}

/// Whether what an assumption says is worth a word.
fn is_large(rounds: &Rounds, fit: &Fit) -> bool {
    let [common_m, value_m, _, _] = fit.values_m;
    let [all, link, place, height] = LEAST_M;
    match fit.assumption {
        Assumption::Sound => false,
        Assumption::Unit(_) | Assumption::Exchanged(..) => true,
        Assumption::AllLong => common_m.abs() > all,
        Assumption::LinkLong(anchor) => {
            let [as_given, _] = rounds.as_given(anchor, fit);
            let fits_everywhere = fit.fitting[anchor] > FITTING_MOVED && as_given < FITTING_AS_GIVEN;
            let least_m = if fits_everywhere && fit.moves() { place } else { link };
            value_m.abs() > least_m && fit.fitting[anchor] > FITTING && as_given < 1.5 * FITTING_AS_GIVEN
        }
        Assumption::Moved(anchor) => {
            fit.moves() && fit.fitting[anchor] > FITTING_MOVED && (place..FARTHEST_M).contains(&fit.moved_m())
        }
        Assumption::Height => value_m.abs() > height,
    }
}

/// What may explain the contradiction, with the values from which to look.
fn candidates(rounds: &Rounds, as_given: &Fit) -> Vec<(Assumption, Vec<[f64; 4]>)> {
    let anchors = suspects(as_given);
    let gross = as_given.cost > GROSS;
    let common = |value_m: f64| [value_m, 0.0, 0.0, 0.0];
    let value = |value_m: f64| [0.0, value_m, 0.0, 0.0];
    let mut candidates = Vec::new();
    if gross {
        candidates.push((Assumption::AllLong, [-1.5, 0.7, 1.5, 3.0].map(common).to_vec()));
        candidates.extend(UNITS_M.map(|unit_m| (Assumption::Unit(unit_m), Vec::new())));
        for (at, one) in anchors.iter().enumerate() {
            let others = anchors.iter().take(at);
            candidates
                .extend(others.map(|other| (Assumption::Exchanged(*one.min(other), *one.max(other)), Vec::new())));
        }
    }
    let mut perhaps = |assumption: Assumption, begins_m: &[[f64; 4]]| {
        if gross {
            candidates.push((assumption, begins_m.to_vec()));
        } else if rounds.tried(assumption, as_given) < 0.9 * as_given.cost {
            candidates.push((assumption, Vec::new()));
        }
    };
    if rounds.height_is_known {
        perhaps(Assumption::Height, &[-1.0, 1.0].map(value));
    }
    for anchor in anchors {
        perhaps(Assumption::LinkLong(anchor), &[-1.0, 1.0, 3.0, 5.0].map(value));
        let aside = [[0.0; 4], value(1.0), value(-1.0), [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0]];
        perhaps(Assumption::Moved(anchor), &aside);
    }
    candidates
}

/// The anchors whose ranges fit worst, as far as they have enough of them.
fn suspects(as_given: &Fit) -> Vec<usize> {
    let mut anchors: Vec<usize> =
        (0..as_given.fitting.len()).filter(|anchor| as_given.ranges[*anchor] >= LEAST_RANGES).collect();
    anchors.sort_by(|one, other| as_given.fitting[*one].total_cmp(&as_given.fitting[*other]));
    anchors.truncate(SUSPECTS);
    anchors.sort_unstable();
    anchors
}
