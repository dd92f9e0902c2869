//! The output of the images: see `onchip_bench` for the lines.

use anyhow::{Context, Result, bail, ensure};

/// One call.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredCall {
    /// The words that name it.
    pub words: String,
    pub instructions: u32,
    /// Bytes.
    pub stack: usize,
    /// Its results.
    pub results: Vec<f32>,
}

/// The complete output of one image.
#[derive(Clone, Debug, Default)]
pub struct Printed {
    /// The measured count for 1000 instructions.
    pub calibration: u32,
    pub calls: Vec<MeasuredCall>,
    /// Names and instructions of the image `costs`.
    pub costs: Vec<(String, u32)>,
    /// The ranges of the round of frames, metres.
    pub ranges: Vec<f32>,
}

impl Printed {
    /// Reads all lines.
    ///
    /// # Errors
    /// A line is not understood, or the last one is missing.
    pub fn parse(text: &str) -> Result<Self> {
        let mut printed = Self::default();
        let mut done = false;
        for line in text.lines() {
            ensure!(!done, "more after the end: {line}");
            done = printed.add(line).with_context(|| format!("not understood: {line}"))?;
        }
        ensure!(done, "the image did not print all");
        Ok(printed)
    }

    /// Reads one line; returns whether it was the last.
    fn add(&mut self, line: &str) -> Result<bool> {
        if let Some((words, rest)) = line.split_once(" : ") {
            let (cost, results) = rest.split_once(" :").context("no results")?;
            let (instructions, stack) = cost.split_once(' ').context("no stack")?;
            let results = results.split_whitespace().map(float).collect::<Result<_>>()?;
            let (words, instructions, stack) = (words.to_owned(), instructions.parse()?, stack.parse()?);
            self.calls.push(MeasuredCall { words, instructions, stack, results });
            return Ok(false);
        }
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["calibration", _, instructions] => self.calibration = instructions.parse()?,
            ["cost", what, instructions] => self.costs.push((what.to_owned(), instructions.parse()?)),
            ["range", _, metres] => self.ranges.push(float(metres)?),
            ["done"] => return Ok(true),
            _ => bail!("unknown line"),
        }
        Ok(false)
    }

    /// The calls whose words begin with these, each with its other words.
    pub fn calls<'p>(&'p self, begin: &'p str) -> impl Iterator<Item = (&'p str, &'p MeasuredCall)> {
        self.calls.iter().filter_map(move |call| Some((call.words.strip_prefix(begin)?.trim_start(), call)))
    }

    /// The worst instructions and the worst stack of the calls whose words begin with these.
    pub fn worst(&self, begin: &str) -> (u64, u64) {
        self.calls(begin).fold((0, 0), |(instructions, stack), (_, call)| {
            (instructions.max(call.instructions.into()), stack.max(call.stack as u64))
        })
    }
}

/// The `f32` of these hexadecimal bits.
fn float(word: &str) -> Result<f32> {
    Ok(f32::from_bits(u32::from_str_radix(word, 16)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read() {
        // 1.5 is 0x3FC00000 and −2 is 0xC0000000 (IEEE 754, single).
        let text = "calibration methods 1000\n\
                    solve b-wls 2 8 31 : 1499 352 : 3fc00000 c0000000\n\
                    solve b-wls 2 8 32 : 1400 360 : 3fc00000 c0000000\n\
                    solve lls 3 4 0 diverged : 10 20 :\n\
                    frame poll 21 : 2136 920 :\n\
                    range 3 3fc00000\n\
                    cost driver.now 120\n\
                    done\n";
        let printed = Printed::parse(text).expect("well formed");
        assert_eq!(printed.calibration, 1000);
        let words = "solve b-wls 2 8 31".to_owned();
        let first = MeasuredCall { words, instructions: 1499, stack: 352, results: vec![1.5, -2.0] };
        assert_eq!(printed.calls.first(), Some(&first));
        assert_eq!(printed.worst("solve b-wls 2 8 "), (1499, 360));
        let failed: Vec<_> = printed.calls("solve lls 3").map(|(words, call)| (words, call.results.len())).collect();
        assert_eq!(failed, [("4 0 diverged", 0)]);
        assert_eq!((printed.worst("frame poll "), &printed.ranges[..]), ((2136, 920), &[1.5][..]));
        assert_eq!(printed.costs, [("driver.now".to_owned(), 120)]);
    }

    #[test]
    fn an_image_that_stops_early_is_an_error() {
        assert!(Printed::parse("calibration methods 1000\n").is_err());
        assert!(Printed::parse("solve b-wls 2 8 31 : 1499\ndone\n").is_err());
    }
}
