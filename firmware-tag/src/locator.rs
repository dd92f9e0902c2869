//! From a round of ranges to a position: the places of the anchors, the solver, the covariance.

use heapless::Vec;
use positioning_core::{Constraints, Fix, MAX_ANCHORS, Method, NoFix, RangeSample, Real, flatten, solve};
use ranging::exchange::{Range, Round};

/// An anchor that the tag knows of by its configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorPlace {
    /// Its short address.
    pub address: u16,
    /// Where it stands, metres.
    pub position_m: [f32; 3],
}

/// What of the position is to be found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Dimensions {
    /// x and y of a tag carried at a known height.
    Plane {
        /// That height, metres.
        height_m: f32,
    },
    /// x, y and z.
    Space,
}

/// Makes positions of rounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Locator<'a> {
    /// What is to be found.
    pub dimensions: Dimensions,
    /// By which method.
    pub method: Method,
    /// Places known by configuration; they count more than what the anchors say of themselves.
    pub anchors: &'a [AnchorPlace],
}

/// What became of one round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Epoch<'a> {
    /// The round with its ranges.
    pub round: Round<'a>,
    /// When its poll left, since the node started, microseconds.
    pub poll_us: u64,
    /// The position, or why there is none.
    pub outcome: Result<Position, NoFix>,
}

/// A position in space; a tag at a known height has that height, and no variance in z.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Position {
    /// Metres, in the anchors' frame.
    pub position_m: [f32; 3],
    /// Covariance, m²; zero in the row and column of a height that was given.
    pub covariance_m2: [[f32; 3]; 3],
    /// The ranges that made it: bit i is the i-th of those it was made from, the round's own first.
    pub used: u16,
    /// How far the ranges agree with it, 0 to 1.
    pub quality: f32,
}

/// Where the anchors of a record stand, for a locator.
pub fn places(record: &node_record::Record) -> Vec<AnchorPlace, { node_record::MAX_ANCHORS }> {
    record.anchors.iter().map(|anchor| AnchorPlace { address: anchor.address, position_m: anchor.position_m }).collect()
}

impl<'a> Locator<'a> {
    /// That of a tag, by the method that serves best with blocked ranges, with these places.
    pub fn of(tag: &node_record::Tag, anchors: &'a [AnchorPlace]) -> Self {
        let dimensions = tag.height_m.map_or(Dimensions::Space, |height_m| Dimensions::Plane { height_m });
        Self { dimensions, method: Method::Robust, anchors }
    }
}

impl Locator<'_> {
    /// The position at the end of a round, whose poll left at `poll_us`, from `ranges`: the round's, and those that stand in for
    /// lost ones.
    pub fn locate<'r>(&self, round: Round<'r>, poll_us: u64, ranges: &[Range]) -> Epoch<'r> {
        let outcome = match self.dimensions {
            Dimensions::Plane { height_m } => self.solve::<2>(ranges, Some(height_m)).map(|fix| {
                let mut position = Position::from(fix);
                position.position_m[2] = height_m;
                position
            }),
            Dimensions::Space => self.solve::<3>(ranges, None).map(Position::from),
        };
        Epoch { round, poll_us, outcome }
    }

    /// Solves in the first `D` coordinates; with a height, ranges are brought to the plane at that height.
    fn solve<const D: usize>(&self, ranges: &[Range], height_m: Option<f32>) -> Result<Fix<f32, D>, NoFix> {
        let mut samples: Vec<RangeSample<f32, D>, MAX_ANCHORS> = Vec::new();
        // Which range each sample is.
        let mut places: Vec<u16, MAX_ANCHORS> = Vec::new();
        for (place, range) in (0..u16::BITS as u16).zip(ranges) {
            let Some(anchor) = self.place_of(range) else { continue };
            let distance = height_m.map_or(range.distance_m, |height| flatten(range.distance_m, anchor[2] - height));
            let mut sample = RangeSample::new(core::array::from_fn(|axis| anchor[axis]), distance);
            sample.sigma = range.deviation_m;
            let fits = samples.push(sample).is_ok() && places.push(place).is_ok();
            debug_assert!(fits, "a round has at most {MAX_ANCHORS} ranges");
        }
        let mut fix = solve(self.method, &samples, &Constraints::default())?;
        let used = places.iter().enumerate().filter(|(sample, _)| fix.used.contains(*sample));
        fix.used.0 = used.fold(0, |set, (_, place)| set | 1 << place);
        Ok(fix)
    }

    fn place_of(&self, range: &Range) -> Option<[f32; 3]> {
        let configured = self.anchors.iter().find(|anchor| anchor.address == range.peer);
        configured.map(|anchor| anchor.position_m).or(range.position_m)
    }
}

impl Position {
    /// Standard deviation along each axis, metres.
    pub fn deviation_m(&self) -> [f32; 3] {
        core::array::from_fn(|axis| Real::sqrt(self.covariance_m2[axis][axis]))
    }

    /// Whether the height was given and not found.
    pub fn height_is_given(&self) -> bool {
        self.covariance_m2[2][2] == 0.0
    }
}

impl<const D: usize> From<Fix<f32, D>> for Position {
    fn from(fix: Fix<f32, D>) -> Self {
        let mut position =
            Self { position_m: [0.0; 3], covariance_m2: [[0.0; 3]; 3], used: fix.used.0, quality: fix.quality };
        for (row, value) in fix.position.into_iter().enumerate().take(3) {
            position.position_m[row] = value;
            for (column, value) in fix.covariance[row].into_iter().enumerate().take(3) {
                position.covariance_m2[row][column] = value;
            }
        }
        position
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ranging::{Diagnostics, RadioInstant};

    /// Four anchors at the corners of a room of 3 m × 4 m, 2 m up; their order is their address, 1 to 4.
    const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 2.0], [3.0, 0.0, 2.0], [3.0, 4.0, 2.0], [0.0, 4.0, 2.0]];
    /// From the tag the corners are √(1+1+4), √(4+1+4), √(4+9+4), √(1+9+4) m away.
    const TAG: [f32; 3] = [1.0, 1.0, 0.0];
    const FROM_TAG: [f32; 4] = [2.449_489_7, 3.0, 4.123_105_6, 3.741_657_4];

    fn ranges(positions: impl Fn(usize) -> Option<[f32; 3]>) -> [Range; 4] {
        core::array::from_fn(|i| Range {
            peer: i as u16 + 1,
            distance_m: FROM_TAG[i],
            deviation_m: 0.03,
            position_m: positions(i),
            diagnostics: Diagnostics::default(),
        })
    }

    fn round(ranges: &[Range]) -> Round<'_> {
        Round { number: 1, poll: RadioInstant::default(), asked: 4, ranges }
    }

    fn locator(dimensions: Dimensions, anchors: &[AnchorPlace]) -> Locator<'_> {
        // Least squares: perfect ranges give the very position, whatever their deviation.
        Locator { dimensions, method: Method::Nls, anchors }
    }

    fn near(found: [f32; 3], expected: [f32; 3]) -> bool {
        found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.01)
    }

    #[test]
    fn a_tag_at_a_known_height_is_found_in_the_plane() {
        let heard = ranges(|i| Some(CORNERS[i]));
        let epoch = locator(Dimensions::Plane { height_m: 0.0 }, &[]).locate(round(&heard), 0, &heard);
        let position = epoch.outcome.unwrap();
        assert!(near(position.position_m, TAG), "{position:?}");
        assert_eq!((position.used, position.covariance_m2[2]), (0b1111, [0.0; 3]));
        assert!(position.covariance_m2[0][0] > 0.0);
    }

    #[test]
    fn configured_places_count_more_than_those_from_the_air() {
        let heard = ranges(|_| Some([9.0, 9.0, 9.0]));
        let table: [AnchorPlace; 4] =
            core::array::from_fn(|i| AnchorPlace { address: i as u16 + 1, position_m: CORNERS[i] });
        let epoch = locator(Dimensions::Plane { height_m: 0.0 }, &table).locate(round(&heard), 0, &heard);
        assert!(near(epoch.outcome.unwrap().position_m, TAG));
    }

    #[test]
    fn a_range_to_an_anchor_of_unknown_place_is_left_out_and_the_others_keep_their_bits() {
        let heard = ranges(|i| (i != 1).then_some(CORNERS[i]));
        let position =
            locator(Dimensions::Plane { height_m: 0.0 }, &[]).locate(round(&heard), 0, &heard).outcome.unwrap();
        assert_eq!(position.used, 0b1101);
        assert!(near(position.position_m, TAG), "{position:?}");
    }

    #[test]
    fn too_few_ranges_give_a_reason() {
        let heard = ranges(|i| Some(CORNERS[i]));
        let space = locator(Dimensions::Space, &[]);
        assert_eq!(space.locate(round(&heard[..3]), 0, &heard[..3]).outcome, Err(NoFix::TooFewAnchors));
        assert_eq!(space.locate(round(&[]), 0, &[]).outcome, Err(NoFix::TooFewAnchors));
    }

    #[test]
    fn in_space_below_coplanar_anchors_the_lower_image_is_taken_and_its_doubt_told() {
        let heard = ranges(|i| Some(CORNERS[i]));
        let position = locator(Dimensions::Space, &[]).locate(round(&heard), 0, &heard).outcome.unwrap();
        assert!(near(position.position_m, TAG), "{position:?}");
        // The mirror image is 4 m above: half of its squared distance is 8 m².
        assert!(position.covariance_m2[2][2] > 7.5, "{position:?}");
    }
}
