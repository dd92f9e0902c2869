//! Sends Bluetooth advertisements by the radio of the nRF52832, without a controller: a packet on each of the three
//! advertising channels, which nobody can connect to (ADV_NONCONN_IND; Bluetooth Core 5.4, volume 6, part B, 2.3.1.3). A
//! controller takes 90 KiB of flash, and the crystal for itself.
//!
//! The radio whitens the packet and adds its check; registers as in the nRF52832 Product Specification 1.4, 23.

use core::sync::atomic::{Ordering, compiler_fence};

use embassy_nrf::pac::{FICR, RADIO, radio::vals};
use embassy_nrf::{Peri, peripherals};
use embassy_time::{Duration, Timer};
use wire::ble::TagPosition;

use crate::delay::Crystal;

/// The advertising channels: number, and frequency above 2400 MHz.
const CHANNELS: [(u8, u8); 3] = [(37, 2), (38, 26), (39, 80)];
/// The access address of advertisements.
const ACCESS: u32 = 0x8E89_BED6;
/// The packet is ADV_NONCONN_IND, from a random address.
const KIND: u8 = 0x42;
const ADDRESS_BYTES: usize = 6;
/// The greatest length of what follows the header of two bytes.
const PAYLOAD_BYTES: usize = ADDRESS_BYTES + TagPosition::BYTES;
/// The start of the radio takes 140 µs, the 47 bytes of a packet 376 µs.
const ON_AIR: Duration = Duration::from_micros(600);

/// The chip's own radio.
pub struct Advertiser {
    packet: [u8; 2 + PAYLOAD_BYTES],
}

impl Advertiser {
    /// Sets the radio up.
    #[cold]
    pub fn new(_radio: Peri<'static, peripherals::RADIO>) -> Self {
        RADIO.mode().write(|w| w.set_mode(vals::Mode::Ble1mbit));
        RADIO.txpower().write(|w| w.set_txpower(vals::Txpower::_0dBm));
        RADIO.base0().write_value(ACCESS << 8);
        RADIO.prefix0().write(|w| w.set_ap0((ACCESS >> 24) as u8));
        RADIO.txaddress().write(|w| w.set_txaddress(0));
        RADIO.pcnf0().write(|w| {
            w.set_s0len(true);
            w.set_lflen(8);
        });
        RADIO.pcnf1().write(|w| {
            w.set_maxlen(PAYLOAD_BYTES as u8);
            w.set_balen(3);
            w.set_endian(vals::Endian::Little);
            w.set_whiteen(true);
        });
        RADIO.crccnf().write(|w| {
            w.set_len(vals::Len::Three);
            w.set_skipaddr(vals::Skipaddr::Skip);
        });
        RADIO.crcpoly().write(|w| w.set_crcpoly(0x65B));
        RADIO.crcinit().write(|w| w.set_crcinit(0x55_5555));
        RADIO.shorts().write(|w| {
            w.set_ready_start(true);
            w.set_end_disable(true);
        });
        let mut packet = [0; 2 + PAYLOAD_BYTES];
        let [kind, length, address @ ..] = &mut packet;
        (*kind, *length) = (KIND, PAYLOAD_BYTES as u8);
        let [a, b, c, d] = FICR.deviceaddr(0).read().to_le_bytes();
        let [e, f, ..] = FICR.deviceaddr(1).read().to_le_bytes();
        // The two highest bits are ones in a static random address.
        address[..ADDRESS_BYTES].copy_from_slice(&[a, b, c, d, e, f | 0xC0]);
        Self { packet }
    }

    /// Starts a transmission. The radio reads the packet until it is disabled again. The packet stays where it is: the task is
    /// never dropped.
    #[cold]
    fn begin(&mut self, (number, above_2400_mhz): (u8, u8)) {
        RADIO.frequency().write(|w| w.set_frequency(above_2400_mhz));
        RADIO.datawhiteiv().write(|w| w.set_datawhiteiv(0x40 | number));
        RADIO.packetptr().write_value(&raw const self.packet as u32);
        RADIO.events_disabled().write_value(0);
        compiler_fence(Ordering::SeqCst);
        RADIO.tasks_txen().write_value(1);
    }
}

impl firmware_tag::advertise::Advertiser for Advertiser {
    async fn advertise(&mut self, data: &[u8; TagPosition::BYTES]) {
        self.packet[2 + ADDRESS_BYTES..].copy_from_slice(data);
        let _crystal = Crystal::hold().await;
        for channel in CHANNELS {
            self.begin(channel);
            while RADIO.events_disabled().read() == 0 {
                Timer::after(ON_AIR).await;
            }
            compiler_fence(Ordering::SeqCst);
        }
    }
}
