//! The trade between frames and accuracy is what the table of `examples/schemes.rs` shows.

#[allow(dead_code, reason = "its main prints the table")]
#[path = "../examples/schemes.rs"]
mod schemes;

use schemes::{Row, Scheme, row};

#[test]
fn successive_polls_give_double_sided_accuracy_for_half_the_frames() {
    let [polls, double] = [Scheme::WithPolls, Scheme::AsymmetricOneFinal].map(row);
    for Row { scheme, bias_m, deviation_m } in [&polls, &double] {
        assert!(bias_m.abs() < 0.01 && *deviation_m < 0.03, "{scheme:?}: {bias_m} m, {deviation_m} m");
    }
    assert!(2 * polls.scheme.frames(8) <= double.scheme.frames(8));
    assert!(polls.scheme.micros(8) < 0.6 * double.scheme.micros(8));
    // Two stamps of 3.0 cm, halved: 2.12 cm; what the rate adds over replies of 0.5 to 2.1 ms is below 2 mm.
    assert!((polls.deviation_m - 0.0212).abs() < 0.002, "{}", polls.deviation_m);
}

#[test]
fn single_sided_is_off_by_half_the_drift_of_the_reply() {
    // Poll's tail 83.1 + answer 304 + 138.4 to the RMARKER = 525.5 µs; a slot 189.7 + 72 + 3 = 264.7 µs.
    // ½ × 40 ppm × (525.5 + 7 × 264.7) µs × c = 14.26 m in the last slot.
    let Row { bias_m, .. } = row(Scheme::SingleSided);
    assert!((bias_m.abs() - 14.26).abs() < 0.05, "{bias_m}");
}

#[test]
fn the_carrier_alone_is_coarse() {
    // 0.2 ppm over half of 0.53 to 2.38 ms, root mean square 1.57 ms: 4.7 cm, with the stamps' 2.1 cm 5.2 cm.
    let Row { bias_m, deviation_m, .. } = row(Scheme::WithCarrier);
    assert!(bias_m.abs() < 0.01 && (deviation_m - 0.052).abs() < 0.003, "{bias_m}, {deviation_m}");
}

#[test]
fn the_sum_suffers_from_unequal_replies() {
    // The last anchor answers after 2.38 ms and gets its final 0.53 ms later: ¼ × 40 ppm × 1.85 ms × c = 5.55 m.
    let Row { bias_m, .. } = row(Scheme::SymmetricOneFinal);
    assert!((bias_m.abs() - 5.55).abs() < 0.05, "{bias_m}");
}
