//! Recordings with one mistake each, as people make them, and recordings without one: what `baliza check` must name, and
//! what it must be silent about.
//!
//! A room with anchors on its walls, a tag that walks or rests, and ranges with white noise (5 cm), an error that lasts
//! for each link (4 cm), one of all ranges (-5 to 15 cm), 5 % loss and 1 % wild ranges. In each third recording without a
//! mistake a link is blocked in a part of the room.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::draw::{between, normal, uniform};
use crate::prior::on_the_walls;

/// What somebody did wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mistake {
    /// Two anchors stand in each other's place in the file.
    Exchanged,
    /// An anchor is 1 m from its place in the file.
    Moved,
    /// All ranges are 1.5 m too long.
    AllLong,
    /// The ranges of one anchor are 3 m too long.
    LinkLong,
    /// Ranges in feet.
    Feet,
    /// Times of flight in nanoseconds.
    Nanoseconds,
    /// Ranges in millimetres.
    Millimetres,
    /// Times in kiloseconds.
    Kiloseconds,
    /// All times are equal.
    EqualTimes,
    /// The clock is put back by 20 s.
    ClockBack,
    /// The tag's height is given 1 m too high or too low.
    Height,
    /// A range of 0 where there is none.
    Zeros,
}

impl Mistake {
    /// All mistakes.
    pub const ALL: [Self; 12] = [
        Self::Exchanged,
        Self::Moved,
        Self::AllLong,
        Self::LinkLong,
        Self::Feet,
        Self::Nanoseconds,
        Self::Millimetres,
        Self::Kiloseconds,
        Self::EqualTimes,
        Self::ClockBack,
        Self::Height,
        Self::Zeros,
    ];

    /// Its name, that of a folder of `examples/mistakes`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Exchanged => "exchanged",
            Self::Moved => "moved",
            Self::AllLong => "all-long",
            Self::LinkLong => "one-long",
            Self::Feet => "feet",
            Self::Nanoseconds => "nanoseconds",
            Self::Millimetres => "millimetres",
            Self::Kiloseconds => "kiloseconds",
            Self::EqualTimes => "equal-times",
            Self::ClockBack => "clock-back",
            Self::Height => "height",
            Self::Zeros => "zeros",
        }
    }

    /// The word of its sentence that names it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Exchanged => "exchanged",
            Self::Moved => "from where the file has it",
            Self::AllLong => "all ranges are about",
            Self::LinkLong => "m long everywhere",
            Self::Feet => "feet",
            Self::Nanoseconds => "nanoseconds",
            Self::Millimetres => "millimetres",
            Self::Kiloseconds => "kiloseconds",
            Self::EqualTimes => "stands still",
            Self::ClockBack => "goes backwards",
            Self::Height => "at a height of about",
            Self::Zeros => "stand for none",
        }
    }
}

/// A drawn recording.
#[derive(Clone, Debug)]
pub struct DrawnRecording {
    /// The anchors as the file has them, metres.
    pub anchors_m: Vec<[f64; 3]>,
    /// The tag's height as it is given; `None`: positions in space.
    pub height_m: Option<f64>,
    /// Of each epoch: the time, seconds, and anchors with ranges, metres.
    pub epochs: Vec<(f64, Vec<(usize, f64)>)>,
    /// The anchors that the mistake is about.
    pub subjects: Vec<usize>,
}

/// How long and where.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// The number of anchors.
    pub anchors: usize,
    /// The number of epochs, ten a second.
    pub epochs: usize,
    /// Whether the tag's height is given.
    pub is_plane: bool,
    /// Whether the tag rests.
    pub rests: bool,
}

/// Draws a recording.
pub fn drawn(mistake: Option<Mistake>, extent: Extent, seed: u64) -> DrawnRecording {
    let kind = mistake.and_then(|mistake| Mistake::ALL.iter().position(|other| *other == mistake));
    let random =
        &mut Pcg64Mcg::seed_from_u64(seed.wrapping_mul(100_003) ^ (kind.map_or(0, |kind| kind as u64 + 1) << 8));
    let room_m = [between(random, 6.0, 20.0), between(random, 5.0, 12.0), between(random, 2.5, 4.0)];
    let mut anchors_m = anchors(random, room_m, extent);
    let height_m = between(random, 0.5, 1.5);
    let places = walk(random, room_m, height_m, extent);
    let common_m = between(random, -0.05, 0.15);
    let lasting_m: Vec<f64> = anchors_m.iter().map(|_| 0.04 * normal(random)).collect();
    let (one, step) = (random.random_range(0..extent.anchors), random.random_range(1..extent.anchors));
    let other = (one + step) % extent.anchors;
    let blocked = (mistake.is_none() && seed.is_multiple_of(3)).then(|| {
        (random.random_range(0..extent.anchors), room_m[0] * between(random, 0.3, 0.7), between(random, 0.2, 1.2))
    });
    let mut epochs = Vec::with_capacity(places.len());
    for (number, place) in places.iter().enumerate() {
        let mut ranges = Vec::with_capacity(extent.anchors);
        for (anchor, at) in anchors_m.iter().enumerate() {
            let distance_m = place.iter().zip(at).map(|(one, other)| (one - other).powi(2)).sum::<f64>().sqrt();
            let mut range_m = distance_m + 0.05 * normal(random) + common_m + lasting_m[anchor];
            let is_lost = uniform(random) < 0.05;
            if uniform(random) < 0.01 {
                range_m = (range_m + between(random, -3.0, 20.0)).max(0.1);
            }
            if let Some((_, _, long_m)) = blocked.filter(|(link, from_m, _)| *link == anchor && place[0] > *from_m) {
                range_m += long_m;
            }
            let is_none = mistake == Some(Mistake::Zeros) && uniform(random) < 0.1;
            if !is_lost {
                let range_m = if is_none { 0.0 } else { measured(mistake, range_m, anchor == one) };
                ranges.push((anchor, (range_m * 1.0e4).round() / 1.0e4));
            }
        }
        epochs.push((time_s(mistake, number, places.len()), ranges));
    }
    let subjects = match mistake {
        Some(Mistake::Exchanged) => {
            anchors_m.swap(one, other);
            vec![one, other]
        }
        Some(Mistake::Moved) => {
            let angle = between(random, 0.0, TAU);
            let up = if extent.is_plane { 0.0 } else { between(random, -0.5, 0.5) };
            let across = (1.0 - up * up).sqrt();
            let by_m = [across * angle.cos(), across * angle.sin(), up];
            anchors_m[one].iter_mut().zip(by_m).for_each(|(coordinate, by_m)| *coordinate += by_m);
            vec![one]
        }
        Some(Mistake::LinkLong) => vec![one],
        Some(_) | None => Vec::new(),
    };
    let wrong_m = if mistake == Some(Mistake::Height) { if seed.is_multiple_of(2) { 1.0 } else { -1.0 } } else { 0.0 };
    DrawnRecording { anchors_m, height_m: extent.is_plane.then_some(height_m + wrong_m), epochs, subjects }
}

/// What the file has of a range.
fn measured(mistake: Option<Mistake>, range_m: f64, is_subject: bool) -> f64 {
    match mistake {
        Some(Mistake::AllLong) => range_m + 1.5,
        Some(Mistake::LinkLong) if is_subject => range_m + 3.0,
        Some(Mistake::Feet) => range_m / 0.3048,
        Some(Mistake::Nanoseconds) => range_m / 0.299_792_458,
        Some(Mistake::Millimetres) => range_m * 1000.0,
        Some(_) | None => range_m,
    }
}

/// What the file has of a time.
fn time_s(mistake: Option<Mistake>, number: usize, count: usize) -> f64 {
    let t_s = number as f64 * 0.1;
    match mistake {
        Some(Mistake::Kiloseconds) => t_s / 1000.0,
        Some(Mistake::EqualTimes) => 0.0,
        Some(Mistake::ClockBack) if number >= count / 2 => t_s - 0.3 * count as f64 * 0.1,
        Some(_) | None => t_s,
    }
}

/// Anchors along the walls, one in each of as many equal parts. In space every second one is low.
fn anchors(random: &mut impl Rng, [length, width, height]: [f64; 3], extent: Extent) -> Vec<[f64; 3]> {
    let around_m = 2.0 * (length + width);
    let begin_m = between(random, 0.0, around_m);
    let place = |number: usize| {
        let share = (number as f64 + between(random, 0.1, 0.9)) / extent.anchors as f64;
        let [x, y] = on_the_walls([length, width], begin_m + share * around_m, 0.0);
        let is_low = !extent.is_plane && number % 2 == 1;
        let z = if is_low {
            between(random, 0.2, 1.0)
        } else if extent.is_plane {
            between(random, 1.5, height)
        } else {
            between(random, height - 0.6, height - 0.1)
        };
        [x, y, z].map(|coordinate| (coordinate * 1.0e3).round() / 1.0e3)
    };
    (0..extent.anchors).map(place).collect()
}

/// The places of a tag that walks from one drawn place to the next at 1 m/s, or rests.
fn walk(random: &mut impl Rng, [length, width, _]: [f64; 3], height_m: f64, extent: Extent) -> Vec<[f64; 3]> {
    let mut draw = || {
        let z = if extent.is_plane { height_m } else { between(random, 0.5, 1.8) };
        [between(random, 0.5, length - 0.5), between(random, 0.5, width - 0.5), z]
    };
    let (mut at, mut goal) = (draw(), draw());
    let mut places = Vec::with_capacity(extent.epochs);
    for _ in 0..extent.epochs {
        places.push(at);
        if extent.rests {
            continue;
        }
        let way: [f64; 3] = std::array::from_fn(|axis| goal[axis] - at[axis]);
        let left_m = way.iter().map(|part| part * part).sum::<f64>().sqrt();
        if left_m < 0.15 {
            goal = draw();
        } else {
            at.iter_mut().zip(way).for_each(|(coordinate, part)| *coordinate += 0.1 * part / left_m);
        }
    }
    places
}
