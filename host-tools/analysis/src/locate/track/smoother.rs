//! What a tracker's locator knew at each time, and what it knows of these times in the end: a Rauch-Tung-Striebel
//! smoother over the states of the engine (position, velocity, common error, errors of links).
//!
//! Forwards, the history looks at the locator before and after each measurement. A time is a node: mean and covariance
//! after the measurements of that time, and how the next node is predicted from it. Measurements change a node and need
//! no way back. Links are predicted when they are measured; a prediction of one link and a measurement of another can
//! change places, so all of them belong to the transition to the node. A link that got another error, and a track that
//! was started, have no state before.
//!
//! Each of two hypotheses is a chain of nodes. Where the second one won, its positions count from its beginning on, and
//! the track before ends there. Where both live at the end, the position is that of the likelier one.

use std::collections::{HashMap, HashSet};

use nalgebra::{DMatrix, DVector};
use positioning_core::Alternative;
use positioning_core::engine::{Hypothesis, LinkState, Verdict};
use positioning_core::locator::{Locator, TagUpdate};

use super::rts::{Gaussian, smoothed};

/// The states of position and velocity.
const MOTION: usize = 6;
/// The index of the first velocity.
const VELOCITY: usize = 3;

/// The share of the later measurements' information that the earlier ones had already: links err alike for longer than
/// the engine models, so both do not count in full. It widens the covariance and leaves the position.
const ALIKE: f64 = 0.5;

/// What the locator knew at a time.
struct Node {
    chain: usize,
    /// The node before; `None` where a track starts.
    before: Option<usize>,
    from_before: Transition,
    means: Box<[f32]>,
    /// The lower triangle of the covariance, row by row.
    covariance: Box<[f32]>,
}

/// How a node is predicted from the one before.
#[derive(Default)]
struct Transition {
    dt_s: f64,
    /// The covariance of position and velocity at the end, by the motion alone; `None` where no time has passed.
    motion: Option<Box<[[f32; MOTION]; MOTION]>>,
    /// The links that were measured at the end: state, part that is kept, mean and variance of the prior.
    links: Vec<(usize, f64, [f64; 2])>,
}

/// A hypothesis that goes on: its chain, the node before, and the transition from that up to now.
struct Open {
    chain: usize,
    before: Option<usize>,
    transition: Transition,
}

/// A chain of nodes.
struct Chain {
    /// The probability of a rival in the end: 1 if it has won, 0 if it has lost.
    share: f64,
    /// The node of the track when this chain began as its rival.
    began_beside: Option<usize>,
}

/// The history of a locator.
#[derive(Default)]
pub(super) struct History {
    nodes: Vec<Node>,
    chains: Vec<Chain>,
    /// The track and its rival.
    open: [Option<Open>; 2],
    /// The nodes of track and rival at the end of each epoch.
    epochs: Vec<[Option<usize>; 2]>,
    /// Nodes after which their track was wrong.
    last_right: HashSet<usize>,
    /// Whether there was a measurement since the last node.
    measured: bool,
}

/// Position, velocity and the position's covariance.
#[derive(Clone, Copy)]
pub(super) struct Smoothed {
    pub(super) position: [f64; 3],
    pub(super) velocity: [f64; 3],
    pub(super) covariance: [[f64; 3]; 3],
    /// The variance of the height by the filter, m².
    pub(super) filtered_zz: f64,
    /// The other place, where two hypotheses are left.
    pub(super) alternative: Option<Alternative<f64, 3>>,
}

impl History {
    /// The next epoch begins.
    pub(super) fn begin_epoch(&mut self) {
        self.epochs.push([None; 2]);
    }

    /// Gives a measurement of this time to the locator, and follows what it does to the states.
    pub(super) fn observe<'a>(
        &mut self,
        locator: &mut Locator<'a, 0>,
        t_us: u64,
        measure: impl FnOnce(&mut Locator<'a, 0>) -> Verdict,
    ) {
        self.advance(locator, t_us);
        let before = links(locator);
        let verdict = measure(locator);
        self.follow_links(locator, &before, verdict == Verdict::Readmitted);
    }

    /// Ends the epoch.
    pub(super) fn end_round(&mut self, locator: &mut Locator<'_, 0>, t_us: u64, measured: usize) -> TagUpdate {
        self.advance(locator, t_us);
        let (before, links) = (locator.hypotheses().map(|of| of.map(|(state, _)| key(&state))), links(locator));
        let update = locator.end_round(t_us, measured);
        self.follow_links(locator, &links, false);
        let [track, rival] = locator.hypotheses();
        let Some((track, _)) = track else {
            self.open = [None, None];
            return update;
        };
        let here = key(&track);
        if is_new(&track) || before[0].is_none() {
            self.open = [Some(self.begin(None)), None];
        } else if let ([Some(was), Some(other)], None) = (before, rival)
            && square(&here, &other) < square(&here, &was)
        {
            self.rival_has_won();
        }
        if rival.is_none() {
            self.open[1] = None;
        } else if self.open[1].is_none() || rival.is_some_and(|(rival, _)| is_new(&rival)) {
            self.open[1] = Some(self.begin(self.nodes.len().into()));
        }
        self.close(locator);
        if let Some(epoch) = self.epochs.last_mut() {
            *epoch = [0, 1].map(|of| self.open.get(of)?.as_ref()?.before);
        }
        update
    }

    fn begin(&mut self, began_beside: Option<usize>) -> Open {
        self.chains.push(Chain { share: 0.0, began_beside });
        Open { chain: self.chains.len() - 1, before: None, transition: Transition::default() }
    }

    /// Follows the rival as the track.
    fn rival_has_won(&mut self) {
        self.open.swap(0, 1);
        self.open[1] = None;
        if let Some(chain) = self.open[0].as_ref().and_then(|open| self.chains.get_mut(open.chain)) {
            chain.share = 1.0;
            self.last_right.extend(chain.began_beside);
        }
    }

    /// Adds the nodes of this time.
    fn close(&mut self, locator: &Locator<'_, 0>) {
        for (open, state) in self.open.iter_mut().zip(locator.hypotheses()) {
            let (Some(open), Some((state, _))) = (open, state) else { continue };
            let means: Box<[f32]> = state.means().into();
            let covariance = (0..means.len()).flat_map(|r| (0..=r).map(move |c| (r, c)));
            let covariance = covariance.map(|(r, c)| state.covariance(r, c)).collect();
            let from_before = std::mem::take(&mut open.transition);
            self.nodes.push(Node { chain: open.chain, before: open.before, from_before, means, covariance });
            open.before = Some(self.nodes.len() - 1);
        }
        self.measured = false;
    }

    /// Predicts the locator to a time.
    fn advance(&mut self, locator: &mut Locator<'_, 0>, t_us: u64) {
        let then_us = locator.hypotheses()[0].map_or(t_us, |(track, _)| track.t_us());
        if then_us < t_us && self.measured {
            self.close(locator);
        }
        locator.advance(t_us);
        for (open, state) in self.open.iter_mut().zip(locator.hypotheses()) {
            match (open.as_mut(), state) {
                (Some(open), Some((state, _))) if state.t_us() > then_us => {
                    let motion = std::array::from_fn(|r| std::array::from_fn(|c| state.covariance(r, c)));
                    open.transition.dt_s += (state.t_us() - then_us) as f64 * 1.0e-6;
                    open.transition.motion = Some(Box::new(motion));
                }
                (Some(_), Some(_)) => {}
                (_, None) | (None, _) => *open = None,
            }
        }
    }

    /// Notes which links have been predicted to the present since they were like this.
    fn follow_links(&mut self, locator: &Locator<'_, 0>, before: &[Vec<LinkState<f32>>; 2], renewed: bool) {
        self.measured = true;
        for ((open, state), before) in self.open.iter_mut().zip(locator.hypotheses()).zip(before) {
            let (Some(open), Some((state, _))) = (open, state) else { continue };
            for link in state.links() {
                let was = before.iter().find(|was| (was.state, was.anchor) == (link.state, link.anchor));
                let (kept, prior) = match was {
                    Some(was) if was.measured_us == link.measured_us => continue,
                    Some(was) if !renewed => (was.kept.into(), was.prior),
                    Some(_) | None => (0.0, link.prior),
                };
                open.transition.links.push((link.state, kept, prior.map(f64::from)));
            }
        }
    }

    /// The states at the ends of the epochs by all measurements. `locator` is at the end of the last one.
    pub(super) fn smoothed(mut self, locator: &Locator<'_, 0>) -> Vec<Option<Smoothed>> {
        if let ([_, Some(open)], [_, Some((_, share))]) = (&self.open, locator.hypotheses())
            && let Some(chain) = self.chains.get_mut(open.chain)
        {
            chain.share = share.into();
        }
        let mut found: Vec<Option<Smoothed>> = vec![None; self.nodes.len()];
        let mut by_later: HashMap<usize, Gaussian> = HashMap::new();
        for (at, node) in self.nodes.iter().enumerate().rev() {
            let filtered = node.filtered();
            let state = by_later.remove(&at).unwrap_or_else(|| filtered.clone());
            found[at] = Some(Smoothed::of(&state, &filtered));
            let before = node.before.filter(|before| !self.last_right.contains(before));
            if let Some((before, earlier)) =
                before.and_then(|before| Some((before, self.nodes.get(before)?.filtered())))
            {
                let (transition, predicted) = node.predicted(&earlier);
                let earlier = smoothed(&earlier, &transition, &predicted, &state);
                by_later.extend(earlier.filter(is_finite).map(|state| (before, state)));
            }
        }
        let of_epoch = |[track, rival]: &[Option<usize>; 2]| {
            let track = found[(*track)?]?;
            let Some(rival) = *rival else { return Some(track) };
            let share = self.chains.get(self.nodes.get(rival)?.chain)?.share;
            Some(track.or(&found[rival]?, share))
        };
        self.epochs.iter().map(of_epoch).collect()
    }
}

impl Node {
    fn filtered(&self) -> Gaussian {
        let states = self.means.len();
        let covariance = DMatrix::from_fn(states, states, |r, c| {
            let (low, high) = (r.min(c), r.max(c));
            f64::from(self.covariance[high * (high + 1) / 2 + low])
        });
        Gaussian { mean: DVector::from_iterator(states, self.means.iter().map(|mean| f64::from(*mean))), covariance }
    }

    /// The transition from the node before to this one, and this one's state as predicted by it.
    fn predicted(&self, before: &Gaussian) -> (DMatrix<f64>, Gaussian) {
        let Transition { dt_s, motion, links } = &self.from_before;
        let mut transition = DMatrix::identity(self.means.len(), before.mean.len());
        for axis in 0..VELOCITY {
            transition[(axis, VELOCITY + axis)] = *dt_s;
        }
        for (state, kept, _) in links.iter().filter(|(state, ..)| *state < before.mean.len()) {
            transition[(*state, *state)] *= kept;
        }
        let mut mean = &transition * &before.mean;
        let mut covariance = &transition * &before.covariance * transition.transpose();
        for (r, row) in motion.iter().flat_map(|rows| rows.iter().enumerate()) {
            row.iter().enumerate().for_each(|(c, element)| covariance[(r, c)] = f64::from(*element));
        }
        for (state, kept, [prior, variance]) in links {
            mean[*state] += (1.0 - kept) * prior;
            covariance[(*state, *state)] += (1.0 - kept * kept) * variance;
        }
        (transition, Gaussian { mean, covariance })
    }
}

impl Smoothed {
    fn of(state: &Gaussian, filtered: &Gaussian) -> Self {
        let part = |first: usize| std::array::from_fn(|axis| state.mean[first + axis]);
        let element = |r, c| {
            let (by_all, by_earlier): (f64, f64) = (state.covariance[(r, c)], filtered.covariance[(r, c)]);
            by_all + ALIKE * (by_earlier - by_all)
        };
        Self {
            position: part(0),
            velocity: part(VELOCITY),
            covariance: std::array::from_fn(|r| std::array::from_fn(|c| element(r, c))),
            filtered_zz: filtered.covariance[(2, 2)],
            alternative: None,
        }
    }

    /// The likelier of this place and another with its probability. The covariance reaches from it to the other.
    fn or(&self, other: &Self, share: f64) -> Self {
        let ([likelier, other], share) =
            if share > 0.5 { ([other, self], 1.0 - share) } else { ([self, other], share) };
        if share <= 0.0 {
            return *likelier;
        }
        let apart: [f64; 3] = std::array::from_fn(|axis| other.position[axis] - likelier.position[axis]);
        let reaching = |r: usize, c: usize| {
            let [own, others] = [likelier, other].map(|place| place.covariance[r][c]);
            own + share * (others - own + apart[r] * apart[c])
        };
        let covariance = std::array::from_fn(|r| std::array::from_fn(|c| reaching(r, c)));
        Self { covariance, alternative: Some(Alternative { apart, share }), ..*likelier }
    }
}

fn links(locator: &Locator<'_, 0>) -> [Vec<LinkState<f32>>; 2] {
    locator.hypotheses().map(|of| of.map_or_else(Vec::new, |(state, _)| state.links().collect()))
}

/// Position and velocity, by which a hypothesis is found again.
fn key(state: &Hypothesis<'_, f32>) -> [f32; MOTION] {
    std::array::from_fn(|index| state.means().get(index).copied().unwrap_or(0.0))
}

fn square(one: &[f32; MOTION], other: &[f32; MOTION]) -> f32 {
    one.iter().zip(other).map(|(one, other)| (one - other) * (one - other)).sum()
}

/// Whether a hypothesis was started at its present time: its velocity is not known, and no position tells it.
fn is_new(state: &Hypothesis<'_, f32>) -> bool {
    let is_apart = |axis: usize| state.covariance(axis, VELOCITY + axis) == 0.0;
    key(state)[VELOCITY..].iter().all(|velocity| *velocity == 0.0) && (0..2).all(is_apart)
}

fn is_finite(state: &Gaussian) -> bool {
    let variances = state.covariance.diagonal();
    state.mean.iter().all(|mean| mean.is_finite())
        && variances.iter().all(|variance| variance.is_finite() && *variance >= -1e-9)
}
