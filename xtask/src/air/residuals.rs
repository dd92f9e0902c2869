//! Statistics of residuals: measured ranges minus distances between surveyed anchors and true positions.
//!
//! The input is a recording's `anchors.csv`, `ranges.csv` and `truth.csv`. The common mean of all links is removed,
//! here their median, because a common antenna delay is no error of the air.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use baliza_report::mean;

/// Residuals beyond this belong to no direct path, metres.
const LARGEST_M: f64 = 1.5;
/// Samples of a link of which all pairs are compared.
const COMPARED: usize = 1_500;
/// Bins of the covariance: their width, metres, and their number.
const BIN_M: f64 = 0.1;
const BINS: usize = 30;
/// The minimum number of pairs in a bin.
const PAIRS: u32 = 1_000;

/// A range's residual and the tag's position, metres.
#[derive(Clone, Copy, Debug)]
struct Sample {
    residual_m: f64,
    at_m: [f64; 3],
}

/// The residuals of the links of a tag, each in the order of time.
pub struct Residuals {
    links: Vec<Vec<Sample>>,
}

/// What residuals look like, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// Root mean square of the links' errors.
    pub rms_m: f64,
    /// The movement after which a link's error, less its mean and its white part, has a correlation of 1/e.
    pub length_m: Option<f64>,
    /// The median link's white part: the standard deviation of successive differences, divided by √2.
    pub white_m: f64,
}

/// A tag's true positions by time.
#[derive(Default)]
pub struct Truth(Vec<(f64, [f64; 3])>);

impl Truth {
    /// The true positions of a tag, or of the only one.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(folder: &Path, tag: Option<&str>) -> Result<Self> {
        let rows = rows(&folder.join("truth.csv"), &["t_s", "x_m", "y_m", "z_m"], tag)?;
        let mut truth: Vec<_> = rows.into_iter().map(|(_, [t_s, x, y, z])| (t_s, [x, y, z])).collect();
        truth.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Self(truth))
    }

    /// The position at a time, interpolated.
    fn at(&self, t_s: f64) -> Option<[f64; 3]> {
        let next = self.0.partition_point(|(known_s, _)| *known_s < t_s);
        let after = self.0.get(next).or(self.0.last())?;
        let before = next.checked_sub(1).and_then(|before| self.0.get(before)).unwrap_or(after);
        let part = if after.0 > before.0 { (t_s - before.0) / (after.0 - before.0) } else { 0.0 };
        Some(std::array::from_fn(|i| before.1[i] + part.min(1.0) * (after.1[i] - before.1[i])))
    }

    /// As a file with an epoch for each position, where the truth's clock is `late_s` late.
    pub fn to_csv(&self, late_s: f64) -> String {
        let at = |t_s: f64| self.at(t_s + late_s).unwrap_or_default();
        let row = |(epoch, (t_s, _)): (usize, &(f64, [f64; 3]))| {
            let [x, y, z] = at(*t_s);
            format!("{epoch},{t_s},{x:.4},{y:.4},{z:.4}\n")
        };
        "epoch,t_s,x_m,y_m,z_m\n".to_owned() + &self.0.iter().enumerate().map(row).collect::<String>()
    }
}

impl Residuals {
    /// The residuals of a tag, or of the only one, in a recording whose truth is `late_s` late.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn read(folder: &Path, tag: Option<&str>, late_s: f64) -> Result<Self> {
        let truth = Truth::read(folder, tag)?;
        let anchors = rows(&folder.join("anchors.csv"), &["x_m", "y_m", "z_m"], None)?;
        let anchors: BTreeMap<String, [f64; 3]> = anchors.into_iter().collect();
        let mut links: BTreeMap<String, Vec<Sample>> = BTreeMap::new();
        for (anchor, [t_s, range_m]) in rows(&folder.join("ranges.csv"), &["t_s", "range_m"], tag)? {
            let (Some(place), Some(at_m)) = (anchors.get(&anchor), truth.at(t_s + late_s)) else { continue };
            let residual_m = range_m - distance(*place, at_m);
            links.entry(anchor).or_default().push(Sample { residual_m, at_m });
        }
        let mut all: Vec<f64> = links.values().flatten().map(|sample| sample.residual_m).collect();
        let common_m = median(&mut all);
        let without = |link: Vec<Sample>| {
            let moved = link.into_iter().map(|s| Sample { residual_m: s.residual_m - common_m, ..s });
            moved.filter(|sample| sample.residual_m.abs() < LARGEST_M).collect()
        };
        Ok(Self { links: links.into_values().map(without).filter(|link: &Vec<_>| link.len() > 2).collect() })
    }

    /// The statistics.
    pub fn statistics(&self) -> Statistics {
        let squares = self.links.iter().map(|link| mean(link.iter().map(|s| s.residual_m.powi(2))));
        let mut white: Vec<f64> = self.links.iter().map(|link| white_m(link)).collect();
        Statistics { rms_m: mean(squares).sqrt(), length_m: self.length_m(), white_m: median(&mut white) }
    }

    /// The correlation length; `None` if the tag did not move so far.
    fn length_m(&self) -> Option<f64> {
        let (mut sums, mut counts) = ([0.0; BINS], [0_u32; BINS]);
        let mut variance = 0.0;
        for link in &self.links {
            let mean_m = mean(link.iter().map(|s| s.residual_m));
            let lasting = mean(link.iter().map(|s| (s.residual_m - mean_m).powi(2))) - white_m(link).powi(2);
            variance += lasting / self.links.len() as f64;
            let few: Vec<_> = link.iter().step_by(link.len().div_ceil(COMPARED)).collect();
            for (at, a) in few.iter().enumerate() {
                for b in few.get(at + 1..).unwrap_or_default() {
                    let bin = (distance(a.at_m, b.at_m) / BIN_M) as usize;
                    if let (Some(sum), Some(count)) = (sums.get_mut(bin), counts.get_mut(bin)) {
                        *sum += (a.residual_m - mean_m) * (b.residual_m - mean_m);
                        *count += 1;
                    }
                }
            }
        }
        let correlations = sums.iter().zip(counts).map(|(sum, count)| (sum / f64::from(count) / variance, count));
        let filled = (0..).zip(correlations).filter(|(_, (_, count))| *count >= PAIRS);
        let (mut last, falls_to) = ((0.0, 1.0), (-1.0_f64).exp());
        for (bin, (correlation, _)) in filled {
            let here = ((f64::from(bin) + 0.5) * BIN_M, correlation);
            if correlation < falls_to {
                return Some(here.0 - (here.0 - last.0) * (falls_to - here.1) / (last.1 - here.1));
            }
            last = here;
        }
        None
    }
}

/// The standard deviation of successive differences, divided by √2.
fn white_m(link: &[Sample]) -> f64 {
    let differences = || link.windows(2).map(|pair| pair[1].residual_m - pair[0].residual_m);
    let mean_m = mean(differences());
    (mean(differences().map(|difference| (difference - mean_m).powi(2))) / 2.0).sqrt()
}

/// The middle one, or the lower of the two in the middle.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied().unwrap_or(f64::NAN)
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

/// The anchor (empty where there is none) and these columns of each row of a CSV file that has all of them, of a tag
/// or of all.
fn rows<const N: usize>(file: &Path, columns: &[&str; N], tag: Option<&str>) -> Result<Vec<(String, [f64; N])>> {
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let place = |name: &str| header.iter().position(|column| *column == name);
    let (anchor, of_tag) = (place("anchor"), place("tag"));
    let wanted = columns.map(place);
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let field = |at: Option<usize>| at.and_then(|at| fields.get(at)).copied();
        if tag.is_some() && field(of_tag) != tag {
            return None;
        }
        let mut values = [0.0; N];
        for (value, at) in values.iter_mut().zip(wanted) {
            *value = field(at)?.parse().ok()?;
        }
        Some((field(anchor).unwrap_or_default().to_owned(), values))
    };
    Ok(lines.filter_map(row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(residual_m: impl Fn(f64) -> f64) -> Vec<Sample> {
        let step = |i: i32| f64::from(i) * 0.01;
        (0..1_500).map(|i| Sample { residual_m: residual_m(step(i)), at_m: [step(i), 0.0, 0.0] }).collect()
    }

    #[test]
    fn a_wave_has_its_amplitude_and_length() {
        // A wave of 3 m: rms 0.1/√2; its covariance is cos(2πh/3), which is 1/e at h = 3·acos(1/e)/2π = 0.570 m.
        let wave = |x: f64| 0.1 * (std::f64::consts::TAU * x / 3.0).sin();
        let found = Residuals { links: vec![link(wave), link(|x| -wave(x))] }.statistics();
        assert!((found.rms_m - 0.0707).abs() < 1e-4, "{found:?}");
        // Distances are in bins of 0.1 m.
        assert!((found.length_m.unwrap() - 0.570).abs() < 0.02, "{found:?}");
        // Successive differences of 0.1·2π·0.01/3·cos: deviation 0.00148, divided by √2.
        assert!((found.white_m - 0.00105).abs() < 2e-5, "{found:?}");
    }

    #[test]
    fn what_only_alternates_is_white_and_a_constant_is_neither() {
        let sign = |x: f64| if (x * 100.0).round() as i32 % 2 == 0 { 0.02 } else { -0.02 };
        let found = Residuals { links: vec![link(|x| 0.1 + sign(x))] }.statistics();
        // Differences of ±0.04: 0.04/√2. The whole: √(0.1² + 0.02²).
        assert!((found.white_m - 0.0283).abs() < 1e-4 && (found.rms_m - 0.102).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn a_late_truth_is_read_later() {
        let truth = Truth(vec![(0.0, [0.0; 3]), (1.0, [1.0, 2.0, 0.0]), (2.0, [1.0, 2.0, 4.0])]);
        assert_eq!(truth.at(0.5), Some([0.5, 1.0, 0.0]));
        assert_eq!(truth.at(9.0), Some([1.0, 2.0, 4.0]));
        assert!(truth.to_csv(0.5).contains("\n1,1,1.0000,2.0000,2.0000\n"), "{}", truth.to_csv(0.5));
    }
}
