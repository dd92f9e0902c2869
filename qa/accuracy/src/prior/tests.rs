use super::movement::least_jump_m;
use super::*;

/// Three cases of each group.
fn some() -> Vec<Case> {
    (0..3 * Group::ALL.len()).map(|number| draw(number, 1)).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// All ranges with their errors, metres.
fn errors(case: &Case) -> impl Iterator<Item = (CaseRange, f64)> {
    case.epochs.iter().flat_map(|epoch| {
        epoch.ranges.iter().map(|range| (*range, range.range_m - distance(&epoch.at_m, &case.anchors_m[range.anchor])))
    })
}

#[test]
fn equal_numbers_and_seeds_draw_equal_cases() {
    assert_eq!(draw(3, 1), draw(3, 1));
    assert_ne!(draw(3, 1).epochs, draw(3, 2).epochs);
    assert_ne!(draw(3, 1).epochs, draw(10, 1).epochs);
}

#[test]
fn rooms_anchors_and_rates_are_within_their_bounds() {
    for case in some() {
        let CaseConditions { room_m, group, rate_hz, .. } = case.conditions;
        assert!((5.0..=40.0).contains(&room_m[0]) && (4.0..=40.0).contains(&room_m[1]), "{room_m:?}");
        assert!((4..=19).contains(&case.anchors_m.len()) && (2.0..=50.0).contains(&rate_hz));
        assert_eq!(group == Group::ManyAnchors, case.anchors_m.len() > 12);
        let inside = |at: &[f64; 3]| at.iter().zip(room_m).all(|(c, size)| (-0.3..=size).contains(c));
        assert!(
            case.anchors_m.iter().chain(case.epochs.iter().map(|epoch| &epoch.at_m)).all(inside),
            "{}",
            case.name()
        );
        assert!(case.epochs.windows(2).all(|pair| pair[0].t_s < pair[1].t_s));
        let single = group == Group::Asynchronous;
        assert!(case.epochs.iter().all(|epoch| epoch.ranges.len() <= if single { 1 } else { 19 }));
    }
}

#[test]
fn anchors_are_almost_on_a_line_in_their_group() {
    for case in some().iter().filter(|case| case.conditions.group == Group::Collinear) {
        let Layout::Line { but_one, .. } = case.conditions.layout else { panic!("a line") };
        let on_it = &case.anchors_m[..case.anchors_m.len() - usize::from(but_one)];
        // The smaller eigenvalue of the covariance of x and y is the variance across the best line.
        let [x, y] = [0, 1].map(|axis: usize| on_it.iter().map(|at| at[axis]).collect::<Vec<_>>());
        let covariance = |a: &[f64], b: &[f64]| {
            let (p, q) = (mean(a), mean(b));
            mean(&a.iter().zip(b).map(|(a, b)| (a - p) * (b - q)).collect::<Vec<_>>())
        };
        let (xx, yy, xy) = (covariance(&x, &x), covariance(&y, &y), covariance(&x, &y));
        let least = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        assert!(least.max(0.0).sqrt() < 0.1, "{least}");
    }
}

#[test]
fn a_tag_walks_rests_or_jumps_as_its_group_says() {
    for case in some() {
        let steps: Vec<(f64, f64)> = (case.epochs.windows(2))
            .map(|pair| (distance(&pair[0].at_m, &pair[1].at_m), pair[1].t_s - pair[0].t_s))
            .collect();
        // At most 1.5 m/s, a little more while the velocity turns.
        let jumps = steps.iter().filter(|(metres, seconds)| *metres > 1.8 * seconds).count();
        match case.conditions.movement {
            Movement::Walk => assert_eq!(jumps, 0),
            Movement::Rest => {
                assert!(steps.iter().all(|(metres, seconds)| *metres == 0.0 || *seconds > 60.0));
                assert_eq!(steps.iter().filter(|(_, seconds)| *seconds > 60.0).count(), 2);
            }
            Movement::WalkAndJump | Movement::RestAndJump => {
                assert!((1..=2).contains(&jumps), "{jumps}");
                let farthest = steps.iter().map(|(metres, _)| *metres).fold(0.0, f64::max);
                assert!(farthest >= least_jump_m(&case.conditions), "{farthest}");
            }
        }
    }
}

#[test]
fn direct_errors_have_the_variance_that_is_stated() {
    // Lasting: the mean square of U(0.03, 0.12) is (0.03² + 0.03 · 0.12 + 0.12²) ⁄ 3 = 0.0063 m².
    let mut lasting = Vec::new();
    for case in some() {
        let CaseConditions { common_m, white_m, .. } = case.conditions;
        let direct: Vec<f64> = errors(&case)
            .filter(|(range, _)| !range.blocked && !range.wild)
            .map(|(_, error)| error - common_m)
            .collect();
        lasting.push(mean(&direct.iter().map(|error| error * error).collect::<Vec<_>>()) - white_m * white_m);
        assert!((0.02..=0.08).contains(&white_m), "{white_m}");
    }
    assert!((mean(&lasting) - 0.0063).abs() < 0.0015, "{}", mean(&lasting));
}

#[test]
fn errors_at_rest_change_by_the_white_part_alone() {
    for case in some().iter().filter(|case| case.conditions.group == Group::Rest) {
        let mut last = vec![None; case.anchors_m.len()];
        let mut squares = Vec::new();
        for (range, error) in errors(case).filter(|(range, _)| !range.blocked && !range.wild) {
            if let Some(before) = last[range.anchor].replace(error) {
                let change: f64 = error - before;
                squares.push(0.5 * change * change);
            }
        }
        // A few differences are between two stays: half of their squares are up to 0.03 m².
        let deviation = mean(&squares).sqrt();
        assert!((deviation / case.conditions.white_m - 1.0).abs() < 0.15, "{deviation}, {}", case.conditions.white_m);
    }
}

#[test]
fn blocked_and_wild_ranges_have_the_shares_and_sizes_that_are_stated() {
    let cases: Vec<Case> = (0..40).map(|number| draw(number, 2)).collect();
    let share = |case: &Case, which: fn(&CaseRange) -> bool| {
        let of: Vec<f64> = errors(case).map(|(range, _)| f64::from(u8::from(which(&range)))).collect();
        mean(&of)
    };
    let blocked: Vec<f64> = cases.iter().map(|case| share(case, |range| range.blocked)).collect();
    // The mean of U(0, 0.4), a little less because blocked ranges are lost more often.
    assert!((mean(&blocked) - 0.19).abs() < 0.06, "{}", mean(&blocked));
    for case in &cases {
        // Within four deviations of a share of this number of ranges.
        let (expected, count) = (case.conditions.wild, errors(case).count() as f64);
        let wild = share(case, |range| range.wild);
        assert!((wild - expected).abs() < 4.0 * (expected / count).sqrt() + 1.0 / count, "{wild}, {expected}");
    }
    for case in &cases {
        let CaseConditions { common_m, .. } = case.conditions;
        for (_, error) in errors(case).filter(|(range, _)| range.blocked && !range.wild) {
            // The excess is at least 0.2 m; lasting and white errors are within five deviations.
            assert!((error - common_m) > 0.2 - 5.0 * 0.15, "{error}");
        }
    }
    let excess: Vec<f64> = cases
        .iter()
        .flat_map(|case| {
            errors(case).filter(|(range, _)| range.blocked && !range.wild).map(|(_, e)| e - case.conditions.common_m)
        })
        .collect();
    // (1.5 − 0.2) ⁄ ln 7.5 = 0.645 m, and of half of the links 0.3 m · √(2 ⁄ π) more: 0.765 m.
    assert!((mean(&excess) - 0.765).abs() < 0.12, "{}", mean(&excess));
}

#[test]
fn files_have_the_columns_of_recordings_and_a_row_a_range() {
    let case = draw(0, 1);
    let [anchors, ranges, truth] = texts(&case);
    assert_eq!(anchors.1.lines().count(), 1 + case.anchors_m.len());
    assert_eq!(truth.1.lines().count(), 1 + case.epochs.len());
    assert_eq!(ranges.1.lines().count(), 1 + case.epochs.iter().map(|epoch| epoch.ranges.len()).sum::<usize>());
    assert!(ranges.1.starts_with("epoch,t_s,anchor,range_m,rx_power_dbm,fp_power_dbm,los\n0,0,"));
    assert!(index([&case]).lines().nth(1).is_some_and(|row| row.starts_with("00-walk,2,")));
}
