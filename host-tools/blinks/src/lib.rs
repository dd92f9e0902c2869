//! Positions of tags that blink. Input: what anchors report of the arrivals of blinks and of sync frames, each in its own
//! clock ([`wire::telemetry::Arrival`]). Output: a position for each blink that enough anchors have received.
//!
//! The sync frames tie the anchors' clocks together (`clocks.rs`): no wires synchronise them. The differences of a blink's
//! arrivals go into the tag's track as those of a tag that listens do ([`positioning_core::locator`]), with the
//! uncertainty of the clocks in their deviations. The station and the simulation call this one type.

mod clocks;

use std::collections::{HashMap, HashSet, VecDeque};
use std::fmt;

use positioning_core::engine::Tdoa;
use positioning_core::linalg::distance_squared;
use positioning_core::locator::{Locator, Position, Reception, Settings};
use positioning_core::nlos::{Feature, Features};
use positioning_core::{MAX_ANCHORS, SolveError};
use radio::RadioInstant;
use wire::telemetry::{Arrival, ArrivedFrame, Doubt, Fix, Outcome, Solver};

use clocks::{Common, Relation, STAMP_M, between_m, between_s, relation};

/// A blink is solved this long after its first report, seconds: the sync frames after it have come, and all reports.
const PATIENCE_S: f64 = 0.3;
/// Sync frames are kept for this long, seconds, and at most this many of an anchor.
const KEPT_S: f64 = 1.0;
const MAX_STAMPS: usize = 512;
/// Blinks that wait, and tags that are followed: those that were silent longest are forgotten.
const MAX_WAITING: usize = 1 << 14;
const MAX_TAGS: usize = 1 << 14;
/// A blink whose last report came longer ago than this, seconds, is another one with the same number.
const SAME_S: f64 = 10.0;
/// Anchors whose clocks are compared for a blink: the reference, and as many as a position uses.
const MAX_RECEIVED: usize = MAX_ANCHORS + 1;
/// The reference must share sync frames with this many other anchors, if some does.
const ENOUGH: usize = 3;
/// A difference beyond this share of the distance between its anchors belongs to a tag behind one of them: it hardly
/// depends on where the tag is.
const DEGENERATE: f64 = 0.98;

/// The positions of tags that blink.
#[derive(Default)]
pub struct Multilateration {
    /// The caller's clock.
    now_s: f64,
    anchors: HashMap<u16, Anchor>,
    heights_m: HashMap<u16, f32>,
    tags: HashMap<u16, Tag>,
    /// Blinks that wait, by tag and number, and in the order of their first reports.
    waiting: HashMap<(u16, u16), Blink>,
    order: VecDeque<(f64, (u16, u16))>,
    /// Blinks that were solved not long ago, with their time: late reports of them say nothing.
    solved: VecDeque<(f64, (u16, u16))>,
    known: HashSet<(u16, u16)>,
}

/// Locators are of no interest.
impl fmt::Debug for Multilateration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers = [self.anchors.len(), self.tags.len(), self.waiting.len()];
        write!(f, "Multilateration {{ anchors, tags, waiting: {numbers:?} }}")
    }
}

/// An anchor: where it is, and the sync frames that it has received and sent.
#[derive(Default)]
struct Anchor {
    position_m: Option<[f64; 3]>,
    stamps: VecDeque<Stamp>,
}

/// A sync frame at an anchor.
#[derive(Clone, Copy)]
struct Stamp {
    reported_s: f64,
    /// Who sent it, and its superframe.
    frame: (u16, u16),
    at: RadioInstant,
}

/// A blink.
#[derive(Debug)]
struct Blink {
    /// When its first report was made.
    t_s: f64,
    received: Vec<Received>,
}

/// A blink at an anchor.
#[derive(Clone, Copy, Debug)]
struct Received {
    anchor: u16,
    at: RadioInstant,
    powers_dbm: [f64; 2],
}

/// A reception to which those at other anchors are compared.
struct Reference {
    received: Received,
    position_m: [f64; 3],
    /// When its anchor received or sent each sync frame.
    sync_frames: HashMap<(u16, u16), RadioInstant>,
}

struct Tag {
    locator: Locator<'static, 0>,
    blinked_s: f64,
}

/// A blink that was solved, or could not be.
#[derive(Clone, Copy, Debug)]
pub struct Solved {
    /// Short address of the tag.
    pub tag: u16,
    /// The number of the blink, as the tag counts.
    pub number: u16,
    /// When the first anchor reported it, seconds of the caller's clock, as far as that is known.
    pub t_s: f64,
    /// Anchors that received it.
    pub received: usize,
    /// The position, or why there is none.
    pub outcome: Result<Position, SolveError>,
}

impl Solved {
    /// The same as telemetry has the end of a round, published at `t_us`, microseconds of the clock of `t_s`.
    pub fn fix(&self, t_us: u64) -> Fix {
        let (outcome, doubt) = match self.outcome {
            Ok(Position { position_m, covariance_m2, used, quality, flag, alternative_m }) => {
                (Outcome::position(position_m, covariance_m2, used, quality), Doubt::of(flag, alternative_m))
            }
            Err(reason) => (Outcome::Reason(reason), Doubt::None),
        };
        let age_us = t_us.saturating_sub(micros(self.t_s)).min(u32::MAX.into()) as u32;
        let asked = self.received.min(u8::MAX.into()) as u8;
        Fix { t_us, round: self.number, age_us, asked, outcome, solver: Solver::Track, doubt }
    }
}

fn micros(seconds: f64) -> u64 {
    (seconds.max(0.0) * 1e6) as u64
}

impl Multilateration {
    /// Sets where an anchor is, metres.
    pub fn set_anchor(&mut self, anchor: u16, position_m: [f64; 3]) {
        self.anchors.entry(anchor).or_default().position_m = Some(position_m);
    }

    /// Sets the height at which a tag is carried, metres; `None`: it is anywhere in space.
    pub fn set_height(&mut self, tag: u16, height_m: Option<f32>) {
        let before = match height_m {
            Some(height_m) => self.heights_m.insert(tag, height_m),
            None => self.heights_m.remove(&tag),
        };
        if before != height_m {
            self.tags.remove(&tag);
        }
    }

    /// Takes what `anchor` has reported at `t_s` of its clock, as far as that is known in the caller's, and what the caller
    /// has received at `now_s`, both in seconds. Reports may come in any order.
    pub fn take(&mut self, now_s: f64, t_s: f64, anchor: u16, arrival: &Arrival) {
        self.watch_clock(now_s);
        let (frame, at) = ((arrival.source, arrival.number), arrival.instant());
        match arrival.frame {
            // An anchor without a place is of no use.
            _ if !self.anchors.contains_key(&anchor) => {}
            ArrivedFrame::SyncFrame | ArrivedFrame::OwnSyncFrame => {
                let Some(Anchor { stamps, .. }) = self.anchors.get_mut(&anchor) else { return };
                while stamps.front().is_some_and(|old| stamps.len() >= MAX_STAMPS || now_s - old.reported_s > KEPT_S) {
                    stamps.pop_front();
                }
                stamps.push_back(Stamp { reported_s: now_s, frame, at });
            }
            ArrivedFrame::Blink => {
                let power = |dbm: Option<f64>| dbm.unwrap_or(f64::NAN);
                let powers_dbm = [power(arrival.rx_power_dbm()), power(arrival.first_path_power_dbm())];
                self.receive((now_s, t_s), frame, Received { anchor, at, powers_dbm });
            }
        }
    }

    /// A clock that is set back would keep everything waiting.
    fn watch_clock(&mut self, now_s: f64) {
        if now_s + PATIENCE_S < self.now_s {
            for anchor in self.anchors.values_mut() {
                anchor.stamps.clear();
            }
            (self.waiting, self.order) = (HashMap::new(), VecDeque::new());
            (self.solved, self.known) = (VecDeque::new(), HashSet::new());
        }
        self.now_s = now_s;
    }

    fn receive(&mut self, (now_s, t_s): (f64, f64), key: (u16, u16), received: Received) {
        let is_old = |(solved_s, _): &mut (f64, _)| now_s - *solved_s > SAME_S;
        while let Some((_, old)) = self.solved.pop_front_if(is_old) {
            self.known.remove(&old);
        }
        if self.known.contains(&key) {
            return;
        }
        if let Some(blink) = self.waiting.get_mut(&key) {
            let is_new = blink.received.iter().all(|known| known.anchor != received.anchor);
            if is_new && blink.received.len() < MAX_STAMPS {
                blink.received.push(received);
            }
        } else if self.waiting.len() < MAX_WAITING {
            self.waiting.insert(key, Blink { t_s, received: vec![received] });
            self.order.push_back((now_s, key));
        }
    }

    /// Solves the blinks that have waited long enough at `now_s`, in the order of their first reports.
    pub fn advance(&mut self, now_s: f64) -> Vec<Solved> {
        self.watch_clock(now_s);
        let mut solved = Vec::new();
        while let Some((_, key)) = self.order.pop_front_if(|(first_s, _)| now_s - *first_s >= PATIENCE_S) {
            let Some(blink) = self.waiting.remove(&key) else { continue };
            self.solved.push_back((now_s, key));
            self.known.insert(key);
            let (outcome, t_s) = (self.solve(key.0, &blink), blink.t_s);
            solved.push(Solved { tag: key.0, number: key.1, t_s, received: blink.received.len(), outcome });
        }
        solved
    }

    fn solve(&mut self, tag: u16, blink: &Blink) -> Result<Position, SolveError> {
        let (t_s, t_us) = (blink.t_s, micros(blink.t_s));
        let (reference, differences) = self.differences(blink);
        let reference = reference.ok_or(SolveError::TooFewAnchors)?;
        let height_m = self.heights_m.get(&tag).copied();
        self.forget_tags(tag);
        let followed = self
            .tags
            .entry(tag)
            .or_insert_with(|| Tag { locator: Locator::new(Settings::tag(height_m)), blinked_s: t_s });
        followed.blinked_s = t_s;
        let of_reference = reception(&reference);
        for (index, (other, tdoa)) in differences.iter().enumerate() {
            followed.locator.tdoa(t_us, index, *tdoa, [&of_reference, &reception(other)]);
        }
        followed.locator.end_round(t_us, differences.len()).position()
    }

    /// Makes room for a tag.
    fn forget_tags(&mut self, tag: u16) {
        if self.tags.len() < MAX_TAGS || self.tags.contains_key(&tag) {
            return;
        }
        let silent = self.tags.iter().min_by(|(_, a), (_, b)| a.blinked_s.total_cmp(&b.blinked_s));
        if let Some(silent) = silent.map(|(tag, _)| *tag) {
            self.tags.remove(&silent);
        }
    }

    /// The reference of a blink, and how much farther the tag is from each other anchor.
    fn differences(&self, blink: &Blink) -> (Option<Received>, Vec<(Received, Tdoa<f32>)>) {
        let mut received = blink.received.clone();
        received.sort_by(|a, b| b.powers_dbm[0].total_cmp(&a.powers_dbm[0]));
        received.truncate(MAX_RECEIVED);
        let mut best = (None, Vec::new());
        for reference in &received {
            let Some(reference) = self.reference(*reference) else { continue };
            let others = received.iter().filter(|other| other.anchor != reference.received.anchor);
            let differences: Vec<_> =
                others.filter_map(|other| Some((*other, self.difference(&reference, other)?))).collect();
            if differences.len() > best.1.len() {
                best = (Some(reference.received), differences);
            }
            if best.1.len() >= ENOUGH {
                break;
            }
        }
        best
    }

    /// A reception to which others are compared.
    fn reference(&self, received: Received) -> Option<Reference> {
        let Anchor { position_m, stamps } = self.anchors.get(&received.anchor)?;
        let sync_frames = stamps.iter().map(|stamp| (stamp.frame, stamp.at)).collect();
        Some(Reference { received, position_m: (*position_m)?, sync_frames })
    }

    /// How much farther the tag is from an anchor than from the reference.
    fn difference(&self, reference: &Reference, other: &Received) -> Option<Tdoa<f32>> {
        let to = self.anchors.get(&other.anchor)?;
        let (reference_m, position_m) = (reference.position_m, to.position_m?);
        let relation = self.relation(reference, (other, &to.stamps, position_m))?;
        // Clocks that agree at the blink show the same for a sync frame whose distances are counted.
        let difference_m = -relation.later_m;
        let apart_m = distance(reference_m, position_m);
        let is_degenerate = difference_m.abs() > DEGENERATE * apart_m;
        let own_m = (STAMP_M * STAMP_M + relation.variance_m2).sqrt();
        (!is_degenerate).then(|| Tdoa {
            anchor: other.anchor,
            position_m: position_m.map(|metres| metres as f32),
            reference: reference.received.anchor,
            reference_m: reference_m.map(|metres| metres as f32),
            difference_m: difference_m as f32,
            deviations_m: [STAMP_M as f32, own_m as f32],
            p_nlos: [None; 2],
        })
    }

    /// How much later than the blink, by one anchor's clock and by another's, the sync frames came that both know.
    fn relation(
        &self,
        Reference { received, position_m: reference_m, sync_frames }: &Reference,
        (other, stamps, other_m): (&Received, &VecDeque<Stamp>, [f64; 3]),
    ) -> Option<Relation> {
        let mut common: Vec<Common> = stamps
            .iter()
            .filter_map(|stamp| {
                let at = *sync_frames.get(&stamp.frame)?;
                let sender = stamp.frame.0;
                let sender_m = self.anchors.get(&sender)?.position_m?;
                let ways_m = distance(sender_m, other_m) - distance(sender_m, *reference_m);
                let is_of_one = sender == received.anchor || sender == other.anchor;
                Some(Common {
                    after_s: between_s(received.at, at),
                    later_m: between_m(other.at, stamp.at) - between_m(received.at, at) - ways_m,
                    receptions: if is_of_one { 1 } else { 2 },
                })
            })
            // Of another turn of the number of superframes.
            .filter(|common| common.after_s.abs() < KEPT_S)
            .collect();
        relation(&mut common)
    }
}

/// What an anchor's receiver measured on a blink.
fn reception(received: &Received) -> Reception {
    let [power_dbm, first_path_dbm] = received.powers_dbm.map(|dbm| dbm as f32);
    let mut features = Features::default();
    features.set(Feature::PowerDifference, power_dbm - first_path_dbm);
    Reception { features, power_dbm }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    distance_squared(&a, &b).sqrt()
}

#[cfg(test)]
mod tests;
