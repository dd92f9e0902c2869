//! Tests of sleep, supply failures, sensors, and the impulse response.

use std::future::pending;

use super::*;
use ranging::Restart;

#[test]
fn sleep_keeps_the_configuration_and_waking_restores_the_rest() {
    for wake in [Wake::Outside(WakeBy::ChipSelect), Wake::Counter { counter: 1, or: WakeBy::ChipSelect }] {
        let (world, a, b) = two_nodes(0.0);
        let config = Config { tx_antenna_delay: Some(16_400), ..fast() };
        let (mut sender, mut receiver) = (driver(a.peripherals(), config), driver(b.peripherals(), fast()));
        let clock = a.peripherals().delay;
        let statistics = a.clone();
        let (stamps, heard) = run(
            &world,
            async move {
                sender.init().await.unwrap();
                sender.sleep(wake).await.unwrap();
                assert_eq!(sender.now().await, Err(Error::NotReady));
                clock.pause_ms(1_000).await;
                sender.wake().await.unwrap();
                let before = statistics.chip_statistics();
                assert_eq!((before.too_fast, before.not_idle), (0, 0));
                let at = soon(&mut sender, us(5_000)).await;
                let sent = sender.transmit(b"awake", Start::At(at), false).await.unwrap();
                let again = sender.transmit(b"awake", Start::Now, false).await.unwrap();
                (at, sent, again)
            },
            async move {
                receiver.init().await.unwrap();
                let first = receive(&mut receiver, Start::Now, us(2_000_000), true).await.map(|h| h.bytes);
                (first, receive(&mut receiver, Start::Now, us(10_000), false).await.map(|h| h.bytes))
            },
        );
        assert_eq!(heard, (Ok(b"awake".to_vec()), Ok(b"awake".to_vec())));
        // The transmit times include the antenna delay: 16400 after a multiple of 512, for the delayed start and for
        // the immediate one.
        assert_eq!(stamps.1, stamps.0.snapped(512).plus(RadioDuration::from_ticks(16_400)));
        assert_eq!((stamps.2.ticks() - 16_400) % 512, 0);
    }
}

/// Makes a chip sleep for `micros` microseconds, or until it is roused, and then send a frame, which must be received.
/// Returns whether it slept, and how long that took, milliseconds.
fn sleep_and_send<F: Future<Output = ()> + 'static>(
    sleeps: bool,
    micros: u32,
    roused: impl FnOnce(&World) -> F + 'static,
) -> (bool, f64) {
    let (world, a, b) = two_nodes(0.0);
    let (mut sender, mut receiver) =
        (driver(a.peripherals(), Config { sleeps, ..fast() }), driver(b.peripherals(), fast()));
    let clock = world.clone();
    let (sleep, heard) = run(
        &world,
        async move {
            sender.restart().await.unwrap();
            let before = clock.now();
            let slept = Restart::sleep(&mut sender, micros, roused(&clock)).await.unwrap();
            let took = clock.now().as_secs_f64() - before.as_secs_f64();
            sender.transmit(b"awake", Start::Now, false).await.unwrap();
            (slept, 1e3 * took)
        },
        async move {
            receiver.init().await.unwrap();
            receive(&mut receiver, Start::Now, us(500_000), false).await.map(|heard| heard.bytes)
        },
    );
    assert_eq!(heard, Ok(b"awake".to_vec()));
    let statistics = a.chip_statistics();
    assert_eq!((statistics.too_fast, statistics.not_idle), (0, 0));
    sleep
}

#[test]
fn a_wait_is_slept_through_where_it_is_long_and_the_configuration_lets_it() {
    for (sleeps, wait_ms, expected) in [(false, 100, false), (true, 6, false), (true, 100, true)] {
        let (slept, took_ms) = sleep_and_send(sleeps, 1_000 * wait_ms, |_| pending());
        assert_eq!(slept, expected);
        // The chip is awake in time: the wake-up takes place within the wait, and leaves less than a millisecond of it
        // unused.
        let expected_ms = if slept { 99.0..100.2 } else { 0.0..0.1 };
        assert!(expected_ms.contains(&took_ms), "{took_ms} ms");
    }
}

#[test]
fn a_sleep_may_be_cut_short() {
    let (slept, took_ms) = sleep_and_send(true, 8_000_000, |world| world.delay().pause_ms(20));
    assert!(slept);
    // 20 ms, then 0.6 ms of the select line and 3 to 4 ms of the crystal.
    assert!((23.0..25.0).contains(&took_ms), "{took_ms} ms");
}

#[test]
fn the_chip_may_go_and_come_back() {
    let (world, a, b) = two_nodes(0.0);
    let mut radio = driver(a.peripherals(), fast());
    let (node, world_again) = (a.clone(), world.clone());
    run(
        &world,
        async move {
            radio.init().await.unwrap();
            // The chip's supply fails while it listens, and returns: nothing hangs.
            let failing = node.clone();
            world_again.at(world_again.now() + Duration::from_millis(5), move |_| failing.power_off());
            assert!(receive(&mut radio, Start::Now, us(20_000), false).await.is_err());
            assert!(matches!(radio.init().await, Err(Error::WrongChip(_))));
            assert_eq!(radio.now().await, Err(Error::NotReady));
            node.power_on();
            radio.init().await.unwrap();
            radio.transmit(b"back", Start::Now, false).await.unwrap();
        },
        async {},
    );
    drop(b);
}

#[test]
fn a_board_without_a_reset_line_finds_its_chip_asleep() {
    let (world, a, _b) = two_nodes(0.0);
    let mut radio = driver(a.peripherals(), fast());
    run(
        &world,
        async move {
            radio.init().await.unwrap();
            radio.sleep(Wake::Outside(WakeBy::ChipSelect)).await.unwrap();
            // The processor restarts and has lost its state.
            let (bus, irq, _, delay) = radio.release();
            let mut radio: Driver<()> = Dw1000::new(bus, irq, (), delay, fast());
            radio.init().await.unwrap();
            radio.transmit(b"found", Start::Now, false).await.unwrap();
        },
        async {},
    );
}

#[test]
fn impulse_response_has_its_peak_at_the_first_path() {
    let (world, a, b) = two_nodes(0.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let clock = a.peripherals().delay;
    let (_, window) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            clock.pause_ms(20).await;
            sender.transmit(&[1; 20], Start::Now, false).await.unwrap();
        },
        async move {
            receiver.init().await.unwrap();
            let heard = receive(&mut receiver, Start::Now, us(60_000), false).await.unwrap();
            let mut samples = Vec::new();
            let window = ResponseWindow { first_path_index: heard.first_path_index, before: 16, count: 64 };
            let start = receiver.impulse_response(window, |sample| samples.push(sample)).await.unwrap();
            assert_eq!(start, Some(heard.first_path_index as u16 - 16));
            assert!(heard.first_path_power_dbm <= heard.rx_power_dbm);
            samples
        },
    );
    let magnitude = |s: &Sample| f64::from(s.i).hypot(f64::from(s.q));
    let peak = window.iter().map(magnitude).fold(0.0, f64::max);
    let noise = window[..12].iter().map(magnitude).fold(0.0, f64::max);
    assert!(peak > 10.0 * noise, "before the first path {noise}, in it {peak}");
    let at = window.iter().position(|s| magnitude(s) == peak).unwrap();
    assert!((16..24).contains(&at), "{at}");
}

#[test]
fn sensors_and_trim() {
    let world = World::new(1, AirConfig::ideal());
    let node = |trim, temperature_c, supply_v| {
        let chip = ChipConfig { trim, temperature_c, supply_v, ..ChipConfig::default() };
        world.add_node(NodeConfig { chip, ..NodeConfig::at([0.0; 3]) })
    };
    let (a, b) = (node(0, 41.0, 3.0), node(5, 23.0, 3.3));
    let (mut warm, mut cold) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    run(
        &world,
        async move {
            warm.init().await.unwrap();
            let seen = warm.compensate().await.unwrap().unwrap();
            // The steps are 1.14 °C and 5.8 mV.
            assert!((seen.temperature_celsius - 41.0).abs() < 0.6 && (seen.voltage - 3.0).abs() < 0.003, "{seen:?}");
        },
        async move {
            cold.init().await.unwrap();
        },
    );
    // A factory trim of 5 pulls by 20 ppm in this simulation. Without a trim the middle is used, which is a step of 1.6
    // ppm from zero.
    assert!((b.chip().clock_ppm(world.now()) - 20.0).abs() < 0.5);
    assert!(a.chip().clock_ppm(world.now()).abs() < 2.5);
}
