//! Tests of the world as test code uses it: which code may run it, and what may be read meanwhile.

use crate::host::*;
use dw1000_sim::air::Prf;
use dw1000_sim::air::{AirClient, ReceptionEvent, RxSettings, Sfd, SfdKind};
use dw1000_sim::{NodeConfig, Path, TrueTime, World};
use embedded_hal_async::spi::{Operation, SpiDevice};
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

fn identifier(world: &World, spi: &mut dw1000_sim::SimSpi) -> u32 {
    let mut id = [0; 4];
    let mut operations = [Operation::Write(&[0x00]), Operation::Read(&mut id)];
    world.block_on(spi.transaction(&mut operations)).expect("it ends").expect("and cannot fail");
    u32::from_le_bytes(id)
}

#[test]
fn blocking_code_in_an_action_leaves_the_running_world_its_end() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    // A task that never ends.
    let delay = host.node.peripherals().delay;
    world.spawn(async move {
        loop {
            delay.pause_ms(1).await;
        }
    });
    let seen = Rc::new(Cell::new(0));
    let (id, node) = (seen.clone(), host.node.clone());
    world.at(TrueTime::from_micros(7_000), move |w| id.set(identifier(w, &mut node.peripherals().spi)));
    world.run_until(TrueTime::from_micros(10_000));
    assert_eq!(seen.get(), 0xDECA_0130);
    assert_eq!(world.now(), TrueTime::from_micros(10_000));
}

#[test]
#[should_panic(
    expected = "World::block_on inside a task or an AirClient, for which the world waits: await there instead"
)]
fn blocking_code_in_a_nodes_firmware_is_refused_in_words() {
    let world = World::new(1, quiet());
    let node = world.add_node(NodeConfig::at([0.0; 3]));
    let inner = world.clone();
    node.boot(move |mut p| {
        let world = inner.clone();
        async move {
            identifier(&world, &mut p.spi);
        }
    });
    world.run_for(Duration::from_millis(10));
}

#[test]
#[should_panic(expected = "World::run_until inside a task or an AirClient")]
fn running_the_world_from_a_task_is_refused_in_words() {
    let world = World::new(1, quiet());
    let inner = world.clone();
    world.spawn(async move { inner.run_for(Duration::from_millis(1)) });
    world.run_for(Duration::from_millis(10));
}

struct Client;

impl AirClient for Client {
    fn on_air(&mut self, world: &World, _: TrueTime, _: ReceptionEvent) {
        world.run_for(Duration::from_millis(1));
    }
}

#[test]
#[should_panic(expected = "World::run_until inside a task or an AirClient")]
fn running_the_world_from_an_air_client_is_refused_in_words() {
    let world = World::new(1, quiet());
    let (port, _client) = world.add_client(Path::Fixed([1.0, 0.0, 0.0]), |_| Rc::new(RefCell::new(Client)));
    let host = ready(&world, 0.0, chip(0));
    let sfd = Sfd { kind: SfdKind::Ieee, symbols: 8 };
    let settings = RxSettings {
        channel: 5,
        code: 4,
        prf: Prf::Mhz16,
        sfd,
        slow: false,
        long_frames: false,
        pac: 8,
        sfd_timeout: 4161,
    };
    world.listen(port, settings);
    host.send(&[1, 2, 3]);
}

#[test]
fn a_sniffer_may_look_at_air_and_chips_and_let_blocking_code_run() {
    let world = World::new(1, quiet());
    let (a, b) = (ready(&world, 0.0, chip(0)), ready(&world, 3.0, chip(0)));
    let seen = Rc::new(RefCell::new(Vec::new()));
    let (log, inner, sender, other) = (seen.clone(), world.clone(), a.node.clone(), b.node.clone());
    world.sniff(move |frame| {
        let sent = inner.air().statistics().frames_sent;
        let counter = sender.chip().counter(inner.now());
        let id = identifier(&inner, &mut other.peripherals().spi);
        log.borrow_mut().push((frame.bytes[0], sent, counter > 0, id));
    });
    a.send(&[1, 1, 1]);
    a.send(&[2, 2, 2]);
    assert_eq!(*seen.borrow(), [(1, 1, true, 0xDECA_0130), (2, 2, true, 0xDECA_0130)]);
}

#[test]
fn frames_sent_while_a_sniffer_lets_the_world_run_are_seen_after() {
    let world = World::new(1, quiet());
    let (a, b) = (ready(&world, 0.0, chip(0)), ready(&world, 3.0, chip(0)));
    b.prepare(&[2, 2, 2]);
    let seen = Rc::new(RefCell::new(Vec::new()));
    let (log, inner) = (seen.clone(), world.clone());
    world.sniff(move |frame| {
        log.borrow_mut().push(frame.bytes[0]);
        if frame.bytes[0] == 1 {
            b.command(TXSTRT);
            inner.run_for(Duration::from_millis(1));
        }
    });
    a.send(&[1, 1, 1]);
    assert_eq!(*seen.borrow(), [1, 2]);
}

#[test]
fn all_peripherals_of_a_node_share_its_bus_clock_which_a_restart_resets() {
    let world = World::new(1, quiet());
    let node = world.add_node(NodeConfig::at([0.0; 3]));
    let clocks = Rc::new(RefCell::new(Vec::new()));
    let log = clocks.clone();
    node.boot(move |p| {
        log.borrow_mut().push(p.spi.clock().hz());
        async move { p.spi.clock().set_hz(8_000_000) }
    });
    world.run_for(Duration::from_millis(5));
    assert_eq!(node.peripherals().spi.clock().hz(), 8_000_000);
    // Code that has only another handle reads whole words at the first handle's clock.
    assert_eq!(identifier(&world, &mut node.peripherals().spi), 0xDECA_0130);
    node.reset_processor();
    assert_eq!(*clocks.borrow(), [2_000_000, 2_000_000], "the board's own at each start");
}
