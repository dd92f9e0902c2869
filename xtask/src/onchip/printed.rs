//! The output of the images: see `onchip_bench` for the lines.

use anyhow::{Context, Result, bail, ensure};
use positioning_core::Method;

/// One call of a method.
#[derive(Clone, Debug, PartialEq)]
pub struct Solve {
    pub method: Method,
    pub dims: usize,
    pub anchors: usize,
    pub epoch: u32,
    pub instructions: u32,
    /// Bytes.
    pub stack: usize,
    /// The position in metres, or the reason why there is none.
    pub answer: Result<Vec<f32>, String>,
}

/// One square root.
#[derive(Clone, Debug, PartialEq)]
pub struct Root {
    pub library: String,
    pub argument: f32,
    pub instructions: u32,
    pub root: f32,
}

/// One step of weighted least squares.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightedStep {
    pub variant: String,
    /// The library of the square root.
    pub library: String,
    pub instructions: u32,
    /// Bytes.
    pub stack: usize,
    /// Metres.
    pub position: [f32; 2],
}

/// A protocol's step after a received frame, or towards a sent one.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameCost {
    pub name: String,
    /// Bytes, without the check bytes.
    pub length: u32,
    pub instructions: u32,
    /// Bytes.
    pub stack: usize,
}

/// One call that returns a number: of the classification of blocked paths, or of the functions on the RSSI of
/// beacons.
#[derive(Clone, Debug, PartialEq)]
pub struct Call {
    pub what: String,
    pub instructions: u32,
    /// Bytes.
    pub stack: usize,
    /// Skewness, probability, coordinate or RSSI.
    pub value: f32,
}

impl Call {
    fn parse([what, instructions, stack, value]: [&str; 4]) -> Result<Self> {
        let (instructions, stack) = (instructions.parse()?, stack.parse()?);
        Ok(Self { what: what.to_owned(), instructions, stack, value: float(value)? })
    }
}

/// One step of the engine.
#[derive(Clone, Debug, PartialEq)]
pub struct EngineStep {
    pub what: String,
    pub dims: usize,
    pub anchors: u16,
    pub instructions: u32,
    /// Bytes.
    pub stack: usize,
    /// Metres.
    pub position: [f32; 3],
}

/// The complete output of one image.
#[derive(Clone, Debug, Default)]
pub struct Printed {
    /// The measured count for 1000 instructions.
    pub calibration: u32,
    pub solves: Vec<Solve>,
    pub roots: Vec<Root>,
    pub steps: Vec<WeightedStep>,
    pub frames: Vec<FrameCost>,
    pub sights: Vec<Call>,
    pub beacons: Vec<Call>,
    pub engine: Vec<EngineStep>,
    /// Names and instructions of the image `costs`.
    pub costs: Vec<(String, u32)>,
    /// The ranges of the round of [`frames`](Self::frames), metres.
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
            let words: Vec<&str> = line.split_whitespace().collect();
            done = printed.add(&words).with_context(|| format!("not understood: {line}"))?;
        }
        ensure!(done, "the image did not print all");
        Ok(printed)
    }

    /// Reads one line; returns whether it was the last.
    fn add(&mut self, words: &[&str]) -> Result<bool> {
        match words {
            ["calibration", _, instructions] => self.calibration = instructions.parse()?,
            ["solve", method, dims, anchors, epoch, instructions, stack, answer @ ..] => self.solves.push(Solve {
                method: method.parse()?,
                dims: dims.parse()?,
                anchors: anchors.parse()?,
                epoch: epoch.parse()?,
                instructions: instructions.parse()?,
                stack: stack.parse()?,
                answer: match answer {
                    ["fix", position @ ..] => Ok(position.iter().map(|word| float(word)).collect::<Result<_>>()?),
                    ["none", reason] => Err((*reason).to_owned()),
                    _ => bail!("neither fix nor none"),
                },
            }),
            ["root", library, argument, instructions, root] => self.roots.push(Root {
                library: (*library).to_owned(),
                argument: argument.parse()?,
                instructions: instructions.parse()?,
                root: float(root)?,
            }),
            ["step", variant, library, instructions, stack, x, y] => self.steps.push(WeightedStep {
                variant: (*variant).to_owned(),
                library: (*library).to_owned(),
                instructions: instructions.parse()?,
                stack: stack.parse()?,
                position: [float(x)?, float(y)?],
            }),
            ["frame", name, length, instructions, stack] => self.frames.push(FrameCost {
                name: (*name).to_owned(),
                length: length.parse()?,
                instructions: instructions.parse()?,
                stack: stack.parse()?,
            }),
            ["nlos", what, instructions, stack, value] => {
                self.sights.push(Call::parse([what, instructions, stack, value])?);
            }
            ["beacons", what, instructions, stack, value] => {
                self.beacons.push(Call::parse([what, instructions, stack, value])?);
            }
            ["engine", what, dims, anchors, instructions, stack, x, y, z] => self.engine.push(EngineStep {
                what: (*what).to_owned(),
                dims: dims.parse()?,
                anchors: anchors.parse()?,
                instructions: instructions.parse()?,
                stack: stack.parse()?,
                position: [float(x)?, float(y)?, float(z)?],
            }),
            ["cost", what, instructions] => self.costs.push(((*what).to_owned(), instructions.parse()?)),
            ["range", _, metres] => self.ranges.push(float(metres)?),
            ["done"] => return Ok(true),
            _ => bail!("unknown line"),
        }
        Ok(false)
    }

    /// The worst instructions and the worst stack over the epochs of one cell of the table.
    pub fn worst(&self, method: Method, dims: usize, anchors: usize) -> (u32, usize) {
        self.solves
            .iter()
            .filter(|solve| (solve.method, solve.dims, solve.anchors) == (method, dims, anchors))
            .fold((0, 0), |(instructions, stack), solve| (instructions.max(solve.instructions), stack.max(solve.stack)))
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
                    solve b-wls 2 8 31 1499 352 fix 3fc00000 c0000000\n\
                    solve lls 3 4 0 10 20 none diverged\n\
                    step hand core 428 32 3fc00000 c0000000\n\
                    frame poll 21 2136 920\n\
                    nlos features 9935 592 3fc00000\n\
                    beacons advert 300 40 c0000000\n\
                    engine range 2 8 3416 1356 3fc00000 c0000000 3fc00000\n\
                    range 3 3fc00000\n\
                    cost driver.now 120\n\
                    done\n";
        let printed = Printed::parse(text).expect("well formed");
        assert_eq!(printed.calibration, 1000);
        assert_eq!(printed.solves[0].answer, Ok(vec![1.5, -2.0]));
        assert_eq!(printed.solves[1].answer, Err("diverged".to_owned()));
        assert_eq!(printed.worst(Method::BWls, 2, 8), (1499, 352));
        assert_eq!(printed.steps[0].position, [1.5, -2.0]);
        assert_eq!((printed.engine[0].anchors, printed.engine[0].position), (8, [1.5, -2.0, 1.5]));
        let poll = FrameCost { name: "poll".to_owned(), length: 21, instructions: 2136, stack: 920 };
        assert_eq!((&printed.frames[..], &printed.ranges[..]), (&[poll][..], &[1.5][..]));
        assert_eq!(printed.costs, [("driver.now".to_owned(), 120)]);
        let features = Call { what: "features".to_owned(), instructions: 9935, stack: 592, value: 1.5 };
        assert_eq!(printed.sights, [features]);
        assert_eq!((printed.beacons[0].what.as_str(), printed.beacons[0].value), ("advert", -2.0));
    }

    #[test]
    fn an_image_that_stops_early_is_an_error() {
        assert!(Printed::parse("calibration methods 1000\n").is_err());
        assert!(Printed::parse("solve b-wls 2 8 31 1499\ndone\n").is_err());
    }
}
