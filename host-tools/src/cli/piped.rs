//! `solve` and `track` of ranges that arrive in a pipe: each epoch's position is written as soon as the next epoch
//! begins, and nothing of a long stream is kept.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use analysis::Setup;
use analysis::locate::advice;
use anyhow::Result;
use recording::output::STANDARD;
use recording::positions::{LiveTable, Rows, TableParts};
use recording::{Anchor, Epoch, Epochs, LiveEpochs, OpenRound, Solved, Space, Truths, drop_repeats};

use super::stream::feed_stdout;

/// A recording whose ranges come on standard input.
pub struct Piped {
    pub anchors: Vec<Anchor>,
    pub setup: Setup,
    pub truths: Option<Truths>,
    /// Added to the times of the truth, seconds.
    pub offset_s: f64,
    /// The duration of rounds of single ranges, where they are made.
    pub longest_s: Option<f64>,
    pub is_csv: bool,
}

/// What was found so far.
#[derive(Default)]
struct Found {
    errors: u64,
    square_m2: f64,
    positions: usize,
    /// By their reasons: how many epochs have no position, and one of them.
    without: BTreeMap<&'static str, (usize, Option<Solved>)>,
}

impl Found {
    fn take(&mut self, solved: &Solved) {
        match solved.outcome {
            Ok(_) => self.positions += 1,
            Err(reason) => {
                let (count, example) = self.without.entry(reason.as_str()).or_default();
                *count += 1;
                *example = Some(*solved);
            }
        }
        if let Some(error_m) = solved.error_m {
            self.errors += 1;
            self.square_m2 += error_m * error_m;
        }
    }

    fn text(&self) -> String {
        let mut text = format!("{} positions", self.positions);
        if self.errors > 0 {
            text += &format!(", RMSE {:.3} m", (self.square_m2 / self.errors as f64).sqrt());
        }
        for (reason, (count, _)) in &self.without {
            text += &format!(", {count} {reason}");
        }
        text + "\n"
    }
}

impl Piped {
    /// Writes the positions as the ranges come. `locate` returns those of an epoch of a tag, one a method; `follows`:
    /// they have velocities.
    ///
    /// # Errors
    /// The first line that is wrong, standard output cannot be written, or there is no position at all.
    pub fn run(
        &self,
        methods: &[&str],
        follows: bool,
        mut locate: impl FnMut(Option<&str>, &Epoch) -> Vec<Solved>,
    ) -> Result<()> {
        let mut live = LiveEpochs::open(Path::new(STANDARD), &self.anchors)?;
        let heights = matches!(self.setup.space, Space::Full(_));
        // Whether any position will be doubtful is not known yet.
        let (errors, tags) = (self.truths.is_some(), live.has_tags());
        let parts = TableParts { errors, heights, velocities: follows, flags: true, tags };
        let mut table = LiveTable::new(parts, self.is_csv);
        let height = self.setup.space.height();
        let mut found = Found::default();
        let mut rounds: HashMap<Option<String>, OpenRound> = HashMap::new();
        let mut write = |tag: Option<&str>, epochs: &Epochs| -> Result<bool> {
            for epoch in epochs.iter() {
                let mut single = Epochs::default();
                single.push(epoch.name, epoch.t_s, epoch.truth);
                for (method, solved) in methods.iter().zip(locate(tag, &epoch)) {
                    found.take(&solved);
                    if !feed_stdout(&table.text(Rows { tag, method, epochs: &single, solved: &[solved], height })?)? {
                        return Ok(false);
                    }
                }
            }
            Ok(true)
        };
        while let Some((tag, mut epochs)) = live.next_epoch()? {
            drop_repeats(&mut epochs);
            if let Some(truth) = self.truths.as_ref().map(|truths| truths.of(tag.as_deref())).transpose()?.flatten() {
                truth.join(&mut epochs, self.offset_s);
            }
            if let Some(longest_s) = self.longest_s {
                let round = rounds.entry(tag.clone()).or_insert_with(|| OpenRound::new(longest_s));
                let mut ended = Epochs::default();
                for epoch in epochs.iter() {
                    let ranges = epoch.ranges.iter();
                    ranges.for_each(|range| round.take(epoch.name, epoch.truth, range, &mut ended));
                }
                epochs = ended;
            }
            if !write(tag.as_deref(), &epochs)? {
                return Ok(());
            }
        }
        for (tag, mut round) in rounds {
            let mut ended = Epochs::default();
            round.end(&mut ended);
            if !write(tag.as_deref(), &ended)? {
                return Ok(());
            }
        }
        super::note(&found.text());
        let without = found.without.values().filter_map(|(count, solved)| Some((*count, solved.as_ref()?)));
        let without = without.flat_map(|(count, solved)| std::iter::repeat_n(solved, count));
        let why = (found.positions == 0).then(|| advice::nothing_solved(without, "anchors", heights)).flatten();
        super::report::some_position(why)
    }
}
