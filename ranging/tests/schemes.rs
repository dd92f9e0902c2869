//! The trade between frames and accuracy is what the table of `examples/schemes.rs` shows.

#[allow(dead_code, reason = "its main prints the table")]
#[path = "../examples/schemes.rs"]
mod schemes;

use schemes::{CASES, Case, Errors, SCHEMES, Scheme, errors};

#[test]
fn successive_polls_give_double_sided_accuracy_for_half_the_frames() {
    let [polls, double] = [Scheme::WithPolls, Scheme::AsymmetricOneFinal];
    for scheme in [polls, double] {
        let Errors { bias_m, deviation_m } = errors(scheme, Case::Followed);
        assert!(bias_m.abs() < 0.01 && deviation_m < 0.03, "{scheme:?}: {bias_m} m, {deviation_m} m");
    }
    assert!(2 * polls.frames(8) <= double.frames(8));
    assert!(polls.micros(8) < 0.6 * double.micros(8));
    // Two stamps of 3.0 cm, halved: 2.12 cm; what the rate adds over replies of 0.5 to 2.1 ms is below 2 mm.
    let Errors { deviation_m, .. } = errors(polls, Case::Followed);
    assert!((deviation_m - 0.0212).abs() < 0.002, "{deviation_m}");
}

#[test]
fn single_sided_is_off_by_half_the_drift_of_the_reply() {
    // Poll's tail 83.1 + answer 304 + 138.4 to the RMARKER = 525.5 µs; a slot 189.7 + 72 + 3 = 264.7 µs.
    // ½ × 40 ppm × (525.5 + 7 × 264.7) µs × c = 14.26 m in the last slot.
    let Errors { bias_m, .. } = errors(Scheme::SingleSided, Case::Followed);
    assert!((bias_m.abs() - 14.26).abs() < 0.05, "{bias_m}");
}

#[test]
fn the_carrier_alone_is_coarse() {
    // 0.2 ppm over half of 0.53 to 2.38 ms, root mean square 1.57 ms: 4.7 cm, with the stamps' 2.1 cm 5.2 cm.
    let Errors { bias_m, deviation_m } = errors(Scheme::WithCarrier, Case::Followed);
    assert!(bias_m.abs() < 0.01 && (deviation_m - 0.052).abs() < 0.003, "{bias_m}, {deviation_m}");
}

#[test]
fn the_sum_suffers_from_unequal_replies() {
    // The last anchor answers after 2.38 ms and gets its final 0.53 ms later: ¼ × 40 ppm × 1.85 ms × c = 5.55 m.
    let Errors { bias_m, .. } = errors(Scheme::SymmetricOneFinal, Case::Followed);
    assert!((bias_m.abs() - 5.55).abs() < 0.05, "{bias_m}");
}

#[test]
fn the_product_needs_no_model_of_clocks() {
    for scheme in SCHEMES {
        let product = match scheme {
            Scheme::AsymmetricOneFinal | Scheme::AsymmetricToldLater | Scheme::AsymmetricEach => true,
            Scheme::SingleSided | Scheme::WithCarrier | Scheme::WithPolls | Scheme::SymmetricOneFinal => false,
        };
        for case in CASES.into_iter().filter(|_| product) {
            let Errors { bias_m, deviation_m } = errors(scheme, case);
            assert!(bias_m.abs() < 0.01 && deviation_m < 0.03, "{scheme:?}, {case:?}: {bias_m} m, {deviation_m} m");
        }
    }
}

#[test]
fn a_model_of_clocks_stands_a_second_of_silence_and_not_a_jump() {
    // 0.05 ppm over half of up to 2.38 ms are 1.8 cm, of which the carrier and the poll itself leave less than half.
    let Errors { bias_m, deviation_m } = errors(Scheme::WithPolls, Case::Silence);
    assert!(bias_m.abs() < 0.01 && (0.0212..0.028).contains(&deviation_m), "{bias_m} m, {deviation_m} m");
    // 1 ppm over half of 2.38 ms is 35.7 cm in the last slot: a single round tells nearly nothing of it.
    let Errors { bias_m, .. } = errors(Scheme::WithPolls, Case::Jump);
    assert!((bias_m.abs() - 0.357).abs() < 0.01, "{bias_m} m");
    let Errors { bias_m, .. } = errors(Scheme::WithCarrier, Case::Jump);
    assert!(bias_m.abs() < 0.01, "{bias_m} m");
}
