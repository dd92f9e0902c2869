//! Derives the advertisement from the config record. It uses no clock and no chip.

use core::fmt;

use wire::ble::{Fresh, IBeacon, LENGTH, RotatingId};
use wire::config::{Record, Role};

/// The number of random bytes for one advertisement.
pub const RANDOM_BYTES: usize = 14;

/// The bounds of the interval in the standard for advertising that is neither connectable nor scannable, milliseconds
/// (Bluetooth Core 5.4, volume 4, part E, 7.8.5).
const SHORTEST_INTERVAL_MS: u16 = 20;
const LONGEST_INTERVAL_MS: u16 = 10_240;

/// Why a record gives no beacon settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingsError {
    /// The record is for another role.
    OtherRole,
    /// This interval, milliseconds, is not from 20 to 10,240.
    Interval(u16),
    /// These bits name no channel, or a channel beyond the three.
    Channels(u8),
    /// The record asks for rotating identifiers, and has no key for them.
    NoKey,
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OtherRole => f.write_str("the record is for another role"),
            Self::Interval(ms) => {
                write!(f, "the interval of {ms} ms is not from {SHORTEST_INTERVAL_MS} to {LONGEST_INTERVAL_MS} ms")
            }
            Self::Channels(bits) => write!(f, "the channels {bits:#05b} are not some of 0b111"),
            Self::NoKey => f.write_str("identities rotate only with a beacon key"),
        }
    }
}

/// Some of the channels 37, 38 and 39: bits 0, 1, 2. At least one bit is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Channels(u8);

impl Channels {
    /// From the bits in the record. `None` if they are not valid.
    pub fn new(bits: u8) -> Option<Self> {
        (1..=0b111).contains(&bits).then_some(Self(bits))
    }

    /// Channels 37, 38, 39 as bits 0, 1, 2.
    pub fn bits(self) -> u8 {
        self.0
    }
}

/// What the controller is configured to advertise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Advertisement {
    /// Advertising data.
    pub data: [u8; LENGTH],
    /// The random address of the sender, in the order on the air: the lowest byte first.
    pub address: [u8; 6],
    /// The interval from one advertisement to the next, milliseconds.
    pub interval_ms: u16,
    /// The channels for advertising.
    pub channels: Channels,
    /// The requested transmit power, dBm.
    pub tx_power_dbm: i8,
}

/// The checked settings of a beacon.
pub struct Settings {
    beacon: IBeacon,
    rotation: Option<Rotation>,
    /// A random static address, derived from the chip's address.
    address: [u8; 6],
    interval_ms: u16,
    channels: Channels,
    tx_power_dbm: i8,
}

struct Rotation {
    rotating_id: RotatingId,
    period_ms: u32,
}

impl Settings {
    /// The settings of a record. `chip_address` is the chip's own address of 48 bits, the highest byte first.
    ///
    /// # Errors
    /// The record is for another role, its interval or its channels are not valid, or it has no key for its rotation.
    pub fn of(record: &Record, chip_address: [u8; 6]) -> Result<Self, SettingsError> {
        let advertiser = match record.role {
            Role::Advertiser(advertiser) => advertiser,
            Role::Tag(_) | Role::Anchor { .. } | Role::Scanner => return Err(SettingsError::OtherRole),
        };
        if !(SHORTEST_INTERVAL_MS..=LONGEST_INTERVAL_MS).contains(&advertiser.interval_ms) {
            return Err(SettingsError::Interval(advertiser.interval_ms));
        }
        let rotation = match (advertiser.rotate_s, &record.beacon_key) {
            (0, _) => None,
            (_, None) => return Err(SettingsError::NoKey),
            (seconds, Some(key)) => {
                Some(Rotation { rotating_id: RotatingId::new(key), period_ms: 1000 * u32::from(seconds) })
            }
        };
        Ok(Self {
            beacon: IBeacon {
                uuid: advertiser.uuid,
                major: advertiser.major,
                minor: advertiser.minor,
                measured_power_dbm: advertiser.measured_power_dbm,
            },
            rotation,
            address: static_address(chip_address),
            interval_ms: advertiser.interval_ms,
            channels: Channels::new(advertiser.channels).ok_or(SettingsError::Channels(advertiser.channels))?,
            tx_power_dbm: advertiser.tx_power_dbm,
        })
    }

    /// The requested transmit power, dBm.
    pub fn tx_power_dbm(&self) -> i8 {
        self.tx_power_dbm
    }

    /// How long an advertisement is used, milliseconds. `None` means for ever.
    pub fn rotation_ms(&self) -> Option<u32> {
        self.rotation.as_ref().map(|rotation| rotation.period_ms)
    }

    /// The next advertisement. Without rotation it is always the same.
    pub fn advertisement(&self, random: &[u8; RANDOM_BYTES]) -> Advertisement {
        let &[a, b, c, d, e, f, g, h, ref address @ ..] = random;
        let (beacon, address) = match &self.rotation {
            Some(rotation) => (
                rotation.rotating_id.rotate(&self.beacon, Fresh::new([a, b, c, d, e, f, g, h])),
                non_resolvable_address(*address),
            ),
            None => (self.beacon, self.address),
        };
        Advertisement {
            data: beacon.emit(),
            address,
            interval_ms: self.interval_ms,
            channels: self.channels,
            tx_power_dbm: self.tx_power_dbm,
        }
    }
}

/// A random static address: the two highest bits are ones (Bluetooth Core 5.4, volume 6, part B, 1.3.2.1). The chip's
/// own address need not be registered as a Bluetooth address.
/// address need not be registered as a Bluetooth one.
fn static_address(chip: [u8; 6]) -> [u8; 6] {
    let [a, b, c, d, e, f] = chip;
    [f, e, d, c, b, a | 0xC0]
}

/// A non-resolvable private address: the two highest bits are zeros. The others are neither all zeros nor all ones (the
/// same, 1.3.2.2).
/// 1.3.2.2).
fn non_resolvable_address(random: [u8; 6]) -> [u8; 6] {
    let [a, b, c, d, e, f] = random;
    let address = [a, b, c, d, e, f & 0x3F];
    match address {
        [0, 0, 0, 0, 0, 0] | [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x3F] => [1, 0, 0, 0, 0, 0],
        other => other,
    }
}
