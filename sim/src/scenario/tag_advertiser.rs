//! The radio of a board that advertises its tag's positions, on the Bluetooth air. It costs the processor time.

use std::time::Duration;

use firmware_tag::advertise;
use wire::ble::TagPosition;

use super::telemetry::Outlet;
use crate::air::Path;
use crate::bluetooth::{Advertiser, Bluetooth, Sender};
use crate::costs::Costs;
use crate::{Processor, World};

/// RSSI at one metre: a usual value of 0 dBm.
const RSSI_1M_DBM: f64 = -59.0;
/// What a board pauses from the end of an advertisement on a channel to the next.
const HOP: Duration = Duration::from_micros(500);
/// What a board's radio costs for a channel beside two wake-ups: some twenty registers, written and read, instructions.
const CHANNEL_INSTRUCTIONS: u32 = 300;
/// What an advertisement draws, µC: the nRF52832 sends at 0 dBm with 5.3 mA (Product Specification 1.4, 23.15, with its
/// converter) three times 376 µs, and takes 140 µs to start; the crystal, 0.25 mA, runs for 3 ms.
pub(super) const ADVERTISEMENT_UC: f64 = 3.0 * (0.376 + 0.140) * 5.3 + 3.0 * 0.25;
/// Blocks of AES in the code of an advertisement: two, and two for 23 bytes and their length; as many as in a response's.
const BLOCKS: u32 = 4;

/// The radio of one tag.
pub(super) struct TagAdvertiser<'a> {
    radio: Advertiser,
    world: World,
    processor: &'a Processor,
    outlet: &'a Outlet,
}

impl<'a> TagAdvertiser<'a> {
    pub(super) fn new(
        (world, air): (&World, &Bluetooth),
        address: u16,
        path: Path,
        (processor, outlet): (&'a Processor, &'a Outlet),
    ) -> Self {
        let sender = Sender::new(air.medium(), world.seed(), address.into(), path, RSSI_1M_DBM);
        Self { radio: air.advertiser(sender), world: world.clone(), processor, outlet }
    }
}

impl advertise::Advertiser for TagAdvertiser<'_> {
    async fn advertise(&mut self, data: &[u8; TagPosition::BYTES]) {
        let (board, world) = (self.processor.board(), &self.world);
        let costs = Costs::of(board.core);
        self.processor.charge_ns(BLOCKS * board.cipher_block_ns);
        self.processor.charge_background(costs.code.made);
        let before = async || {
            world.sleep_until(world.now() + HOP).await;
            self.processor.background(world, 2 * costs.wake + CHANNEL_INSTRUCTIONS).await;
        };
        self.radio.send_once(data, before).await;
        self.outlet.advertised.update(|count| count + 1);
    }
}
