//! Initialisation: which chip answers, in which order, at which clock.

use embassy_futures::block_on;

use super::double::*;
use crate::driver::{Dw1000, Error, SpiClock, fastest_clock};
use core::convert::Infallible;
use radio::{Config, FrameFilter, PhyConfig, Radio, RadioInstant, TxPower};

fn uninitialised() -> (Driver, Bus) {
    let bus = Bus::default();
    (Dw1000::new(bus.clone(), Line(true), (), Delay::default(), Config::new(PhyConfig::FAST)), bus)
}

#[test]
fn another_chip_is_named() {
    let (mut radio, bus) = uninitialised();
    bus.answer(&[0x00], &[0xFF; 4]);
    assert_eq!(block_on(radio.init()), Err(Error::WrongChip(0xFFFF_FFFF)));
    // The chip might have slept: the chip-select line was held, and the chip was read again.
    let seen = bus.seen();
    assert_eq!(seen[1..], [read(&[0x00], 4), Seen::Hold(600_000), read(&[0x00], 4)]);
}

#[test]
fn a_pll_that_does_not_lock_is_an_error() {
    let (mut radio, bus) = uninitialised();
    bus.answer(&[0x00], &[0x30, 0x01, 0xCA, 0xDE]);
    assert_eq!(block_on(radio.init()), Err(Error::PllNotLocked));
    assert!(!bus.seen().contains(&Seen::Clock(SpiClock::Fast)));
}

#[test]
fn the_bus_is_slow_until_the_pll_has_locked() {
    let (mut radio, bus) = uninitialised();
    bus.answer(&[0x00], &[0x30, 0x01, 0xCA, 0xDE]);
    // Not locked at first, then locked.
    bus.answer(SYS_STATUS, &[0, 0, 0, 0]);
    bus.answer(SYS_STATUS, &[0x02, 0, 0, 0]);
    block_on(radio.init()).unwrap();
    let seen = bus.seen();
    assert_eq!(seen[0], Seen::Clock(SpiClock::Slow));
    let fast = seen.iter().position(|s| *s == Seen::Clock(SpiClock::Fast)).unwrap();
    let locked = seen.iter().rposition(|s| *s == read(&[0x0F], 4)).unwrap();
    assert!(locked < fast);
    // Whenever the chip is set to run from its crystal (PMSC_CTRL0 = 01), the bus is slow.
    let mut clock = SpiClock::Slow;
    for seen in &seen {
        match seen {
            Seen::Clock(now) => clock = *now,
            Seen::Write(bytes) if bytes[..] == [0xB6, 0x01] => assert_eq!(clock, SpiClock::Slow),
            Seen::Write(_) | Seen::Read(..) | Seen::Hold(_) => {}
        }
    }
    assert_eq!(clock, SpiClock::Fast);
    // The detector's program is loaded, with the clocks that this needs (2.5.5.10).
    let load = seen.iter().position(|s| *s == write(&[0xED, 0x06, 0x00, 0x80])).unwrap();
    assert_eq!(seen[load - 2..load], [write(&[0xB6, 0x01]), write(&[0xF6, 0x01, 0x03])]);
    assert_eq!(seen[load + 1..load + 3], [write(&[0xB6, 0x00]), write(&[0xF6, 0x01, 0x02])]);
    // No crystal trim by the maker: the middle, with the upper bits 011.
    assert!(seen.contains(&write(&[0xEB, 0x0E, 0x70])));
}

#[test]
fn the_makers_trims_are_used() {
    let (mut radio, bus) = uninitialised();
    bus.answer(&[0x00], &[0x30, 0x01, 0xCA, 0xDE]);
    bus.answer(SYS_STATUS, &[0x02, 0, 0, 0]);
    // One-time programmable memory in the order of reading: LDO tune, voltage, temperature, crystal (5 bits), antenna
    // delays (PRF 16: 0x4001, PRF 64: 0x4055), powers of channels 1, 2, 3, 4, 5, 7 at PRF 16 and 64: that of channel 5
    // at 64 is the tenth.
    let words = [[0x28, 0, 0, 0], [173, 0, 0, 0], [116, 0, 0, 0], [0xF3, 0x01, 0, 0], [0x01, 0x40, 0x55, 0x40]];
    let powers = (1..=12).map(|nth| if nth == 10 { [0x87, 0x67, 0x47, 0x27] } else { [nth; 4] });
    for word in words.into_iter().chain(powers) {
        bus.answer(&[0x6D, 0x0A], &word);
    }
    block_on(radio.init()).unwrap();
    let seen = bus.seen();
    assert!(seen.contains(&write(&[0xED, 0x12, 0x02])), "regulators' tuning loaded");
    assert!(seen.contains(&write(&[0xEB, 0x0E, 0x73])));
    for address in [0x04, 0x08, 0x09, 0x1E, 0x1C].into_iter().chain(0x10..=0x1B) {
        assert!(seen.contains(&write(&[0xED, 0x04, address, 0x00])));
    }
    assert!(seen.contains(&write(&[0x9E, 0x87, 0x67, 0x47, 0x27])));
    assert!(seen.contains(&write(&[0x98, 0x55, 0x40])) && seen.contains(&write(&[0xEE, 0x84, 0x30, 0x55, 0x40])));
    // The node reports the delay that the chip adds.
    assert_eq!(radio.antenna_delay().ticks(), 0x4055);
    assert_eq!(radio.departure(RadioInstant::from_ticks(0x1FF)).ticks(), 0x4055);
}

/// TX_ANTD and TX_POWER of a board whose one-time programmable memory holds these antenna delays and this power.
fn calibrated(config: Config, delays: [u8; 4], power: [u8; 4]) -> (u16, u32) {
    let bus = Bus::default();
    let mut radio: Driver = Dw1000::new(bus.clone(), Line(true), (), Delay::default(), config);
    bus.answer(&[0x00], &[0x30, 0x01, 0xCA, 0xDE]);
    bus.answer(SYS_STATUS, &[0x02, 0, 0, 0]);
    for word in [[0; 4], [0; 4], [0; 4], [0; 4], delays, power] {
        bus.answer(&[0x6D, 0x0A], &word);
    }
    block_on(radio.init()).unwrap();
    let written = bus.seen();
    let datum = |header: u8| {
        written.iter().find_map(|seen| match seen {
            Seen::Write(bytes) if bytes[0] == header => Some(bytes[1..].to_vec()),
            Seen::Write(_) | Seen::Read(..) | Seen::Hold(_) | Seen::Clock(_) => None,
        })
    };
    let delay = u16::from_le_bytes(datum(0x98).unwrap().try_into().unwrap());
    assert_eq!(radio.antenna_delay().ticks(), i64::from(delay));
    (delay, u32::from_le_bytes(datum(0x9E).unwrap().try_into().unwrap()))
}

#[test]
fn a_module_without_calibration_has_the_defaults_of_its_pulse_frequency() {
    // 513.9067 ns and 514.462 ns for both directions: × 63.8976 / 2 = 16418.7 and 16436.4 ticks. Powers: table 20.
    let mode = |mode| Config::new(PhyConfig::evk1000_mode(mode).unwrap());
    for void in [[0; 4], [0xFF; 4]] {
        assert_eq!(calibrated(mode(4), void, void), (16_436, 0x0727_4767));
        assert_eq!(calibrated(mode(2), void, void), (16_419, 0x1535_5575));
    }
}

#[test]
fn what_is_configured_counts_more_than_the_makers_and_these_more_than_defaults() {
    let (delays, power) = ([0x01, 0x40, 0x55, 0x40], [0x87, 0x67, 0x47, 0x27]);
    let mode = |mode| Config::new(PhyConfig::evk1000_mode(mode).unwrap());
    // 6.81 Mbit/s: boosts; 110 kbit/s has none, the low byte is for all parts of the frame. PRF 64 and 16.
    assert_eq!(calibrated(mode(8), delays, power), (0x4055, 0x2747_6787));
    assert_eq!(calibrated(mode(5), delays, power), (0x4001, 0x8787_8787));
    let constant = Config { tx_power: TxPower::Constant, ..mode(8) };
    assert_eq!(calibrated(constant, delays, power), (0x4055, 0x8787_8787));
    let own = |smart| {
        let tx_power = TxPower::Calibrated { register: 0x1122_3344, smart };
        move |mode| Config { tx_power, tx_antenna_delay: Some(16_400), ..mode }
    };
    assert_eq!(calibrated(own(true)(mode(8)), delays, power), (16_400, 0x1122_3344));
    assert_eq!(calibrated(own(true)(mode(5)), delays, power), (16_400, 0x4444_4444));
    // Powers of the frame's parts are that at every rate.
    assert_eq!(calibrated(own(false)(mode(5)), delays, power), (16_400, 0x1122_3344));
}

#[test]
fn filter_address_power_and_trim_reach_the_chip() {
    let config = Config {
        tx_power: TxPower::Calibrated { register: 0x1F2F_3F4F, smart: false },
        crystal_trim: Some(0x0A),
        pan: 0xDECA,
        short_address: 0x1234,
        eui: 0x0102_0304_0506_0708,
        filter: FrameFilter::DATA.and(FrameFilter::TYPE_5),
        tx_antenna_delay: Some(0x4000),
        rx_antenna_delay: Some(0x4100),
        ..Config::new(PhyConfig::FAST)
    };
    let (mut radio, bus, _) = fast(true);
    block_on(radio.configure(config)).unwrap();
    let seen = bus.seen();
    for bytes in [
        &[0x81, 8, 7, 6, 5, 4, 3, 2, 1][..],
        &[0x83, 0x34, 0x12, 0xCA, 0xDE],
        // FFEN, FFAD, FFA5 (bits 0, 3, 8), HIRQ_POL (9), DIS_STXP (18); DIS_DRXB (12) is not set.
        &[0x84, 0x09, 0x03, 0x04, 0x00],
        &[0x9E, 0x4F, 0x3F, 0x2F, 0x1F],
        &[0xEB, 0x0E, 0x6A],
        &[0x98, 0x00, 0x40],
        &[0xEE, 0x84, 0x30, 0x00, 0x41],
    ] {
        assert!(seen.contains(&write(bytes)), "{bytes:x?}");
    }
    block_on(radio.set_address(0xABCD, 0x0042)).unwrap();
    assert_eq!(bus.seen(), [write(&[0x83, 0x42, 0x00, 0xCD, 0xAB])]);
}

/// The fastest clock of a chip whose answers arrive a bit late above `late_mhz`, and lose a one between zeros, which is
/// the shortest pulse, above `weak_mhz`.
fn fastest_on_wires(late_mhz: u32, weak_mhz: u32) -> u32 {
    let mut eui = [0; 8];
    let exchange = |mhz, bytes: &mut [u8]| {
        match bytes[0] {
            0x81 => eui.copy_from_slice(&bytes[1..]),
            0x01 => {
                let mut answer = u64::from_be_bytes(eui);
                if mhz > weak_mhz {
                    answer &= answer << 1 | answer >> 1;
                }
                if mhz > late_mhz {
                    answer >>= 1;
                }
                bytes[1..].copy_from_slice(&answer.to_be_bytes());
            }
            other => panic!("no other register than EUI may be touched: {other:#x}"),
        }
        Ok::<_, Infallible>(())
    };
    let Ok(mhz) = fastest_clock(20, 2, exchange);
    mhz
}

#[test]
fn wires_that_are_too_long_get_a_slower_clock() {
    assert_eq!(fastest_on_wires(20, 20), 20);
    assert_eq!(fastest_on_wires(19, 20), 10);
    assert_eq!(fastest_on_wires(20, 9), 5);
    // Below 5 MHz there is the clock that the chip was identified at.
    assert_eq!(fastest_on_wires(4, 4), 2);
    assert_eq!(fastest_on_wires(0, 0), 2);
}

#[test]
fn a_bus_that_fails_is_no_slow_bus() {
    assert_eq!(fastest_clock(20, 2, |_, _| Err("unplugged")), Err("unplugged"));
}
