//! The measurements since the end of the last round, and the solution of a round by itself.

use heapless::Vec;

use super::settings::{Dimensions, Settings};
use crate::measurement::{BeaconPosition, Range, Tdoa, probability};
use crate::track::{Blocked, TdoaSample, hyperbolic};
use crate::{AnchorSet, Area, Constraints, Fix, MAX_ANCHORS, RangeSample, Real, Side, SolveError, Solver, flatten};

/// The measurements of a round.
#[derive(Clone, Debug)]
pub(super) struct Round<T> {
    pub(super) ranges: Vec<Range<T>, MAX_ANCHORS>,
    pub(super) tdoas: Vec<Tdoa<T>, MAX_ANCHORS>,
    /// The tag's position by the RSSI values of beacons.
    pub(super) by_beacons: Option<BeaconPosition<T>>,
    /// The ranges that have changed the track.
    pub(super) used: u16,
    /// Whether ranges have not been given to the track yet.
    pub(super) waits: bool,
    /// The number of measurements that were given.
    pub(super) given: usize,
    /// The number of measurements that were used.
    pub(super) taken: usize,
}

impl<T: Real> Round<T> {
    pub(super) fn new() -> Self {
        Self { ranges: Vec::new(), tdoas: Vec::new(), by_beacons: None, used: 0, waits: false, given: 0, taken: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.ranges.clear();
        self.tdoas.clear();
        self.by_beacons = None;
        self.waits = false;
        (self.used, self.given, self.taken) = (0, 0, 0);
    }

    /// Counts a measurement that was used; `place` is the index of a range in the round.
    pub(super) fn count(&mut self, place: Option<usize>) {
        self.taken = self.taken.saturating_add(1);
        if let Some(place) = place {
            self.used |= 1_u16.checked_shl(place as u32).unwrap_or(0);
        }
    }

    /// Keeps a range and returns its index in the round. Further ranges than a position can take go only to the
    /// track.
    pub(super) fn keep(&mut self, range: &Range<T>) -> Option<usize> {
        self.ranges.push(*range).is_ok().then(|| self.ranges.len() - 1)
    }

    /// The share of the measurements that were used.
    pub(super) fn quality(&self) -> T {
        if self.given == 0 { T::ZERO } else { T::count(self.taken) / T::count(self.given) }
    }

    /// The round's position.
    #[inline(never)]
    pub(super) fn solve(&self, settings: &Settings<T>) -> Result<Fix<T, 3>, SolveError> {
        if !self.ranges.is_empty() {
            return match settings.dimensions {
                Dimensions::Plane { height } => self.solve_plane(settings, height),
                Dimensions::Space { side } => self.solve_space(settings, side),
            };
        }
        if !self.tdoas.is_empty() {
            return self.solve_differences(settings);
        }
        // RSSI values do not determine the height.
        let by_beacons = self.by_beacons.as_ref().zip(settings.dimensions.height());
        by_beacons.map(|(position, height)| position.at(height)).ok_or(SolveError::TooFewAnchors)
    }

    /// The ranges that a solver gets: all of them, or those in line of sight plus enough of the least blocked ones.
    fn chosen(&self, settings: &Settings<T>) -> u16 {
        let all = ((1_u32 << self.ranges.len()) - 1) as u16;
        let Blocked::Ignore { threshold, at_least } = settings.filter.blocked else { return all };
        let direct = |place: usize| self.ranges.get(place).is_some_and(|r| probability(r.p_nlos) < threshold);
        let chosen = (0..self.ranges.len()).filter(|&place| direct(place)).fold(0_u16, |set, place| set | 1 << place);
        self.with_least_blocked(chosen, at_least.into())
    }

    /// Adds the least blocked ranges to a set until it has `enough`.
    pub(super) fn with_least_blocked(&self, mut set: u16, enough: usize) -> u16 {
        while (set.count_ones() as usize) < enough {
            let mut least: Option<(usize, T)> = None;
            for (place, range) in self.ranges.iter().enumerate() {
                let blocked = probability(range.p_nlos);
                if set >> place & 1 == 0 && least.is_none_or(|(_, other)| blocked < other) {
                    least = Some((place, blocked));
                }
            }
            let Some((place, _)) = least else { break };
            set |= 1 << place;
        }
        set
    }

    #[inline(never)]
    fn solve_plane(&self, settings: &Settings<T>, height: T) -> Result<Fix<T, 3>, SolveError> {
        let area = settings.area.map(|area| Area { min: [area.min[0], area.min[1]], max: [area.max[0], area.max[1]] });
        let fix =
            self.solve_in(settings, settings.solvers.plane, &Constraints { side: Side::Unknown, area }, |range| {
                let distance = flatten(length(range, settings), range.position_m[2] - height);
                RangeSample::new([range.position_m[0], range.position_m[1]], distance)
            })?;
        let [x, y] = fix.position;
        let mut covariance = [[T::ZERO; 3]; 3];
        for (row, of) in covariance.iter_mut().zip(&fix.covariance) {
            [row[0], row[1]] = *of;
        }
        let [dx, dy] = fix.dilution_of_precision;
        Ok(Fix {
            position: [x, y, height],
            covariance,
            dilution_of_precision: [dx, dy, T::ZERO],
            used: fix.used,
            quality: fix.quality,
        })
    }

    #[inline(never)]
    fn solve_space(&self, settings: &Settings<T>, side: Side<T, 3>) -> Result<Fix<T, 3>, SolveError> {
        self.solve_in(settings, settings.solvers.space, &Constraints { side, area: settings.area }, |range| {
            RangeSample::new(range.position_m, length(range, settings))
        })
    }

    fn solve_in<const D: usize>(
        &self,
        settings: &Settings<T>,
        solver: Solver<T, D>,
        constraints: &Constraints<T, D>,
        sample: impl Fn(&Range<T>) -> RangeSample<T, D>,
    ) -> Result<Fix<T, D>, SolveError> {
        let chosen = self.chosen(settings);
        let mut samples: Vec<RangeSample<T, D>, MAX_ANCHORS> = Vec::new();
        for (place, range) in self.ranges.iter().enumerate() {
            if chosen >> place & 1 == 1 {
                // There is room for as many samples as ranges.
                let _ = samples.push(RangeSample { sigma: deviation(range, settings), ..sample(range) });
            }
        }
        let mut fix = solver(&samples, constraints)?;
        fix.used = spread(fix.used, chosen);
        Ok(fix)
    }

    #[inline(never)]
    fn solve_differences(&self, settings: &Settings<T>) -> Result<Fix<T, 3>, SolveError> {
        let Some(first) = self.tdoas.first() else { return Err(SolveError::TooFewAnchors) };
        let mut samples: Vec<TdoaSample<T>, MAX_ANCHORS> = Vec::new();
        for tdoa in self.tdoas.iter().filter(|tdoa| tdoa.reference == first.reference) {
            let sigma = white(settings, tdoa.deviations_m[1], probability(tdoa.p_nlos[1]));
            let _ = samples.push(TdoaSample { anchor: tdoa.position_m, difference: tdoa.difference_m, sigma });
        }
        let sigma = white(settings, first.deviations_m[0], probability(first.p_nlos[0]));
        let start = match settings.dimensions {
            Dimensions::Space { side: Side::Of(point) } => Some(point),
            Dimensions::Space { side: Side::Unknown } | Dimensions::Plane { .. } => None,
        };
        let mut fix = hyperbolic(&samples, first.reference_m, sigma, settings.dimensions.height(), start)?;
        // Hyperbolas do not know the area. If the position is outside it, the nearest position inside is taken.
        fix.position = Constraints { side: Side::Unknown, area: settings.area }.inside(fix.position);
        Ok(fix)
    }
}

/// Moves the bits of `used`, which number the members of `chosen`, to their indices among all ranges.
fn spread(used: AnchorSet, chosen: u16) -> AnchorSet {
    let members = (0..16_usize).filter(|place| chosen >> place & 1 == 1);
    AnchorSet(members.enumerate().filter(|(k, _)| used.contains(*k)).fold(0, |set, (_, place)| set | 1 << place))
}

/// The length of a range as it is used.
pub(super) fn length<T: Real>(range: &Range<T>, settings: &Settings<T>) -> T {
    let excess = if settings.mitigate { range.excess_m.unwrap_or(T::ZERO) } else { T::ZERO };
    range.distance_m - excess
}

/// The deviation of a single range with all its errors.
fn deviation<T: Real>(range: &Range<T>, settings: &Settings<T>) -> T {
    white(settings, range.deviation_m, probability(range.p_nlos))
}

fn white<T: Real>(settings: &Settings<T>, own: T, blocked: T) -> T {
    let noise = &settings.filter.noise;
    // An unknown probability adds no variance here. It would not weigh one range against another, and a round by
    // itself does not need it.
    let both = |blocked: T| {
        let blocked = Some(blocked);
        let variance = noise.noise_variance(own.squared(), blocked) + noise.link_variance(blocked);
        // Exactly as given where there is nothing to add.
        if variance > own.squared() { variance.sqrt() } else { own }
    };
    match settings.filter.blocked {
        Blocked::TwoVariances { threshold, direct_m2, blocked_m2 } => {
            if blocked >= threshold {
                blocked_m2.sqrt()
            } else {
                direct_m2.sqrt()
            }
        }
        Blocked::Alike => both(T::ZERO),
        Blocked::Ignore { .. } | Blocked::Weigh => both(blocked),
    }
}
