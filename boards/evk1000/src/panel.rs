//! The EVB1000's user interface: what the switches S1 select, and what the display shows (P. M. de Rojas Malpartida's
//! thesis, Universidad de Sevilla, 2021, chapter 5).
//!
//! Switches and a record, if there is one → the record that the node uses. Distances → two lines of text.

use heapless::HistoryBuf;
use ranging::PhyConfig;
use wire::config::{Calibration, Identity, Mode, Network, Phy, PollContent, Record, Role, Solver, Tag};

use crate::lcd::{Text, WIDTH};

/// The switches S1-4 to S1-8; `true` is on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Switches {
    /// S1-4: on for an anchor, off for a tag.
    pub anchor: bool,
    /// S1-5, S1-6, S1-7: the mode.
    pub mode: [bool; 3],
    /// S1-8: on for native mode, off for DecaRanging.
    pub native: bool,
}

/// The PAN of boards without a record.
const PAN: u16 = 0xDECA;

/// A tag without a record: two boards range as often as they can.
const TAG: Tag = Tag {
    height_m: None,
    rate_chz: None,
    still_rate_chz: None,
    sleep: false,
    anchors_per_round: 4,
    tells: PollContent::Distances,
    scan: None,
    report_ranges: true,
    solver: Solver::Track,
    scheme: None,
    height_sigma_m: 0.0,
    area: None,
};

impl Switches {
    /// The record that the node uses: the settings of the switches, and the rest from `record` or from a default.
    pub fn apply(self, record: Option<Record>) -> Record {
        let mut record = record.unwrap_or_else(|| Record {
            identity: Identity::default(),
            role: Role::Tag(TAG),
            network: Network {
                pan: PAN,
                mode: Mode::Native,
                phy: self.phy(),
                turnaround: None,
                region: None,
                key: None,
            },
            calibration: Calibration::default(),
            pins: None,
            anchors: Default::default(),
            beacons: Default::default(),
            beacon_key: None,
        });
        record.role = match (self.anchor, record.role) {
            (true, role @ Role::Anchor { .. }) | (false, role @ Role::Tag(_)) => role,
            (true, Role::Tag(_) | Role::Advertiser(_) | Role::Scanner) => Role::Anchor { position_m: None },
            (false, Role::Anchor { .. } | Role::Advertiser(_) | Role::Scanner) => Role::Tag(TAG),
        };
        record.network.phy = self.phy();
        record.network.mode = match (self.native, record.network.mode) {
            (true, mode @ (Mode::Native | Mode::Blink | Mode::Listening { .. }))
            | (false, mode @ Mode::DecaRanging { .. }) => mode,
            (true, Mode::DecaRanging { .. }) => Mode::Native,
            (false, Mode::Native | Mode::Blink | Mode::Listening { .. }) => Mode::DecaRanging { fast: false },
        };
        record
    }

    fn phy(self) -> Phy {
        let [s1_5, s1_6, s1_7] = self.mode;
        let phy = PhyConfig::from_evk1000_switches(s1_5, s1_6, s1_7);
        Phy {
            channel: phy.channel().number(),
            prf_mhz: match phy.prf() {
                ranging::phy::Prf::Mhz16 => 16,
                ranging::phy::Prf::Mhz64 => 64,
            },
            rate_kbps: match phy.data_rate() {
                ranging::phy::DataRate::Kbps110 => 110,
                ranging::phy::DataRate::Kbps850 => 850,
                ranging::phy::DataRate::Kbps6810 => 6810,
            },
            preamble: phy.preamble_length().symbols(),
            code: Some(phy.preamble_code()),
        }
    }
}

/// What a board without a distance to show waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Awaiting {
    /// An anchor waits for a tag's poll.
    Poll,
    /// A tag waits for an anchor's answer.
    Response,
    /// The image has no tag, and S1-4 selects one. The image waits until S1-4 is switched on and the board is reset.
    Switch,
}

/// The content of the display.
#[derive(Debug)]
pub struct Panel {
    awaiting: Awaiting,
    distances: HistoryBuf<f32, 8>,
}

impl Panel {
    /// The panel of a node that has no peer yet.
    pub const fn new(awaiting: Awaiting) -> Self {
        Self { awaiting, distances: HistoryBuf::new() }
    }

    /// Adds a measured distance, metres.
    pub fn measured(&mut self, distance_m: f32) {
        self.distances.write(distance_m);
    }

    /// The peer is lost.
    pub fn lost(&mut self) {
        *self = Self::new(self.awaiting);
    }

    /// The text: the last distance and the mean of the last eight, or what the board waits for.
    pub fn text(&self) -> Text {
        match (self.distances.recent(), self.awaiting) {
            (Some(last), _) => {
                let sum: f32 = self.distances.as_slice().iter().sum();
                [distance(b"LAST:", *last), distance(b"AVG8:", sum / self.distances.len() as f32)]
            }
            (None, Awaiting::Poll) => [*b"    AWAITING    ", *b"      POLL      "],
            (None, Awaiting::Response) => [*b"    AWAITING    ", *b"    RESPONSE    "],
            (None, Awaiting::Switch) => [*b"  ANCHOR ONLY:  ", *b" SWITCH S1-4 ON "],
        }
    }
}

/// A line such as `LAST:   12.34 m `: two decimals, right-aligned, or dashes for a number that is too long.
fn distance(label: &[u8; 5], metres: f32) -> [u8; WIDTH] {
    let mut line = [b' '; WIDTH];
    line[..5].copy_from_slice(label);
    line[14] = b'm';
    let centimetres = metres * 100.0 + if metres < 0.0 { -0.5 } else { 0.5 };
    // Columns 5 to 12: sign, five digits, point, two digits.
    if !(-9_999_999.0..=9_999_999.0).contains(&centimetres) {
        line[10..13].copy_from_slice(b"---");
        return line;
    }
    let (negative, mut rest) = ((centimetres as i32) < 0, (centimetres as i32).unsigned_abs());
    let mut column = 13;
    let mut digits = 0;
    while digits < 3 || rest > 0 {
        if digits == 2 {
            column -= 1;
            line[column] = b'.';
        }
        column -= 1;
        line[column] = b'0' + (rest % 10) as u8;
        rest /= 10;
        digits += 1;
    }
    if negative && column > 5 {
        line[column - 1] = b'-';
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::Settings;
    use firmware_common::settings::Cipher;

    const CIPHER: Cipher = Cipher { seed: 1, make_code: wire::uwb::native::software_code };

    #[test]
    fn without_a_record_the_switches_decide_all() {
        for mode in 0..8_u8 {
            let switches = [mode & 1 != 0, mode & 2 != 0, mode & 4 != 0];
            let record = Switches { anchor: true, mode: switches, native: false }.apply(None);
            assert_eq!(record.role, Role::Anchor { position_m: None });
            assert_eq!(record.network.mode, Mode::DecaRanging { fast: false });
            let settings = Settings::of(&record, 0x0200_0000_0000_1234, CIPHER).unwrap();
            // Table 5-1 of de Rojas Malpartida's thesis has the modes in this order, as 1 to 8.
            assert_eq!(Some(settings.network.phy), PhyConfig::evk1000_mode(mode + 1));
            assert_eq!(settings.address, 0x1234);
        }
        assert!(matches!(Switches::default().apply(None).role, Role::Tag(_)));
    }

    #[test]
    fn a_board_without_a_record_measures_how_quick_it_is() {
        for native in [false, true] {
            let record = Switches { native, ..Switches::default() }.apply(None);
            assert_eq!(record.network.turnaround, None);
            assert_eq!(Settings::of(&record, 1, CIPHER).unwrap().network.pinned, None);
        }
    }

    #[test]
    fn mode_5_is_that_of_the_measurements() {
        // Off, off, on: channel 5, 110 kbit/s, 16 MHz, 1024 symbols.
        let record = Switches { mode: [false, false, true], ..Switches::default() }.apply(None);
        let Phy { channel, prf_mhz, rate_kbps, preamble, .. } = record.network.phy;
        assert_eq!((channel, rate_kbps, prf_mhz, preamble), (5, 110, 16, 1024));
    }

    #[test]
    fn a_record_says_what_the_switches_do_not() {
        let mut record = Switches { anchor: true, native: true, ..Switches::default() }.apply(None);
        record.identity.address = Some(7);
        record.role = Role::Anchor { position_m: Some([1.0, 2.0, 3.0]) };
        record.calibration.antenna_delay = Some(16_500);
        record.network.pan = 0xBA12;
        record.network.mode = Mode::DecaRanging { fast: true };

        let anchor = Switches { anchor: true, mode: [true; 3], native: false }.apply(Some(record.clone()));
        assert_eq!(anchor.role, record.role);
        assert_eq!(
            (anchor.identity, anchor.calibration, anchor.network.pan),
            (record.identity, record.calibration, 0xBA12)
        );
        // The switch has only one position for both variants.
        assert_eq!(anchor.network.mode, Mode::DecaRanging { fast: true });
        assert_eq!(anchor.network.phy.rate_kbps, 6810);

        let tag = Switches { anchor: false, mode: [true; 3], native: true }.apply(Some(record));
        assert_eq!((tag.role, tag.network.mode), (Role::Tag(TAG), Mode::Native));
        assert_eq!(tag.identity.address, Some(7));
    }

    #[test]
    fn the_display_waits_as_the_boards_do() {
        assert_eq!(Panel::new(Awaiting::Response).text(), [*b"    AWAITING    ", *b"    RESPONSE    "]);
        assert_eq!(Panel::new(Awaiting::Poll).text(), [*b"    AWAITING    ", *b"      POLL      "]);
    }

    #[test]
    fn the_display_has_the_last_distance_and_the_mean_of_eight() {
        let mut panel = Panel::new(Awaiting::Response);
        panel.measured(3.0);
        assert_eq!(panel.text(), [*b"LAST:    3.00 m ", *b"AVG8:    3.00 m "]);
        for distance_m in [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 9.5] {
            panel.measured(distance_m);
        }
        // The first distance is no longer in the mean: 37.5 / 8 = 4.6875.
        assert_eq!(panel.text(), [*b"LAST:    9.50 m ", *b"AVG8:    4.69 m "]);
        panel.lost();
        assert_eq!(panel.text(), Panel::new(Awaiting::Response).text());
    }

    #[test]
    fn distances_are_written_to_the_centimetre() {
        assert_eq!(&distance(b"LAST:", 0.004), b"LAST:    0.00 m ");
        assert_eq!(&distance(b"LAST:", 0.056), b"LAST:    0.06 m ");
        assert_eq!(&distance(b"LAST:", -0.126), b"LAST:   -0.13 m ");
        assert_eq!(&distance(b"LAST:", 123.456), b"LAST:  123.46 m ");
        assert_eq!(&distance(b"LAST:", 99_999.0), b"LAST:99999.00 m ");
        assert_eq!(&distance(b"LAST:", 100_000.0), b"LAST:     --- m ");
        assert_eq!(&distance(b"LAST:", f32::NAN), b"LAST:     --- m ");
    }
}
