//! The Bluetooth scanner on a chip of Espressif, without a DW1000. Everything except the controller and the driver of Wi-Fi
//! runs in the main thread.
#![no_std]
#![no_main]

use baliza_board_esp32::bluetooth::{Parts, Scanner};
use baliza_board_esp32::{Board, supervise};
use embassy_executor::Spawner;
use embassy_futures::join::join;
use embassy_time::Delay;
use firmware_common::node::{Guard, Node, Reporter, TELEMETRY_BYTES, Tasks};
use static_cell::StaticCell;
use wire::config::Record;
use wire::telemetry::{Condition, Role};

type Sightings = firmware_scanner::Sightings<'static, Guard, TELEMETRY_BYTES>;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RECORD: StaticCell<Record> = StaticCell::new();
static SIGHTINGS: StaticCell<Sightings> = StaticCell::new();

#[embassy_executor::task]
async fn scan(parts: Parts, sightings: &'static Sightings) {
    match Scanner::start(parts) {
        Ok(scanner) => {
            let listening = scanner.listen(|heard| sightings.receive(heard.data, heard.rssi));
            join(listening, sightings.run(&scanner, Delay)).await;
        }
        // The watchdog then resets the chip.
        Err(error) => defmt::error!("no Bluetooth: {}", error),
    }
}

/// Spawns all tasks. Without a usable record it only spawns the task that reports this.
fn start(spawner: Spawner) {
    let board = Board::take(spawner);
    let (mut node, configured) = Node::start(&REPORTER, Role::Scanner, board.start);
    if let Some(configured) = configured {
        match configured.record.role {
            wire::config::Role::Scanner => {
                board.care.gateway.set(board.wifi.start(spawner, &configured));
                // The program beats the heartbeat that ranging uses in other roles.
                node.tasks = Tasks::Ranging;
                let record = RECORD.init(configured.record);
                let sightings = SIGHTINGS.init_with(|| Sightings::new(node.reporter, record));
                spawner.spawn(scan(board.bluetooth, sightings).unwrap());
            }
            _ => node.report(Condition::WrongRecord),
        }
    }
    spawner.spawn(supervise(node, board.care).unwrap());
}

baliza_board_esp32::entry!(start);
