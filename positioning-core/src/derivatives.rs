//! The one check of derivatives: against central differences of the function itself, at random places.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// The number of places.
const PLACES: usize = 200;
/// The step of a difference, in the unit of the variables.
const STEP: f64 = 1.0e-5;
/// The greatest accepted error of a derivative, relative to the greatest derivative there, or to 1 if that is less.
const TOLERANCE: f64 = 1.0e-5;

/// Checks that `function` returns a value with its derivative by each variable. The variables are drawn between
/// `center` − `spread` and `center` + `spread`; those without spread are constants.
///
/// # Panics
/// A derivative is wrong.
pub(crate) fn assert_derivatives<const N: usize>(
    name: &str,
    center: [f64; N],
    spread: [f64; N],
    function: impl Fn(&[f64; N]) -> (f64, [f64; N]),
) {
    let mut rng = Pcg64::seed_from_u64(1);
    for place in 0..PLACES {
        let at: [f64; N] = core::array::from_fn(|i| center[i] + spread[i] * rng.random_range(-1.0..=1.0));
        let (_, found) = function(&at);
        let largest = found.iter().fold(1.0, |largest: f64, slope| largest.max(slope.abs()));
        for i in 0..N {
            let moved = |step: f64| {
                let mut moved = at;
                moved[i] += step;
                function(&moved).0
            };
            let expected = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
            assert!(
                (found[i] - expected).abs() <= TOLERANCE * largest,
                "{name}, place {place}: the derivative by variable {i} is {expected}, not {}, at {at:?}",
                found[i]
            );
        }
    }
}

#[test]
#[should_panic(expected = "the derivative by variable 1 is")]
fn a_wrong_derivative_is_found() {
    assert_derivatives("product", [0.0; 2], [1.0; 2], |[x, y]| (x * y, [*y, 1.001 * x]));
}
