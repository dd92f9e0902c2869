//! The measurements since the end of the last round, and the solution of a round by itself.

use heapless::Vec;

use super::settings::{Dimensions, Settings};
use crate::geometry::{Plane, plane_of};
use crate::linalg::{add_scaled, dot, sub};
use crate::measurement::{BeaconPosition, Range, Tdoa, probability};
use crate::track::state::State;
use crate::track::{Blocked, TdoaSample, hyperbolic};
use crate::{Alternative, AnchorSet, Area, Constraints, Fix, MAX_ANCHORS, RangeSample, Real, Side, SolveError, Solver};

/// A range of an earlier round helps to solve a round with too few ranges for this time, microseconds: a person walks a
/// metre meanwhile.
const RECENT_US: u64 = 1_000_000;

/// A plane is level if the upward part of its unit normal exceeds this: within 14°.
const LEVEL: f64 = 0.97;

/// A range of this round, or of one shortly before.
#[derive(Clone, Copy, Debug)]
struct Kept<T> {
    range: Range<T>,
    t_us: u64,
    /// Its index in this round; `None`: it is of an earlier one.
    place: Option<u8>,
}

/// The line or plane near which the anchors of a round lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mirror<T> {
    /// The middle of the anchors, metres.
    centre: [T; 3],
    /// Its unit normal, towards the side that solvers take.
    normal: [T; 3],
    /// Whether tags are on that side: the side is known, or the plane is level, and anchors hang higher than tags.
    pub(super) one_sided: bool,
    /// Whether all of the round's anchors lie near it.
    pub(super) is_of_all: bool,
}

impl<T: Real> Mirror<T> {
    /// The same, where other anchors do not lie near it.
    pub(super) fn of_some(self) -> Self {
        Self { is_of_all: false, ..self }
    }

    /// The distance of a place from it, metres; positive on the side that solvers take.
    pub(super) fn off(&self, place: &[T; 3]) -> T {
        dot(&self.normal, &sub(place, &self.centre))
    }

    /// The mirror image of a place.
    pub(super) fn image(&self, place: &[T; 3]) -> [T; 3] {
        add_scaled(place, T::of(-2.0) * self.off(place), &self.normal)
    }

    /// Turns a state into its mirror image.
    pub(super) fn reflect(&self, state: &mut State<T>) {
        state.reflect(&self.centre, &self.normal);
    }
}

/// The measurements of a round.
#[derive(Clone, Debug)]
pub(super) struct Round<T> {
    /// The nearest sixteen.
    ranges: Vec<Kept<T>, MAX_ANCHORS>,
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
    /// The number of ranges that were given.
    ranged: u8,
    /// The number of ranges since the hypotheses were compared.
    pub(super) unjudged: usize,
    /// Whether an anchor has been ranged twice since the ranges were last dropped.
    repeats: bool,
}

impl<T: Real> Round<T> {
    pub(super) fn new() -> Self {
        Self {
            ranges: Vec::new(),
            tdoas: Vec::new(),
            by_beacons: None,
            used: 0,
            waits: false,
            given: 0,
            taken: 0,
            ranged: 0,
            unjudged: 0,
            repeats: false,
        }
    }

    /// Drops all measurements.
    pub(super) fn clear(&mut self) {
        self.ranges.clear();
        self.repeats = false;
        self.end();
    }

    /// Begins the next round; the ranges stay for it.
    pub(super) fn end(&mut self) {
        self.ranges.iter_mut().for_each(|kept| kept.place = None);
        self.tdoas.clear();
        self.by_beacons = None;
        self.waits = false;
        self.ranged = 0;
        (self.used, self.given, self.taken) = (0, 0, 0);
    }

    /// Whether the kept ranges are as many as a round with one to spare, or all that there are.
    pub(super) fn is_complete(&self, dimensions: &Dimensions<T>) -> bool {
        let least = if dimensions.height().is_some() { 4 } else { 5 };
        self.repeats || self.ranges.len() >= least || !self.tdoas.is_empty()
    }

    /// Counts a measurement that was used; `place` is the index of a range in the round.
    pub(super) fn count(&mut self, place: Option<usize>) {
        self.taken = self.taken.saturating_add(1);
        if let Some(place) = place {
            self.used |= bit(place);
        }
    }

    /// Keeps a range for the solver, which takes the nearest sixteen, and returns its index in the round. A recent
    /// range to the same anchor in an earlier round makes room.
    pub(super) fn keep(&mut self, range: &Range<T>, t_us: u64) -> usize {
        let place = self.ranged;
        self.ranged = self.ranged.saturating_add(1);
        self.unjudged = self.unjudged.saturating_add(1);
        let before = self.ranges.len();
        self.ranges.retain(|kept| {
            let recent = t_us.saturating_sub(kept.t_us) <= RECENT_US;
            kept.place.is_some() || recent && kept.range.anchor != range.anchor
        });
        self.repeats |= self.ranges.len() < before;
        let kept = Kept { range: *range, t_us, place: Some(place) };
        if self.ranges.push(kept).is_err() {
            let farther = |a: &&mut Kept<T>, b: &&mut Kept<T>| {
                a.range.distance_m.partial_cmp(&b.range.distance_m).unwrap_or(core::cmp::Ordering::Equal)
            };
            if let Some(farthest) = self.ranges.iter_mut().max_by(farther)
                && range.distance_m < farthest.range.distance_m
            {
                *farthest = kept;
            }
        }
        place.into()
    }

    /// The ranges that a solver gets.
    pub(super) fn ranges(&self) -> impl Iterator<Item = &Range<T>> + Clone {
        self.ranges.iter().map(|kept| &kept.range)
    }

    /// The kept range of this index, with its index in this round, if it is of this round.
    pub(super) fn given_range(&self, index: usize) -> Option<(usize, Range<T>)> {
        let kept = self.ranges.get(index)?;
        Some((kept.place?.into(), kept.range))
    }

    /// Counts all measurements as used.
    pub(super) fn count_all(&mut self) {
        let places = self.ranges.iter().filter_map(|kept| kept.place);
        self.used = places.fold(0, |set, place| set | bit(place.into()));
        self.taken = self.used.count_ones() as usize + self.tdoas.len();
        self.unjudged = 0;
    }

    /// The share of the measurements that were used.
    pub(super) fn quality(&self) -> T {
        if self.given == 0 { T::ZERO } else { T::count(self.taken) / T::count(self.given) }
    }

    /// The line (in the plane) or plane (in space) near which the anchors lie that count; `None` where they are spread.
    pub(super) fn mirror(&self, dimensions: &Dimensions<T>, counts: &dyn Fn(&Range<T>) -> bool) -> Option<Mirror<T>> {
        let places = self.ranges().filter(|range| counts(range)).map(|range| range.position_m);
        match dimensions {
            Dimensions::Plane { height } => {
                let Plane { centre: [x, y], normal: [across_x, across_y], .. } =
                    plane_of(places.map(|[x, y, _]| [x, y]))?;
                Some(Mirror {
                    centre: [x, y, *height],
                    normal: [across_x, across_y, T::ZERO],
                    one_sided: false,
                    is_of_all: true,
                })
            }
            Dimensions::Space { side } => {
                let Plane { centre, normal, is_exact } = plane_of(places)?;
                let (towards_tag, one_sided) = match side {
                    Side::Unknown => (-normal[2], is_exact && normal[2].abs() > T::of(LEVEL)),
                    Side::Of(point) => (dot(&normal, &sub(point, &centre)), true),
                };
                let normal = if towards_tag < T::ZERO { normal.map(|c| -c) } else { normal };
                Some(Mirror { centre, normal, one_sided, is_of_all: true })
            }
        }
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
        self.with_least_blocked(self.direct(threshold), at_least.into())
    }

    /// The kept ranges whose probability of a blocked link is below a threshold: bit i is the range of index i.
    fn direct(&self, threshold: T) -> u16 {
        let direct = self.ranges.iter().enumerate().filter(|(_, kept)| probability(kept.range.p_nlos) < threshold);
        direct.fold(0, |set, (index, _)| set | bit(index))
    }

    /// The kept ranges that are probably blocked, and that are needed for `enough` ranges: bit i is the range of index
    /// i.
    pub(super) fn least_blocked_beyond(&self, threshold: T, enough: usize) -> u16 {
        let direct = self.direct(threshold);
        self.with_least_blocked(direct, enough) & !direct
    }

    /// Adds the least blocked ranges to a set until it has `enough`.
    fn with_least_blocked(&self, mut set: u16, enough: usize) -> u16 {
        while (set.count_ones() as usize) < enough {
            let mut least: Option<(usize, T)> = None;
            for (place, Kept { range, .. }) in self.ranges.iter().enumerate() {
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
        let constraints = Constraints { side: Side::Unknown, area };
        let fix = self.solve_in(settings, settings.solvers.plane, &constraints, |range, sigma| {
            let [x, y, z] = range.position_m;
            let slant = RangeSample { sigma, ..RangeSample::new([x, y], range.distance_m) };
            slant.flattened(z - height, settings.height_sigma)
        })?;
        let [x, y] = fix.position;
        let mut covariance = [[T::ZERO; 3]; 3];
        covariance[2][2] = settings.height_sigma.squared();
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
            alternative: fix
                .alternative
                .map(|Alternative { apart: [x, y], share }| Alternative { apart: [x, y, T::ZERO], share }),
        })
    }

    #[inline(never)]
    fn solve_space(&self, settings: &Settings<T>, side: Side<T, 3>) -> Result<Fix<T, 3>, SolveError> {
        self.solve_in(settings, settings.solvers.space, &Constraints { side, area: settings.area }, |range, sigma| {
            RangeSample { sigma, ..RangeSample::new(range.position_m, range.distance_m) }
        })
    }

    fn solve_in<const D: usize>(
        &self,
        settings: &Settings<T>,
        solver: Solver<T, D>,
        constraints: &Constraints<T, D>,
        sample: impl Fn(&Range<T>, T) -> RangeSample<T, D>,
    ) -> Result<Fix<T, D>, SolveError> {
        let chosen = self.chosen(settings);
        let mut samples: Vec<RangeSample<T, D>, MAX_ANCHORS> = Vec::new();
        for (place, Kept { range, .. }) in self.ranges.iter().enumerate() {
            if chosen >> place & 1 == 1 {
                // There is room for as many samples as ranges.
                let sigma = deviation(settings, range.deviation_m, range.p_nlos);
                let alike = matches!(settings.filter.blocked, Blocked::Alike);
                let p_nlos = range.p_nlos.filter(|_| !alike);
                let _ = samples.push(sample(range, sigma).with_p_nlos(p_nlos));
            }
        }
        let mut fix = solver(&samples, constraints)?;
        let used = spread(fix.used, chosen);
        let places = self.ranges.iter().enumerate().filter(|(index, _)| used.contains(*index));
        fix.used = AnchorSet(places.filter_map(|(_, kept)| kept.place).fold(0, |set, place| set | bit(place.into())));
        Ok(fix)
    }

    #[inline(never)]
    fn solve_differences(&self, settings: &Settings<T>) -> Result<Fix<T, 3>, SolveError> {
        let Some(first) = self.tdoas.first() else { return Err(SolveError::TooFewAnchors) };
        let mut samples: Vec<TdoaSample<T>, MAX_ANCHORS> = Vec::new();
        for tdoa in self.tdoas.iter().filter(|tdoa| tdoa.reference == first.reference) {
            let sigma = deviation(settings, tdoa.deviations_m[1], tdoa.p_nlos[1]);
            let _ = samples.push(TdoaSample { anchor: tdoa.position_m, difference: tdoa.difference_m, sigma });
        }
        let sigma = deviation(settings, first.deviations_m[0], first.p_nlos[0]);
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

/// The bit of a range in a set; none beyond sixteen.
fn bit(place: usize) -> u16 {
    1_u16.checked_shl(place as u32).unwrap_or(0)
}

/// Moves the bits of `used`, which number the members of `chosen`, to their indices among all ranges.
fn spread(used: AnchorSet, chosen: u16) -> AnchorSet {
    let members = (0..16_usize).filter(|place| chosen >> place & 1 == 1);
    AnchorSet(members.enumerate().filter(|(k, _)| used.contains(*k)).fold(0, |set, (_, place)| set | 1 << place))
}

/// The deviation of a single measurement with the error of a direct link, metres.
fn deviation<T: Real>(settings: &Settings<T>, own: T, p_nlos: Option<T>) -> T {
    let noise = &settings.filter.noise;
    match settings.filter.blocked.variance(probability(p_nlos)) {
        Some(variance) => variance.sqrt(),
        // Exactly as given where there is nothing to add.
        None if noise.lasts() => (own.squared() + noise.direct_sigma.squared()).sqrt(),
        None => own,
    }
}
