//! Reproductions of published benchmarks on simulated data, and the code that only they need and no node runs.
//!
//! | module | what is in it |
//! |---|---|
//! | [`fusion`] | the filter of patent ES 2 397 388, of ranges and powers; [`fusion::bench`] compares it with the
//! engine |
//! | [`garcia`] | E. García et al.: differences of arrival with detection of blocked paths by their skewness |
//! | [`barral`] | V. Barral et al.: classifiers and mitigators of blocked ranges |
//! | [`linde`] | A. Linde Cerezo's thesis: four Bluetooth beacons in a room |
//! | [`accuracy`] | statistics of the accuracy protocol: blocks, ratios, verdicts, settings that leave a site out |
//! | [`prior`] | recordings of ranges drawn from broad distributions, on which no setting was chosen |
//! | [`thesis`] | P. M. de Rojas Malpartida's thesis: every method on simulated ranges |
//!
//! Each benchmark draws its data from a seed and returns scores and a Markdown table; `baliza bench` prints them.
#![forbid(unsafe_code)]

pub mod accuracy;
pub mod barral;
mod field;
pub mod fusion;
pub mod garcia;
pub mod linde;
pub mod prior;
pub mod thesis;

/// A standard normal number, by Box and Muller: recorded figures are drawn from this stream.
fn normal(random: &mut impl rand::Rng) -> f64 {
    let (u, v): (f64, f64) = (random.random_range(f64::MIN_POSITIVE..1.0), random.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// A number between 0 and 1, never 0.
fn uniform(random: &mut impl rand::Rng) -> f64 {
    random.random_range(f64::MIN_POSITIVE..1.0)
}

/// A number between two others.
fn between(random: &mut impl rand::Rng, least: f64, greatest: f64) -> f64 {
    least + (greatest - least) * uniform(random)
}

/// A number between two others whose logarithm is evenly distributed.
fn log_between(random: &mut impl rand::Rng, least: f64, greatest: f64) -> f64 {
    between(random, least.ln(), greatest.ln()).exp()
}
