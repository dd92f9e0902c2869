//! DecaRanging mode on a small simulated air, against this project's own nodes and against a board implemented from the
//! frames' description alone.

use std::cell::RefCell;
use std::rc::Rc;

use crate::air::{ANTENNA_DELAY, Air, Boxed, Owned, boxed, mischief, moments};
use ranging::decaranging::{Anchor, AnchorConfig, INIT_DELAY, Tag, TagConfig};
use ranging::exchange::{Event, Link};
use ranging::native::ReplyDelay;
use ranging::{PhyConfig, RadioDuration, RadioInstant, Start};
use wire::uwb::decaranging::Variant;

/// The reply delay of a board on the air of these tests.
const QUICK: ReplyDelay = ReplyDelay {
    answer: RadioDuration::from_micros(250),
    listen_again: RadioDuration::from_micros(40),
    transmit: RadioDuration::from_micros(150),
};
const TAG_EUI: u64 = 0xDECA_0200_0000_1234;
const ANCHOR: u16 = 0x0042;

fn tag_of(phy: PhyConfig, variant: Variant, turnaround: ReplyDelay) -> Boxed {
    boxed(Tag::new(TagConfig {
        eui: TAG_EUI,
        variant,
        phy,
        turnaround,
        antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
        period: RadioDuration::from_micros(50_000),
    }))
}

fn tag(phy: PhyConfig, variant: Variant) -> Boxed {
    tag_of(phy, variant, QUICK)
}

fn anchor(phy: PhyConfig) -> Boxed {
    boxed(Anchor::new(AnchorConfig {
        address: ANCHOR,
        eui: 0xDECA_0100_0000_0042,
        phy,
        turnaround: QUICK,
        antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
        init_delay: INIT_DELAY,
    }))
}

fn errors(air: &Air, node: usize, from: f64, truth: f64) -> Vec<f64> {
    let ranges = air.rounds(node, from).into_iter().flat_map(|(_, ranges)| ranges);
    ranges.map(|range| f64::from(range.distance_m) - truth).collect()
}

fn assert_accurate(errors: &[f64], least: usize, what: &str) {
    let (bias, deviation) = moments(errors);
    assert!(errors.len() >= least, "{what}: {} ranges", errors.len());
    assert!(bias.abs() < 0.01 && deviation < 0.03, "{what}: bias {bias:.4} m, deviation {deviation:.4} m");
}

/// A board implemented from its description, with its own bytes and its own arithmetic. `heard` gets the distances that
/// it would show, metres.
struct Board {
    variant: Variant,
    reply_us: u32,
    /// As an anchor it writes its delay in milliseconds, without a unit.
    millis: bool,
    heard: Rc<RefCell<Vec<f64>>>,
    sequence: u8,
    peer: [u8; 2],
    own: [u8; 2],
    stamps: [RadioInstant; 4],
}

/// Metres per tick, by the board's own constants.
const BOARD_METRES: f64 = 299_702_547.0 / (499.2e6 * 128.0);

fn ticks(later: RadioInstant, earlier: RadioInstant) -> f64 {
    let span = later.ticks().wrapping_sub(earlier.ticks()) & 0xFF_FFFF_FFFF;
    span as f64
}

impl Board {
    fn new(variant: Variant, reply_us: u32, heard: &Rc<RefCell<Vec<f64>>>) -> Self {
        let stamps = [RadioInstant::default(); 4];
        Self {
            variant,
            reply_us,
            millis: false,
            heard: Rc::clone(heard),
            sequence: 0,
            peer: [0; 2],
            own: [0x77, 0x10],
            stamps,
        }
    }

    fn fast(&self) -> bool {
        self.variant == Variant::Fast
    }

    fn head(&mut self) -> Vec<u8> {
        self.sequence = self.sequence.wrapping_add(1);
        let [p0, p1] = self.peer;
        let [o0, o1] = self.own;
        vec![0x41, 0x88, self.sequence, 0xCA, 0xDE, p0, p1, o0, o1]
    }

    /// Payload of a frame from the peer to this board.
    fn payload<'f>(&self, bytes: &'f [u8]) -> Option<&'f [u8]> {
        let ours = bytes.len() > 9 && bytes[..2] == [0x41, 0x88] && bytes[3..5] == [0xCA, 0xDE];
        (ours && bytes[5..7] == self.own && bytes[7..9] == self.peer).then(|| &bytes[9..])
    }

    fn at(&self, rx: RadioInstant) -> RadioInstant {
        rx.plus(RadioDuration::from_micros(self.reply_us))
    }

    /// The instant at which a frame with this start leaves the antenna: low nine bits ignored, antenna delay added.
    fn leaves(at: RadioInstant) -> RadioInstant {
        RadioInstant::from_ticks((at.ticks() & !511) + ANTENNA_DELAY as u64)
    }

    fn listen() -> Owned {
        Owned::Receive { start: Start::Now, window: RadioDuration::from_micros(200_000), keep_listening: true }
    }

    /// As an anchor: takes any tag that blinks.
    fn anchor(mut self) -> Boxed {
        Box::new(move |_, _, event| {
            let frame = match event {
                Event::Sent(departure) => {
                    self.stamps[1] = departure;
                    return Self::listen();
                }
                Event::Received(frame) => frame,
                _ => return Self::listen(),
            };
            let bytes = frame.bytes;
            if bytes[0] == 0xC5 && (bytes.len() == 10 || bytes.len() == 16) {
                self.peer = [0x34, 0x12];
                self.sequence += 1;
                let mut init = vec![0x41, 0x8C, self.sequence, 0xCA, 0xDE];
                init.extend(&bytes[2..10]);
                init.extend(self.own);
                init.push(0x20);
                init.extend(self.peer);
                let field = match self.reply_us {
                    us if self.millis => us / 1000,
                    us if us < 0x8000 => us,
                    us => 0x8000 | (us / 1000),
                };
                init.extend([field as u8, (field >> 8) as u8]);
                let start = Start::At(frame.rx_time.plus(RadioDuration::from_micros(20_000)));
                return Owned::Transmit { frame: init, start, listen: true };
            }
            let fast = self.fast();
            let Some(payload) = self.payload(bytes).map(<[u8]>::to_vec) else { return Self::listen() };
            let mut out = self.head();
            match (payload[0], payload.len(), fast) {
                (0x21, 3, false) | (0x61, 1, true) => {
                    self.stamps[0] = frame.rx_time;
                    out.extend(if fast { vec![0x50] } else { vec![0x10, 0x02, 0, 0] });
                }
                (0x29, 16, false) | (0x69, 9, true) => {
                    let five = |i: usize| RadioInstant::from_le_bytes(payload[i..i + 5].try_into().unwrap());
                    let four = |i: usize| f64::from(u32::from_le_bytes(payload[i..i + 4].try_into().unwrap()));
                    let [trp, tsr, _, _] = self.stamps;
                    let (tr_sr, ts_rr) = (ticks(frame.rx_time, tsr), ticks(tsr, trp));
                    let tof = if fast {
                        // Product form on the two reported intervals.
                        let (reply2, round1) = (four(1), four(5));
                        (round1 * tr_sr - ts_rr * reply2) / (round1 + tr_sr + ts_rr + reply2)
                    } else {
                        // P. M. de Rojas Malpartida's thesis (2021), equation 5-2: [(TRR − TSP) − (TSR − TRP) + (TRF −
                        // TSR) − (TSF − TRR)] / 4.
                        let (tsp, trr, tsf) = (five(1), five(6), five(11));
                        (ticks(trr, tsp) - ts_rr + tr_sr - ticks(tsf, trr)) / 4.0
                    };
                    self.heard.borrow_mut().push(tof * BOARD_METRES);
                    let whole = (tof.round() as i64).to_le_bytes();
                    out.push(if fast { 0x6A } else { 0x2A });
                    out.extend(&whole[..if fast { 4 } else { 5 }]);
                }
                _ => return Self::listen(),
            }
            Owned::Transmit { frame: out, start: Start::At(self.at(frame.rx_time)), listen: true }
        })
    }

    /// As a tag: blinks every second, then polls every 100 ms.
    fn tag(mut self) -> Boxed {
        let mut taken = false;
        let mut next: Option<RadioInstant> = None;
        let mut long_blink = false;
        Box::new(move |now, _, event| {
            let mut begin = next.is_none();
            match event {
                Event::Sent(departure) => self.stamps[2] = departure,
                Event::Timeout | Event::Late => begin = true,
                Event::Received(frame) => {
                    let bytes = frame.bytes;
                    let init = bytes.len() == 20 && bytes[..2] == [0x41, 0x8C] && bytes[15] == 0x20;
                    if init && bytes[3..5] == [0xCA, 0xDE] && bytes[5..13] == TAG_EUI.to_le_bytes() {
                        taken = true;
                        self.peer = [bytes[13], bytes[14]];
                        self.own = [bytes[16], bytes[17]];
                        let field = u32::from(bytes[18]) | u32::from(bytes[19]) << 8;
                        self.reply_us = if field < 0x8000 { field } else { (field & 0x7FFF) * 1000 };
                        begin = true;
                        next = Some(now);
                    } else if let Some(payload) = self.payload(bytes).map(<[u8]>::to_vec) {
                        let fast = self.fast();
                        let answered = if fast { payload[..] == [0x50] } else { payload[..] == [0x10, 2, 0, 0] };
                        let report = if fast {
                            payload[0] == 0x6A && payload.len() == 5
                        } else {
                            payload[0] == 0x2A && payload.len() == 6
                        };
                        if answered {
                            let (poll_tx, resp_rx) = (self.stamps[2], frame.rx_time);
                            let start = self.at(resp_rx);
                            let final_tx = Self::leaves(start);
                            let mut out = self.head();
                            if fast {
                                out.push(0x69);
                                for span in [ticks(final_tx, resp_rx), ticks(resp_rx, poll_tx)] {
                                    out.extend((span as u32).to_le_bytes());
                                }
                            } else {
                                out.push(0x29);
                                for instant in [poll_tx, resp_rx, final_tx] {
                                    out.extend(&instant.ticks().to_le_bytes()[..5]);
                                }
                            }
                            return Owned::Transmit { frame: out, start: Start::At(start), listen: true };
                        }
                        if report {
                            let mut sign = [if payload[payload.len() - 1] & 0x80 == 0 { 0 } else { 0xFF }; 8];
                            sign[..payload.len() - 1].copy_from_slice(&payload[1..]);
                            self.heard.borrow_mut().push(i64::from_le_bytes(sign) as f64 * BOARD_METRES);
                        }
                    }
                }
                _ => {}
            }
            let due = *next.get_or_insert(now);
            let rest = due.since(now);
            if !begin && rest > RadioDuration::ZERO {
                return Owned::Receive { start: Start::Now, window: rest, keep_listening: true };
            }
            if rest > RadioDuration::ZERO {
                return Owned::WaitUntil(due);
            }
            let frame = if taken {
                next = Some(now.plus(RadioDuration::from_micros(100_000)));
                let mut out = self.head();
                out.extend(if self.fast() { vec![0x61] } else { vec![0x21, 0x7F, 0x8E] });
                out
            } else {
                next = Some(now.plus(RadioDuration::from_micros(1_000_000)));
                self.sequence += 1;
                let mut blink = vec![0xC5, self.sequence];
                blink.extend(TAG_EUI.to_le_bytes());
                long_blink = !long_blink;
                if long_blink {
                    blink.extend([0x43, 0x02, 0xD1, 0x7F, 0x8E, 0x00]);
                }
                blink
            };
            Owned::Transmit { frame, start: Start::Now, listen: true }
        })
    }
}

#[test]
fn our_tag_ranges_with_a_board() {
    for (mode, variant, reply_us, millis) in [
        (8, Variant::Fast, 500, false),
        (8, Variant::Standard, 900, false),
        (8, Variant::Standard, 5000, false),
        (8, Variant::Standard, 5000, true),
        (5, Variant::Standard, 150_000, false),
        (5, Variant::Standard, 150_000, true),
        (2, Variant::Fast, 600, false),
    ] {
        let phy = PhyConfig::evk1000_mode(mode).unwrap();
        let mut air = Air::new(phy, 40 + u64::from(mode));
        // The power at which the range bias of the mode's pulse rate is zero.
        air.power_dbm = if mode == 8 { -81.5 } else { -86.25 };
        let shown = Rc::default();
        let board = Board { millis, ..Board::new(variant, reply_us, &shown) };
        air.add([0.0, 0.0, 1.0], 20.0, board.anchor());
        let ours = air.add([7.0, 0.0, 1.0], -20.0, tag(phy, variant));
        air.run_until(40.0);
        let what = format!("mode {mode}, {variant:?}");
        assert_eq!(air.links(ours).len(), 1, "{what}: {:?}", air.links(ours));
        assert!(matches!(air.links(ours)[0], (time, Link::Paired(0x1077)) if time < 0.1), "{what}");
        // Equal replies, measured by two clocks 40 ppm apart, differ by 40 ppm of themselves. A quarter of this
        // difference enters the sum of equation 5-2: 1.8 cm for 150 ms. This is the board's error, and our anchor shows
        // what the board reports.
        let own_error = match variant {
            Variant::Standard => 0.25 * 40e-6 * 40e-6 * f64::from(reply_us) * 1e-6 * 299_702_547.0,
            Variant::Fast => 0.0,
        };
        let truth = 7.0 + own_error;
        assert_accurate(&errors(&air, ours, 0.0, truth), 80, &what);
        let board: Vec<f64> = shown.borrow().iter().map(|metres| metres - truth).collect();
        assert_accurate(&board, 80, &format!("{what}, the board"));
    }
}

#[test]
fn our_anchor_ranges_with_a_board() {
    for (mode, variant) in [(8, Variant::Fast), (8, Variant::Standard), (5, Variant::Standard), (3, Variant::Fast)] {
        let phy = PhyConfig::evk1000_mode(mode).unwrap();
        let mut air = Air::new(phy, 50 + u64::from(mode));
        // The power at which the range bias of the mode's pulse rate is zero.
        air.power_dbm = if matches!(mode, 8 | 3) { -81.5 } else { -86.25 };
        let shown = Rc::default();
        let ours = air.add([0.0, 0.0, 1.0], 20.0, anchor(phy));
        air.add([12.0, 0.0, 1.0], -20.0, Board::new(variant, 0, &shown).tag());
        air.run_until(20.0);
        let what = format!("mode {mode}, {variant:?}");
        assert_eq!(air.links(ours).len(), 1, "{what}: {:?}", air.links(ours));
        assert!(matches!(air.links(ours)[0], (_, Link::Paired(0x1234))), "{what}: {:?}", air.links(ours));
        assert_accurate(&errors(&air, ours, 0.0, 12.0), 80, &what);
        let board: Vec<f64> = shown.borrow().iter().map(|metres| metres - 12.0).collect();
        assert_accurate(&board, 80, &format!("{what}, the board"));
    }
}

/// Our tag and our anchor, `distance` apart.
fn pair(seed: u64, distance: f64, variant: Variant, tag_turnaround: ReplyDelay) -> (Air, usize, usize) {
    let phy = PhyConfig::FAST;
    let mut air = Air::new(phy, seed);
    let anchor = air.add([0.0, 0.0, 0.0], 20.0, anchor(phy));
    let tag = air.add([distance, 0.0, 0.0], -20.0, tag_of(phy, variant, tag_turnaround));
    (air, anchor, tag)
}

#[test]
fn both_ends_know_the_distance() {
    for (seed, distance) in [(60, 0.01), (61, 0.3), (62, 50.0)] {
        for variant in [Variant::Standard, Variant::Fast] {
            let (mut air, anchor, tag) = pair(seed, distance, variant, QUICK);
            air.run_until(30.0);
            assert_accurate(&errors(&air, anchor, 0.0, distance), 500, "anchor");
            assert_accurate(&errors(&air, tag, 0.0, distance), 500, "tag");
            // 0.1 ns are 3.0 cm: × √6 / 4.
            let (_, deviation) = moments(&errors(&air, tag, 0.0, distance));
            assert!((deviation - 0.0184).abs() < 0.003, "{deviation}");
            let negative = air.rounds(tag, 0.0).iter().filter(|(_, ranges)| ranges[0].distance_m < 0.0).count();
            assert_eq!(negative > 100, distance < 0.1, "{negative} at {distance} m");
        }
    }
}

#[test]
fn replies_unequal_by_a_millisecond_do_no_harm() {
    let slow = ReplyDelay { answer: RadioDuration::from_micros(1250), ..QUICK };
    for variant in [Variant::Standard, Variant::Fast] {
        let (mut air, anchor, tag) = pair(63, 10.0, variant, slow);
        air.run_until(30.0);
        assert_accurate(&errors(&air, anchor, 0.0, 10.0), 500, "anchor");
        assert_accurate(&errors(&air, tag, 0.0, 10.0), 500, "tag");
    }
}

#[test]
fn counters_wrap_inside_exchanges() {
    for variant in [Variant::Standard, Variant::Fast] {
        let (mut air, anchor, tag) = pair(64, 10.0, variant, QUICK);
        air.run_until(1.0);
        // A poll leaves every 50 ms and an exchange lasts about 1.5 ms. With wraps at steps of 0.3 ms, one falls inside
        // an exchange.
        let exchange = air.sent.iter().rev().find(|flight| flight.sender == tag).unwrap().rmarker;
        for step in 0..12 {
            let next = exchange + 0.05 * f64::from(step + 1) - 0.003;
            air.run_until(next);
            // 3 ms to the next poll, then 0 to 1.5 ms into the exchange: the protocols see their clocks jump once,
            // which loses at most that exchange.
            for node in [anchor, tag] {
                air.set_clock(node, (1 << 40) - (63_897_600.0 * (3.0 + 0.12 * f64::from(step))) as u64);
            }
        }
        air.run_until(exchange + 2.0);
        let errors = errors(&air, anchor, 0.5, 10.0);
        assert!(errors.len() > 25, "{}", errors.len());
        assert!(errors.iter().all(|error| error.abs() < 0.15), "{errors:?}");
    }
}

#[test]
fn a_dead_link_is_paired_again_by_itself() {
    let (mut air, anchor_node, tag_node) = pair(65, 5.0, Variant::Fast, QUICK);
    let phy = PhyConfig::FAST;
    air.run_until(2.0);
    // The tag is reset: no reset of the anchor is needed.
    air.switch_on(tag_node, tag(phy, Variant::Fast));
    air.run_until(4.0);
    assert!(air.rounds(tag_node, 2.0)[0].0 < 2.2);
    // The anchor is reset: it answers the tag's polls as soon as it listens.
    air.switch_on(anchor_node, anchor(phy));
    air.run_until(6.0);
    assert!(air.rounds(anchor_node, 4.0)[0].0 < 4.2);
    // Out of range for ten seconds, and back: the tag has given up, and blinks once a second.
    air.reach = 1.0;
    air.run_until(16.0);
    assert!(air.rounds(tag_node, 6.1).is_empty());
    assert!(air.links(tag_node).iter().any(|(time, link)| *time > 6.0 && *link == Link::Lost(ANCHOR)));
    assert!(air.links(anchor_node).iter().any(|(time, link)| *time > 6.0 && *link == Link::Lost(0x1234)));
    air.reach = f64::INFINITY;
    air.run_until(19.0);
    assert!(air.rounds(tag_node, 16.0)[0].0 < 17.2);
    assert_accurate(&errors(&air, anchor_node, 16.0, 5.0), 20, "after all");
}

#[test]
fn loss_stalls_nothing() {
    for variant in [Variant::Standard, Variant::Fast] {
        let (mut air, anchor, _) = pair(66, 5.0, variant, QUICK);
        air.loss = 0.3;
        air.run_until(30.0);
        // Poll, response and final must be received: 0.7³ = 34 % of 20 a second, from the pairing on.
        let times: Vec<f64> = air.rounds(anchor, 5.0).iter().map(|(time, _)| *time).collect();
        assert!(times.len() > 130, "{}", times.len());
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] < 1.5));
    }
}

#[test]
fn repeated_cut_flipped_foreign_and_late_frames_do_no_harm() {
    for (seed, variant) in [(70, Variant::Standard), (71, Variant::Fast), (72, Variant::Standard), (73, Variant::Fast)]
    {
        let (mut air, anchor, tag) = pair(seed, 5.0, variant, QUICK);
        air.add([3.0, 3.0, 1.0], 5.0, mischief(seed));
        air.run_until(30.0);
        for node in [anchor, tag] {
            let errors = errors(&air, node, 0.0, 5.0);
            assert!(errors.len() > 100, "{}", errors.len());
            let worst = errors.iter().fold(0.0, |worst: f64, error| worst.max(error.abs()));
            assert!(worst < 0.15, "seed {seed}, {variant:?}: {worst} m");
        }
    }
}
