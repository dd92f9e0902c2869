//! Results of the protocol: one method on one recording, its file of blocks, and the comparison of two methods or two
//! versions.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use baliza_research::accuracy::{
    Block, Figures, LogRatio, Measure, Outcome, Scored, blocks, outcome, over_recordings, ratio,
};
use host_tools::{Table, UserError};

const COLUMNS: &str = "site,recording,method,offset_s,block,epochs,fixed,sum_m,sum_m2";

/// One method on one recording.
pub struct Score {
    /// The site.
    pub site: String,
    /// Whether the site is simulated.
    pub simulated: bool,
    /// The recording.
    pub recording: String,
    /// The method.
    pub method: String,
    /// The error that is compared.
    pub measure: Measure,
    /// The offset of the truth's clock, seconds.
    pub offset_s: f64,
    /// The figures.
    pub figures: Figures,
    /// The blocks.
    pub blocks: Vec<Block>,
}

impl Score {
    /// The score of epochs in the order of time.
    pub fn of([site, recording, method]: [&str; 3], measure: Measure, scored: &[Scored]) -> Self {
        let [site, recording, method] = [site, recording, method].map(str::to_owned);
        let (figures, blocks) = (Figures::of(scored), blocks(scored));
        Self { site, simulated: false, recording, method, measure, offset_s: 0.0, figures, blocks }
    }
}

/// The file of `--out`: a row a block.
pub fn to_csv(scores: &[Score]) -> String {
    let mut text = format!("{COLUMNS}\n");
    // A name with a comma is quoted. Writing to a string cannot fail.
    let quoted = |name: &str| if name.contains(',') { format!("\"{name}\"") } else { name.to_owned() };
    for score in scores {
        let names = [&score.site, &score.recording, &score.method].map(|name| quoted(name)).join(",");
        for (number, Block { epochs, fixed, sum_m, sum_m2 }) in score.blocks.iter().enumerate() {
            let _ = writeln!(text, "{names},{},{number},{epochs},{fixed},{sum_m},{sum_m2}", score.offset_s);
        }
    }
    text
}

/// The results of an earlier run: blocks by recording and method, and the offset of the truth's clock by recording.
#[derive(Default)]
pub struct Earlier {
    blocks: BTreeMap<[String; 2], Vec<Block>>,
    offsets_s: BTreeMap<String, f64>,
}

impl Earlier {
    /// Reads the file of `--out`.
    ///
    /// # Errors
    /// The first line that is wrong.
    pub fn read(file: &Path) -> Result<Self, UserError> {
        let mut table = Table::open(file)?;
        let [recording, method, offset] =
            [table.column("recording")?, table.column("method")?, table.column("offset_s")?];
        let [epochs, fixed, sum_m, sum_m2] =
            [table.column("epochs")?, table.column("fixed")?, table.column("sum_m")?, table.column("sum_m2")?];
        let mut earlier = Self::default();
        while let Some(row) = table.next_row()? {
            let names = [row.some_text(recording)?.to_owned(), row.some_text(method)?.to_owned()];
            earlier.offsets_s.insert(names[0].clone(), row.some_number(offset)?);
            // The conversion saturates: a number that is negative becomes 0.
            earlier.blocks.entry(names).or_default().push(Block {
                epochs: row.some_number(epochs)? as usize,
                fixed: row.some_number(fixed)? as usize,
                sum_m: row.some_number(sum_m)?,
                sum_m2: row.some_number(sum_m2)?,
            });
        }
        Ok(earlier)
    }

    /// The offset of the truth's clock in a recording, so that both versions have the same truth.
    pub fn offset_s(&self, recording: &str) -> Option<f64> {
        self.offsets_s.get(recording).copied()
    }

    /// The blocks of a method on a recording.
    pub fn blocks(&self, recording: &str, method: &str) -> Option<&[Block]> {
        self.blocks.get(&[recording.to_owned(), method.to_owned()]).map(Vec::as_slice)
    }
}

/// New against old at one site.
#[derive(Clone, Debug)]
pub struct Compared {
    pub site: String,
    pub simulated: bool,
    pub method: String,
    /// The geometric means of both errors over the recordings, new and old, metres.
    pub errors_m: [Option<f64>; 2],
    pub ratio: Option<LogRatio>,
    pub outcome: Outcome,
}

/// Compares the scores of a method with their old blocks, site by site, in the order of the scores. Recordings without
/// old blocks are left out.
pub fn compare<'s>(
    scores: impl IntoIterator<Item = &'s Score>,
    old: impl Fn(&Score) -> Option<&'s [Block]>,
) -> Vec<Compared> {
    let mut sites: Vec<Vec<Pair>> = Vec::new();
    for score in scores {
        let Some(blocks) = old(score) else { continue };
        let same = |pairs: &&mut Vec<Pair>| {
            pairs.iter().any(|(other, _)| other.site == score.site && other.method == score.method)
        };
        match sites.iter_mut().find(same) {
            Some(pairs) => pairs.push((score, blocks)),
            None => sites.push(vec![(score, blocks)]),
        }
    }
    sites.iter().filter_map(|pairs| compare_site(pairs)).collect()
}

/// A new score and its old blocks.
type Pair<'s> = (&'s Score, &'s [Block]);

fn compare_site(pairs: &[Pair]) -> Option<Compared> {
    let (first, _) = pairs.first()?;
    let ratios: Vec<_> = pairs.iter().filter_map(|(new, old)| ratio(new.measure, &new.blocks, old)).collect();
    let sums: Vec<[Block; 2]> = pairs.iter().map(|(new, old)| [Block::sum(&new.blocks), Block::sum(*old)]).collect();
    let answered = [0, 1].map(|which: usize| {
        let share = |sums: &[Block; 2]| sums[which].fixed as f64 / sums[which].epochs.max(1) as f64;
        baliza_report::mean(sums.iter().map(share))
    });
    let errors_m =
        [0, 1].map(|which: usize| geometric_mean(sums.iter().filter_map(|sums| sums[which].error_m(first.measure))));
    let ratio = over_recordings(&ratios);
    let (site, method, outcome) = (first.site.clone(), first.method.clone(), outcome(ratio, answered));
    Some(Compared { site, simulated: first.simulated, method, errors_m, ratio, outcome })
}

/// The geometric mean; `None` without values.
pub fn geometric_mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mean = baliza_report::mean(values.into_iter().map(f64::ln)).exp();
    mean.is_finite().then_some(mean)
}

#[cfg(test)]
mod tests {
    use baliza_research::accuracy::{Measure, Outcome, Scored};

    use super::{Earlier, Score, compare, to_csv};

    fn score(recording: &str, method: &str, error_m: f64) -> Score {
        let epoch = |at| Scored {
            t_s: Some(f64::from(at)),
            error_m: Some(error_m * (1.0 + 0.1 * f64::from(at % 3))),
            normalised_square: None,
        };
        let scored: Vec<_> = (0..30).map(epoch).collect();
        Score { offset_s: 0.28, ..Score::of(["a, b", recording, method], Measure::Rmse, &scored) }
    }

    #[test]
    fn blocks_survive_their_file() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("accuracy.csv");
        let scores = [score("one", "solve", 0.2), score("one", "track", 0.1)];
        std::fs::write(&file, to_csv(&scores)).expect("written");
        let earlier = Earlier::read(&file).expect("read");
        assert_eq!(earlier.blocks("one", "track"), Some(scores[1].blocks.as_slice()));
        assert_eq!((earlier.offset_s("one"), earlier.offset_s("two")), (Some(0.28), None));
        assert_eq!(earlier.blocks("one", "robust"), None);
    }

    #[test]
    fn recordings_of_a_site_are_compared_together() {
        let old = [score("one", "track", 0.2), score("two", "track", 0.1)];
        let new = [score("one", "track", 0.1), score("two", "track", 0.1), score("three", "track", 0.1)];
        let find = |score: &Score| old.iter().find(|old| old.recording == score.recording).map(|old| &old.blocks[..]);
        let [site] = &compare(&new, find)[..] else { panic!("one site") };
        // Half at one of two: √½.
        let ratio = site.ratio.expect("a ratio");
        assert!((ratio.value - 0.5 * 0.5_f64.ln()).abs() < 1e-9 && ratio.deviation < 1e-9, "{ratio:?}");
        assert_eq!(site.outcome, Outcome::Better);
    }
}
