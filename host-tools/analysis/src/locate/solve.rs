//! One fix for each epoch, without memory between epochs: the tag's own solver, in the tag's own `f32`.
//!
//! Coordinates are taken relative to the middle of the anchors before they become `f32`. So a site grid with a distant
//! origin does not lose digits.

use std::sync::{Mutex, PoisonError};
use std::thread;

use positioning_core::nlos::Classifier as _;
use positioning_core::{
    Alternative, Area, Constraints, Fix, MAX_ANCHORS, Method, POWER_DIFFERENCE_PRIOR, RangeSample, Side, SolveError,
};

use recording::{Anchor, Coordinates, Epoch, Epochs, Half, Height, Measured, NoPosition, Position, Solved, Space};

/// A thread takes this number of epochs at once: some milliseconds of work.
const AT_ONCE: usize = 1024;

/// How to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup {
    /// The space.
    pub space: Space,
    /// Standard deviation of the height in the plane, metres; 0: it is exact.
    pub height_sigma_m: f64,
    /// The area in which the tag can be: least and greatest x and y, metres.
    pub area_m: Option<[[f64; 2]; 2]>,
}

impl Setup {
    /// With an exact height, and nothing known of the area.
    pub fn of(space: Space) -> Self {
        Self { space, height_sigma_m: 0.0, area_m: None }
    }
}

/// An alternative of a node's `f32`.
pub(crate) fn double(Alternative { apart, share }: Alternative<f32, 3>) -> Alternative<f64, 3> {
    Alternative { apart: apart.map(f64::from), share: share.into() }
}

/// Solves one epoch after another with the same anchors.
#[derive(Debug)]
pub struct Solver<'a> {
    anchors: &'a [Anchor],
    setup: Setup,
    /// The solver's origin of coordinates, metres.
    origin: [f64; 3],
}

impl<'a> Solver<'a> {
    /// A solver for these anchors.
    pub fn new(anchors: &'a [Anchor], setup: Setup) -> Self {
        Self { anchors, setup, origin: middle_m(anchors) }
    }

    /// The position of one epoch by `method`, and its error where the true position is known.
    pub fn solve(&self, method: Method, epoch: &Epoch) -> Solved {
        let outcome = match self.setup.space {
            _ if epoch.ranges.is_empty() => Err(NoPosition::SolveError(SolveError::TooFewAnchors)),
            Space::Plane(height) => self.in_plane(method, epoch, height),
            Space::Full(half) => self.in_space(method, epoch, half),
        };
        Solved::of(outcome, epoch.truth)
    }

    /// The positions of epochs by `method`, in their order. All processors work on them; `step` is called with the
    /// number of those that are done, from any thread.
    pub fn solve_all(&self, method: Method, epochs: &Epochs, step: impl Fn(usize) + Sync) -> Vec<Solved> {
        let unsolved = Solved { outcome: Err(NoPosition::SolveError(SolveError::TooFewAnchors)), error_m: None };
        let mut solved = vec![unsolved; epochs.len()];
        let threads = thread::available_parallelism().map_or(1, usize::from).min(epochs.len().div_ceil(AT_ONCE));
        let parts = Mutex::new(solved.chunks_mut(AT_ONCE).enumerate());
        let work = || {
            // A thread that panics ends the scope with its panic, so what it leaves is not used.
            let next = || parts.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some((part, solved)) = next() {
                for (at, solved) in solved.iter_mut().enumerate() {
                    if let Some(epoch) = epochs.get(part * AT_ONCE + at) {
                        *solved = self.solve(method, &epoch);
                    }
                }
                step(solved.len());
            }
        };
        thread::scope(|scope| {
            (1..threads).for_each(|_| drop(scope.spawn(work)));
            work();
        });
        solved
    }

    fn in_plane(&self, method: Method, epoch: &Epoch, height: Height) -> Result<Position, NoPosition> {
        let tag_z = match height {
            Height::Unknown => None,
            Height::Fixed(z) => Some(z),
            Height::FromTruth => Some(epoch.truth.and_then(|truth| truth.z_m).ok_or(NoPosition::HeightUnknown)?),
        };
        let of = |measured: Measured| {
            let place = &self.anchors.get(measured.anchor)?.place;
            let anchor = [self.local(0, place.x_m), self.local(1, place.y_m)];
            let slant = sample(&measured, anchor, measured.range_m as f32);
            Some(match tag_z {
                Some(tag_z) => slant.flattened((place.z_m? - tag_z) as f32, self.setup.height_sigma_m as f32),
                None => slant,
            })
        };
        let area = self.setup.area_m.map(|corners| {
            let [min, max] = corners.map(|[x, y]| [self.local(0, x), self.local(1, y)]);
            Area { min, max }
        });
        let constraints = Constraints { side: Side::Unknown, area };
        let fix = solve(method, epoch.ranges.iter().filter_map(of), &constraints)?;
        let [sigma_x, sigma_y] = fix.sigma().map(f64::from);
        Ok(Position {
            place: Coordinates {
                x_m: self.global(0, fix.position[0]),
                y_m: self.global(1, fix.position[1]),
                z_m: None,
            },
            sigma: Coordinates { x_m: sigma_x, y_m: sigma_y, z_m: None },
            covariance_xy: fix.covariance[0][1].into(),
            covariance_z: None,
            velocity_m_s: None,
            used: fix.used.len(),
            alternative: fix.alternative.map(|Alternative { apart: [x, y], share }| Alternative {
                apart: [x.into(), y.into(), 0.0],
                share: share.into(),
            }),
            flag: fix.flag(epoch.ranges.len()),
        })
    }

    fn in_space(&self, method: Method, epoch: &Epoch, half: Option<Half>) -> Result<Position, NoPosition> {
        /// Farther below or above than any anchor, metres.
        const AWAY_M: f32 = 1.0e4;
        let of = |measured: Measured| {
            let place = &self.anchors.get(measured.anchor)?.place;
            let anchor = [self.local(0, place.x_m), self.local(1, place.y_m), self.local(2, place.z_m?)];
            Some(sample(&measured, anchor, measured.range_m as f32))
        };
        let side = match half {
            None => Side::Unknown,
            Some(Half::Below) => Side::Of([0.0, 0.0, -AWAY_M]),
            Some(Half::Above) => Side::Of([0.0, 0.0, AWAY_M]),
        };
        let area = self.setup.area_m.map(|[least, greatest]| Area {
            min: [self.local(0, least[0]), self.local(1, least[1]), f32::NEG_INFINITY],
            max: [self.local(0, greatest[0]), self.local(1, greatest[1]), f32::INFINITY],
        });
        let fix = solve(method, epoch.ranges.iter().filter_map(of), &Constraints { side, area })?;
        let [x_m, y_m, z_m] = std::array::from_fn(|axis| self.global(axis, fix.position[axis]));
        let [sigma_x, sigma_y, sigma_z] = fix.sigma().map(f64::from);
        Ok(Position {
            place: Coordinates { x_m, y_m, z_m: Some(z_m) },
            sigma: Coordinates { x_m: sigma_x, y_m: sigma_y, z_m: Some(sigma_z) },
            covariance_xy: fix.covariance[0][1].into(),
            covariance_z: Some([fix.covariance[0][2], fix.covariance[1][2]].map(f64::from)),
            velocity_m_s: None,
            used: fix.used.len(),
            alternative: fix.alternative.map(double),
            flag: fix.flag(epoch.ranges.len()),
        })
    }

    fn local(&self, axis: usize, coordinate: f64) -> f32 {
        (coordinate - self.origin[axis]) as f32
    }

    fn global(&self, axis: usize, coordinate: f32) -> f64 {
        f64::from(coordinate) + self.origin[axis]
    }
}

/// The middle of the anchors, metres. It is zero along an axis without known coordinates.
pub(crate) fn middle_m(anchors: &[Anchor]) -> [f64; 3] {
    let middle = |coordinate: fn(&Coordinates) -> Option<f64>| {
        let (least, greatest) = anchors
            .iter()
            .filter_map(|anchor| coordinate(&anchor.place))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), c| (least.min(c), greatest.max(c)));
        if least <= greatest { 0.5 * least + 0.5 * greatest } else { 0.0 }
    };
    [middle(|p| Some(p.x_m)), middle(|p| Some(p.y_m)), middle(|p| p.z_m)]
}

/// A range as a sample of a solver. Its powers, where they are known, say how probably its link is blocked.
fn sample<const D: usize>(measured: &Measured, anchor: [f32; D], range_m: f32) -> RangeSample<f32, D> {
    let by_powers = POWER_DIFFERENCE_PRIOR.nlos_probability(&measured.diagnostics.features);
    RangeSample { los: measured.line_of_sight, ..RangeSample::new(anchor, range_m).with_p_nlos(by_powers) }
}

/// Solves with the shortest ranges where there are more than a fix can take, because a blocked range is too long.
fn solve<const D: usize>(
    method: Method,
    samples: impl Iterator<Item = RangeSample<f32, D>>,
    constraints: &Constraints<f32, D>,
) -> Result<Fix<f32, D>, NoPosition> {
    let mut samples: Vec<_> = samples.collect();
    if samples.len() > MAX_ANCHORS {
        samples.sort_by(|a, b| a.range.total_cmp(&b.range));
        samples.truncate(MAX_ANCHORS);
    }
    positioning_core::solve(method, &samples, constraints).map_err(NoPosition::SolveError)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use positioning_core::{Method, SolveError};

    use super::{AT_ONCE, Height, NoPosition, Setup, Solver, Space};
    use recording::Diagnostics;
    use recording::{Anchor, Coordinates, Epochs, Measured};

    #[test]
    fn each_epoch_gets_its_own_position_whichever_thread_solves_it() {
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]];
        let place = |[x_m, y_m]: [f64; 2]| Coordinates { x_m, y_m, z_m: None };
        let anchors = corners.map(|at_m| Anchor { name: String::new(), place: place(at_m) });
        // A walk along x. Every tenth epoch has no ranges.
        let x_m = |at: usize| 1.0 + at as f64 * 1.0e-3;
        let mut epochs = Epochs::default();
        for at in 0..3 * AT_ONCE + 7 {
            let tag = place([x_m(at), 3.0]);
            epochs.push("", None, Some(tag));
            for (anchor, Anchor { place, .. }) in anchors.iter().enumerate().filter(|_| at % 10 != 0) {
                let range_m = place.horizontal_m(&tag);
                let diagnostics = Diagnostics::default();
                epochs.push_range(&Measured { anchor, range_m, t_s: None, line_of_sight: None, diagnostics });
            }
        }
        let solver = Solver::new(&anchors, Setup::of(Space::Plane(Height::Unknown)));
        let done = AtomicUsize::new(0);
        let solved = solver.solve_all(Method::Robust, &epochs, |epochs| {
            done.fetch_add(epochs, Ordering::Relaxed);
        });
        assert_eq!((solved.len(), done.into_inner()), (epochs.len(), epochs.len()));
        for (at, solved) in solved.iter().enumerate() {
            match solved.outcome {
                Ok(position) => assert!((position.place.x_m - x_m(at)).abs() < 1.0e-4, "{at}: {position:?}"),
                Err(reason) => assert_eq!((at % 10, reason), (0, NoPosition::SolveError(SolveError::TooFewAnchors))),
            }
        }
    }
}
