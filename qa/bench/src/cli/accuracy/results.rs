//! Results of the protocol: one method on one recording, its file of blocks, and the comparison of two methods or two
//! versions.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use accuracy::{
    Block, Figures, LEAST_ANSWERED, LogRatio, Measure, ScoredEpoch, SiteOutcome, blocks, both_fixed, outcome,
    over_recordings, ratio,
};
use anyhow::Result;
use recording::{Table, UserError};

const COLUMNS: &str = "site,recording,method,offset_s,block,epochs,fixed,sum_m,sum_m2";

/// One method on one recording.
pub struct MethodScore {
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
    /// The results of the epochs, in the order of time.
    pub scored: Vec<ScoredEpoch>,
    /// The blocks.
    pub blocks: Vec<Block>,
}

impl MethodScore {
    /// The score of epochs in the order of time.
    pub fn of([site, recording, method]: [&str; 3], measure: Measure, scored: Vec<ScoredEpoch>) -> Self {
        let [site, recording, method] = [site, recording, method].map(str::to_owned);
        let (figures, blocks) = (Figures::of(&scored), blocks(&scored));
        Self { site, simulated: false, recording, method, measure, offset_s: 0.0, figures, scored, blocks }
    }
}

/// The file of `--out`: a row a block.
pub fn to_csv(scores: &[MethodScore]) -> String {
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
    pub outcome: SiteOutcome,
}

/// New and old blocks of a method on a recording, which are pairs, and the shares of epochs with a position.
pub struct Pair<'s> {
    pub new: &'s MethodScore,
    pub blocks: [Cow<'s, [Block]>; 2],
    pub answered: [f64; 2],
}

impl<'s> Pair<'s> {
    /// Against the blocks of an earlier run.
    pub fn with_earlier(new: &'s MethodScore, old: &'s [Block]) -> Self {
        Self { new, blocks: [new.blocks.as_slice().into(), old.into()], answered: [&new.blocks, old].map(answered) }
    }

    /// Against another method of the same run: only epochs where both have a position.
    pub fn with_other(new: &'s MethodScore, old: &'s MethodScore) -> Self {
        let both = both_fixed(&new.scored, &old.scored).map(|scored| blocks(&scored).into());
        Self { new, blocks: both, answered: [&new.blocks, &old.blocks].map(|blocks| answered(blocks)) }
    }

    fn ratio(&self) -> Option<LogRatio> {
        let [new, old] = &self.blocks;
        let enough = self.answered.iter().all(|share| *share >= LEAST_ANSWERED);
        enough.then(|| ratio(self.new.measure, new, old)).flatten()
    }
}

/// The share of epochs with a position.
fn answered(blocks: &[Block]) -> f64 {
    let Block { epochs, fixed, .. } = Block::sum(blocks);
    fixed as f64 / epochs.max(1) as f64
}

/// Compares pairs site by site and method by method, in their order.
pub fn compare<'s>(pairs: impl IntoIterator<Item = Pair<'s>>) -> Vec<Compared> {
    let mut sites: Vec<Vec<Pair>> = Vec::new();
    for pair in pairs {
        let same = |pairs: &&mut Vec<Pair>| {
            pairs.iter().any(|other| other.new.site == pair.new.site && other.new.method == pair.new.method)
        };
        match sites.iter_mut().find(same) {
            Some(pairs) => pairs.push(pair),
            None => sites.push(vec![pair]),
        }
    }
    sites.iter().filter_map(|pairs| compare_site(pairs)).collect()
}

fn compare_site(pairs: &[Pair]) -> Option<Compared> {
    let MethodScore { site, simulated, method, measure, .. } = pairs.first()?.new;
    let ratios: Vec<_> = pairs.iter().filter_map(Pair::ratio).collect();
    let compared = || pairs.iter().filter(|pair| pair.ratio().is_some());
    let errors_m = [0, 1].map(|which: usize| {
        geometric_mean(compared().filter_map(|pair| Block::sum(pair.blocks[which].iter()).error_m(*measure)))
    });
    let answered = [0, 1].map(|which: usize| baliza_report::mean(pairs.iter().map(|pair| pair.answered[which])));
    let ratio = over_recordings(&ratios);
    let (site, method, outcome) = (site.clone(), method.clone(), outcome(ratio, answered));
    Some(Compared { site, simulated: *simulated, method, errors_m, ratio, outcome })
}

/// The geometric mean; `None` without values.
pub fn geometric_mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mean = baliza_report::mean(values.into_iter().map(f64::ln)).exp();
    mean.is_finite().then_some(mean)
}

#[cfg(test)]
mod tests {
    use accuracy::{Measure, ScoredEpoch, SiteOutcome};

    use super::{Earlier, MethodScore, Pair, compare, to_csv};

    fn score(recording: &str, method: &str, error_m: f64) -> MethodScore {
        let epoch = |at| ScoredEpoch {
            t_s: Some(f64::from(at)),
            error_m: Some(error_m * (1.0 + 0.1 * f64::from(at % 3))),
            normalised_square: None,
        };
        let scored: Vec<_> = (0..30).map(epoch).collect();
        MethodScore { offset_s: 0.28, ..MethodScore::of(["a, b", recording, method], Measure::Rmse, scored) }
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
        let new = [score("one", "track", 0.1), score("two", "track", 0.1)];
        let pairs = new.iter().zip(&old).map(|(new, old)| Pair::with_earlier(new, &old.blocks));
        let [site] = &compare(pairs)[..] else { panic!("one site") };
        // Half at one of two: √½.
        let ratio = site.ratio.expect("a ratio");
        assert!((ratio.value - 0.5 * 0.5_f64.ln()).abs() < 1e-9 && ratio.deviation < 1e-9, "{ratio:?}");
        assert_eq!(site.outcome, SiteOutcome::Better);
    }

    #[test]
    fn two_methods_are_compared_where_both_have_a_position() {
        let (mut track, mut solve) = (score("one", "track", 0.1), score("one", "solve", 0.2));
        // The solver has no position in the ten epochs where the track errs by 5 m.
        for at in 5..15 {
            track.scored[at].error_m = Some(5.0);
            solve.scored[at].error_m = None;
        }
        let [site] = &compare([Pair::with_other(&track, &solve)])[..] else { panic!("one site") };
        let ratio = site.ratio.expect("a ratio");
        assert!((ratio.value - 0.5_f64.ln()).abs() < 1e-9, "{ratio:?}");
    }
}
