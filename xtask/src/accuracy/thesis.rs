//! The thesis' simulation beside what the thesis printed.
//!
//! P. M. de Rojas Malpartida, *Evaluación de un sistema UWB frente a medidas sin línea de visión directa* (Universidad de Sevilla,
//! 2021), chapter 8. The places of its anchors were not printed, so the figures cannot match to the digit.

use serde::Deserialize;

use super::metres;

/// One method with so many direct anchors, as `baliza bench thesis --json` prints it.
#[derive(Deserialize)]
pub struct Score {
    pub method: String,
    /// How many of the twelve anchors are direct; none: all points.
    pub ddp_anchors: Option<u8>,
    pub points: u64,
    pub rmse_m: Option<f64>,
}

/// The numbers of direct anchors that the thesis printed.
pub const DIRECT: std::ops::RangeInclusive<u8> = 3..=9;

/// RMSE in metres with 3, 4, … 9 direct anchors: tables 8-1 (LLS, NLS, bounding box, B-WLS), 8-3 (NLS-CCV), 8-5 and 8-11 (BB-NLS,
/// BB-NLS-R), 8-13 (B-WLS-R).
const PRINTED: [(&str, [f64; 7]); 8] = [
    ("bounding-box", [0.4939, 0.5127, 0.4354, 0.4405, 0.3859, 0.3682, 0.3901]),
    ("lls", [0.8979, 0.9116, 0.7943, 0.7095, 0.6728, 0.6059, 0.5599]),
    ("nls", [0.7097, 0.7014, 0.6125, 0.5404, 0.5018, 0.4678, 0.4053]),
    ("nls-ccv", [0.1505, 0.1415, 0.1289, 0.1172, 0.1202, 0.1056, 0.1120]),
    ("b-wls", [0.3102, 0.3007, 0.2496, 0.2446, 0.1932, 0.1950, 0.1665]),
    ("b-wls-r", [0.3111, 0.2665, 0.2191, 0.2147, 0.1635, 0.1561, 0.1321]),
    ("bb-nls", [0.3470, 0.2791, 0.2551, 0.2226, 0.1961, 0.1649, 0.1564]),
    ("bb-nls-r", [0.3005, 0.2505, 0.2153, 0.1849, 0.1628, 0.1352, 0.1244]),
];

/// What the thesis printed for a method, metres, with 3, 4, … 9 direct anchors.
pub fn printed(method: &str) -> Option<[f64; 7]> {
    PRINTED.iter().find(|(name, _)| *name == method).map(|&(_, values)| values)
}

/// RMSE of `method` with `direct` anchors, metres.
pub fn rmse(scores: &[Score], method: &str, direct: Option<u8>) -> Option<f64> {
    scores.iter().find(|score| score.method == method && score.ddp_anchors == direct)?.rmse_m
}

/// The methods in the order of the scores.
pub fn methods(scores: &[Score]) -> Vec<&str> {
    scores.iter().filter(|score| score.ddp_anchors.is_none()).map(|score| score.method.as_str()).collect()
}

/// Ours and, in brackets, the thesis'.
pub fn table(scores: &[Score]) -> String {
    let points = scores.iter().find(|score| score.ddp_anchors.is_none()).map_or(0, |score| score.points);
    let mut table = format!("| RMSE, m | all {points} points |");
    for direct in DIRECT {
        table += &format!(" {direct} direct |");
    }
    table += &format!("\n|---|{}\n", "---:|".repeat(DIRECT.count() + 1));
    for method in methods(scores) {
        table += &format!("| `{method}` | **{}** |", metres(rmse(scores, method, None)));
        for (place, direct) in DIRECT.enumerate() {
            let ours = metres(rmse(scores, method, Some(direct)));
            let theirs = printed(method).map_or_else(String::new, |values| format!(" ({:.3})", values[place]));
            table += &format!(" {ours}{theirs} |");
        }
        table.push('\n');
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ours_stand_beside_the_printed_ones() {
        let score =
            |method: &str, ddp_anchors, rmse_m| Score { method: method.into(), ddp_anchors, points: 10, rmse_m };
        let scores =
            [score("b-wls", None, Some(0.25)), score("b-wls", Some(3), Some(0.3)), score("robust", None, None)];
        let table = table(&scores);
        let rows: Vec<_> = table.lines().collect();
        assert!(rows[0].starts_with("| RMSE, m | all 10 points | 3 direct |"));
        // Table 8-1 of the thesis: 0,3102 m with 3 direct anchors and 0,1665 m with 9.
        assert!(rows[2].starts_with("| `b-wls` | **0.250** | 0.300 (0.310) | – (0.301) |"), "{}", rows[2]);
        assert!(rows[2].ends_with("| – (0.167) |"), "{}", rows[2]);
        assert!(rows[3].starts_with("| `robust` | **–** | – | – |"), "{}", rows[3]);
    }
}
