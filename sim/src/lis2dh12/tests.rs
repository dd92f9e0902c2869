//! The model against the data sheet (DocID025056) and AN5005, and the driver's set-up on it.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use dw1000_sim::{AirConfig, BoardProfile, Processor, TrueTime, World};
use embedded_hal_async::digital::Wait;
use embedded_hal_async::i2c::I2c;
use firmware_tag::motion::lis2dh12::{Lis2dh12, Sa0Pad};
use firmware_tag::motion::{MotionSensor, MotionSensorError};

use super::{Condition, Device, NoAcknowledge, Sensor};

/// The acceleration of a sensor that lies flat.
const FLAT_MG: [f64; 3] = [0.0, 0.0, 1000.0];

fn read(device: &mut Device, register: u8) -> u8 {
    let mut byte = [0];
    device.write(&[register]);
    device.read(&mut byte);
    byte[0]
}

/// 10 Hz, low-power mode, ± 2 g, all axes.
fn low_power() -> Device {
    let mut device = Device::new();
    assert!(device.write(&[0x20, 0x2F]));
    device
}

/// The same with high events of all axes on INT1 above 48 mg, filtered by 0.2 Hz.
fn waking() -> Device {
    let mut device = low_power();
    for (register, value) in [(0x21, 0x01), (0x22, 0x40), (0x30, 0x2A), (0x32, 3)] {
        device.write(&[register, value]);
    }
    device.sample(FLAT_MG);
    read(&mut device, 0x26);
    device.sample(FLAT_MG);
    assert!(!device.int1());
    device
}

#[test]
fn registers_have_the_data_sheets_defaults_and_some_are_read_only() {
    let mut device = Device::new();
    for (register, value) in [(0x0F, 0x33), (0x1E, 0x10), (0x20, 0x07), (0x21, 0), (0x30, 0), (0x2F, 0x20)] {
        assert_eq!(read(&mut device, register), value, "{register:#x}");
    }
    for register in [0x0F, 0x27, 0x28, 0x31, 0x10] {
        let before = read(&mut device, register);
        device.write(&[register, 0x5A]);
        assert_eq!(read(&mut device, register), before, "{register:#x}");
    }
    // The sub-address is incremented only if its highest bit is set.
    device.write(&[0x32 | 0x80, 1, 2]);
    let mut both = [0; 2];
    device.write(&[0x32 | 0x80]);
    device.read(&mut both);
    assert_eq!(both, [1, 2]);
    device.write(&[0x32]);
    device.read(&mut both);
    assert_eq!(both, [1, 1]);
}

#[test]
fn rates_and_currents_are_the_data_sheets() {
    // ODR 0 to 7 in low-power mode: the data sheet's table of current consumption.
    let ua = [0.5, 2.0, 3.0, 4.0, 6.0, 10.0, 18.0, 36.0];
    let hz = [0.0, 1.0, 10.0, 25.0, 50.0, 100.0, 200.0, 400.0];
    for odr in 0..8_u8 {
        let mut device = Device::new();
        device.write(&[0x20, odr << 4 | 0x0F]);
        assert_eq!(device.current_ua(), ua[usize::from(odr)]);
        let expected = (odr > 0).then(|| Duration::from_secs_f64(1.0 / hz[usize::from(odr)]));
        assert_eq!(device.period(), expected);
    }
    // 5.376 kHz in low-power mode, 1.344 kHz otherwise.
    let mut device = Device::new();
    device.write(&[0x20, 0x9F]);
    assert_eq!(device.period(), Some(Duration::from_secs_f64(1.0 / 5376.0)));
    device.write(&[0x20, 0x97]);
    assert_eq!((device.period(), device.current_ua()), (Some(Duration::from_secs_f64(1.0 / 1344.0)), 185.0));
}

#[test]
fn samples_are_left_justified_in_the_modes_resolution() {
    // 350 mg is 350/16 = 21.9, i.e. 22 digits with 8 bits; 350/4 = 87.5, i.e. 88 digits with 10 bits; 350 digits with
    // 12 bits.
    for (ctrl1, ctrl4, value) in [(0x2F, 0, 22 << 8), (0x27, 0, 88 << 6), (0x27, 0x08, 350 << 4)] {
        let mut device = Device::new();
        device.write(&[0x20, ctrl1]);
        device.write(&[0x23, ctrl4]);
        device.sample([350.0, -3000.0, 0.0]);
        let mut out = [0; 6];
        assert_eq!(read(&mut device, 0x27), 0x0F);
        device.write(&[0x28 | 0x80]);
        device.read(&mut out);
        assert_eq!(i16::from_le_bytes([out[0], out[1]]), value);
        // An acceleration beyond the range reads as the end of the range.
        assert_eq!(i16::from_le_bytes([out[2], out[3]]), i16::MIN);
        assert_eq!(read(&mut device, 0x27), 0);
        device.sample(FLAT_MG);
        device.sample(FLAT_MG);
        assert_eq!(read(&mut device, 0x27), 0xFF, "one was overwritten");
    }
}

#[test]
fn the_filter_lets_a_step_decay_with_its_time_constant() {
    let mut device = waking();
    device.write(&[0x21, 0x09]);
    let mut out = [0; 6];
    let mut x_mg = Vec::new();
    for _ in 0..16 {
        device.sample([1000.0, 0.0, 1000.0]);
        device.write(&[0x28 | 0x80]);
        device.read(&mut out);
        x_mg.push(16.0 * f64::from(out[1] as i8));
    }
    // 0.2 Hz: τ = 1/(2π · 0.2 Hz) = 0.796 s. A step of 992 mg falls to 1/e, 365 mg, after 0.8 s, and to 134 mg after
    // 1.6 s; ± a digit.
    assert!((x_mg[7] - 365.0).abs() <= 20.0 && (x_mg[15] - 134.0).abs() <= 20.0, "{x_mg:?}");
    // Reading REFERENCE makes the present acceleration the reference.
    read(&mut device, 0x26);
    device.sample([1000.0, 0.0, 1000.0]);
    device.write(&[0x28 | 0x80]);
    device.read(&mut out);
    assert_eq!(out, [0; 6]);
}

#[test]
fn int1_is_high_while_an_axis_is_above_the_threshold() {
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut device = waking();
            // Three digits, 48 mg, do not exceed three steps. Six digits do: 0.88 · 96 mg = 85 mg.
            let mut moved = FLAT_MG;
            moved[axis] += sign * 48.0;
            device.sample(moved);
            assert!(!device.int1());
            moved[axis] += sign * 48.0;
            device.sample(moved);
            assert!(device.int1());
            // Active, and the axis's high event: XH is bit 1, YH bit 3, ZH bit 5.
            assert_eq!(read(&mut device, 0x31), 0x40 | 2 << (2 * axis));
        }
    }
    // Gravity alone, without the filter, is an event that never ends.
    let mut device = waking();
    device.write(&[0x21, 0]);
    (0..50).for_each(|_| device.sample(FLAT_MG));
    assert!(device.int1());
}

#[test]
fn an_event_has_to_last_for_longer_than_the_duration() {
    let mut device = waking();
    device.write(&[0x33, 2]);
    let shaken = [[400.0, 0.0, 1000.0], [-400.0, 0.0, 1000.0]];
    let highs: Vec<bool> = (0..5)
        .map(|i| {
            device.sample(shaken[i % 2]);
            device.int1()
        })
        .collect();
    assert_eq!(highs, [false, false, true, true, true]);
}

#[test]
fn a_latched_event_stays_until_it_is_read_and_others_end_by_themselves() {
    for latched in [false, true] {
        let mut device = waking();
        device.write(&[0x24, if latched { 0x08 } else { 0 }]);
        device.sample([400.0, 0.0, 1000.0]);
        assert!(device.int1());
        // The filter swings back by less than the threshold: 0.88 · 400 mg less 400 mg.
        device.sample(FLAT_MG);
        device.sample(FLAT_MG);
        assert_eq!(device.int1(), latched);
        read(&mut device, 0x31);
        assert!(!device.int1());
    }
}

#[test]
fn the_lines_polarity_and_what_is_routed_to_it() {
    let mut device = waking();
    device.write(&[0x25, 0x02]);
    assert!(device.int1(), "active low");
    device.write(&[0x25, 0]);
    device.sample([400.0, 0.0, 1000.0]);
    device.write(&[0x22, 0]);
    assert!(!device.int1());
    // Data ready.
    device.write(&[0x22, 0x10]);
    assert!(device.int1());
}

/// A world with a sensor that measures what is in the cell, its processor, and the cell.
fn bench(condition: Condition) -> (World, Sensor, Processor, Rc<Cell<[f64; 3]>>) {
    let world = World::new(1, AirConfig::default());
    let felt = Rc::new(Cell::new(FLAT_MG));
    let source = felt.clone();
    let sensor = Sensor::new(&world, condition, move |_| source.get());
    (world, sensor, Processor::new(BoardProfile::DWM1001), felt)
}

fn driver(world: &World, sensor: &Sensor, processor: &Processor) -> impl MotionSensor + use<> {
    Lis2dh12::new(sensor.twi(processor), Sa0Pad::High, sensor.int1(processor), world.delay())
}

#[test]
fn the_driver_sets_up_low_power_waking_whatever_the_registers_held() {
    let (world, sensor, processor, _) = bench(Condition::Works);
    // The registers as a former program left them: high resolution, filtered data, FIFO, latched, active low, axes off.
    let mut twi = sensor.twi(&processor);
    for bytes in [[0x20, 0x70], [0x21, 0xFF], [0x23, 0x38], [0x24, 0x48], [0x25, 0x02], [0x33, 9]] {
        world.block_on(twi.write(0x19, &bytes)).unwrap().unwrap();
    }
    world.block_on(driver(&world, &sensor, &processor).start()).unwrap().unwrap();
    let mut register = |register| {
        let mut byte = [0];
        world.block_on(twi.write_read(0x19, &[register], &mut byte)).unwrap().unwrap();
        byte[0]
    };
    // By the data sheet: 10 Hz, low power, all axes; filter on the first generator, normal mode, HPCF 01; its interrupt
    // on INT1; ± 2 g; no FIFO and no latch; active high; high events of all axes; 3 · 16 mg; no duration.
    let expected = [
        (0x20, 0x2F),
        (0x21, 0x11),
        (0x22, 0x40),
        (0x23, 0x00),
        (0x24, 0x00),
        (0x25, 0x00),
        (0x30, 0x2A),
        (0x32, 3),
        (0x33, 0),
    ];
    for (address, value) in expected {
        assert_eq!(register(address), value, "{address:#x}");
    }
}

#[test]
fn who_lies_still_is_quiet_and_a_push_is_told_with_the_next_sample() {
    let (world, sensor, processor, felt) = bench(Condition::Works);
    let mut driver = driver(&world, &sensor, &processor);
    world.block_on(driver.start()).unwrap().unwrap();
    let moved = Rc::new(Cell::new(None));
    let (told, clock) = (moved.clone(), world.clone());
    world.spawn(async move {
        driver.moved().await;
        told.set(Some(clock.now().as_secs_f64()));
    });
    world.run_until(TrueTime::from_secs_f64(60.0));
    assert_eq!(moved.get(), None);
    felt.set([100.0, 0.0, 1000.0]);
    world.run_until(TrueTime::from_secs_f64(60.15));
    let moved_s = moved.get().expect("told");
    assert!(moved_s - 60.0 <= 0.1, "{moved_s}");
    // 3 µA for 59.8 s, and 0.5 µA before.
    assert!((sensor.drawn_uc() - 180.0).abs() < 1.0, "{} µC", sensor.drawn_uc());
}

#[test]
fn a_sensor_that_is_not_there_or_is_another_is_found_out() {
    for (condition, found) in
        [(Condition::Silent, MotionSensorError::Silent), (Condition::Foreign, MotionSensorError::Foreign)]
    {
        let (world, sensor, processor, _) = bench(condition);
        assert_eq!(world.block_on(driver(&world, &sensor, &processor).start()), Some(Err(found)));
    }
    let (world, sensor, processor, _) = bench(Condition::Works);
    assert_eq!(
        world.block_on(sensor.twi(&processor).write(0x18, &[0x0F])),
        Some(Err(NoAcknowledge)),
        "another address"
    );
    // A transaction on a bus that hangs never ends.
    let (world, sensor, processor, _) = bench(Condition::Hung);
    assert_eq!(world.block_on(driver(&world, &sensor, &processor).start()), None);
}

#[test]
fn a_transfer_takes_its_bits_and_the_processors_time() {
    let (world, sensor, processor, _) = bench(Condition::Works);
    world.block_on(sensor.twi(&processor).write_read(0x19, &[0x0F], &mut [0])).unwrap().unwrap();
    // Address and register, address and data: 2 · (2 + 2 · 9) clocks of 10 µs are 400 µs. 600 instructions of 1.5/64 µs
    // are 14 µs.
    let took_us = world.now().as_secs_f64() * 1e6;
    assert!((took_us - 414.0).abs() < 0.1, "{took_us} µs");
}

#[test]
fn without_its_supply_a_sensor_forgets_and_a_stuck_line_stays() {
    let (world, sensor, processor, _) = bench(Condition::Works);
    world.block_on(driver(&world, &sensor, &processor).start()).unwrap().unwrap();
    sensor.set_supply(false);
    assert_eq!(world.block_on(sensor.twi(&processor).write(0x19, &[0x0F])), Some(Err(NoAcknowledge)));
    let before = sensor.drawn_uc();
    world.run_for(Duration::from_secs(10));
    assert_eq!(sensor.drawn_uc(), before);
    sensor.set_supply(true);
    world.run_for(Duration::from_secs(10));
    // Powered down: 0.5 µA.
    assert!((sensor.drawn_uc() - before - 5.0).abs() < 1e-6);
    let (world, sensor, processor, _) = bench(Condition::Stuck(true));
    assert_eq!(world.block_on(sensor.int1(&processor).wait_for_high()), Some(Ok(())));
}
