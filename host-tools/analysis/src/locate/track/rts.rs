//! The smoother's step (H. E. Rauch, F. Tung, C. T. Striebel, *Maximum likelihood estimates of linear dynamic systems*,
//! AIAA Journal 3, 1965): from a state that is known by all measurements of a recording, back to the state before it,
//! which is known by the measurements up to its time.

use nalgebra::{Cholesky, DMatrix, DVector};

/// Mean and covariance of a state.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian {
    pub mean: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

/// The least share of a variance that is added to it, so that rounding leaves the matrix positive, and how much greater
/// each further attempt is.
const JITTER: f64 = 1e-13;
const ATTEMPTS: i32 = 4;

/// A state by all measurements. `filtered` is the state by the measurements up to its time, `transition` the matrix that
/// predicts the next state, `predicted` that prediction, and `next` the next state by all measurements. `None`: the
/// prediction's covariance is not positive.
pub fn smoothed(
    filtered: &Gaussian,
    transition: &DMatrix<f64>,
    predicted: &Gaussian,
    next: &Gaussian,
) -> Option<Gaussian> {
    let across = &filtered.covariance * transition.transpose();
    // What is known for certain, and what has nothing to do with the state before it, says nothing about that state.
    let says = |&state: &usize| predicted.covariance[(state, state)] > 0.0 && across.column(state).amax() > 0.0;
    let states: Vec<usize> = (0..predicted.mean.len()).filter(says).collect();
    let scale =
        DVector::from_iterator(states.len(), states.iter().map(|&i| predicted.covariance[(i, i)].sqrt().recip()));
    let scaled = |matrix: &DMatrix<f64>| {
        DMatrix::from_fn(states.len(), states.len(), |r, c| matrix[(states[r], states[c])] * scale[r] * scale[c])
    };
    let correlation = scaled(&predicted.covariance);
    let factors = (0..ATTEMPTS).find_map(|attempt| {
        let jitter = DMatrix::identity(states.len(), states.len()) * (JITTER * 1e3_f64.powi(attempt));
        Cholesky::new(&correlation + jitter)
    })?;
    let across = DMatrix::from_fn(filtered.mean.len(), states.len(), |r, c| across[(r, states[c])] * scale[c]);
    let gain = factors.solve(&across.transpose()).transpose();
    let moved = DVector::from_fn(states.len(), |r, _| (next.mean[states[r]] - predicted.mean[states[r]]) * scale[r]);
    let narrowed = scaled(&(&next.covariance - &predicted.covariance));
    let covariance = &filtered.covariance + &gain * narrowed * gain.transpose();
    let covariance = (&covariance + covariance.transpose()) * 0.5;
    Some(Gaussian { mean: &filtered.mean + gain * moved, covariance })
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::{Gaussian, smoothed};

    /// Steps of a walk along a line.
    const STEPS: usize = 12;
    /// The variances of the first state: metres, metres per second, the lasting error of a sensor.
    const FIRST: [f64; 3] = [4.0, 1.0, 0.09];

    /// A position that moves with a velocity, measured with an error that is forgotten slowly. Measurements have a
    /// variance of 0.04 m²; every third is lost.
    fn model() -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
        let transition = DMatrix::from_row_slice(3, 3, &[1.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.8]);
        let noise = DMatrix::from_row_slice(3, 3, &[0.02, 0.05, 0.0, 0.05, 0.2, 0.0, 0.0, 0.0, 0.03]);
        (transition, noise, DMatrix::from_row_slice(1, 3, &[1.0, 0.0, 1.0]))
    }

    fn measured(step: usize) -> Option<f64> {
        (step % 3 != 2).then(|| 0.7 * step as f64 + (1.3 * step as f64).sin())
    }

    /// Means and covariances of all states at once: the least squares of all equations of the model, which are the
    /// first state, each transition, and each measurement, each divided by its deviation.
    fn by_least_squares() -> (DVector<f64>, DMatrix<f64>) {
        let (transition, noise, sensor) = model();
        let mut information = DMatrix::zeros(3 * STEPS, 3 * STEPS);
        let mut right = DVector::zeros(3 * STEPS);
        for axis in 0..3 {
            information[(axis, axis)] += 1.0 / FIRST[axis];
        }
        let weight = noise.try_inverse().expect("positive");
        for step in 0..STEPS - 1 {
            let mut equation = DMatrix::zeros(3, 3 * STEPS);
            equation.view_mut((0, 3 * step), (3, 3)).copy_from(&-&transition);
            equation.view_mut((0, 3 * step + 3), (3, 3)).copy_from(&DMatrix::identity(3, 3));
            information += equation.transpose() * &weight * equation;
        }
        for step in 0..STEPS {
            if let Some(measured) = measured(step) {
                let mut equation = DMatrix::zeros(1, 3 * STEPS);
                equation.view_mut((0, 3 * step), (1, 3)).copy_from(&sensor);
                information += equation.transpose() * &equation / 0.04;
                right += equation.transpose() * measured / 0.04;
            }
        }
        let covariance = information.try_inverse().expect("determined");
        (&covariance * right, covariance)
    }

    #[test]
    fn a_filter_and_the_way_back_are_least_squares_over_all_measurements() {
        let (transition, noise, sensor) = model();
        let mut predicted =
            Gaussian { mean: DVector::zeros(3), covariance: DMatrix::from_diagonal(&DVector::from_row_slice(&FIRST)) };
        let mut filter = Vec::new();
        for step in 0..STEPS {
            let mut filtered = predicted.clone();
            if let Some(measured) = measured(step) {
                let across = &filtered.covariance * sensor.transpose();
                let variance = (&sensor * &across)[(0, 0)] + 0.04;
                let gain = &across / variance;
                filtered.mean += &gain * (measured - (&sensor * &filtered.mean)[(0, 0)]);
                filtered.covariance -= &gain * across.transpose();
            }
            let of_this_step = predicted.clone();
            predicted = Gaussian {
                mean: &transition * &filtered.mean,
                covariance: &transition * &filtered.covariance * transition.transpose() + &noise,
            };
            filter.push((filtered, of_this_step));
        }
        let (means, covariance) = by_least_squares();
        let mut state = filter[STEPS - 1].0.clone();
        for step in (0..STEPS).rev() {
            if step + 1 < STEPS {
                state = smoothed(&filter[step].0, &transition, &filter[step + 1].1, &state).expect("positive");
            }
            let expected = (means.rows(3 * step, 3), covariance.view((3 * step, 3 * step), (3, 3)));
            assert!((&state.mean - expected.0).amax() < 1e-9, "{step}: {state:?}");
            assert!((&state.covariance - expected.1).amax() < 1e-9, "{step}: {state:?}");
        }
    }

    #[test]
    fn what_is_known_and_what_was_renewed_says_nothing_about_the_state_before() {
        // The second state is known. The third is a new one at the next time.
        let filtered = Gaussian {
            mean: DVector::from_row_slice(&[1.0, 2.0, 3.0]),
            covariance: DMatrix::from_row_slice(3, 3, &[0.5, 0.0, 0.2, 0.0, 0.0, 0.0, 0.2, 0.0, 0.4]),
        };
        let transition = DMatrix::from_diagonal(&DVector::from_row_slice(&[1.0, 1.0, 0.0]));
        let predicted = Gaussian {
            mean: DVector::from_row_slice(&[1.0, 2.0, 0.0]),
            covariance: DMatrix::from_diagonal(&DVector::from_row_slice(&[1.0, 0.0, 9.0])),
        };
        let next = Gaussian {
            mean: DVector::from_row_slice(&[2.0, 7.0, 9.0]),
            covariance: DMatrix::from_diagonal(&DVector::from_row_slice(&[0.6, 0.0, 1.0])),
        };
        let found = smoothed(&filtered, &transition, &predicted, &next).expect("positive");
        // Gains 0.5 and 0.2 on the first state alone: means 1 + 0.5, 2, 3 + 0.2; variances 0.5 + 0.25·(−0.4) = 0.4, 0.4
        // + 0.04·(−0.4) = 0.384; covariance 0.2 + 0.1·(−0.4) = 0.16.
        assert!((found.mean - DVector::from_row_slice(&[1.5, 2.0, 3.2])).amax() < 1e-9);
        assert!(
            (found.covariance - DMatrix::from_row_slice(3, 3, &[0.4, 0.0, 0.16, 0.0, 0.0, 0.0, 0.16, 0.0, 0.384]))
                .amax()
                < 1e-9
        );
    }
}
