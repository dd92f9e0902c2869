//! The conditions of a case: room, anchors, times, and the sizes of all errors.

use rand::Rng;

use super::happens;
use crate::draw::{between, log_between, normal};

/// Most epochs of a case: rounds, and single ranges.
const MOST_EPOCHS: [f64; 2] = [1500.0, 4000.0];
/// Silence between two stays, seconds.
const SILENCE_S: f64 = 60.0;
/// The least distance of an anchor from floor and ceiling, metres.
const CLEAR_M: f64 = 0.2;

/// A group of cases, which has one property in common. Everything else is drawn as in the other groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// The tag walks.
    Walk,
    /// The tag rests.
    Rest,
    /// The tag jumps by metres.
    Teleport,
    /// Each range comes by itself.
    Asynchronous,
    /// In the plane, the anchors are almost on a line.
    Collinear,
    /// More anchors than a fix can take, or almost.
    ManyAnchors,
    /// The height is not known.
    Space,
}

impl Group {
    /// All groups, in the order in which cases take turns.
    pub const ALL: [Self; 7] =
        [Self::Walk, Self::Rest, Self::Teleport, Self::Asynchronous, Self::Collinear, Self::ManyAnchors, Self::Space];

    /// Its name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Walk => "walk",
            Self::Rest => "rest",
            Self::Teleport => "teleport",
            Self::Asynchronous => "asynchronous",
            Self::Collinear => "collinear",
            Self::ManyAnchors => "many-anchors",
            Self::Space => "3d",
        }
    }
}

/// Where the anchors are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Layout {
    /// Around the walls.
    Walls,
    /// Along one wall.
    OneWall,
    /// Along a line.
    Line {
        /// The line's y, metres.
        y_m: f64,
        /// Deviation of the anchors from the line, metres.
        off_m: f64,
        /// Whether the last anchor is on a wall somewhere else.
        but_one: bool,
    },
}

/// How the tag moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Movement {
    /// From one random position to the next.
    Walk,
    /// Three stays.
    Rest,
    /// A walk with jumps.
    WalkAndJump,
    /// Stays with jumps between them.
    RestAndJump,
}

/// What the powers of a reception say about its link: the difference between received power and first-path power, dB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Powers {
    /// There are none (probability 0.25).
    Absent,
    /// N(2, 1.5²) direct, N(8, 2.5²) blocked (0.25).
    Informative,
    /// N(3, 2.5²) direct, N(4.5, 2.5²) blocked (0.2).
    Weak,
    /// N(m, 1.5²), m of U(0, 12) for each link, whether blocked or not (0.15).
    Misleading,
    /// N(7, 2²) direct, N(3, 2²) blocked (0.15).
    Reversed,
}

/// What a case is drawn from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaseConditions {
    /// The group.
    pub group: Group,
    /// The room: length, width and height, metres.
    pub room_m: [f64; 3],
    /// Number of anchors.
    pub anchors: usize,
    /// Their layout.
    pub layout: Layout,
    /// How the tag moves.
    pub movement: Movement,
    /// The tag's least and greatest height, metres.
    pub heights_m: [f64; 2],
    /// Rounds a second.
    pub rate_hz: f64,
    /// Seconds without silences.
    pub seconds: f64,
    /// The share of ranges that is lost over a direct link.
    pub loss: f64,
    /// The error common to all ranges, metres.
    pub common_m: f64,
    /// Correlation length of lasting errors, metres.
    pub lasting_length_m: f64,
    /// Deviation of the white error, metres.
    pub white_m: f64,
    /// The share of positions where a link is blocked.
    pub blocked: f64,
    /// Correlation length of blocked regions, metres.
    pub blocked_length_m: f64,
    /// The share of wild ranges.
    pub wild: f64,
    /// The powers.
    pub powers: Powers,
}

impl CaseConditions {
    /// Draws the conditions of a case of this group.
    pub(super) fn draw(random: &mut impl Rng, group: Group) -> Self {
        let length = log_between(random, 5.0, 40.0);
        let width = (length * between(random, 0.3, 1.0)).max(4.0);
        let height = between(random, 2.4, 4.0) + if length > 15.0 { between(random, 0.0, 4.0) } else { 0.0 };
        let (least, greatest) = match group {
            Group::ManyAnchors => (13, 19),
            Group::Space => (5, 12),
            Group::Collinear => (4, 8),
            Group::Walk | Group::Rest | Group::Teleport | Group::Asynchronous => (4, 12),
        };
        let anchors = random.random_range(least..=greatest);
        let layout = match group {
            Group::Collinear => {
                let (y_m, off_m) = (width * between(random, 0.0, 0.5), between(random, 0.01, 0.05));
                Layout::Line { y_m, off_m, but_one: happens(random, 0.7) }
            }
            Group::Walk | Group::Rest | Group::Teleport | Group::Asynchronous | Group::ManyAnchors | Group::Space => {
                if happens(random, 0.8) {
                    Layout::Walls
                } else {
                    Layout::OneWall
                }
            }
        };
        let rests = happens(random, 0.3);
        let movement = match group {
            Group::Walk => Movement::Walk,
            Group::Rest => Movement::Rest,
            Group::Teleport => {
                if rests {
                    Movement::RestAndJump
                } else {
                    Movement::WalkAndJump
                }
            }
            Group::Asynchronous | Group::Collinear | Group::ManyAnchors | Group::Space => {
                if rests {
                    Movement::Rest
                } else {
                    Movement::Walk
                }
            }
        };
        let heights_m = if group == Group::Space { [0.3, 2.0] } else { [between(random, 0.3, 1.8); 2] };
        let single = group == Group::Asynchronous;
        let rate_hz = log_between(random, 2.0, if single { 10.0 } else { 50.0 });
        let epochs_hz = if single { rate_hz * anchors as f64 } else { rate_hz };
        let seconds = between(random, 40.0, 80.0).min(MOST_EPOCHS[usize::from(single)] / epochs_hz);
        Self {
            group,
            room_m: [length, width, height],
            anchors,
            layout,
            movement,
            heights_m,
            rate_hz,
            seconds,
            loss: between(random, 0.0, 0.25),
            common_m: 0.1 * normal(random),
            lasting_length_m: between(random, 0.2, 1.0),
            white_m: between(random, 0.02, 0.08),
            blocked: between(random, 0.0, 0.4),
            blocked_length_m: between(random, 1.0, 4.0),
            wild: between(random, 0.0, 0.03),
            powers: Powers::draw(random),
        }
    }

    /// Draws the anchors' positions, metres.
    pub(super) fn anchors(&self, random: &mut impl Rng) -> Vec<[f64; 3]> {
        let [length, width, height] = self.room_m;
        let begin = between(random, 0.0, 2.0 * (length + width));
        let lowest = if self.group == Group::Space { CLEAR_M } else { 1.5 };
        (0..self.anchors)
            .map(|number| {
                // One in each of as many equal parts of the wall.
                let share = (number as f64 + between(random, 0.1, 0.9)) / self.anchors as f64;
                let around = begin + share * 2.0 * (length + width);
                let [x, y] = match self.layout {
                    Layout::Walls => on_the_walls([length, width], around, between(random, 0.05, 0.3)),
                    Layout::Line { but_one: true, .. } if number + 1 == self.anchors => {
                        on_the_walls([length, width], around, between(random, 0.05, 0.3))
                    }
                    Layout::OneWall => [share * length, between(random, 0.05, 0.5)],
                    Layout::Line { y_m, off_m, .. } => [share * length, y_m + off_m * normal(random)],
                };
                let place = [x, y, between(random, lowest, height - CLEAR_M)];
                place.map(|coordinate| (coordinate * 1e3).round() / 1e3)
            })
            .collect()
    }

    /// The times of epochs, seconds.
    pub(super) fn times_s(&self, anchors: usize) -> Vec<f64> {
        let epochs_hz = if self.group == Group::Asynchronous { self.rate_hz * anchors as f64 } else { self.rate_hz };
        let third = self.seconds / 3.0;
        let silent_s = |t_s: f64| match self.movement {
            Movement::Rest => SILENCE_S * (t_s / third).floor(),
            Movement::Walk | Movement::WalkAndJump | Movement::RestAndJump => 0.0,
        };
        let count = (self.seconds * epochs_hz) as usize;
        let times = (0..count).map(|epoch| epoch as f64 / epochs_hz);
        times.map(|t_s| ((t_s + silent_s(t_s)) * 1e4).round() / 1e4).collect()
    }
}

/// The position at this length along the walls, this far inside, metres.
pub(crate) fn on_the_walls([length, width]: [f64; 2], along_m: f64, inset_m: f64) -> [f64; 2] {
    let along_m = along_m % (2.0 * (length + width));
    let [x, y] = if along_m < length {
        [along_m, 0.0]
    } else if along_m < length + width {
        [length, along_m - length]
    } else if along_m < 2.0 * length + width {
        [2.0 * length + width - along_m, width]
    } else {
        [0.0, 2.0 * (length + width) - along_m]
    };
    [x.clamp(inset_m, length - inset_m), y.clamp(inset_m, width - inset_m)]
}

impl Powers {
    fn draw(random: &mut impl Rng) -> Self {
        let share = between(random, 0.0, 1.0);
        match share {
            _ if share < 0.25 => Self::Absent,
            _ if share < 0.5 => Self::Informative,
            _ if share < 0.7 => Self::Weak,
            _ if share < 0.85 => Self::Misleading,
            _ => Self::Reversed,
        }
    }

    /// Its name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Absent => "absent",
            Self::Informative => "informative",
            Self::Weak => "weak",
            Self::Misleading => "misleading",
            Self::Reversed => "reversed",
        }
    }
}

impl Movement {
    /// Its name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Walk => "walk",
            Self::Rest => "rest",
            Self::WalkAndJump => "walk-and-jump",
            Self::RestAndJump => "rest-and-jump",
        }
    }
}

impl Layout {
    /// Its name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Walls => "walls",
            Self::OneWall => "one-wall",
            Self::Line { but_one: false, .. } => "line",
            Self::Line { but_one: true, .. } => "line-but-one",
        }
    }
}
