//! A robust fit of a whole recording: the tag's place in each round, and what all rounds have in common, such as an
//! error of all ranges or the place of an anchor.
//!
//! Input: the anchors, some rounds of ranges, and one [`Assumption`] about what is wrong. Output: how well the ranges
//! fit together under it. The cost is that of Cauchy's distribution (P. J. Huber, Robust Statistics, 1981), summed over
//! the ranges; its minimum comes by iteratively reweighted Gauss-Newton steps. The places of the rounds are eliminated
//! from the normal equations by the Schur complement, as in the bundle adjustment of B. Triggs et al., 2000.

/// The scale of a range's error, metres: noise, lasting errors of a link and the movement in a round together.
pub const SCALE_M: f64 = 0.15;
/// A range fits where its residual is less, metres.
const FITS_M: f64 = 0.2;
/// The error of all ranges that antenna delays usually leave, metres.
const USUAL_COMMON_M: f64 = 0.3;
/// The scales of the steps, from rough to fine, metres.
const SCALES_M: [f64; 9] = [2.0, 2.0, 1.0, 0.5, 0.3, SCALE_M, SCALE_M, SCALE_M, SCALE_M];
/// A round whose mean cost is below this needs no other beginning.
const GOOD: f64 = 0.3;
/// Steps of all places together, and how often the places are sought again after them: a step may
/// carry a place away.
const STEPS: usize = 6;
const SEEKS: usize = 2;
/// The most that a place moves in one step, metres.
const STEP_M: f64 = 5.0;
/// What all rounds have in common: the error of all ranges, and three values of the assumption.
const COMMON: usize = 4;

/// What is assumed to be wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Assumption {
    /// Nothing.
    Sound,
    /// The ranges have another unit: metres of one.
    Unit(f64),
    /// Two anchors have each other's place.
    Exchanged(usize, usize),
    /// All ranges are wrong by one length.
    AllLong,
    /// The ranges of an anchor are wrong by one length.
    LinkLong(usize),
    /// An anchor is elsewhere.
    Moved(usize),
    /// The tag's height is another one.
    Height,
}

/// The ranges that were measured at one place of the tag.
#[derive(Clone, Debug)]
pub struct FitRound {
    /// Anchor and range, metres.
    pub ranges: Vec<(usize, f64)>,
    /// The tag's height as given, metres, in the plane.
    pub height_m: f64,
    /// The time, seconds.
    pub t_s: Option<f64>,
    /// The number of its epoch, where it is one.
    pub epoch: Option<usize>,
}

/// What is fitted.
#[derive(Clone, Debug)]
pub struct Rounds {
    /// The places of the anchors as given, metres.
    pub anchors_m: Vec<[f64; 3]>,
    /// The rounds, in the order of time.
    pub rounds: Vec<FitRound>,
    /// The number of coordinates that the ranges have to give: 2, or 3.
    pub dims: usize,
    /// Whether the tag has one height, which the user gave.
    pub height_is_known: bool,
}

/// How well the ranges fit together.
#[derive(Clone, Debug)]
pub struct Fit {
    /// What is assumed.
    pub assumption: Assumption,
    /// The error of all ranges, and the values of the assumption: an error or a height, or an anchor's displacement,
    /// metres.
    pub values_m: [f64; COMMON],
    /// The place of each round, metres.
    pub places_m: Vec<[f64; 3]>,
    /// The cost for each range more than the places need.
    pub cost: f64,
    /// The share of each anchor's ranges that fit.
    pub fitting: Vec<f64>,
    /// The number of each anchor's ranges.
    pub ranges: Vec<usize>,
    /// The magnitudes of the residuals, in their order, metres.
    pub residuals_m: Vec<f64>,
    /// The root mean square of the residuals but for the tenth that is largest, metres.
    pub residual_m: f64,
}

impl Fit {
    /// How far the anchor is from its place, metres.
    pub fn moved_m(&self) -> f64 {
        self.values_m[1..].iter().map(|by_m| by_m * by_m).sum::<f64>().sqrt()
    }

    /// Whether the tag was at places that are a metre apart: four of five places reach over a metre along an axis.
    pub fn moves(&self) -> bool {
        (0..2).any(|axis| {
            let mut along: Vec<f64> = self.places_m.iter().map(|place| place[axis]).collect();
            along.sort_by(f64::total_cmp);
            let at = |share: usize| along.get((along.len() * share / 10).min(along.len() - 1)).copied().unwrap_or(0.0);
            !along.is_empty() && at(9) - at(1) > 1.0
        })
    }
}

/// The site under an assumption.
struct Model {
    anchors_m: Vec<[f64; 3]>,
    long_m: Vec<f64>,
    factor: f64,
    up_m: f64,
}

impl Model {
    fn of(rounds: &Rounds, assumption: Assumption, values_m: &[f64; COMMON]) -> Self {
        let mut model = Self {
            anchors_m: rounds.anchors_m.clone(),
            long_m: vec![values_m[0]; rounds.anchors_m.len()],
            factor: 1.0,
            up_m: 0.0,
        };
        match assumption {
            Assumption::Sound | Assumption::AllLong => {}
            Assumption::Unit(factor) => model.factor = factor,
            Assumption::Exchanged(one, other) => model.anchors_m.swap(one, other),
            Assumption::LinkLong(anchor) => model.long_m[anchor] += values_m[1],
            Assumption::Moved(anchor) => {
                for (coordinate, by_m) in model.anchors_m[anchor].iter_mut().zip(&values_m[1..]) {
                    *coordinate += by_m;
                }
            }
            Assumption::Height => model.up_m = values_m[1],
        }
        model
    }

    /// The residual of a range, metres, and the direction from the anchor to the place.
    fn residual(&self, place_m: &[f64; 3], &(anchor, range_m): &(usize, f64)) -> (f64, [f64; 3]) {
        let at_m = &self.anchors_m[anchor];
        let away: [f64; 3] = std::array::from_fn(|axis| place_m[axis] - at_m[axis]);
        let distance_m = away.iter().map(|part| part * part).sum::<f64>().sqrt().max(1.0e-3);
        (range_m * self.factor - self.long_m[anchor] - distance_m, away.map(|part| part / distance_m))
    }

    fn cost(&self, place_m: &[f64; 3], round: &FitRound) -> f64 {
        round.ranges.iter().map(|range| (self.residual(place_m, range).0 / SCALE_M).powi(2).ln_1p()).sum()
    }
}

/// The normal equations of a round's place: matrix and right side.
type Normal = ([[f64; 3]; 3], [f64; 3]);

impl Rounds {
    /// The fit under an assumption that ends best, of those that begin with these values.
    pub fn fit(&self, assumption: Assumption, begins_m: &[[f64; COMMON]]) -> Fit {
        let fits = begins_m.iter().skip(1).map(|begin_m| self.fit_from(assumption, *begin_m));
        let first = self.fit_from(assumption, begins_m.first().copied().unwrap_or_default());
        fits.fold(first, |best, fit| if fit.cost < best.cost { fit } else { best })
    }

    /// This number of the rounds, at equal intervals, or all of them.
    pub fn some(&self, most: usize) -> Self {
        let step = self.rounds.len().div_ceil(most).max(1);
        Self { anchors_m: self.anchors_m.clone(), rounds: self.rounds.iter().step_by(step).cloned().collect(), ..*self }
    }

    /// What an assumption explains at once, from the places of another fit of the same rounds: the cost after a few
    /// steps.
    pub fn tried(&self, assumption: Assumption, from: &Fit) -> f64 {
        let (mut values_m, mut places_m) = ([from.values_m[0], 0.0, 0.0, 0.0], from.places_m.clone());
        let model = self.steps(3, assumption, &mut values_m, &mut places_m);
        self.rated(assumption, values_m, &model, places_m).cost
    }

    fn fit_from(&self, assumption: Assumption, begin_m: [f64; COMMON]) -> Fit {
        let mut values_m = begin_m;
        let mut model = Model::of(self, assumption, &values_m);
        let mut places_m = self.locate(&model);
        for _ in 0..SEEKS {
            model = self.steps(STEPS, assumption, &mut values_m, &mut places_m);
            let again_m = self.locate(&model);
            for ((round, place), again) in self.rounds.iter().zip(&mut places_m).zip(again_m) {
                if model.cost(&again, round) < model.cost(place, round) {
                    *place = again;
                }
            }
        }
        self.rated(assumption, values_m, &model, places_m)
    }

    /// Steps of all places and of what they have in common. Returns the site under the last values.
    fn steps(
        &self,
        count: usize,
        assumption: Assumption,
        values_m: &mut [f64; COMMON],
        places_m: &mut [[f64; 3]],
    ) -> Model {
        let mut model = Model::of(self, assumption, values_m);
        for _ in 0..count {
            let step = self.step(&model, assumption, places_m);
            for (value, by_m) in values_m.iter_mut().zip(step) {
                *value += by_m.clamp(-STEP_M, STEP_M);
            }
            if assumption != Assumption::AllLong {
                values_m[0] = values_m[0].clamp(-USUAL_COMMON_M, USUAL_COMMON_M);
            }
            model = Model::of(self, assumption, values_m);
            if assumption == Assumption::Height {
                self.rounds
                    .iter()
                    .zip(&mut *places_m)
                    .for_each(|(round, place)| place[2] = round.height_m + model.up_m);
            }
        }
        model
    }

    fn rated(&self, assumption: Assumption, values_m: [f64; COMMON], model: &Model, places_m: Vec<[f64; 3]>) -> Fit {
        let with = || self.rounds.iter().zip(&places_m);
        let spare: usize = self.rounds.iter().map(|round| round.ranges.len().saturating_sub(self.dims)).sum();
        let cost = with().map(|(round, place)| model.cost(place, round)).sum::<f64>() / spare.max(1) as f64;
        let mut residuals_m: Vec<f64> = with()
            .flat_map(|(round, place)| round.ranges.iter().map(|range| model.residual(place, range).0.abs()))
            .collect();
        residuals_m.sort_by(f64::total_cmp);
        let squares = residuals_m.iter().take(residuals_m.len() * 9 / 10).map(|residual_m| residual_m * residual_m);
        let (mut fitting, mut ranges) = (vec![0.0; model.anchors_m.len()], vec![0_usize; model.anchors_m.len()]);
        for (round, place) in with() {
            for range in &round.ranges {
                ranges[range.0] += 1;
                fitting[range.0] += f64::from(u8::from(model.residual(place, range).0.abs() < FITS_M));
            }
        }
        fitting.iter_mut().zip(&ranges).for_each(|(fits, ranges)| *fits /= (*ranges).max(1) as f64);
        let residual_m = (squares.clone().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        Fit { assumption, values_m, places_m, cost, fitting, ranges, residuals_m, residual_m }
    }

    /// How the ranges of an anchor agree with its place as given, where a fit has the tag: the shares of those that fit,
    /// and of those that are too short.
    pub fn as_given(&self, anchor: usize, fit: &Fit) -> [f64; 2] {
        let model = Model::of(self, Assumption::Sound, &[fit.values_m[0], 0.0, 0.0, 0.0]);
        let with = self.rounds.iter().zip(&fit.places_m);
        let of_anchor = with.flat_map(|(round, place)| round.ranges.iter().map(move |range| (place, range)));
        let residuals_m =
            of_anchor.filter(|(_, range)| range.0 == anchor).map(|(place, range)| model.residual(place, range).0);
        let (mut fitting, mut short, mut all) = (0.0, 0.0, 0.0_f64);
        for residual_m in residuals_m {
            all += 1.0;
            fitting += f64::from(u8::from(residual_m.abs() < FITS_M));
            short += f64::from(u8::from(residual_m < -FITS_M));
        }
        [fitting / all.max(1.0), short / all.max(1.0)]
    }

    /// The place of each round.
    fn locate(&self, model: &Model) -> Vec<[f64; 3]> {
        let count = model.anchors_m.len().max(1) as f64;
        let middle: [f64; 3] =
            std::array::from_fn(|axis| model.anchors_m.iter().map(|at| at[axis]).sum::<f64>() / count);
        let mut last: Option<[f64; 3]> = None;
        let mut places = Vec::with_capacity(self.rounds.len());
        for round in &self.rounds {
            let good = GOOD * round.ranges.len() as f64;
            let height = |place: [f64; 3]| {
                if self.dims == 2 { [place[0], place[1], round.height_m + model.up_m] } else { place }
            };
            let mut best = (f64::INFINITY, height(middle));
            let mut consider = |begin: [f64; 3]| {
                if best.0 > good {
                    let place = self.descend(model, round, height(begin));
                    let cost = model.cost(&place, round);
                    if cost < best.0 {
                        best = (cost, place);
                    }
                }
                best.1
            };
            if let Some(last) = last {
                consider(last);
            }
            let linear = self.linear(model, round, &middle);
            consider(linear);
            if self.dims == 3 {
                consider([linear[0], linear[1], linear[2] - 2.0]);
                consider([linear[0], linear[1], linear[2] + 2.0]);
            }
            consider(middle);
            for [x_m, y_m] in [[-3.0, 0.0], [3.0, 0.0], [0.0, -3.0], [0.0, 3.0]] {
                consider([middle[0] + x_m, middle[1] + y_m, middle[2]]);
            }
            last = Some(best.1);
            places.push(best.1);
        }
        places
    }

    /// The place by the differences of the squared ranges, which are linear in it.
    fn linear(&self, model: &Model, round: &FitRound, middle: &[f64; 3]) -> [f64; 3] {
        let count = round.ranges.len().max(1) as f64;
        let rows: Vec<([f64; 3], f64)> = round
            .ranges
            .iter()
            .map(|&(anchor, range_m)| {
                let at: [f64; 3] = std::array::from_fn(|axis| model.anchors_m[anchor][axis] - middle[axis]);
                let range_m = range_m * model.factor - model.long_m[anchor];
                (at, at.iter().map(|part| part * part).sum::<f64>() - range_m * range_m)
            })
            .collect();
        let mean_at: [f64; 3] = std::array::from_fn(|axis| rows.iter().map(|row| row.0[axis]).sum::<f64>() / count);
        let mean = rows.iter().map(|row| row.1).sum::<f64>() / count;
        let (mut matrix, mut right): Normal = ([[0.0; 3]; 3], [0.0; 3]);
        for (at, value) in &rows {
            let at: [f64; 3] = std::array::from_fn(|axis| 2.0 * (at[axis] - mean_at[axis]));
            add(&mut matrix, &mut right, &at, value - mean, 1.0);
        }
        for axis in 0..3 {
            matrix[axis][axis] += 0.1;
        }
        if self.dims == 2 {
            fix_height(&mut matrix, &mut right);
        }
        let by = solved(matrix, [right]).map_or([0.0; 3], |[by]| by);
        std::array::from_fn(|axis| middle[axis] + by[axis].clamp(-100.0, 100.0))
    }

    /// The nearest minimum of the cost from a place, with a scale that shrinks.
    fn descend(&self, model: &Model, round: &FitRound, mut place: [f64; 3]) -> [f64; 3] {
        for scale_m in SCALES_M {
            let (mut matrix, mut right): Normal = ([[0.0; 3]; 3], [0.0; 3]);
            for range in &round.ranges {
                let (residual_m, direction) = model.residual(&place, range);
                add(&mut matrix, &mut right, &direction, residual_m, weight(residual_m, scale_m));
            }
            let Some(by) = self.place_step(matrix, right) else { break };
            place = moved(place, by);
        }
        place
    }

    fn place_step(&self, mut matrix: [[f64; 3]; 3], mut right: [f64; 3]) -> Option<[f64; 3]> {
        self.damp(&mut matrix, &mut right);
        solved(matrix, [right]).map(|[by]| by)
    }

    fn damp(&self, matrix: &mut [[f64; 3]; 3], right: &mut [f64; 3]) {
        let trace: f64 = (0..3).map(|axis| matrix[axis][axis]).sum();
        for (axis, row) in matrix.iter_mut().enumerate() {
            row[axis] += 1.0e-3 * trace + 1.0e-9;
        }
        if self.dims == 2 {
            fix_height(matrix, right);
        }
    }

    /// One step of all places and of what they have in common, which is returned.
    fn step(&self, model: &Model, assumption: Assumption, places_m: &mut [[f64; 3]]) -> [f64; COMMON] {
        let (mut matrix, mut right) = ([[0.0; COMMON]; COMMON], [0.0; COMMON]);
        let mut kept = Vec::with_capacity(places_m.len());
        for (round, place) in self.rounds.iter().zip(places_m.iter()) {
            let (mut own, mut own_right): Normal = ([[0.0; 3]; 3], [0.0; 3]);
            let mut mixed = [[0.0; 3]; COMMON];
            for range in &round.ranges {
                let (residual_m, direction) = model.residual(place, range);
                let weight = weight(residual_m, SCALE_M);
                let common = self.derivatives(assumption, range.0, &direction);
                add(&mut own, &mut own_right, &direction, residual_m, weight);
                add(&mut matrix, &mut right, &common, residual_m, weight);
                for (mixed, common) in mixed.iter_mut().zip(common) {
                    for (mixed, direction) in mixed.iter_mut().zip(direction) {
                        *mixed += weight * common * direction;
                    }
                }
            }
            self.damp(&mut own, &mut own_right);
            if self.dims == 2 {
                mixed.iter_mut().for_each(|mixed| mixed[2] = 0.0);
            }
            // The place's part of the others' equations.
            let Some([by, a, b, c, d]) = solved(own, [own_right, mixed[0], mixed[1], mixed[2], mixed[3]]) else {
                kept.push(None);
                continue;
            };
            let of_common = [a, b, c, d];
            for (row, mixed) in mixed.iter().enumerate() {
                right[row] -= dot(mixed, &by);
                for (column, of_common) in of_common.iter().enumerate() {
                    matrix[row][column] -= dot(mixed, of_common);
                }
            }
            kept.push(Some((by, of_common)));
        }
        let trace: f64 = (0..COMMON).map(|at| matrix[at][at]).sum();
        for (at, row) in matrix.iter_mut().enumerate() {
            // A value that the assumption does not have is kept.
            row[at] += 1.0e-4 * trace + 1.0e-6;
        }
        let step = solved(matrix, [right]).map_or([0.0; COMMON], |[step]| step);
        for (place, kept) in places_m.iter_mut().zip(kept) {
            if let Some((by, of_common)) = kept {
                let by = std::array::from_fn(|axis| {
                    by[axis] - step.iter().zip(&of_common).map(|(step, of)| step * of[axis]).sum::<f64>()
                });
                *place = moved(*place, by);
            }
        }
        step
    }

    /// The change of a predicted range with the common values. That with the place is `direction`.
    fn derivatives(&self, assumption: Assumption, anchor: usize, direction: &[f64; 3]) -> [f64; COMMON] {
        let of = |is: bool, value: f64| if is { value } else { 0.0 };
        match assumption {
            Assumption::Sound | Assumption::AllLong | Assumption::Unit(_) | Assumption::Exchanged(..) => {
                [1.0, 0.0, 0.0, 0.0]
            }
            Assumption::LinkLong(long) => [1.0, of(anchor == long, 1.0), 0.0, 0.0],
            Assumption::Moved(moved) => {
                let [x, y, z] = direction.map(|part| of(anchor == moved, -part));
                [1.0, x, y, of(self.dims == 3, z)]
            }
            Assumption::Height => [1.0, direction[2], 0.0, 0.0],
        }
    }
}

fn weight(residual_m: f64, scale_m: f64) -> f64 {
    1.0 / (1.0 + (residual_m / scale_m).powi(2))
}

fn moved(place: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| place[axis] + by[axis].clamp(-STEP_M, STEP_M))
}

fn dot(one: &[f64; 3], other: &[f64; 3]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

/// Adds an equation to normal equations.
fn add<const N: usize>(matrix: &mut [[f64; N]; N], right: &mut [f64; N], row: &[f64; N], value: f64, weight: f64) {
    for at in 0..N {
        right[at] += weight * row[at] * value;
        for column in 0..N {
            matrix[at][column] += weight * row[at] * row[column];
        }
    }
}

fn fix_height(matrix: &mut [[f64; 3]; 3], right: &mut [f64; 3]) {
    for axis in 0..3 {
        matrix[axis][2] = 0.0;
        matrix[2][axis] = 0.0;
    }
    (matrix[2][2], right[2]) = (1.0, 0.0);
}

/// Solves for several right sides by elimination. `None` where the matrix is singular.
fn solved<const N: usize, const M: usize>(
    mut matrix: [[f64; N]; N],
    mut rights: [[f64; N]; M],
) -> Option<[[f64; N]; M]> {
    for at in 0..N {
        let pivot = (at..N).max_by(|a, b| matrix[*a][at].abs().total_cmp(&matrix[*b][at].abs()))?;
        matrix.swap(at, pivot);
        rights.iter_mut().for_each(|right| right.swap(at, pivot));
        let divisor = matrix[at][at];
        if !(divisor.abs() > 1.0e-14 && divisor.is_finite()) {
            return None;
        }
        for row in 0..N {
            if row != at {
                let share = matrix[row][at] / divisor;
                for column in at..N {
                    matrix[row][column] -= share * matrix[at][column];
                }
                rights.iter_mut().for_each(|right| right[row] -= share * right[at]);
            }
        }
    }
    Some(rights.map(|right| std::array::from_fn(|at| right[at] / matrix[at][at])))
}
