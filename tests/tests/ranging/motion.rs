//! Tags that lie still and are then moved, with and without a motion sensor: the real driver and logic on a
//! register-level LIS2DH12.

use sim::scenario::Scenario;
use system_tests::{Run, TAG, hall, tag};
use wire::telemetry::MotionSensor;

/// The time at which the tag is carried away, seconds.
const LEAVES_S: f64 = 61.0;
/// At the still rate, a second usually has no position, or one. At the full rate, a DWM1001 has more than three
/// hundred.
const AWAKE_HZ: f64 = 30.0;

/// Four anchors and a tag that ranges as often as it can, but once in ten seconds while it lies still. After a minute
/// the tag is carried away.
fn carried_off(record: &str, more: &str) -> Run {
    let walk = format!("path_m = [[8, 5, 1.2], [16, 9, 1.2]]\nleaves_s = {LEAVES_S}\n{more}");
    let tag = tag(&format!("still_rate_hz = 0.1\n{record}"), &walk);
    Run::of(Scenario::parse(&(hall("seconds = 73", 4, &[]) + &tag)).unwrap())
}

/// The same tag, never carried away.
fn lying(seconds: f64, more: &str) -> Run {
    let tag = tag("still_rate_hz = 0.1\nsleep = true", &format!("path_m = [[8, 5, 1.2]]\n{more}"));
    Run::of(Scenario::parse(&(hall(&format!("seconds = {seconds}"), 4, &[]) + &tag)).unwrap())
}

/// Positions per second within an interval.
fn rate(run: &Run, from_s: f64, to_s: f64) -> f64 {
    run.fix_times(TAG, from_s, to_s).len() as f64 / (to_s - from_s)
}

/// The time from an instant until a tenth of a second has at least ten positions, seconds.
fn until_awake(run: &Run, since_s: f64) -> f64 {
    let times = run.fix_times(TAG, since_s, f64::INFINITY);
    let awake = times.windows(10).find(|ten| ten[9] - ten[0] < 0.1).map(|ten| ten[0]);
    awake.map_or(f64::INFINITY, |t_s| t_s - since_s)
}

fn states(run: &Run) -> Vec<MotionSensor> {
    run.motion_sensor(TAG).into_iter().map(|(_, state)| state).collect()
}

#[test]
fn a_tag_that_is_picked_up_ranges_at_full_rate_within_a_second() {
    // The radio sleeps between rounds, or waits.
    for record in ["sleep = true", "sleep = false"] {
        let run = carried_off(record, "");
        assert_eq!(states(&run), [MotionSensor::Ready]);
        // While it lies still, it ranges once in ten seconds, and next 9 s after it is carried away.
        assert!(rate(&run, 20.0, LEAVES_S) <= 0.125, "{record}: {}", rate(&run, 20.0, LEAVES_S));
        let awake_s = until_awake(&run, LEAVES_S);
        assert!(awake_s < 1.0, "{record}: {awake_s} s");
        let gap_s = run.longest_gap(TAG, LEAVES_S + awake_s, LEAVES_S + 7.0);
        assert!(gap_s < 0.2, "{record}: {gap_s} s");
    }
}

/// 32 768 superframes, half of their numbers, are 55 minutes, and all of them 109.
#[test]
fn a_tag_that_rested_for_any_time_ranges_at_full_rate_within_two_seconds() {
    let minutes = [30, 55, 80, 108, 120, 170];
    let tags = minutes.map(|minutes| {
        let walk = format!("path_m = [[8, 5, 1.2], [11, 5, 1.2]]\nleaves_s = {}", 60 * minutes);
        tag("still_rate_hz = 0.1\nsleep = true", &walk)
    });
    let run = Run::of_text(&(hall("seconds = 10220\nfidelity = \"air\"", 4, &[]) + &tags.concat()));
    for (address, minutes) in (TAG..).zip(minutes) {
        let times = run.fix_times(address, f64::from(60 * minutes), f64::INFINITY);
        let awake = times.windows(10).find(|ten| ten[9] - ten[0] < 0.1).map(|ten| ten[0] - f64::from(60 * minutes));
        assert!(awake.is_some_and(|awake_s| awake_s < 2.0), "after {minutes} minutes: {awake:?} s");
    }
}

#[test]
fn a_trolley_that_is_pushed_off_gently_wakes_its_tag_while_it_gains_speed() {
    let run = carried_off("sleep = true", "carried_by = \"trolley\"");
    // 48 mg are exceeded before the middle of the two seconds of acceleration. One second later the tag ranges.
    let awake_s = until_awake(&run, LEAVES_S);
    assert!(awake_s < 2.0, "{awake_s} s");
}

#[test]
fn a_trolley_at_constant_speed_is_not_taken_for_still() {
    // 36 s at 0.25 m/s, which no accelerometer detects.
    let walk = "path_m = [[4, 3, 1.2], [13, 3, 1.2]]\nspeed_m_s = 0.25\ncarried_by = \"trolley\"";
    let tag = tag("still_rate_hz = 0.1\nsleep = true", walk);
    let run = Run::of(Scenario::parse(&(hall("seconds = 40", 4, &[]) + &tag)).unwrap());
    assert_eq!(states(&run), [MotionSensor::Ready]);
    for second in 5..36 {
        let rate = rate(&run, f64::from(second), f64::from(second + 1));
        assert!(rate > AWAKE_HZ, "from {second} s: {rate} a second");
    }
}

#[test]
fn without_a_sensor_that_works_positions_wake_a_tag_at_its_next_round() {
    let cases: [(&str, &[MotionSensor]); 5] = [
        ("none", &[]),
        ("silent", &[MotionSensor::Silent]),
        ("hung", &[MotionSensor::Silent]),
        ("foreign", &[MotionSensor::Foreign]),
        ("stuck-low", &[MotionSensor::Ready]),
    ];
    for (sensor, expected) in cases {
        let run = carried_off("sleep = true", &format!("motion_sensor = \"{sensor}\""));
        assert_eq!(states(&run), expected, "{sensor}");
        assert!(rate(&run, 20.0, LEAVES_S) <= 0.125, "{sensor}: {}", rate(&run, 20.0, LEAVES_S));
        // One round in ten seconds, and one second to get more slots.
        let awake_s = until_awake(&run, LEAVES_S);
        assert!((5.0..11.0).contains(&awake_s), "{sensor}: {awake_s} s");
    }
    // Other boards have no motion sensor.
    let run = carried_off("sleep = true\nboard = \"esp32c3\"", "");
    assert_eq!(states(&run), []);
    assert!(until_awake(&run, LEAVES_S) > 5.0);
}

#[test]
fn a_shaking_shelf_and_a_line_that_is_stuck_keep_a_tag_awake_for_two_minutes() {
    for more in ["vibration_mg = 60", "motion_sensor = \"stuck-high\""] {
        let run = lying(200.0, more);
        assert_eq!(states(&run), [MotionSensor::Ready, MotionSensor::Endless], "{more}");
        assert!(rate(&run, 100.0, 110.0) > AWAKE_HZ, "{more}");
        assert!(rate(&run, 130.0, 200.0) <= 0.125, "{more}: {}", rate(&run, 130.0, 200.0));
    }
}

#[test]
fn what_is_drawn_at_rest_has_the_sensors_three_microamperes() {
    // The data sheet's current at 10 Hz in low-power mode. The sensor begins in power-down, with 0.5 µA.
    let sensor_ua = |run: &Run| 1e3 * run.summary.tag_currents_ma.map_or(0.0, |currents| currents.motion_sensor);
    let watched = sensor_ua(&lying(30.0, ""));
    assert!((2.9..=3.0).contains(&watched), "{watched} µA");
    let unused = Run::of_text(&hall("seconds = 10", 4, &["[[8, 5, 1.2]]"]));
    assert!((sensor_ua(&unused) - 0.5).abs() < 1e-6, "{} µA", sensor_ua(&unused));
}
