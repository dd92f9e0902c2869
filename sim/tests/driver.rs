//! The DW1000 driver of `ranging` on simulated chips, at the registers, with the time that a board takes.

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;
use std::time::Duration;

use embedded_hal::digital::OutputPin;
use embedded_hal::spi::{ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;
use ranging::dw1000::{
    ClockedSpi, Config, Dw1000, Error, FrameFilter, ResetLine, Sample, SpiClock as Speed, TxPower, Wake, WakeBy,
};
use ranging::phy::{Channel, DataRate, PhyConfig, PreambleLength, Prf};
use ranging::radio::MAX_FRAME;
use ranging::time::METRES_PER_TICK;
use ranging::{Radio, RadioDuration, RadioInstant, ReceiveError, Start, TransmitError};
use sim::{
    AirConfig, ChipConfig, ClockConfig, IrqPin, Node, NodeConfig, Peripherals, ResetPin, SimDelay, SimSpi, SpiClock,
    TrueTime, World,
};

/// A DWM1001's bus: 2 MHz until the PLL has locked, 8 MHz after.
struct Bus(SimSpi, SpiClock);

impl ErrorType for Bus {
    type Error = Infallible;
}

impl SpiDevice for Bus {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        self.0.transaction(operations).await
    }
}

impl ClockedSpi for Bus {
    fn set_clock(&mut self, clock: Speed) -> Result<(), Infallible> {
        self.1.set_hz(match clock {
            Speed::Slow => 2_000_000,
            Speed::Fast => 8_000_000,
        });
        Ok(())
    }
}

struct Reset(ResetPin);

impl ResetLine for Reset {
    fn pull_low(&mut self) {
        let Ok(()) = self.0.set_low();
    }
    fn release(&mut self) {
        let Ok(()) = self.0.set_high();
    }
}

type Driver<R = Reset> = Dw1000<Bus, IrqPin, R, SimDelay>;

fn driver(peripherals: Peripherals, config: Config) -> Driver {
    let clock = peripherals.spi.clock();
    let bus = Bus(peripherals.spi, clock);
    Dw1000::new(bus, peripherals.irq, Reset(peripherals.reset), peripherals.delay, config)
}

fn us(micros: u32) -> RadioDuration {
    RadioDuration::from_micros(micros)
}

/// A node on the x axis whose clock is `ppm` off, and stays so.
fn node_at(world: &World, x: f64, ppm: f64) -> Node {
    let mut config = NodeConfig::at([x, 0.0, 1.0]);
    config.chip.clock = ClockConfig { offset_ppm: ppm, ..ClockConfig::IDEAL };
    world.add_node(config)
}

/// Two nodes, 10 m apart, whose clocks are ±`ppm` off.
fn two_nodes(ppm: f64) -> (World, Node, Node) {
    let world = World::new(7, AirConfig::ideal());
    let (a, b) = (node_at(&world, 0.0, ppm), node_at(&world, 10.0, -ppm));
    (world, a, b)
}

fn fast() -> Config {
    Config::new(PhyConfig::FAST)
}

/// The instant `span` from now, as a delayed start.
async fn soon(radio: &mut Driver, span: RadioDuration) -> RadioInstant {
    radio.now().await.unwrap().plus(span)
}

/// Nothing that the chip would not have taken.
fn assert_well_treated(node: &Node) {
    let seen = node.chip_statistics();
    assert_eq!((seen.too_fast, seen.deaf, seen.not_idle, seen.bad_stamps), (0, 0, 0, 0), "{seen:?}");
}

#[derive(Clone, Debug, PartialEq)]
struct Heard {
    bytes: Vec<u8>,
    rx_time: RadioInstant,
    ppm: f32,
    first_path_index: f32,
    rx_power_dbm: f32,
    first_path_power_dbm: f32,
}

/// Receives into something that can be kept.
async fn hear(
    radio: &mut Driver,
    start: Start,
    window: RadioDuration,
    keep: bool,
) -> Result<Heard, ReceiveError<Error<Infallible>>> {
    let mut buffer = [0; MAX_FRAME];
    radio.receive(&mut buffer, start, window, keep).await.map(|frame| Heard {
        bytes: frame.bytes.to_vec(),
        rx_time: frame.rx_time,
        ppm: frame.diagnostics.clock_offset_ppm,
        first_path_index: frame.diagnostics.first_path_index,
        rx_power_dbm: frame.diagnostics.rx_power_dbm,
        first_path_power_dbm: frame.diagnostics.first_path_power_dbm,
    })
}

/// Runs two applications to their ends; what they return.
fn run<A: 'static, B: 'static>(
    world: &World,
    a: impl Future<Output = A> + 'static,
    b: impl Future<Output = B> + 'static,
) -> (A, B) {
    let (left, right) = (Rc::new(RefCell::new(None)), Rc::new(RefCell::new(None)));
    let (l, r) = (left.clone(), right.clone());
    world.spawn(async move { *l.borrow_mut() = Some(a.await) });
    world.spawn(async move { *r.borrow_mut() = Some(b.await) });
    world.run_until(TrueTime::from_secs_f64(30.0));
    let taken = (left.borrow_mut().take(), right.borrow_mut().take());
    (taken.0.expect("the first ended"), taken.1.expect("the second ended"))
}

/// Poll and answer, single-sided; the distance that its four stamps and the carrier integrator give, metres.
fn ranged(config: Config, ppm: f64, reply: RadioDuration) -> (f64, Heard, Node, Node) {
    let (world, a, b) = two_nodes(ppm);
    let (mut tag, mut anchor) = (driver(a.peripherals(), config), driver(b.peripherals(), config));
    let ((poll_tx, response), (poll_rx, response_tx)) = run(
        &world,
        async move {
            tag.init().await.unwrap();
            let at = soon(&mut tag, us(20_000)).await;
            let poll_tx = tag.transmit(b"poll", Start::At(at), true).await.unwrap();
            (poll_tx, hear(&mut tag, Start::Now, us(30_000), false).await.unwrap())
        },
        async move {
            anchor.init().await.unwrap();
            let poll = hear(&mut anchor, Start::Now, us(60_000), false).await.unwrap();
            assert_eq!(poll.bytes, b"poll");
            let at = poll.rx_time.plus(reply);
            let promised = anchor.departure(at);
            let response_tx = anchor.transmit(b"response", Start::At(at), false).await.unwrap();
            assert_eq!(response_tx, promised);
            (poll.rx_time, response_tx)
        },
    );
    assert_eq!(response.bytes, b"response");
    let round = response.rx_time.since(poll_tx).ticks() as f64;
    let reply = response_tx.since(poll_rx).ticks() as f64;
    // Seed 002, equation 3, the reply in the tag's clock by the anchor's offset against it.
    let tof = (round - reply * (1.0 - f64::from(response.ppm) * 1e-6)) / 2.0;
    (tof * METRES_PER_TICK, response, a, b)
}

#[test]
fn two_chips_measure_their_distance() {
    let (metres, response, a, b) = ranged(fast(), 10.0, us(500));
    // The carrier integrator errs by 0.05 ppm: 500 µs × 0.05e-6 / 2 × c = 4 mm; a tick is 4.7 mm.
    assert!((metres - 10.0).abs() < 0.02, "{metres}");
    // The anchor's clock runs 20 ppm slower than the tag's.
    assert!((response.ppm + 20.0).abs() < 0.3, "{}", response.ppm);
    assert_well_treated(&a);
    assert_well_treated(&b);
}

#[test]
fn every_mode_of_the_evk1000_measures_it_too() {
    for mode in 1..=8 {
        let phy = PhyConfig::evk1000_mode(mode).unwrap();
        let reply = RadioDuration::from_ticks(phy.airtime(10).ticks() + us(600).ticks());
        let (metres, _, a, b) = ranged(Config::new(phy), 2.0, reply);
        // 0.05 ppm over 5 ms at 110 kbit/s: 4 cm.
        assert!((metres - 10.0).abs() < 0.1, "mode {mode}: {metres}");
        assert_well_treated(&a);
        assert_well_treated(&b);
    }
}

#[test]
fn rates_and_preambles_beside_the_evk1000s() {
    for (channel, prf, rate, preamble) in [
        (Channel::Ch2, Prf::Mhz64, DataRate::Kbps6810, PreambleLength::Symbols64),
        (Channel::Ch5, Prf::Mhz64, DataRate::Kbps850, PreambleLength::Symbols256),
        (Channel::Ch3, Prf::Mhz16, DataRate::Kbps850, PreambleLength::Symbols512),
        (Channel::Ch4, Prf::Mhz64, DataRate::Kbps6810, PreambleLength::Symbols512),
        (Channel::Ch7, Prf::Mhz16, DataRate::Kbps110, PreambleLength::Symbols2048),
    ] {
        let phy = PhyConfig::new(channel, prf, rate, preamble).unwrap();
        let reply = RadioDuration::from_ticks(phy.airtime(10).ticks() + us(600).ticks());
        let (metres, ..) = ranged(Config::new(phy), 2.0, reply);
        assert!((metres - 10.0).abs() < 0.1, "{phy:?}: {metres}");
    }
}

/// What a sender of `frames`, `gap` after one another (from RMARKER to RMARKER), got through to a receiver that keeps listening.
fn burst(count: u8, bytes: usize, gap: RadioDuration) -> (Vec<RadioInstant>, Vec<Heard>, Node, Node) {
    let (world, a, b) = two_nodes(5.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let (sent, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            let mut at = soon(&mut sender, us(20_000)).await;
            let mut sent = Vec::new();
            for number in 0..count {
                sent.push(sender.transmit(&vec![number; bytes], Start::At(at), false).await.unwrap());
                at = at.plus(gap);
            }
            sent
        },
        async move {
            receiver.init().await.unwrap();
            let mut heard = Vec::new();
            while let Ok(frame) = hear(&mut receiver, Start::Now, us(50_000), true).await {
                heard.push(frame);
            }
            heard
        },
    );
    (sent, heard, a, b)
}

#[test]
fn responses_of_a_round_are_all_heard() {
    // 25 bytes and check: 194 µs of air every 300 µs.
    let (sent, heard, a, b) = burst(20, 25, us(300));
    assert_eq!(heard.len(), 20);
    for (number, (sent, heard)) in sent.windows(2).zip(heard.windows(2)).enumerate() {
        assert_eq!(heard[0].bytes, [number as u8; 25]);
        let (spaced, seen) = (sent[1].since(sent[0]).ticks(), heard[1].rx_time.since(heard[0].rx_time).ticks());
        // 10 ppm of 300 µs are 192 ticks; each stamp is rounded to a tick.
        assert!((seen - spaced).abs() <= 200, "{number}: {spaced} became {seen}");
        assert!((heard[0].ppm - 10.0).abs() < 0.3, "carrier integrator of the frame itself: {}", heard[0].ppm);
    }
    assert_well_treated(&a);
    assert_well_treated(&b);
}

#[test]
fn responses_of_several_anchors_are_heard_from_their_first_symbol_on() {
    // Frames of 27 bytes take 194 µs; 250 µs after one another leave 56 µs to be on again.
    let world = World::new(7, AirConfig::ideal());
    let tag = node_at(&world, 0.0, 0.0);
    for number in 0..5_u8 {
        let mut config = NodeConfig::at([10.0, f64::from(number), 1.0]);
        // Counters that start together: equal instants are equal times.
        config.chip = ChipConfig { clock: ClockConfig::IDEAL, counter: Some(0), ..ChipConfig::default() };
        let mut anchor = driver(world.add_node(config).peripherals(), fast());
        world.spawn(async move {
            anchor.init().await.unwrap();
            for round in 0..4 {
                let at = us(30_000 + 250 * (5 * round + u32::from(number)));
                let at = RadioInstant::from_ticks(0).plus(at);
                anchor.transmit(&[number; 25], Start::At(at), false).await.unwrap();
            }
        });
    }
    let mut radio = driver(tag.peripherals(), fast());
    let (heard, ()) = run(
        &world,
        async move {
            radio.init().await.unwrap();
            let mut buffer = [0; MAX_FRAME];
            let mut heard = Vec::new();
            while let Ok(frame) = radio.receive(&mut buffer, Start::Now, us(50_000), true).await {
                heard.push((frame.bytes[0], frame.diagnostics.preamble_count));
            }
            heard
        },
        async {},
    );
    assert_eq!(heard.iter().map(|h| h.0).collect::<Vec<_>>(), [0, 1, 2, 3, 4].repeat(4));
    // The first was heard with the receiver long on; nobody with a symbol less.
    assert!(heard.iter().all(|h| h.1 == heard[0].1), "{heard:?}");
    assert_well_treated(&tag);
}

#[test]
fn a_late_transmission_is_told_and_the_next_one_goes_out() {
    let (world, a, b) = two_nodes(0.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let clock = a.peripherals().delay;
    let (_, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            clock.pause_ms(20).await;
            // The preamble should have begun 139 µs before the RMARKER.
            for span in [-1_000_000_000, 0, us(100).ticks()] {
                let at = soon(&mut sender, RadioDuration::from_ticks(span)).await;
                let late = sender.transmit(b"late", Start::At(at), true).await;
                assert_eq!(late, Err(TransmitError::Late), "{span}");
            }
            let at = soon(&mut sender, us(400)).await;
            sender.transmit(b"in time", Start::At(at), false).await.unwrap();
        },
        async move {
            receiver.init().await.unwrap();
            let first = hear(&mut receiver, Start::Now, us(60_000), true).await;
            (first, hear(&mut receiver, Start::Now, us(10_000), false).await)
        },
    );
    assert_eq!(heard.0.map(|h| h.bytes), Ok(b"in time".to_vec()));
    assert_eq!(heard.1, Err(ReceiveError::Timeout));
    assert_well_treated(&a);
}

#[test]
fn windows_are_kept() {
    let (world, a, b) = two_nodes(0.0);
    let mut radio = driver(a.peripherals(), fast());
    run(
        &world,
        async move {
            radio.init().await.unwrap();
            // By the chip's timer, by the delay alone, delayed, and with a receiver that is on already.
            for window in [us(300), us(5_000), us(66_000), us(200_000)] {
                let begin = radio.now().await.unwrap();
                assert_eq!(hear(&mut radio, Start::Now, window, true).await, Err(ReceiveError::Timeout));
                let took = radio.now().await.unwrap().since(begin).as_micros() - window.as_micros();
                assert!((0..300).contains(&took), "{window:?}: {took} µs more");
            }
            let begin = soon(&mut radio, us(3_000)).await;
            assert_eq!(hear(&mut radio, Start::At(begin), us(2_000), false).await, Err(ReceiveError::Timeout));
            let took = radio.now().await.unwrap().since(begin).as_micros();
            assert!((2_000..2_300).contains(&took), "{took}");
            radio.transmit(b"?", Start::Now, true).await.unwrap();
            let begin = radio.now().await.unwrap();
            assert_eq!(hear(&mut radio, Start::Now, us(2_000), false).await, Err(ReceiveError::Timeout));
            let took = radio.now().await.unwrap().since(begin).as_micros();
            assert!((2_000..2_300).contains(&took), "{took}");
            // Late.
            let past = soon(&mut radio, us(0)).await;
            assert_eq!(hear(&mut radio, Start::At(past), us(2_000), false).await, Err(ReceiveError::Late));
        },
        async {},
    );
    assert_well_treated(&a);
    drop(b);
}

#[test]
fn a_delayed_receiver_is_deaf_before_its_time() {
    let (world, a, b) = two_nodes(0.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let clock = a.peripherals().delay;
    let (_, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            for millis in [30, 20] {
                clock.pause_ms(millis).await;
                sender.transmit(&[millis as u8], Start::Now, false).await.unwrap();
            }
        },
        async move {
            receiver.init().await.unwrap();
            let start = Start::At(soon(&mut receiver, us(40_000)).await);
            hear(&mut receiver, start, us(30_000), false).await
        },
    );
    assert_eq!(heard.map(|h| h.bytes), Ok(vec![20]));
}

#[test]
fn the_filter_lets_its_own_through_and_the_window_stays_open() {
    let (world, a, b) = two_nodes(0.0);
    let filtered =
        Config { pan: 0xDECA, short_address: 0x0001, filter: FrameFilter::DATA.and(FrameFilter::TYPE_5), ..fast() };
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), filtered));
    let clock = a.peripherals().delay;
    // Data frames: frame control, sequence, PAN, destination, source, payload; and a blink.
    let data = |destination: u16, pan: u16, mark: u8| {
        let ([d0, d1], [p0, p1]) = (destination.to_le_bytes(), pan.to_le_bytes());
        vec![0x41, 0x88, mark, p0, p1, d0, d1, 0x09, 0x00, mark]
    };
    let frames = [
        data(0x0002, 0xDECA, 1),
        data(0x0001, 0xBEEF, 2),
        data(0x0001, 0xDECA, 3),
        data(0x0002, 0xDECA, 4),
        data(0xFFFF, 0xDECA, 5),
        vec![0xC5, 6, 1, 2, 3, 4, 5, 6, 7, 8],
        data(0x0042, 0xDECA, 7),
        data(0x0042, 0xDECA, 8),
    ];
    let (_, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            let mut at = soon(&mut sender, us(20_000)).await;
            for frame in frames {
                sender.transmit(&frame, Start::At(at), false).await.unwrap();
                at = at.plus(us(2_000));
            }
        },
        async move {
            receiver.init().await.unwrap();
            let mut marks = Vec::new();
            for expected in 0..4 {
                marks.push(hear(&mut receiver, Start::Now, us(60_000), true).await.map(|h| h.bytes[2]));
                if expected == 2 {
                    // It has joined and has another address; frame 7 passes by.
                    clock.pause_ms(3).await;
                    receiver.set_address(0xDECA, 0x0042).await.unwrap();
                }
            }
            marks
        },
    );
    // A blink's byte after its sequence number is the first of its address.
    assert_eq!(heard, [Ok(3), Ok(5), Ok(1), Ok(8)]);
    assert_well_treated(&b);
}

#[test]
fn collisions_are_told_and_the_next_stamp_is_right() {
    let world = World::new(3, AirConfig::ideal());
    let (left, middle, right) = (node_at(&world, -10.0, 0.0), node_at(&world, 0.0, 0.0), node_at(&world, 10.0, 0.0));
    let (mut one, mut two) = (driver(left.peripherals(), fast()), driver(right.peripherals(), fast()));
    let mut receiver = driver(middle.peripherals(), fast());
    world.spawn(async move {
        two.init().await.unwrap();
        // Every 5 ms against every 5.107 ms: each meets the other at some time.
        let mut at = soon(&mut two, us(32_000)).await;
        for _ in 0..50 {
            two.transmit(&[2; 100], Start::At(at), false).await.unwrap();
            at = at.plus(us(5_000));
        }
    });
    let (sent, heard) = run(
        &world,
        async move {
            one.init().await.unwrap();
            let mut at = soon(&mut one, us(30_000)).await;
            let mut sent = Vec::new();
            for _ in 0..40 {
                sent.push(one.transmit(&[1; 60], Start::At(at), false).await.unwrap());
                at = at.plus(us(5_107));
            }
            sent
        },
        async move {
            receiver.init().await.unwrap();
            let mut heard = Vec::new();
            loop {
                match hear(&mut receiver, Start::Now, us(50_000), true).await {
                    Err(ReceiveError::Timeout) => return heard,
                    other => heard.push(other),
                }
            }
        },
    );
    let corrupt = heard.iter().filter(|h| **h == Err(ReceiveError::Corrupt)).count();
    assert!(corrupt > 0, "frames met");
    // Every frame that came through has the stamp that its sender's clock says, up to one offset between the clocks.
    let ones: Vec<_> = heard.iter().flatten().filter(|h| h.bytes[0] == 1).collect();
    assert!(ones.len() >= 20, "{}", ones.len());
    let mut offset = None;
    for frame in ones {
        let since = |t: &RadioInstant| frame.rx_time.since(*t).ticks();
        let offsets: Vec<_> = sent.iter().map(since).collect();
        let reference = *offset.get_or_insert(offsets[0]);
        // The first frame is clear of collisions, so the first heard is the first sent.
        let nearest = offsets.iter().map(|o| (o - reference).abs()).min().unwrap();
        // Clocks without drift: a tick of rounding at each end.
        assert!(nearest <= 2, "a stamp is {nearest} ticks off");
    }
    assert_well_treated(&middle);
}

#[test]
fn abandoned_operations_leave_a_radio_that_works() {
    let (world, a, b) = two_nodes(0.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let clock = a.peripherals().delay;
    let other_clock = clock.clone();
    let (_, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            clock.pause_ms(20).await;
            for number in 0..200_u8 {
                sender.transmit(&[number; 20], Start::Now, false).await.unwrap();
                clock.pause_ms(1).await;
            }
        },
        async move {
            receiver.init().await.unwrap();
            other_clock.pause_ms(20).await;
            let mut heard = 0;
            // Receptions dropped anywhere, after times that drift through the frames.
            for round in 0..150_u64 {
                let mut buffer = [0; MAX_FRAME];
                let attempt = receiver.receive(&mut buffer, Start::Now, us(5_000), round % 2 == 0);
                let limit = other_clock.pause(Duration::from_micros(50 + round * 13));
                if let embassy_futures::select::Either::First(frame) =
                    embassy_futures::select::select(attempt, limit).await
                {
                    frame.unwrap();
                    heard += 1;
                }
            }
            let last = hear(&mut receiver, Start::Now, us(5_000), false).await;
            (heard, last.map(|h| h.bytes.len()))
        },
    );
    assert!(heard.0 > 20, "{}", heard.0);
    assert_eq!(heard.1, Ok(20));
    assert_well_treated(&a);
}

#[test]
fn sleep_keeps_the_configuration_and_waking_restores_the_rest() {
    for wake in [Wake::Outside(WakeBy::ChipSelect), Wake::Counter { counter: 1, or: WakeBy::ChipSelect }] {
        let (world, a, b) = two_nodes(0.0);
        let config = Config { tx_antenna_delay: 16_400, ..fast() };
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
                let first = hear(&mut receiver, Start::Now, us(2_000_000), true).await.map(|h| h.bytes);
                (first, hear(&mut receiver, Start::Now, us(10_000), false).await.map(|h| h.bytes))
            },
        );
        assert_eq!(heard, (Ok(b"awake".to_vec()), Ok(b"awake".to_vec())));
        // The departures count the antenna delay: 16400 after a multiple of 512, told and read.
        assert_eq!(stamps.1, stamps.0.snapped().plus(RadioDuration::from_ticks(16_400)));
        assert_eq!((stamps.2.ticks() - 16_400) % 512, 0);
    }
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
            // Its supply fails while it listens, and comes back: nothing hangs.
            let failing = node.clone();
            world_again.at(world_again.now() + Duration::from_millis(5), move |_| failing.power_off());
            assert!(hear(&mut radio, Start::Now, us(20_000), false).await.is_err());
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
            // The processor restarts and knows nothing.
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
            let heard = hear(&mut receiver, Start::Now, us(60_000), false).await.unwrap();
            let mut window = [Sample::default(); 64];
            let start = receiver.impulse_response(heard.first_path_index, 16, &mut window).await.unwrap();
            assert_eq!(start, heard.first_path_index as u16 - 16);
            assert!(heard.first_path_power_dbm <= heard.rx_power_dbm);
            window
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
            let seen = warm.sensors().await.unwrap();
            // Steps of 1.14 °C and 5.8 mV.
            assert!((seen.temperature_celsius - 41.0).abs() < 0.6 && (seen.voltage - 3.0).abs() < 0.003, "{seen:?}");
        },
        async move {
            cold.init().await.unwrap();
        },
    );
    // The maker's trim of 5 pulls by 20 ppm in this simulation; none is the middle, a step of 1.6 ppm from zero.
    assert!((b.chip().clock_ppm(world.now()) - 20.0).abs() < 0.5);
    assert!(a.chip().clock_ppm(world.now()).abs() < 2.5);
}

#[test]
fn power_can_be_calibrated() {
    let heard_at = |tx_power| {
        let (_, response, ..) = ranged(Config { tx_power, ..fast() }, 0.0, us(500));
        response.rx_power_dbm
    };
    let smart = heard_at(TxPower::Smart);
    let constant = heard_at(TxPower::Constant);
    assert!(smart > constant + 1.0, "short frames are boosted: {smart} against {constant}");
    // 0x85 without smart power is what channel 5 has anyway.
    assert_eq!(heard_at(TxPower::Calibrated { register: 0x8585_8585, smart: false }), constant);
}
