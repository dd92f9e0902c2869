//! The tag's true positions: `truth.csv`, joined to epochs by time.
//!
//! The truth may have its own rate and its own numbers of epochs. Between two of its rows a position is interpolated
//! linearly. Where the ranges or the truth have no times, the rows are joined by the epochs' names.

use std::path::{Path, PathBuf};

use crate::grouping::{ByName, tag_of};
use crate::names::{Index, Texts};
use crate::spelled;
use crate::table::quoted;
use crate::{Coordinates, Epochs, Table, UserError};

/// A true position holds for this time before and after its row where it cannot be interpolated, seconds.
const HOLDS_S: f64 = 0.1;
/// The longest time between two rows of a moving tag that is interpolated, seconds.
const LONGEST_GAP_S: f64 = 1.0;
/// A tag moves where two rows are farther apart than this, metres: more than the noise of a survey.
const MOVES_M: f64 = 0.1;
/// Rows of the same epoch are of the same instant where their times differ by no more than this, seconds: files round.
const SAME_INSTANT_S: f64 = 1.0e-3;
/// The tag's true position at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    t_s: Option<f64>,
    place: Coordinates,
}

/// The tag's true positions.
#[derive(Clone, Debug, Default)]
pub struct Truth {
    /// In the order of the file.
    rows: Vec<Row>,
    /// The epoch of each row.
    epochs: Texts,
    by_name: Index,
    /// The rows with a time, in the order of time.
    by_time: Vec<usize>,
}

/// How the truth was joined to epochs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joined {
    /// By time.
    ByTime,
    /// By the epochs' names, because the truth or the epochs have no times.
    ByEpoch,
    /// By the epochs' names, although both have times: their clocks have no second in common.
    ByEpochDespiteTimes,
}

/// The true positions of all tags in a file.
#[derive(Clone, Debug)]
pub struct Truths {
    file: PathBuf,
    /// The name is `None` for rows that do not say whose position they are.
    by_tag: Vec<(Option<String>, Truth)>,
}

impl Truths {
    /// Reads `truth.csv`. With `heights`, a file without a column of heights is an error.
    ///
    /// # Errors
    /// The first line that is wrong.
    pub fn read(file: &Path, heights: bool) -> Result<Self, UserError> {
        let mut table = Table::open(file)?;
        let (epoch, x, y) = (table.column("epoch")?, table.column("x_m")?, table.column("y_m")?);
        let z = if heights { table.column("z_m")? } else { table.optional("z_m") };
        let (time, tag) = (table.optional("t_s"), table.optional("tag"));
        // By tag: its name, its positions, and the line of each.
        let mut by_tag: ByName<(Option<String>, Truth, Vec<u64>)> = ByName::default();
        while let Some(row) = table.next_row()? {
            let name = row.some_text(epoch)?;
            let tag = tag_of(&row, tag);
            let new = || (tag.map(str::to_owned), Truth::default(), Vec::new());
            let (_, truth, lines) = by_tag.of(tag.unwrap_or(""), new);
            if let Some(line) = truth.by_name.find(&truth.epochs, name).and_then(|before| lines.get(before)) {
                return Err(row.wrong(epoch, &format!("{} stands in line {line} already", quoted(name))));
            }
            let place = Coordinates { x_m: row.some_number(x)?, y_m: row.some_number(y)?, z_m: row.number(z)? };
            truth.push(name, row.number(time)?, place);
            lines.push(row.line());
        }
        let mut by_tag: Vec<_> = by_tag.in_order().into_iter().map(|(tag, truth, _)| (tag, truth)).collect();
        if by_tag.is_empty() {
            return Err(UserError::line(file, 1, "no positions below the header"));
        }
        by_tag.iter_mut().for_each(|(_, truth)| truth.sort());
        Ok(Self { file: file.to_owned(), by_tag })
    }

    /// The true positions of a tag. A file that names no tag is of any tag.
    ///
    /// # Errors
    /// The file is of several tags, and the name of the tag is not known.
    pub fn of(&self, tag: Option<&str>) -> Result<Option<&Truth>, UserError> {
        match (self.by_tag.as_slice(), tag) {
            ([(_, only)], None) | ([(None, only)], Some(_)) => Ok(Some(only)),
            (several, None) => {
                let what = format!("it is of {} tags, and the other file has no column tag", several.len());
                Err(UserError::file(&self.file, what))
            }
            (each, Some(tag)) => {
                let alike = |of: &Option<String>| of.as_deref().map(spelled) == Some(spelled(tag));
                let exact = each.iter().find(|(of, _)| of.as_deref() == Some(tag));
                Ok(exact.or_else(|| each.iter().find(|(of, _)| alike(of))).map(|(_, truth)| truth))
            }
        }
    }

    /// The names of the tags, and their true positions.
    pub fn by_tag(&self) -> impl Iterator<Item = (Option<&str>, &Truth)> {
        self.by_tag.iter().map(|(tag, truth)| (tag.as_deref(), truth))
    }
}

impl Truth {
    /// Adds the position of an epoch that has none yet.
    fn push(&mut self, epoch: &str, t_s: Option<f64>, place: Coordinates) {
        let at = self.epochs.push(epoch);
        self.by_name.insert(&self.epochs, at);
        self.rows.push(Row { t_s, place });
    }

    /// Sorts the rows that have a time.
    fn sort(&mut self) {
        let timed = self.rows.iter().enumerate().filter_map(|(at, row)| Some((row.t_s?, at)));
        let mut timed: Vec<(f64, usize)> = timed.collect();
        timed.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        self.by_time = timed.into_iter().map(|(_, at)| at).collect();
    }

    /// A row, by its place in the order of time: time in seconds, position.
    fn timed(&self, place: usize) -> Option<(f64, Coordinates)> {
        let Row { t_s, place } = self.rows.get(*self.by_time.get(place)?)?;
        Some(((*t_s)?, *place))
    }

    /// Whether any position has a time.
    pub fn has_times(&self) -> bool {
        !self.by_time.is_empty()
    }

    /// All positions, in the order of the file.
    pub fn places(&self) -> impl Iterator<Item = &Coordinates> {
        self.rows.iter().map(|row| &row.place)
    }

    /// All rows, in the order of the file: epoch, time in seconds, position.
    pub fn rows(&self) -> impl Iterator<Item = (&str, Option<f64>, &Coordinates)> {
        self.rows.iter().enumerate().map(|(at, row)| (self.epochs.get(at).unwrap_or(""), row.t_s, &row.place))
    }

    /// The position at a time of the truth's clock, seconds. There is none before the first row and after the last one,
    /// and none in a gap of more than a second during which the tag moved; but each row holds for a tenth of a second.
    pub fn at(&self, t_s: f64) -> Option<Coordinates> {
        let is_before = |at: &usize| self.rows.get(*at).is_some_and(|row| row.t_s.is_some_and(|row_s| row_s < t_s));
        let next = self.by_time.partition_point(is_before);
        let before = next.checked_sub(1).and_then(|place| self.timed(place));
        let after = self.timed(next);
        if let (Some((from_s, from)), Some((to_s, to))) = (before, after) {
            let gap_s = to_s - from_s;
            if gap_s <= LONGEST_GAP_S || (from.x_m - to.x_m).hypot(from.y_m - to.y_m) <= MOVES_M {
                let share = (t_s - from_s) / gap_s;
                let between = |from: f64, to: f64| from + share * (to - from);
                return Some(Coordinates {
                    x_m: between(from.x_m, to.x_m),
                    y_m: between(from.y_m, to.y_m),
                    z_m: from.z_m.zip(to.z_m).map(|(from, to)| between(from, to)),
                });
            }
        }
        let near = [before, after].into_iter().flatten().filter(|(row_s, _)| (row_s - t_s).abs() <= HOLDS_S);
        near.min_by(|(one, _), (other, _)| (one - t_s).abs().total_cmp(&(other - t_s).abs())).map(|(_, place)| place)
    }

    /// The position of an epoch, by its time, or else by its name. `offset_s` is added to the times of the truth,
    /// seconds.
    pub fn of_epoch(&self, name: &str, t_s: Option<f64>, offset_s: f64) -> Option<Coordinates> {
        let Some(t_s) = t_s.filter(|_| !self.by_time.is_empty()) else { return self.named(name).map(|row| row.place) };
        match self.named(name) {
            // Times may be rounded: a row of the same epoch and instant is better than its neighbours.
            Some(Row { t_s: Some(row_s), place, .. }) if (row_s + offset_s - t_s).abs() <= SAME_INSTANT_S => {
                Some(*place)
            }
            Some(Row { t_s: None, place, .. }) => Some(*place),
            Some(_) | None => self.at(t_s - offset_s),
        }
    }

    /// The position of each epoch, by its name and its time. `offset_s` is added to the times of the truth, seconds.
    ///
    /// If the two clocks have no second in common and no offset is asked for, the epochs are joined by their names.
    pub fn of_epochs<'a>(
        &self,
        epochs: impl Iterator<Item = (&'a str, Option<f64>)> + Clone,
        offset_s: f64,
    ) -> (Vec<Option<Coordinates>>, Joined) {
        let place = |(name, t_s): (&str, Option<f64>)| self.of_epoch(name, t_s, offset_s);
        let has_times = !self.by_time.is_empty() && epochs.clone().any(|(_, t_s)| t_s.is_some());
        let places: Vec<_> = epochs.clone().map(place).collect();
        match has_times {
            false => (places, Joined::ByEpoch),
            true if offset_s == 0.0 && places.iter().all(Option::is_none) => {
                let places: Vec<_> = epochs.map(|(name, _)| self.named(name).map(|row| row.place)).collect();
                let common = places.iter().any(Option::is_some);
                (places, if common { Joined::ByEpochDespiteTimes } else { Joined::ByTime })
            }
            true => (places, Joined::ByTime),
        }
    }

    /// Gives the epochs their true positions. `offset_s` is added to the times of the truth, seconds.
    pub fn join(&self, epochs: &mut Epochs, offset_s: f64) -> Joined {
        let (places, joined) = self.of_epochs(epochs.iter().map(|epoch| (epoch.name, epoch.t_s)), offset_s);
        epochs.set_truths(places);
        joined
    }

    fn named(&self, name: &str) -> Option<&Row> {
        self.rows.get(self.by_name.find(&self.epochs, name)?)
    }
}

impl Truth {
    /// A truth of these times and positions, whose epochs are numbered from 0.
    pub fn of(rows: impl IntoIterator<Item = (f64, [f64; 3])>) -> Self {
        let mut truth = Self::default();
        for (number, (t_s, [x_m, y_m, z_m])) in rows.into_iter().enumerate() {
            truth.push(&number.to_string(), Some(t_s), Coordinates { x_m, y_m, z_m: Some(z_m) });
        }
        truth.sort();
        truth
    }
}

#[cfg(test)]
mod tests {
    use super::{Joined, Truth};
    use crate::{Coordinates, Epochs};

    fn x_m(place: Option<Coordinates>) -> Option<f64> {
        place.map(|place| (place.x_m * 1.0e6).round() / 1.0e6)
    }

    #[test]
    fn a_position_is_interpolated_but_not_extrapolated_nor_in_a_gap() {
        // 1 m/s for a second, nothing known for two seconds, then at rest for ten.
        let truth = Truth::of([
            (0.0, [0.0, 0.0, 1.0]),
            (1.0, [1.0, 0.0, 2.0]),
            (3.0, [5.0, 0.0, 2.0]),
            (13.0, [5.05, 0.0, 2.0]),
        ]);
        assert_eq!((x_m(truth.at(0.25)), truth.at(0.25).and_then(|place| place.z_m)), (Some(0.25), Some(1.25)));
        assert_eq!([-0.3, -0.05, 0.0, 1.0].map(|t_s| x_m(truth.at(t_s))), [None, Some(0.0), Some(0.0), Some(1.0)]);
        assert_eq!([1.05, 2.0, 2.95, 3.0].map(|t_s| x_m(truth.at(t_s))), [Some(1.0), None, Some(5.0), Some(5.0)]);
        assert_eq!([8.0, 13.05, 13.5].map(|t_s| x_m(truth.at(t_s))), [Some(5.025), Some(5.05), None]);
    }

    fn epochs(times_s: &[Option<f64>]) -> Epochs {
        let mut epochs = Epochs::default();
        times_s.iter().enumerate().for_each(|(at, &t_s)| epochs.push(&at.to_string(), t_s, None));
        epochs
    }

    /// The x of each epoch's true position.
    fn truths_m(epochs: &Epochs) -> Vec<Option<f64>> {
        epochs.iter().map(|epoch| x_m(epoch.truth)).collect()
    }

    #[test]
    fn numbers_of_another_rate_neither_join_nor_add_epochs() {
        // The tag goes at 1 m/s. The truth has ten rows a second, the ranges two epochs a second.
        let truth = Truth::of((0..100).map(|k| (0.1 * f64::from(k), [0.1 * f64::from(k), 0.0, 0.0])));
        let mut heard = epochs(&(0..19).map(|k| Some(0.5 * f64::from(k) + 0.05)).collect::<Vec<_>>());
        assert_eq!(truth.join(&mut heard, 0.0), Joined::ByTime);
        assert_eq!(heard.len(), 19);
        assert_eq!([0, 18].map(|at| truths_m(&heard)[at]), [Some(0.05), Some(9.05)]);
        // Rows that are stamped 0.2 s late need -0.2 s.
        truth.join(&mut heard, -0.2);
        assert_eq!([1, 18].map(|at| truths_m(&heard)[at]), [Some(0.75), Some(9.25)]);
    }

    #[test]
    fn epochs_without_times_or_of_other_clocks_are_joined_by_name() {
        let truth = Truth::of([(0.0, [7.0, 0.0, 0.0]), (0.5, [8.0, 0.0, 0.0]), (1.0, [9.0, 0.0, 0.0])]);
        let mut heard = epochs(&[None, None]);
        assert_eq!(truth.join(&mut heard, 0.0), Joined::ByEpoch);
        assert_eq!(truths_m(&heard), [Some(7.0), Some(8.0)]);
        let mut heard = epochs(&[Some(500.0), Some(501.0)]);
        assert_eq!(truth.join(&mut heard, 0.0), Joined::ByEpochDespiteTimes);
        assert_eq!(truths_m(&heard), [Some(7.0), Some(8.0)]);
    }
}
