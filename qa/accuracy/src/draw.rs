//! Random numbers of the distributions that drawn recordings and re-enacted papers use.

/// A standard normal number, by Box and Muller: recorded figures are drawn from this stream.
pub fn normal(random: &mut impl rand::Rng) -> f64 {
    let (u, v): (f64, f64) = (random.random_range(f64::MIN_POSITIVE..1.0), random.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// A number between 0 and 1, never 0.
pub fn uniform(random: &mut impl rand::Rng) -> f64 {
    random.random_range(f64::MIN_POSITIVE..1.0)
}

/// A number between two others.
pub fn between(random: &mut impl rand::Rng, least: f64, greatest: f64) -> f64 {
    least + (greatest - least) * uniform(random)
}

/// A number between two others whose logarithm is evenly distributed.
pub fn log_between(random: &mut impl rand::Rng, least: f64, greatest: f64) -> f64 {
    between(random, least.ln(), greatest.ln()).exp()
}
