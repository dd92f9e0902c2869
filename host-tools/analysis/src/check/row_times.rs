//! Questions about the times: whether the clock was put back, stands still, or counts another unit.

use recording::{Epoch, Epochs};

use super::{Finding, FindingCode};

/// The rows of one epoch are of one fix where their times differ by no more than this, seconds.
const ONE_FIX_S: f64 = 1.0;

/// A clock that goes back by less is a matter of the order of rows, seconds.
const BACK_S: f64 = 0.5;
/// Where more of the steps go back, the rows are in any order, which is allowed.
const ANY_ORDER: f64 = 0.1;
/// The clock stands still where more of the steps are zero.
const STILL: f64 = 0.3;
/// No tag measures faster, seconds between epochs.
const FASTEST_S: f64 = 1.5e-3;

/// What the times say.
pub(super) fn questions(epochs: &Epochs) -> Vec<Finding> {
    let times_s: Vec<f64> =
        epochs.iter().filter(|epoch| !epoch.ranges.is_empty()).filter_map(|epoch| epoch.t_s).collect();
    // Single ranges of a round may have one time.
    let are_rounds = epochs.iter().any(|epoch| epoch.ranges.len() > 2);
    let still = if are_rounds { still(&times_s) } else { None };
    let unit = if still.is_none() && are_rounds { unit(&times_s) } else { None };
    [apart(epochs), backwards(&times_s), still, unit].into_iter().flatten().collect()
}

/// Where the clock goes back to a time that was recorded already: rows in another order do not.
fn backwards(times_s: &[f64]) -> Option<Finding> {
    // The parts between steps back, each with its least and greatest time, and the times round its first step.
    let mut parts: Vec<([f64; 2], [f64; 2])> = Vec::new();
    let mut before_s = f64::INFINITY;
    for &t_s in times_s {
        match parts.last_mut().filter(|_| t_s >= before_s - BACK_S) {
            Some(([least_s, greatest_s], _)) => (*least_s, *greatest_s) = (least_s.min(t_s), greatest_s.max(t_s)),
            None => parts.push(([t_s; 2], [before_s, t_s])),
        }
        before_s = t_s;
    }
    let count = parts.len().saturating_sub(1);
    let overlaps = |at: usize, [least_s, greatest_s]: [f64; 2]| {
        parts.iter().take(at).any(|([from_s, to_s], _)| greatest_s > from_s + BACK_S && least_s < to_s - BACK_S)
    };
    if count as f64 > ANY_ORDER * times_s.len() as f64 {
        return None;
    }
    let (_, (_, [before_s, t_s])) = parts.iter().enumerate().find(|(at, (part, _))| overlaps(*at, *part))?;
    let message = format!(
        "t_s goes backwards {count} times, first from {before_s} to {t_s} s: epochs of two times are taken as one walk; correct \
         the clock, or make a recording of each part"
    );
    let finding = Finding::new(FindingCode::TimeBackwards, message).with("back_s", before_s - t_s);
    Some(finding.with("steps_back", count as f64))
}

fn still(times_s: &[f64]) -> Option<Finding> {
    let steps = times_s.len().saturating_sub(1);
    let equal = times_s.windows(2).filter(|pair| pair[0] == pair[1]).count();
    (equal >= 2 && equal as f64 > STILL * steps as f64).then(|| {
        let message = format!(
            "t_s stands still in {equal} of {steps} steps from epoch to epoch: a track needs the time of each epoch, with its \
             fractions of a second; leave t_s out where it is unknown"
        );
        Finding::new(FindingCode::TimeEqual, message).with("share", equal as f64 / steps as f64)
    })
}

fn unit(times_s: &[f64]) -> Option<Finding> {
    let mut steps_s: Vec<f64> = times_s.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    steps_s.sort_by(f64::total_cmp);
    let step_s = *steps_s.get(steps_s.len() / 2).filter(|_| steps_s.len() >= 4)?;
    (step_s > 0.0 && step_s < FASTEST_S).then(|| {
        let message = format!(
            "t_s advances by {step_s:.1e} from epoch to epoch, faster than a tag measures: does it count kiloseconds, or \
             minutes? Seconds are expected"
        );
        Finding::new(FindingCode::TimeUnit, message).with("step_s", step_s)
    })
}

/// Epochs whose rows are of several times.
fn apart(epochs: &Epochs) -> Option<Finding> {
    let span = |epoch: &Epoch<'_>| {
        let (first, last) = epoch
            .ranges
            .iter()
            .filter_map(|range| range.t_s)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(first, last), t_s| (first.min(t_s), last.max(t_s)));
        (last - first > ONE_FIX_S).then_some((first, last))
    };
    let mut long = epochs.iter().filter_map(|epoch| Some((epoch, span(&epoch)?)));
    let (epoch, (first, last)) = long.next()?;
    let message = format!(
        "{} of the epochs have rows whose times differ by more than {ONE_FIX_S} s, the first is {} with {first} to {last} s, \
         and the latest time counts: number the epochs again, or make rounds by --group-s",
        1 + long.count(),
        epoch.name
    );
    Some(Finding::new(FindingCode::TimeApart, message))
}
