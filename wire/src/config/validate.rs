//! Checks that a node can work with a config record; and converts its parts to the types of the other crates.

use core::fmt;

use radio::phy::{Channel, DataRate, PhyError, PreambleLength, Prf};
use radio::{Capabilities, PhyConfig, Unsupported};

use crate::config::{
    Advertiser, Board, Identity, Mode, Network, Pins, PollContent, Record, Role, Scan, Solver, Tag, TagArea,
};
use crate::uwb::MAX_ROUND;

/// The deviations of a height that is known, metres. Beyond, positions in space are better.
const HEIGHT_SIGMAS_M: core::ops::RangeInclusive<f32> = 0.01..=1.0;
/// The greatest distance of anything from the origin, metres.
const FARTHEST_M: f32 = 100_000.0;
/// The greatest distance from the origin of an anchor that sends its position on the air, metres: three bytes of
/// millimetres.
const FARTHEST_ON_AIR_M: f32 = 8_388.0;
/// The longest delay of a board, microseconds: so superframes stay shorter than two seconds.
const SLOWEST_US: u16 = 20_000;
/// Rounds a second, 0.01 Hz, and the same range as text.
struct Rates(core::ops::RangeInclusive<u32>, &'static str);
/// In native mode, in which tags count superframes.
const NATIVE_RATES: Rates = Rates(1..=MAX_RATE_CHZ, "0.01 to 1000");
/// The highest rate of a tag, rounds in 100 s.
pub const MAX_RATE_CHZ: u32 = 100_000;
/// Of a tag that blinks: once a superframe at most.
const BLINK_RATES: Rates = Rates(1..=1_000, "0.01 to 10");
/// In other modes: the radio's clock can order instants that are less than 8.6 s apart.
const OTHER_RATES: Rates = Rates(13..=100_000, "0.13 to 1000");
/// The first reserved short address: it means no node, and the next one means all nodes.
const NO_ADDRESS: u16 = 0xFFFE;

/// A field with an invalid value.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Invalid {
    /// The list that contains the field's owner, and its index from 0.
    pub within: Option<(&'static str, u8)>,
    /// The path of the field in the record or in the list's element, with dots; empty text on a node.
    pub field: &'static str,
    /// Its value.
    pub value: Value,
    /// The valid values; empty text on a node.
    pub must: &'static str,
}

/// The value of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Value {
    /// A number, or a Boolean as 0 or 1.
    Integer(u64),
    /// An address.
    Hexadecimal(u64),
    /// A number with a fraction.
    Real(f32),
    /// An entry of a list of names; empty on a node.
    Word(&'static str),
    /// Nothing.
    Absent,
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((list, place)) = self.within {
            write!(f, "{list}[{place}].")?;
        }
        write!(f, "{} is {}: it must be {}", self.field, self.value, self.must)
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Integer(value) => write!(f, "{value}"),
            Self::Hexadecimal(value) => write!(f, "0x{value:04X}"),
            Self::Real(value) => write!(f, "{value}"),
            Self::Word(word) => f.write_str(word),
            Self::Absent => f.write_str("absent"),
        }
    }
}

impl core::error::Error for Invalid {}

/// Inlined, so that no text is left on a node.
#[inline(always)]
pub(crate) fn ensure(holds: bool, field: &'static str, value: Value, must: &'static str) -> Result<(), Invalid> {
    if holds { Ok(()) } else { Err(invalid(field, value, must)) }
}

#[inline(always)]
fn invalid(field: &'static str, value: Value, must: &'static str) -> Invalid {
    Invalid { within: None, field: words(field), value, must: words(must) }
}

/// Texts are for the host: on a node they would cost two kilobytes of flash, and a node cannot show them.
#[inline(always)]
const fn words(words: &'static str) -> &'static str {
    if cfg!(target_os = "none") { "" } else { words }
}

pub(crate) fn integer(value: impl Into<u64>) -> Value {
    Value::Integer(value.into())
}

#[inline(always)]
fn within(list: &'static str, place: usize) -> impl Fn(Invalid) -> Invalid {
    move |invalid| Invalid { within: Some((words(list), place as u8)), ..invalid }
}

impl Record {
    /// The radio configuration of the frames.
    ///
    /// # Errors
    /// If no radio supports it.
    pub fn phy(&self) -> Result<PhyConfig, Invalid> {
        self.network.phy()
    }

    /// Checks whether a node can work with the config record, on at least one board.
    ///
    /// # Errors
    /// The first field with an invalid value.
    pub fn validate(&self) -> Result<(), Invalid> {
        self.identity.validate()?;
        self.validate_network()?;
        self.validate_role()?;
        let trim = self.calibration.crystal_trim.unwrap_or(0);
        ensure(trim <= 31, "calibration.crystal_trim", integer(trim), "0 to 31")?;
        if let Some(pins) = &self.pins {
            pins.validate()?;
        }
        self.validate_anchors()?;
        self.validate_beacons()
    }

    /// Checks whether a node on this board can work with the config record.
    ///
    /// # Errors
    /// As [`validate`](Self::validate); also if the board lacks a pin, free pins or Bluetooth.
    pub fn validate_for(&self, board: Board) -> Result<(), Invalid> {
        self.validate()?;
        let board = board.spec();
        self.network.validate_for(&board.radio)?;
        if let Some(pins) = &self.pins {
            ensure(board.pins.is_some(), "pins.sck", integer(pins.sck), "absent: this board's DW1000 is wired")?;
            for (name, pin, driven) in pins.named() {
                let must = "a free pin of the chip's; sck, mosi, cs and reset are outputs";
                let allowed = board.pins.is_some_and(|choice| choice.allows(pin, driven));
                ensure(allowed, name, integer(pin), must)?;
            }
        }
        if let Role::Tag(Tag { tells: PollContent::Advertised, scan, .. }) = &self.role {
            let refuse = |holds, must| ensure(holds, "tag.advertise_position", Value::Word(words("true")), must);
            refuse(board.tag_advertises, "absent: only the DWM1001's image of a tag advertises")?;
            refuse(scan.is_none(), "absent beside scan_interval_ms: the image that scans does not advertise")?;
            refuse(self.network.mode != Mode::Blink, "absent in mode blink: such a tag does not know its position")?;
        }
        match &self.role {
            Role::Tag(Tag { scan: Some(scan), .. }) => {
                let must = "absent: this board has no Bluetooth";
                ensure(board.has_bluetooth, "tag.scan.interval_ms", integer(scan.interval_ms), must)
            }
            Role::Advertiser(beacon) => {
                let must = "on an ESP32: no other board has an image of a beacon";
                ensure(board.advertises, "beacon.minor", integer(beacon.minor), must)
            }
            Role::Scanner => {
                let must = "on an ESP32: no other board has an image of a scanner";
                ensure(board.has_wifi, "role", Value::Word(words("scanner")), must)
            }
            Role::Tag(Tag { scan: None, .. }) | Role::Anchor { position_m: _ } => Ok(()),
        }
    }

    fn validate_network(&self) -> Result<(), Invalid> {
        let Network { pan, mode, phy: _, turnaround, region: _, key } = self.network;
        ensure(
            pan != 0xFFFF,
            "network.pan",
            Value::Hexadecimal(pan.into()),
            "less than 0xFFFF, which is every network's",
        )?;
        if let Some(pinned) = &turnaround {
            pinned.validate()?;
        }
        self.network.phy()?;
        self.validate_region()?;
        let fits = key.is_none() || !matches!(mode, Mode::DecaRanging { fast: _ });
        ensure(
            fits,
            "network.key",
            Value::Word(words("given")),
            "absent in mode decaranging, whose frames have no code",
        )?;
        match mode {
            Mode::Native | Mode::Blink | Mode::DecaRanging { fast: _ } => Ok(()),
            Mode::Listening { rounds_chz } => OTHER_RATES.ensure(rounds_chz, "network.rounds_hz"),
        }
    }

    fn validate_role(&self) -> Result<(), Invalid> {
        match &self.role {
            Role::Tag(tag) => {
                tag.validate(&self.network.mode.rates())?;
                let is_given = self.network.mode != Mode::Blink || tag.rate_chz.is_some();
                ensure(is_given, "tag.rate_hz", Value::Absent, "given in mode \"blink\"")?;
                self.validate_solver(tag.solver)
            }
            Role::Anchor { position_m: None } | Role::Scanner => Ok(()),
            Role::Anchor { position_m: Some(position_m) } => {
                place(position_m, FARTHEST_ON_AIR_M, "anchor.position_m", "finite and within 8388 m of the origin")
            }
            Role::Advertiser(beacon) => {
                let keyed = beacon.rotate_s == 0 || self.beacon_key.is_some();
                beacon.validate()?;
                ensure(keyed, "beacon_key", Value::Absent, "there where beacon.rotate_s is not 0")
            }
        }
    }

    /// Solvers work on ranges; a tag that only listens has none.
    fn validate_solver(&self, solver: Solver) -> Result<(), Invalid> {
        let fits = match (self.network.mode, solver) {
            (Mode::Native | Mode::Blink | Mode::DecaRanging { fast: _ }, _)
            | (Mode::Listening { .. }, Solver::Track) => true,
            (Mode::Listening { .. }, Solver::Robust | Solver::BWls | Solver::BWlsR | Solver::BoundingBox) => false,
        };
        let must = "track in mode \"listening\": the others solve ranges, and there a tag has differences";
        ensure(fits, "tag.solver", Value::Word(words(solver.name())), must)
    }

    fn validate_anchors(&self) -> Result<(), Invalid> {
        for (index, anchor) in self.anchors.iter().enumerate() {
            let here = within("anchors", index);
            address(anchor.address, "address").map_err(&here)?;
            let first = self.anchors.iter().position(|other| other.address == anchor.address) == Some(index);
            ensure(first, "address", Value::Hexadecimal(anchor.address.into()), "different from the others'")
                .map_err(&here)?;
            everywhere(&anchor.position_m).map_err(&here)?;
        }
        Ok(())
    }

    fn validate_beacons(&self) -> Result<(), Invalid> {
        for (index, beacon) in self.beacons.iter().enumerate() {
            let here = within("beacons", index);
            let same = |other: &crate::config::Beacon| (other.major, other.minor) == (beacon.major, beacon.minor);
            let first = self.beacons.iter().position(same) == Some(index);
            ensure(first, "minor", integer(beacon.minor), "different from those of the same major").map_err(&here)?;
            everywhere(&beacon.position_m).map_err(&here)?;
            let rssi = beacon.rssi_1m_dbm.unwrap_or(-59.0);
            ensure((-120.0..=20.0).contains(&rssi), "rssi_1m_dbm", Value::Real(rssi), "-120 to 20").map_err(&here)?;
            let exponent = beacon.path_loss_exponent.unwrap_or(2.0);
            let plausible = (0.5..=10.0).contains(&exponent);
            ensure(plausible, "path_loss_exponent", Value::Real(exponent), "0.5 to 10").map_err(&here)?;
        }
        Ok(())
    }
}

fn address(address: u16, field: &'static str) -> Result<(), Invalid> {
    ensure(
        address < NO_ADDRESS,
        field,
        Value::Hexadecimal(address.into()),
        "less than 0xFFFE: that is nobody, 0xFFFF everybody",
    )
}

fn everywhere(position_m: &[f32; 3]) -> Result<(), Invalid> {
    place(position_m, FARTHEST_M, "position_m", "finite and within 100 km of the origin")
}

fn place(position_m: &[f32; 3], farthest_m: f32, field: &'static str, must: &'static str) -> Result<(), Invalid> {
    position_m.iter().try_for_each(|metres| ensure(metres.abs() <= farthest_m, field, Value::Real(*metres), must))
}

impl Identity {
    /// The EUI-64 and the short address, on a chip with this EUI-64.
    pub fn on(&self, chip_eui: u64) -> (u64, u16) {
        let eui = self.eui.unwrap_or(chip_eui);
        (eui, self.address.unwrap_or(eui as u16))
    }

    fn validate(&self) -> Result<(), Invalid> {
        if let Some(eui) = self.eui {
            let meant = eui != 0 && eui != u64::MAX;
            ensure(meant, "identity.eui", Value::Hexadecimal(eui), "neither all zeros nor all ones")?;
            let unclear = self.address.is_none() && eui as u16 >= NO_ADDRESS;
            let must =
                "other in its lowest 16 bits, the address where none is given: 0xFFFE is nobody, 0xFFFF everybody";
            ensure(!unclear, "identity.eui", Value::Hexadecimal(eui), must)?;
        }
        self.address.map_or(Ok(()), |given| address(given, "identity.address"))
    }
}

impl Network {
    fn phy(&self) -> Result<PhyConfig, Invalid> {
        let phy = self.phy;
        let channel = Channel::from_number(phy.channel)
            .ok_or_else(|| invalid("network.phy.channel", integer(phy.channel), "1, 2, 3, 4, 5 or 7"))?;
        let prf = Prf::from_mhz(phy.prf_mhz)
            .ok_or_else(|| invalid("network.phy.prf_mhz", integer(phy.prf_mhz), "16 or 64"))?;
        let rate = DataRate::from_kbps(phy.rate_kbps)
            .ok_or_else(|| invalid("network.phy.rate_kbps", integer(phy.rate_kbps), "110, 850 or 6810"))?;
        let preamble = PreambleLength::from_symbols(phy.preamble).ok_or_else(|| {
            let must = "64, 128, 256, 512, 1024, 1536, 2048 or 4096";
            invalid("network.phy.preamble", integer(phy.preamble), must)
        })?;
        let config = PhyConfig::new(channel, prf, rate, preamble);
        let config = config.and_then(|config| phy.code.map_or(Ok(config), |code| config.with_preamble_code(code)));
        config.map_err(|error| match error {
            PhyError::PreambleCode(code) => {
                invalid("network.phy.code", integer(code), "one that the standard gives the channel at this pulse rate")
            }
            PhyError::PreambleTooShort(length) => {
                invalid("network.phy.preamble", integer(length.symbols()), "1024 or more at 110 kbit/s")
            }
            // Delimiter and acquisition chunk are the recommended ones, which are valid.
            PhyError::SfdUndefined | PhyError::PacTooLong(_) => {
                invalid("network.phy.rate_kbps", integer(phy.rate_kbps), "one that delimiter and preamble fit")
            }
        })
    }
}

impl Network {
    /// Checks whether a radio with these capabilities can send and receive the network's frames.
    ///
    /// # Errors
    /// The first field that the radio cannot do.
    pub fn validate_for(&self, radio: &Capabilities) -> Result<(), Invalid> {
        radio.check(&self.phy()?).map_err(|unsupported| {
            let (field, value) = match unsupported {
                Unsupported::Channel(channel) => ("network.phy.channel", integer(channel.number())),
                Unsupported::PulseRate(prf) => ("network.phy.prf_mhz", integer(prf.mhz())),
                Unsupported::DataRate(rate) => ("network.phy.rate_kbps", integer(rate.kbps())),
                Unsupported::Preamble(preamble) => ("network.phy.preamble", integer(preamble.symbols())),
            };
            invalid(field, value, "one that the radio of this board has")
        })
    }
}

impl crate::config::ReplyDelay {
    fn validate(&self) -> Result<(), Invalid> {
        let Self { answer_us, listen_again_us, transmit_us } = *self;
        let times = [
            ("network.turnaround.answer_us", answer_us),
            ("network.turnaround.listen_again_us", listen_again_us),
            ("network.turnaround.transmit_us", transmit_us),
        ];
        for (field, time_us) in times {
            ensure((1..=SLOWEST_US).contains(&time_us), field, integer(time_us), "1 to 20000")?;
        }
        ensure(
            transmit_us <= answer_us,
            "network.turnaround.transmit_us",
            integer(transmit_us),
            "answer_us at most, which counts it in",
        )
    }
}

impl From<crate::config::Scheme> for crate::uwb::layout::Scheme {
    fn from(given: crate::config::Scheme) -> Self {
        match given {
            crate::config::Scheme::SingleSided => Self::SingleSided,
            crate::config::Scheme::DoubleSided => Self::DoubleSided,
        }
    }
}

impl Rates {
    fn ensure(&self, chz: u32, field: &'static str) -> Result<(), Invalid> {
        ensure(self.0.contains(&chz), field, Value::Real(chz as f32 / 100.0), self.1)
    }
}

impl Mode {
    fn rates(self) -> Rates {
        match self {
            Self::Native => NATIVE_RATES,
            Self::Blink => BLINK_RATES,
            Self::DecaRanging { fast: _ } | Self::Listening { rounds_chz: _ } => OTHER_RATES,
        }
    }
}

impl Tag {
    fn validate(&self, rates: &Rates) -> Result<(), Invalid> {
        let height = self.height_m.unwrap_or(0.0);
        ensure(
            height.abs() <= FARTHEST_M,
            "tag.height_m",
            Value::Real(height),
            "finite and within 100 km of the origin",
        )?;
        let (sigma, known) = (self.height_sigma_m, self.height_m.is_some());
        let holds = sigma == 0.0 || known && HEIGHT_SIGMAS_M.contains(&sigma);
        ensure(holds, "tag.height_sigma_m", Value::Real(sigma), "0.01 to 1, beside height_m")?;
        if let Some(TagArea { least_m, greatest_m }) = self.area {
            let holds = least_m.iter().zip(&greatest_m).all(|(least, greatest)| least < greatest);
            ensure(holds, "tag.area", Value::Real(least_m[0]), "of least coordinates below the greatest ones")?;
        }
        for (field, rate) in [("tag.rate_hz", self.rate_chz), ("tag.still_rate_hz", self.still_rate_chz)] {
            rate.map_or(Ok(()), |chz| rates.ensure(chz, field))?;
        }
        if let (Some(rate), Some(still)) = (self.rate_chz, self.still_rate_chz) {
            let value = Value::Real(still as f32 / 100.0);
            ensure(still <= rate, "tag.still_rate_hz", value, "rate_hz at most")?;
        }
        let anchors = self.anchors_per_round;
        let few = (1..=MAX_ROUND as u8).contains(&anchors);
        ensure(few, "tag.anchors_per_round", integer(anchors), "1 to 8")?;
        self.scan.map_or(Ok(()), |scan| scan.validate())
    }
}

impl Scan {
    fn validate(&self) -> Result<(), Invalid> {
        let Self { interval_ms, window_ms } = *self;
        let interval = (3..=10_240).contains(&interval_ms);
        ensure(interval, "tag.scan.interval_ms", integer(interval_ms), "3 to 10240")?;
        let window = (3..=interval_ms).contains(&window_ms);
        ensure(window, "tag.scan.window_ms", integer(window_ms), "3 to the interval")
    }
}

impl Advertiser {
    fn validate(&self) -> Result<(), Invalid> {
        let interval = (20..=10_240).contains(&self.interval_ms);
        ensure(interval, "beacon.interval_ms", integer(self.interval_ms), "20 to 10240")?;
        let power = (-40..=20).contains(&self.tx_power_dbm);
        ensure(power, "beacon.tx_power_dbm", Value::Real(self.tx_power_dbm.into()), "-40 to 20")?;
        let channels = (1..=7).contains(&self.channels);
        ensure(channels, "beacon.channels", integer(self.channels), "one of 37, 38, 39 at least, and no other")
    }
}

impl Pins {
    fn validate(&self) -> Result<(), Invalid> {
        let named = self.named();
        for (index, (name, pin, _)) in named.iter().enumerate() {
            let first = named.iter().position(|(_, other, _)| other == pin) == Some(index);
            ensure(first, name, integer(*pin), "a pin that no other signal has")?;
        }
        Ok(())
    }
}
