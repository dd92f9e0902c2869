//! The epochs of a tag in columns, so that some millions of ranges fit into memory.
//!
//! [`Epochs`] holds the columns, and an [`Epoch`] is a view of one of their rows. A range takes 24 bytes, and 4 more
//! for each diagnostic that its file has; a [`Measured`] is made of them where it is asked for. [`Gathering`] takes the
//! rows of a file, which may be in any order, and gives them to their epochs.

use positioning_core::nlos::{Feature, Features};

use crate::names::{Index, Texts};
use crate::{Coordinates, Diagnostics};

/// A measured range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Index of the anchor in [`Recording::anchors`](crate::Recording::anchors).
    pub anchor: usize,
    /// The range, metres.
    pub range_m: f64,
    /// The time of the range itself, seconds, where its row has one: asynchronous ranges of one epoch have several.
    pub t_s: Option<f64>,
    /// Ground truth of the line of sight, where known.
    pub line_of_sight: Option<bool>,
    /// The receiver's diagnostics of this range.
    pub diagnostics: Diagnostics,
}

/// The difference of the distances to two anchors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredDifference {
    /// Index of the reference anchor in [`Recording::anchors`](crate::Recording::anchors).
    pub reference: usize,
    /// Index of the anchor; for the reference's own reception, that of the reference.
    pub anchor: usize,
    /// The distance to the anchor minus that to the reference, metres.
    pub difference_m: f64,
    /// The receiver's diagnostics of the anchor's frame.
    pub diagnostics: Diagnostics,
}

/// What is measured at one time and makes one fix.
#[derive(Clone, Copy, Debug)]
pub struct Epoch<'a> {
    /// The epoch's name in the files.
    pub name: &'a str,
    /// Its time, seconds: the latest of its rows.
    pub t_s: Option<f64>,
    /// How long before that time it was measured, seconds. It differs from 0 where a node reported its ranges later.
    pub age_s: f64,
    /// The ranges, in the order of the file.
    pub ranges: Measurements<'a, StoredRange>,
    /// Differences of arrivals, of a tag that only listens.
    pub differences: Measurements<'a, StoredDifference>,
    /// The tag's true position.
    pub truth: Option<Coordinates>,
}

/// The epochs of a tag, in their order.
#[derive(Clone, Debug, Default)]
pub struct Epochs {
    names: Texts,
    times_s: Vec<Option<f64>>,
    /// As far as the last one that is not 0.
    ages_s: Vec<f64>,
    /// As far as the last one that is known.
    truths: Vec<Option<Coordinates>>,
    ranges: Rows<StoredRange>,
    differences: Rows<StoredDifference>,
}

impl Epochs {
    /// Adds an epoch that has no measurements yet.
    pub fn push(&mut self, name: &str, t_s: Option<f64>, truth: Option<Coordinates>) {
        if truth.is_some() {
            self.truths.resize(self.names.len(), None);
            self.truths.push(truth);
        }
        self.names.push(name);
        self.times_s.push(t_s);
        self.ranges.begin_epoch();
        self.differences.begin_epoch();
    }

    /// Adds a range to the last epoch.
    pub fn push_range(&mut self, range: &Measured) {
        self.ranges.push(range);
    }

    /// The number of epochs.
    pub fn len(&self) -> usize {
        self.times_s.len()
    }

    /// Whether there is no epoch.
    pub fn is_empty(&self) -> bool {
        self.times_s.is_empty()
    }

    /// An epoch.
    pub fn get(&self, at: usize) -> Option<Epoch<'_>> {
        Some(Epoch {
            name: self.names.get(at)?,
            t_s: *self.times_s.get(at)?,
            age_s: self.ages_s.get(at).copied().unwrap_or(0.0),
            ranges: self.ranges.of(at),
            differences: self.differences.of(at),
            truth: self.truths.get(at).copied().flatten(),
        })
    }

    /// All epochs, in their order.
    pub fn iter(&self) -> impl Iterator<Item = Epoch<'_>> + Clone {
        (0..self.len()).filter_map(|at| self.get(at))
    }

    /// The times of the epochs, seconds.
    pub fn times_s(&self) -> impl Iterator<Item = Option<f64>> {
        self.times_s.iter().copied()
    }

    /// Keeps the ranges for whose epoch and number in it `keep` is true.
    pub fn retain_ranges(&mut self, keep: impl Fn((usize, usize)) -> bool) {
        let mut kept = Rows::default();
        for (at, epoch) in self.iter().enumerate() {
            kept.begin_epoch();
            let ranges = epoch.ranges.iter().enumerate().filter(|(number, _)| keep((at, *number)));
            ranges.for_each(|(_, range)| kept.push(&range));
        }
        self.ranges = kept;
    }

    /// Gives the epochs these true positions.
    pub fn set_truths(&mut self, truths: Vec<Option<Coordinates>>) {
        self.truths = truths;
    }
}

/// The ranges of an epoch, or its differences, in the order of the file.
#[derive(Clone, Copy, Debug)]
pub struct Measurements<'a, S> {
    rows: &'a Rows<S>,
    first: usize,
    end: usize,
}

impl<'a, S: Stored> Measurements<'a, S> {
    /// Their number.
    pub fn len(&self) -> usize {
        self.end - self.first
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.first == self.end
    }

    /// One of them.
    pub fn get(&self, at: usize) -> Option<S::Item> {
        (at < self.len()).then(|| self.rows.get(self.first + at))?
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = S::Item> + Clone + use<'a, S> {
        let rows = self.rows;
        (self.first..self.end).filter_map(|at| rows.get(at))
    }
}

/// What is stored of a measurement beside its diagnostics.
pub trait Stored: Copy {
    /// The measurement.
    type Item;
    /// The measurement without its diagnostics, and these.
    fn of(item: &Self::Item) -> (Self, &Diagnostics);
    /// The measurement again.
    fn with(self, diagnostics: Diagnostics) -> Self::Item;
}

/// A range without its diagnostics.
#[derive(Clone, Copy, Debug)]
pub struct StoredRange {
    range_m: f64,
    /// NaN where the range has no time of its own.
    t_s: f64,
    anchor: u32,
    line_of_sight: Option<bool>,
}

/// A difference without its diagnostics.
#[derive(Clone, Copy, Debug)]
pub struct StoredDifference {
    difference_m: f64,
    reference: u32,
    anchor: u32,
}

/// The index of an anchor in few bytes. There is no anchor with an index that does not fit, nor with the greatest one.
fn short(anchor: usize) -> u32 {
    u32::try_from(anchor).unwrap_or(u32::MAX)
}

impl Stored for StoredRange {
    type Item = Measured;

    fn of(item: &Measured) -> (Self, &Diagnostics) {
        let &Measured { anchor, range_m, t_s, line_of_sight, ref diagnostics } = item;
        (Self { range_m, t_s: t_s.unwrap_or(f64::NAN), anchor: short(anchor), line_of_sight }, diagnostics)
    }

    fn with(self, diagnostics: Diagnostics) -> Measured {
        let Self { range_m, t_s, anchor, line_of_sight } = self;
        let t_s = (!t_s.is_nan()).then_some(t_s);
        Measured { anchor: anchor as usize, range_m, t_s, line_of_sight, diagnostics }
    }
}

impl Stored for StoredDifference {
    type Item = MeasuredDifference;

    fn of(item: &MeasuredDifference) -> (Self, &Diagnostics) {
        let &MeasuredDifference { reference, anchor, difference_m, ref diagnostics } = item;
        (Self { difference_m, reference: short(reference), anchor: short(anchor) }, diagnostics)
    }

    fn with(self, diagnostics: Diagnostics) -> MeasuredDifference {
        let Self { difference_m, reference, anchor } = self;
        MeasuredDifference { reference: reference as usize, anchor: anchor as usize, difference_m, diagnostics }
    }
}

/// The measurements of all epochs, one epoch after the other.
#[derive(Clone, Debug)]
struct Rows<S> {
    stored: Vec<S>,
    /// Where the measurements of each epoch end.
    ends: Vec<usize>,
    diagnostics: DiagnosticsByRow,
}

impl<S> Default for Rows<S> {
    fn default() -> Self {
        Self { stored: Vec::new(), ends: Vec::new(), diagnostics: DiagnosticsByRow::default() }
    }
}

impl<S: Stored> Rows<S> {
    fn begin_epoch(&mut self) {
        self.ends.push(self.stored.len());
    }

    /// Adds a measurement to the last epoch.
    fn push(&mut self, item: &S::Item) {
        if let Some(end) = self.ends.last_mut() {
            let (stored, diagnostics) = S::of(item);
            self.diagnostics.put(self.stored.len(), diagnostics);
            self.stored.push(stored);
            *end = self.stored.len();
        }
    }

    fn get(&self, at: usize) -> Option<S::Item> {
        Some(self.stored.get(at)?.with(self.diagnostics.get(at)))
    }

    fn of(&self, epoch: usize) -> Measurements<'_, S> {
        let end = |epoch: usize| self.ends.get(epoch).copied().unwrap_or(self.stored.len());
        Measurements { rows: self, first: epoch.checked_sub(1).map_or(0, end), end: end(epoch) }
    }
}

/// The diagnostics of receptions by row: a column for each feature and one for the received power, as far as the last
/// row that has it. NaN is unknown.
#[derive(Clone, Debug, Default)]
struct DiagnosticsByRow {
    features: [Vec<f32>; Feature::ALL.len()],
    power_dbm: Vec<f32>,
    deviation_m: Vec<f32>,
}

impl DiagnosticsByRow {
    fn put(&mut self, at: usize, diagnostics: &Diagnostics) {
        let put = |column: &mut Vec<f32>, value: f32| {
            if !value.is_nan() {
                column.resize(at, f32::NAN);
                column.push(value);
            }
        };
        for (column, feature) in self.features.iter_mut().zip(Feature::ALL) {
            put(column, diagnostics.features.get(feature).unwrap_or(f32::NAN));
        }
        put(&mut self.power_dbm, diagnostics.power_dbm);
        put(&mut self.deviation_m, diagnostics.deviation_m);
    }

    fn get(&self, at: usize) -> Diagnostics {
        let mut features = Features::default();
        for (column, feature) in self.features.iter().zip(Feature::ALL) {
            features.set_known(feature, column.get(at).copied());
        }
        let [power_dbm, deviation_m] =
            [&self.power_dbm, &self.deviation_m].map(|column| column.get(at).copied().unwrap_or(f32::NAN));
        Diagnostics { features, power_dbm, deviation_m }
    }
}

/// The epochs of a tag while its rows are read.
#[derive(Debug, Default)]
pub struct Gathering {
    epochs: Epochs,
    index: Index,
    /// The epoch of the last row.
    current: usize,
    late_ranges: Late<StoredRange>,
    late_differences: Late<StoredDifference>,
}

/// Measurements whose epoch had ended in the file already, in the order of the file.
#[derive(Debug)]
struct Late<S> {
    rows: Rows<S>,
    /// The epoch of each.
    epochs: Vec<usize>,
}

impl<S> Default for Late<S> {
    fn default() -> Self {
        Self { rows: Rows::default(), epochs: Vec::new() }
    }
}

impl Gathering {
    /// Takes the epoch's name in a row, the row's time and, where it is known, its age, seconds. The measurements of the
    /// row follow.
    pub fn begin_row(&mut self, epoch: &str, t_s: Option<f64>, age_s: Option<f64>) {
        let Self { epochs, index, current, .. } = self;
        if epochs.names.get(*current) != Some(epoch) {
            *current = index.find(&epochs.names, epoch).unwrap_or_else(|| {
                epochs.push(epoch, None, None);
                index.insert(&epochs.names, epochs.len() - 1);
                epochs.len() - 1
            });
        }
        if let Some(time_s) = epochs.times_s.get_mut(*current) {
            *time_s = [*time_s, t_s].into_iter().flatten().reduce(f64::max);
        }
        if let Some(age_s) = age_s {
            epochs.ages_s.resize(epochs.ages_s.len().max(*current + 1), 0.0);
            epochs.ages_s[*current] = age_s;
        }
    }

    /// Adds a range of the row.
    pub fn push_range(&mut self, range: &Measured) {
        self.late_ranges.push(self.current, &mut self.epochs.ranges, range);
    }

    /// Adds a difference of the row.
    pub fn push_difference(&mut self, difference: &MeasuredDifference) {
        self.late_differences.push(self.current, &mut self.epochs.differences, difference);
    }

    /// The epochs, in the order of their first rows.
    pub fn finish(self) -> Epochs {
        let Epochs { ranges, differences, .. } = self.epochs;
        Epochs {
            ranges: self.late_ranges.merged(ranges),
            differences: self.late_differences.merged(differences),
            ..self.epochs
        }
    }
}

impl<S: Stored> Late<S> {
    /// Adds a measurement to `rows`, or keeps it where its epoch is not the last one.
    fn push(&mut self, epoch: usize, rows: &mut Rows<S>, item: &S::Item) {
        if epoch + 1 == rows.ends.len() {
            rows.push(item);
        } else {
            if self.epochs.is_empty() {
                self.rows.begin_epoch();
            }
            self.rows.push(item);
            self.epochs.push(epoch);
        }
    }

    /// The measurements of all epochs: in each, those of `rows` come first, because they were first in the file.
    fn merged(self, rows: Rows<S>) -> Rows<S> {
        if self.epochs.is_empty() {
            return rows;
        }
        let mut late: Vec<(usize, usize)> =
            self.epochs.into_iter().enumerate().map(|(at, epoch)| (epoch, at)).collect();
        late.sort_unstable();
        let mut late = late.into_iter().peekable();
        let mut merged = Rows::default();
        for epoch in 0..rows.ends.len() {
            merged.begin_epoch();
            rows.of(epoch).iter().for_each(|item| merged.push(&item));
            while let Some((_, at)) = late.next_if(|(of, _)| *of == epoch) {
                self.rows.get(at).iter().for_each(|item| merged.push(item));
            }
        }
        merged
    }
}

#[cfg(test)]
mod tests {
    use super::{Epoch, Gathering, Measured};
    use crate::Diagnostics;
    use positioning_core::nlos::{Feature, Features};

    fn range(range_m: f64, power_dbm: f32) -> Measured {
        let mut features = Features::default();
        features.set(Feature::RiseTime, 2.0 * power_dbm);
        let diagnostics = Diagnostics { features, power_dbm, ..Diagnostics::default() };
        Measured { anchor: 3, range_m, t_s: None, line_of_sight: Some(true), diagnostics }
    }

    #[test]
    fn rows_in_any_order_come_to_their_epochs_in_the_order_of_the_file() {
        let mut rows = Gathering::default();
        let mut row = |epoch, t_s, range_m, power_dbm| {
            rows.begin_row(epoch, t_s, None);
            rows.push_range(&range(range_m, power_dbm));
        };
        row("a", Some(1.0), 10.0, f32::NAN);
        row("b", None, 20.0, -80.0);
        row("a", Some(3.0), 11.0, -70.0);
        row("c", Some(0.0), 30.0, f32::NAN);
        row("b", Some(5.0), 21.0, f32::NAN);
        row("a", Some(2.0), 12.0, -90.0);
        rows.begin_row("empty", None, None);
        let epochs = rows.finish();
        let of = |epoch: Epoch| {
            let ranges = epoch.ranges.iter().map(|range| {
                let Diagnostics { features, power_dbm, .. } = range.diagnostics;
                let of_row = (!power_dbm.is_nan()).then_some(power_dbm);
                assert_eq!(features.get(Feature::RiseTime), of_row.map(|power| 2.0 * power));
                (range.range_m, of_row)
            });
            (epoch.name.to_owned(), epoch.t_s, ranges.collect::<Vec<_>>())
        };
        let expected = [
            ("a", Some(3.0), vec![(10.0, None), (11.0, Some(-70.0)), (12.0, Some(-90.0))]),
            ("b", Some(5.0), vec![(20.0, Some(-80.0)), (21.0, None)]),
            ("c", Some(0.0), vec![(30.0, None)]),
            ("empty", None, vec![]),
        ];
        assert_eq!(
            epochs.iter().map(of).collect::<Vec<_>>(),
            expected.map(|(name, t_s, ranges)| (name.to_owned(), t_s, ranges))
        );
    }
}
