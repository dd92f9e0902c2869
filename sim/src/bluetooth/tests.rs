//! Tests of the air, with beacons and a scanner whose receptions are recorded.

use super::*;
use firmware_tag::scan::Scanner as _;
use wire::ble::IBeacon;

const STILL: Medium = Medium { exponent: 2.0, shadowing_db: 0.0, shadowing_m: 2.0, fading_db: 0.0 };

fn ibeacon(minor: u16) -> [u8; 30] {
    IBeacon { uuid: [1; 16], major: 1, minor, measured_power_dbm: -59 }.emit()
}

/// Runs a scanner at the origin for ten seconds, with beacons at these distances and this interval. Returns the
/// receptions: time in seconds, minor number, RSSI.
fn hear(config: BluetoothConfig, distances_m: &[f64], interval_ms: u64) -> (Vec<(f64, u16, i8)>, BluetoothStatistics) {
    let world = World::new(4, crate::AirConfig::default());
    let air = Bluetooth::new(&world, config.clone(), &[]);
    for (number, distance_m) in (0_u16..).zip(distances_m) {
        let sender = Sender::new(config.medium, 4, number.into(), Path::Fixed([*distance_m, 0.0, 0.0]), -59.0);
        let advertiser = air.advertiser(sender);
        advertiser.send(Some((&ibeacon(number), Duration::from_millis(interval_ms), [true; 3])));
        world.spawn(async move {
            advertiser.serve().await;
        });
    }
    let heard: Rc<RefCell<Vec<(f64, u16, i8)>>> = Rc::default();
    let (written, clock) = (heard.clone(), world.clone());
    let mut scanner = air.scanner(0x1001, Path::Fixed([0.0; 3]), move |data, rssi| {
        let beacon = IBeacon::parse(data).expect("the beacon's own bytes");
        written.borrow_mut().push((clock.now().as_secs_f64(), beacon.minor, rssi));
    });
    world.block_on(scanner.start());
    world.run_until(TrueTime::from_secs_f64(10.0));
    world.block_on(scanner.stop());
    world.run_until(TrueTime::from_secs_f64(11.0));
    let heard = heard.take();
    (heard, air.statistics())
}

fn still() -> BluetoothConfig {
    BluetoothConfig { medium: STILL, ..BluetoothConfig::default() }
}

#[test]
fn an_event_is_heard_once_and_comes_every_interval_and_up_to_10_ms_more() {
    let (heard, statistics) = hear(still(), &[2.0], 100);
    let gaps: Vec<f64> = heard.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
    // The interval is 105 ms in the mean, which gives 95 events in ten seconds. About one event in 30 falls between two
    // channels. From one channel to the next are 0.6 ms, so two events can be 1.3 ms farther apart when the first is
    // received on the first channel and the next on the last.
    assert!((85..=96).contains(&heard.len()), "{}", heard.len());
    assert!(gaps.iter().all(|gap| *gap >= 0.098), "{gaps:?}");
    let single: Vec<f64> = gaps.into_iter().filter(|gap| *gap < 0.15).collect();
    assert!(single.iter().all(|gap| *gap <= 0.112), "{single:?}");
    let mean = single.iter().sum::<f64>() / single.len() as f64;
    assert!((mean - 0.105).abs() < 0.001, "{mean} s");
    // Eleven seconds on three channels. A scanner that is off receives nothing.
    assert!((300..=318).contains(&statistics.sent), "{statistics:?}");
    assert_eq!(statistics.heard, heard.len() as u64);
}

#[test]
fn levels_are_those_of_the_model() {
    let (heard, _) = hear(still(), &[10.0], 20);
    let mean = heard.iter().map(|(_, _, rssi)| f64::from(*rssi)).sum::<f64>() / heard.len() as f64;
    // −59 − 20 dBm; 400 receptions of 1.93 dB: 0.1 dB (1σ).
    assert!((mean + 79.0).abs() < 0.4, "{mean} dBm");
    let offset = BluetoothConfig { receiver_offset_db: 5.0, unknown_rssi: 0.5, ..still() };
    let (heard, _) = hear(offset, &[10.0], 20);
    let (unknown, known): (Vec<i8>, Vec<i8>) = heard.iter().map(|(_, _, rssi)| *rssi).partition(|rssi| *rssi == 127);
    let mean = known.iter().map(|rssi| f64::from(*rssi)).sum::<f64>() / known.len() as f64;
    assert!((mean + 74.0).abs() < 0.4, "{mean} dBm");
    assert!((0.35..0.65).contains(&(unknown.len() as f64 / heard.len() as f64)));
}

#[test]
fn what_is_too_weak_or_unlucky_is_lost() {
    // −59 − 20 lg 70.8 = −96 dBm: 30.8 % are lost; the noise of 2 dB changes this a little. With chance alone, 0.3 are
    // lost.
    let share = |statistics: &BluetoothStatistics, lost: u64| lost as f64 / (statistics.heard + lost) as f64;
    let (_, far) = hear(still(), &[70.8], 20);
    assert!((share(&far, far.lost_to_noise) - 0.308).abs() < 0.12, "{far:?}");
    let (_, unlucky) = hear(BluetoothConfig { loss: 0.3, ..still() }, &[2.0], 20);
    assert!((share(&unlucky, unlucky.lost_by_chance) - 0.3).abs() < 0.08, "{unlucky:?}");
}

#[test]
fn of_two_at_once_only_one_much_stronger_is_heard() {
    // Forty beacons with an interval of 25 ms: within ±368 µs of an advertisement, 39 · 2 · 0.368 / 25 = 115 % others
    // begin in the mean, but a third of the events are shifted so that their channels differ. Beacons of equal strength
    // lose many receptions.
    let (_, alike) = hear(still(), &[2.0; 40], 20);
    assert!(alike.lost_to_collision > alike.heard / 4, "{alike:?}");
    // One beacon is near and 34 dB stronger than all others. It loses almost none, so nearly all its advertisements are
    // received.
    let near_and_far: Vec<f64> = [0.1].into_iter().chain([5.0; 39]).collect();
    let (heard, _) = hear(still(), &near_and_far, 20);
    let near = heard.iter().filter(|(_, minor, _)| *minor == 0).count();
    assert!(near > 360, "{near} of 400");
}
