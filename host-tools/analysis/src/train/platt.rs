//! Fits the two parameters of [`Platt`] to receptions with which the classifier was not trained.

use positioning_core::nlos::Platt;

use super::folds::weights;
use super::samples::TrainingSample;

/// Fits slope and offset to the scores of held-out receptions by Newton's method.
///
/// In Platt's targets, (n + 1)/(n + 2) and 1/(n + 2), n is the number of placements and not that of receptions. A
/// hundred receptions of one placement are still one observation, and a probability of 0.999 needs a thousand
/// placements.
pub fn fit(scored: &[(f32, &TrainingSample)]) -> Platt {
    let samples: Vec<&TrainingSample> = scored.iter().map(|(_, sample)| *sample).collect();
    let weights = weights(&samples);
    let mut placements: Vec<(bool, usize)> = samples.iter().map(|s| (s.blocked == Some(true), s.placement)).collect();
    placements.sort_unstable();
    placements.dedup();
    let of = |class| placements.iter().filter(|(blocked, _)| *blocked == class).count() as f64;
    let (direct, blocked) = (of(false), of(true));
    let targets = [1.0 / (direct + 2.0), (blocked + 1.0) / (blocked + 2.0)];
    let points: Vec<(f64, f64, f64)> = scored
        .iter()
        .zip(weights)
        .map(|((p, sample), weight)| {
            (f64::from(Platt::logit(*p)), targets[usize::from(sample.blocked == Some(true))], weight)
        })
        .collect();
    newton(&points).unwrap_or(Platt::NONE)
}

/// Maximises Σ w (t ln p + (1 − t) ln(1 − p)) with p = σ(ax + b) for points (x, t, w). `None` where it does not
/// converge or the slope is not positive: scores with the wrong sign must neither be inverted nor used.
fn newton(points: &[(f64, f64, f64)]) -> Option<Platt> {
    let loss = |a: f64, b: f64| -> f64 {
        points
            .iter()
            .map(|(x, t, w)| {
                let z = a * x + b;
                // ln(1 + eᶻ) − tz, without overflow.
                w * (z.max(0.0) + (-z.abs()).exp().ln_1p() - t * z)
            })
            .sum()
    };
    let (mut a, mut b) = (1.0, 0.0);
    let mut before = loss(a, b);
    for _ in 0..100 {
        let (mut ga, mut gb, mut haa, mut hab, mut hbb) = (0.0, 0.0, 1e-9, 0.0, 1e-9);
        for (x, t, w) in points {
            let p = 1.0 / (1.0 + (-(a * x + b)).exp());
            let (g, h) = (w * (p - t), w * p * (1.0 - p));
            ga += g * x;
            gb += g;
            haa += h * x * x;
            hab += h * x;
            hbb += h;
        }
        let determinant = haa * hbb - hab * hab;
        let (da, db) = ((hbb * ga - hab * gb) / determinant, (haa * gb - hab * ga) / determinant);
        let mut step = 1.0;
        let mut after = loss(a - da, b - db);
        while (after > before || after.is_nan()) && step > 1e-6 {
            step /= 2.0;
            after = loss(a - step * da, b - step * db);
        }
        (a, b) = (a - step * da, b - step * db);
        if before - after < 1e-12 {
            break;
        }
        before = after;
    }
    (a > 0.0 && a.is_finite() && b.is_finite()).then_some(Platt { slope: a as f32, offset: b as f32 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slope_and_offset_are_those_of_scikit_learn() {
        // LogisticRegression(C=1e9, tol=1e-10).fit(x, y) of sklearn 1.9 on x = −3, −2.5 … 3 with y = 1 at −1, 0.5, 1,
        // 1.5, 2, 3.
        let blocked = [-1.0, 0.5, 1.0, 1.5, 2.0, 3.0];
        let points: Vec<_> = (0..13)
            .map(|i| {
                let x = f64::from(i) * 0.5 - 3.0;
                (x, f64::from(u8::from(blocked.contains(&x))), 1.0 / 13.0)
            })
            .collect();
        let platt = newton(&points).expect("a maximum");
        assert!((f64::from(platt.slope) - 0.805_317_7).abs() < 1e-4, "{platt:?}");
        assert!((f64::from(platt.offset) + 0.233_106_7).abs() < 1e-4, "{platt:?}");
    }

    #[test]
    fn scores_that_point_the_wrong_way_are_not_turned_round() {
        assert_eq!(newton(&[(-1.0, 0.9, 0.5), (1.0, 0.1, 0.5)]), None);
    }
}
