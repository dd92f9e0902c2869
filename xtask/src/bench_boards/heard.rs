//! What a node has reported: the lines of `baliza monitor --format jsonl`, as figures.

use anyhow::{Context, Result};
use serde_json::Value;

/// A node's messages, in their order.
#[derive(Clone, Debug)]
pub struct Heard(Vec<Value>);

impl Heard {
    /// Reads lines of JSON.
    ///
    /// # Errors
    /// A line is no JSON.
    pub fn parse(text: &str) -> Result<Self> {
        let line = |line: &str| serde_json::from_str(line).with_context(|| format!("not a line of monitor: {line}"));
        Ok(Self(text.lines().filter(|text| !text.trim().is_empty()).map(line).collect::<Result<_>>()?))
    }

    fn of<'h>(&'h self, kind: &'h str) -> impl Iterator<Item = &'h Value> {
        self.0.iter().filter(move |message| message["type"] == kind)
    }

    /// Whether a node has said hello.
    pub fn has_hello(&self) -> bool {
        self.of("hello").next().is_some()
    }

    /// When a state was reported first, seconds since the node started.
    pub fn state_s(&self, state: &str) -> Option<f64> {
        self.of("state").find(|message| message["state"] == state)?["t_s"].as_f64()
    }

    /// Rounds with a position or a reason, from the first position on, a second.
    pub fn rounds_per_s(&self) -> Option<f64> {
        let times: Vec<f64> = self.of("fix").filter_map(|fix| fix["t_s"].as_f64()).collect();
        let (first, last) = (times.first()?, times.last()?);
        (last > first).then(|| (times.len() - 1) as f64 / (last - first))
    }

    /// The share of rounds in which this number of anchors gave ranges that were used.
    pub fn share_with(&self, anchors: u64) -> Option<f64> {
        let all = self.of("fix").count();
        let whole = self.of("fix").filter(|fix| fix["used"].as_u64().is_some_and(|used| used >= anchors)).count();
        (all > 0).then(|| whole as f64 / all as f64)
    }

    /// Late starts by the last counters, for each round.
    pub fn late_share(&self) -> Option<f64> {
        let rounds = self.of("fix").count();
        let late = self.of("counters").last()?["late"].as_f64()?;
        (rounds > 0).then(|| late / rounds as f64)
    }

    /// Number, mean and standard deviation of the ranges, metres.
    pub fn ranges(&self) -> Option<(usize, f64, f64)> {
        let ranges: Vec<f64> = self.of("range").filter_map(|range| range["range_m"].as_f64()).collect();
        let count = ranges.len() as f64;
        let mean = ranges.iter().sum::<f64>() / count;
        let square = ranges.iter().map(|range| (range - mean).powi(2)).sum::<f64>() / (count - 1.0);
        (ranges.len() > 1).then(|| (ranges.len(), mean, square.sqrt()))
    }
}
