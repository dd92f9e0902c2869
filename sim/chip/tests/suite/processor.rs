//! The cost of code is visible at the bus, the interrupt line and the timer.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use dw1000_sim::{AirConfig, BoardProfile, NodeConfig, Peripherals, TrueTime, World};
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::spi::SpiDevice;

/// An instruction takes 10 ns; an interrupt takes 2 µs and 100 instructions; a transaction takes 50 instructions and
/// each of its operations 100.
const BOARD: BoardProfile = BoardProfile {
    clock_hz: 100_000_000,
    cycles_per_instruction: 1.0,
    transaction_instructions: 50,
    operation_instructions: 100,
    interrupt_latency_ns: 2_000,
    wake_instructions: 100,
    timer_ns: 1_000,
    ..BoardProfile::INSTANT
};

fn node(world: &World, board: BoardProfile) -> Peripherals {
    world.add_node(NodeConfig { board, ..NodeConfig::at([0.0; 3]) }).peripherals()
}

#[test]
fn a_transaction_begins_when_the_code_before_it_has_run() {
    for (slowdown, expected_ns) in [(1.0, 9_000 + 1_500 + 24_000), (4.0, 4 * 10_500 + 24_000)] {
        let world = World::new(1, AirConfig::default());
        let mut p = node(&world, BOARD.slowed(slowdown));
        p.processor.charge(900);
        // 900 instructions, one operation, six bytes at 2 MHz.
        world.block_on(p.spi.write(&[0; 6])).expect("it ends").expect("no bus fails here");
        assert_eq!(world.now(), TrueTime::ZERO + Duration::from_nanos(expected_ns), "{slowdown}");
    }
}

#[test]
fn a_wait_is_armed_after_the_code_before_it_and_ends_with_an_interrupt() {
    let world = World::new(1, AirConfig::default());
    let mut p = node(&world, BOARD);
    p.processor.charge(1_030);
    world.block_on(p.delay.delay_us(20)).expect("it ends");
    // 10.3 µs of code, 20 µs, up to the timer's next step at 31 µs, 3 µs of interrupt.
    assert_eq!(world.now(), TrueTime::from_micros(34));
}

#[test]
fn two_timers_of_one_node_are_served_one_after_the_other() {
    let world = World::new(1, AirConfig::default());
    let p = node(&world, BOARD);
    let ends = Rc::new(Cell::new([TrueTime::ZERO; 2]));
    for task in 0..2 {
        let (mut delay, ends, world) = (p.delay.clone(), ends.clone(), world.clone());
        p.node.spawn(async move {
            delay.delay_us(10).await;
            let mut all = ends.get();
            all[task] = world.now();
            ends.set(all);
        });
    }
    world.run_for(Duration::from_millis(1));
    assert_eq!(ends.get(), [TrueTime::from_micros(13), TrueTime::from_micros(16)]);
}

#[test]
fn a_wait_that_is_given_up_costs_no_interrupt() {
    let world = World::new(1, AirConfig::default());
    let p = node(&world, BOARD);
    let mut delay = p.delay.clone();
    p.node.spawn(async move {
        let mut first = std::pin::pin!(delay.delay_us(10));
        std::future::poll_fn(|cx| {
            assert!(first.as_mut().poll(cx).is_pending());
            std::task::Poll::Ready(())
        })
        .await;
    });
    world.run_for(Duration::from_millis(1));
    assert_eq!(p.processor.times(world.now()).running, Duration::ZERO);
}
