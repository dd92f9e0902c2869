//! The simulated chip with a driver whose author did not know the simulation: the published `dw1000` crate, unmodified,
//! blocking.

use dw1000::hl::SendTime;
use dw1000::time::{Duration, Instant};
use dw1000::{DW1000, Ready, RxConfig, TxConfig, mac};
use dw1000_sim::{AirConfig, ChipConfig, ClockConfig, Node, NodeConfig, SimSpi, World};
use embedded_hal_02::blocking::delay::{DelayMs, DelayUs};
use embedded_hal_02::blocking::spi::{Transfer, Write};
use embedded_hal_02::digital::v2::OutputPin;
use embedded_hal_async::spi::{Operation, SpiDevice};
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::rc::Rc;

/// embedded-hal 0.2 over the simulated bus. A transfer runs the world until the transfer is over.
struct Bus {
    spi: SimSpi,
    world: World,
    used: Rc<Cell<bool>>,
}

impl Transfer<u8> for Bus {
    type Error = Infallible;

    fn transfer<'w>(&mut self, words: &'w mut [u8]) -> Result<&'w [u8], Infallible> {
        self.used.set(true);
        let _ = self.world.block_on(self.spi.transaction(&mut [Operation::TransferInPlace(words)]));
        Ok(words)
    }
}

impl Write<u8> for Bus {
    type Error = Infallible;

    fn write(&mut self, words: &[u8]) -> Result<(), Infallible> {
        self.used.set(true);
        let _ = self.world.block_on(self.spi.transaction(&mut [Operation::Write(words)]));
        Ok(())
    }
}

/// Chip select. Held low without a transfer, it wakes a sleeping chip.
struct Select {
    spi: SimSpi,
    world: World,
    used: Rc<Cell<bool>>,
    low_since: dw1000_sim::TrueTime,
}

impl OutputPin for Select {
    type Error = Infallible;

    fn set_low(&mut self) -> Result<(), Infallible> {
        self.used.set(false);
        self.low_since = self.world.now();
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        if !self.used.get() {
            let held = (self.world.now() - self.low_since).as_nanos() as u32;
            let _ = self.world.block_on(self.spi.transaction(&mut [Operation::DelayNs(held)]));
        }
        Ok(())
    }
}

struct Wait(World);

impl DelayMs<u8> for Wait {
    fn delay_ms(&mut self, ms: u8) {
        self.0.run_for(std::time::Duration::from_millis(ms.into()));
    }
}

impl DelayUs<u16> for Wait {
    fn delay_us(&mut self, us: u16) {
        self.0.run_for(std::time::Duration::from_micros(us.into()));
    }
}

type Radio = DW1000<Bus, Select, Ready>;

const ANTENNA: u16 = 16_436;

fn node(world: &World, x: f64, counter: u64) -> Node {
    let chip = ChipConfig { clock: ClockConfig::IDEAL, counter: Some(counter), ..ChipConfig::default() };
    world.add_node(NodeConfig { chip, ..NodeConfig::at([x, 0.0, 0.0]) })
}

fn radio(world: &World, node: &Node) -> Radio {
    let used = Rc::new(Cell::new(false));
    let bus = Bus { spi: node.peripherals().spi, world: world.clone(), used: used.clone() };
    let select = Select { spi: node.peripherals().spi, world: world.clone(), used, low_since: world.now() };
    let mut radio = DW1000::new(bus, select).init(&mut Wait(world.clone())).expect("init");
    radio.set_antenna_delay(ANTENNA, ANTENNA).expect("antenna delay");
    radio
}

fn rx() -> RxConfig {
    RxConfig { frame_filtering: false, ..RxConfig::default() }
}

/// Sends from `from` and receives at `to`. Returns both time stamps and the payload.
fn exchange(world: &World, from: Radio, to: Radio, time: SendTime, data: &[u8]) -> (u64, u64, Vec<u8>, Radio, Radio) {
    let mut receiving = to.receive(rx()).expect("receive");
    let mut sending = from.send(data, None, time, TxConfig::default()).expect("send");
    let sent = loop {
        match sending.wait_transmit() {
            Ok(instant) => break instant.value(),
            Err(nb::Error::WouldBlock) => world.run_for(std::time::Duration::from_micros(10)),
            Err(nb::Error::Other(e)) => panic!("{e:?}"),
        }
    };
    let mut buffer = [0; 127];
    let (heard, payload) = loop {
        match receiving.wait_receive(&mut buffer) {
            Ok(message) => break (message.rx_time.value(), message.frame.payload.to_vec()),
            Err(nb::Error::WouldBlock) => world.run_for(std::time::Duration::from_micros(10)),
            Err(nb::Error::Other(e)) => panic!("{e:?}"),
        }
    };
    let from = sending.finish_sending().map_err(|(_, e)| e).expect("finish sending");
    let to = receiving.finish_receiving().map_err(|(_, e)| e).expect("finish receiving");
    (sent, heard, payload, from, to)
}

#[test]
fn sends_receives_and_stamps_to_the_tick() {
    const COUNTERS: (u64, u64) = (0x12_3456_7890, 0xFF_F000_0000);
    let world = World::new(3, AirConfig::ideal());
    let (a, b) = (node(&world, 0.0, COUNTERS.0), node(&world, 30.0, COUNTERS.1));
    world.run_for(std::time::Duration::from_millis(5));
    let (mut radio_a, mut radio_b) = (radio(&world, &a), radio(&world, &b));

    let frames = Rc::new(RefCell::new(Vec::new()));
    let seen = frames.clone();
    world.sniff(move |f| seen.borrow_mut().push(f.bytes.to_vec()));

    for round in 0..3u8 {
        let delayed =
            Instant::new((radio_a.sys_time().unwrap().value() + 10 * 63_897_600 + 321) & 0xFF_FFFF_FFFF).unwrap();
        let time = if round == 0 { SendTime::Now } else { SendTime::Delayed(delayed) };
        let (sent, heard, payload, back_a, back_b) = exchange(&world, radio_a, radio_b, time, &[round, 42, 7]);
        assert_eq!(payload, [round, 42, 7]);
        if round > 0 {
            // The low nine bits are ignored, and the antenna delay is added.
            assert_eq!(sent, ((delayed.value() & !511) + u64::from(ANTENNA)) & 0xFF_FFFF_FFFF);
        }
        // The counters differ by their initial counts, and the frame takes 30 m / 299 704 645 m/s × 63.8976 GHz =
        // 6396.06 ticks.
        let apart = COUNTERS.1.wrapping_sub(COUNTERS.0);
        let flight = heard.wrapping_sub(sent).wrapping_sub(apart) & 0xFF_FFFF_FFFF;
        assert!((6395..=6397).contains(&flight), "{flight}");
        (radio_a, radio_b) = (back_a, back_b);
    }
    // The sequence numbers on the air count up. The MAC parser has accepted the frames above.
    let frames = frames.borrow();
    assert_eq!(frames.iter().map(|f| f[2]).collect::<Vec<_>>(), [0, 1, 2]);
    let (sender, receiver) = (a.chip_statistics(), b.chip_statistics());
    assert_eq!((sender.too_fast, receiver.too_fast), (0, 0));
    assert_eq!(sender.mistuned, 0);
    // At each of the three receptions, the crate has set LDE_REPC for the preamble code after the one in use: 0x451E
    // for code 4, for which table 51 of the user manual has 0x428E.
    assert_eq!(receiver.mistuned, 3);
    assert!(b.chip().mistuned().contains(&"LDE_REPC"));
}

#[test]
fn late_transmission_is_reported() {
    let world = World::new(3, AirConfig::ideal());
    let a = node(&world, 0.0, 99);
    world.run_for(std::time::Duration::from_millis(5));
    let mut radio = radio(&world, &a);
    let past = Instant::new(radio.sys_time().unwrap().value()).unwrap();
    let mut sending = radio.send(b"late", None, SendTime::Delayed(past), TxConfig::default()).unwrap();
    let outcome = sending.wait_transmit();
    assert!(matches!(outcome, Err(nb::Error::Other(dw1000::Error::DelayedSendTooLate))), "{outcome:?}");
}

#[test]
fn frame_filter_keeps_strangers_out() {
    let world = World::new(4, AirConfig::ideal());
    let (a, b) = (node(&world, 0.0, 1), node(&world, 5.0, 2));
    world.run_for(std::time::Duration::from_millis(5));
    let (mut sender, mut receiver) = (radio(&world, &a), radio(&world, &b));
    sender.set_address(mac::PanId(0xDECA), mac::ShortAddress(1)).unwrap();
    receiver.set_address(mac::PanId(0xDECA), mac::ShortAddress(2)).unwrap();
    for (to, passes) in [(2, true), (3, false), (0xFFFF, true)] {
        let mut receiving = receiver.receive(RxConfig::default()).unwrap();
        let address = mac::Address::Short(mac::PanId(0xDECA), mac::ShortAddress(to));
        let mut sending = sender.send(b"hello", Some(address), SendTime::Now, TxConfig::default()).unwrap();
        world.run_for(std::time::Duration::from_millis(1));
        sending.wait_transmit().unwrap();
        let mut buffer = [0; 127];
        match receiving.wait_receive(&mut buffer) {
            Ok(message) => assert!(passes && message.frame.payload == b"hello", "{to}"),
            Err(nb::Error::Other(dw1000::Error::FrameFilteringRejection)) => assert!(!passes, "{to}"),
            Err(other) => panic!("{other:?}"),
        }
        sender = sending.finish_sending().map_err(|(_, e)| e).unwrap();
        receiver = receiving.finish_receiving().map_err(|(_, e)| e).unwrap();
    }
}

#[test]
fn quality_and_power_read_as_sent() {
    let world = World::new(5, AirConfig { scatter_db: -40.0, ..AirConfig::ideal() });
    let (a, b) = (node(&world, 0.0, 1), node(&world, 20.0, 2));
    world.run_for(std::time::Duration::from_millis(5));
    let (sender, receiver) = (radio(&world, &a), radio(&world, &b));
    let mut receiving = receiver.receive(rx()).unwrap();
    let mut sending = sender.send(b"quality", None, SendTime::Now, TxConfig::default()).unwrap();
    world.run_for(std::time::Duration::from_millis(1));
    sending.wait_transmit().unwrap();
    receiving.wait_receive(&mut [0; 127]).unwrap();
    let quality = receiving.read_rx_quality().unwrap();
    // The crate sets TX_POWER 0x0E082848. The frame takes 175 µs, so BOOSTP250 applies: 6 dB above −14.3 dBm. Friis
    // over 20 m at 6.4896 GHz takes 74.71 dB, so −83.01 dBm arrive. In figure 22 at PRF 16, −85 reads −87.5 and −77
    // reads −85, hence −86.88 dBm.
    assert!((quality.rssi + 86.88).abs() < 0.2, "{}", quality.rssi);
    assert_eq!(quality.los_confidence_level, 1.0);
}

#[test]
fn sleeps_wakes_and_sends_again() {
    let world = World::new(6, AirConfig::ideal());
    let (a, b) = (node(&world, 0.0, 1), node(&world, 5.0, 2));
    world.run_for(std::time::Duration::from_millis(5));
    let (sender, receiver) = (radio(&world, &a), radio(&world, &b));
    let asleep = sender.enter_sleep(false, None).unwrap();
    world.run_for(std::time::Duration::from_millis(50));
    let mut awake = asleep.wake_up(&mut Wait(world.clone())).unwrap();
    assert_eq!(awake.get_tx_antenna_delay().unwrap(), Duration::new(ANTENNA.into()).unwrap());
    assert_eq!(awake.get_rx_antenna_delay().unwrap(), Duration::new(ANTENNA.into()).unwrap());
    let (_, _, payload, _, _) = exchange(&world, awake, receiver, SendTime::Now, b"up");
    assert_eq!(payload, b"up");
}
