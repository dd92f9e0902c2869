//! Scaled conjugate gradients (M. Møller, Neural Networks 6, 1993), with which Barral et al. train their perceptrons
//! (table 3): no step length to choose, no line search.

/// Stopping conditions, and Møller's two constants (table 3 of Barral et al.).
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Greatest number of epochs.
    pub epochs: usize,
    /// The gradient's length below which the minimum is reached.
    pub gradient: f64,
    /// Training stops after this number of epochs without a better validation.
    pub validation_checks: usize,
    /// Step for the finite difference of the second derivative.
    pub sigma: f64,
    /// The first damping.
    pub lambda: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { epochs: 1000, gradient: 1e-6, validation_checks: 6, sigma: 5e-5, lambda: 5e-7 }
    }
}

/// Minimises a function from `start` on. `objective` returns the value and writes the gradient. `validate` returns
/// the validation error after every epoch that reduced the value; the result is the point with the least validation
/// error.
pub fn minimise(
    start: Vec<f64>,
    limits: Limits,
    mut objective: impl FnMut(&[f64], &mut [f64]) -> f64,
    mut validate: impl FnMut(&[f64]) -> f64,
) -> Vec<f64> {
    let size = start.len();
    let mut here = Point::new(start, &mut objective);
    let mut direction: Vec<f64> = here.gradient.iter().map(|g| -g).collect();
    let (mut lambda, mut lambda_bar) = (limits.lambda, 0.0);
    let (mut success, mut curvature, mut steps) = (true, 0.0, 0);
    let mut best = Best { at: here.at.clone(), error: validate(&here.at), checks: 0 };
    for _ in 0..limits.epochs {
        let length = dot(&direction, &direction);
        if length.sqrt() < limits.gradient || !length.is_finite() {
            break;
        }
        if success {
            curvature = here.curvature(&direction, limits.sigma / length.sqrt(), &mut objective);
        }
        curvature += (lambda - lambda_bar) * length;
        if curvature <= 0.0 {
            // Made positive.
            lambda_bar = 2.0 * (lambda - curvature / length);
            curvature = -curvature + lambda * length;
            lambda = lambda_bar;
        }
        let mu = -dot(&direction, &here.gradient);
        let next = Point::new(along(&here.at, &direction, mu / curvature), &mut objective);
        // The ratio of the true decrease to that predicted by a parabola.
        let comparison = 2.0 * curvature * (here.value - next.value) / (mu * mu);
        success = comparison >= 0.0;
        if success {
            (lambda_bar, steps) = (0.0, steps + 1);
            // Restarted after as many steps as there are dimensions.
            let conjugate = dot(&next.gradient, &next.gradient) - dot(&next.gradient, &here.gradient);
            let beta = if steps % size == 0 { 0.0 } else { conjugate / mu };
            direction = next.gradient.iter().zip(&direction).map(|(g, p)| beta * p - g).collect();
            here = next;
            if comparison >= 0.75 {
                lambda /= 4.0;
            }
            best.offer(&here.at, validate(&here.at));
            if best.checks >= limits.validation_checks {
                break;
            }
        } else {
            lambda_bar = lambda;
        }
        if comparison < 0.25 {
            lambda += curvature * (1.0 - comparison) / length;
        }
        if !lambda.is_finite() || lambda > 1e30 {
            break;
        }
    }
    best.at
}

/// A point with its value and gradient.
struct Point {
    at: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
}

impl Point {
    fn new(at: Vec<f64>, objective: &mut impl FnMut(&[f64], &mut [f64]) -> f64) -> Self {
        let mut gradient = vec![0.0; at.len()];
        let value = objective(&at, &mut gradient);
        Self { at, value, gradient }
    }

    /// The second derivative along a direction, from the gradient at `step` of the direction away.
    fn curvature(&self, direction: &[f64], step: f64, objective: &mut impl FnMut(&[f64], &mut [f64]) -> f64) -> f64 {
        let there = Self::new(along(&self.at, direction, step), objective);
        let changes = there.gradient.iter().zip(&self.gradient).zip(direction);
        changes.map(|((there, here), p)| (there - here) * p).sum::<f64>() / step
    }
}

/// The point with the least validation error, and the number of later epochs with a greater one.
struct Best {
    at: Vec<f64>,
    error: f64,
    checks: usize,
}

impl Best {
    fn offer(&mut self, at: &[f64], error: f64) {
        if error < self.error {
            *self = Self { at: at.to_vec(), error, checks: 0 };
        } else {
            self.checks += 1;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn along(from: &[f64], direction: &[f64], step: f64) -> Vec<f64> {
    from.iter().zip(direction).map(|(x, p)| x + step * p).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_minimised_in_as_many_steps_as_dimensions() {
        // ½Σ i(x − i)²: minimum at x = (1, 2, 3).
        let objective = |x: &[f64], g: &mut [f64]| {
            x.iter().zip(g).zip([1.0, 2.0, 3.0]).fold(0.0, |sum, ((x, g), i)| {
                *g = i * (x - i);
                sum + i * (x - i).powi(2) / 2.0
            })
        };
        let value = |x: &[f64]| objective(x, &mut [0.0; 3]);
        let found = minimise(vec![0.0; 3], Limits { epochs: 12, ..Limits::default() }, objective, value);
        assert!(found.iter().zip([1.0, 2.0, 3.0]).all(|(x, i)| (x - i).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn the_valley_of_rosenbrock_is_followed_to_its_end() {
        // (1 − x)² + 100(y − x²)²: minimum at (1, 1).
        let objective = |p: &[f64], g: &mut [f64]| {
            let (x, y) = (p[0], p[1]);
            g[0] = -2.0 * (1.0 - x) - 400.0 * x * (y - x * x);
            g[1] = 200.0 * (y - x * x);
            (1.0 - x).powi(2) + 100.0 * (y - x * x).powi(2)
        };
        let value = |p: &[f64]| objective(p, &mut [0.0; 2]);
        let found = minimise(vec![-1.2, 1.0], Limits::default(), objective, value);
        assert!(found.iter().all(|x| (x - 1.0).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn the_best_validation_is_what_is_returned() {
        // The minimum is at 10, but the validation is best at 4: training ends near there.
        let objective = |x: &[f64], g: &mut [f64]| {
            // A quartic, so that it takes many steps.
            g[0] = 4.0 * (x[0] - 10.0).powi(3);
            (x[0] - 10.0).powi(4)
        };
        let found = minimise(vec![0.0], Limits::default(), objective, |x| (x[0] - 4.0).abs());
        assert!((found[0] - 4.0).abs() < 2.5, "{found:?}");
    }
}
