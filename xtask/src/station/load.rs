//! Telemetry of many tags, as nodes send it, for measurements of the station. Each position tells in its height when it
//! was made, so that a listener knows how old it is.

use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result};
use wire::config::Board;
use wire::telemetry::{Diagnostics, Doubt, Fix, Hello, MAX_FRAME, Message, Outcome, Range, Role, Solver, encode};

/// Anchors around a room of 20 m by 12 m, 0.1 mm, with their addresses.
const ANCHORS: [(u16, [i32; 3]); 4] = [
    (0x0101, [0, 0, 25_000]),
    (0x0102, [200_000, 0, 25_000]),
    (0x0103, [200_000, 120_000, 25_000]),
    (0x0104, [0, 120_000, 25_000]),
];
/// Frames of a round: a range to each anchor, and the position.
pub const FRAMES: usize = ANCHORS.len() + 1;
/// A node says who it is once in this number of rounds.
const HELLO_EVERY: u64 = 20;
/// The heights begin again after this time, tenths of a millisecond: 1,000 s are 1,000 m.
const AGAIN: u128 = 10_000_000;

/// The time of the host's clock, tenths of a millisecond, as heights tell it.
pub fn now_tenths() -> i32 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i32::try_from(now.as_micros() / 100 % AGAIN).unwrap_or(0)
}

/// The age of a position with this height, milliseconds.
pub fn age_ms(height_m: f64) -> f64 {
    let tenths = f64::from(now_tenths()) - (height_m * 1e4).round();
    tenths.rem_euclid(AGAIN as f64) / 10.0
}

/// Who a tag is.
pub fn hello(tag: u16, t_us: u64, to: &mut Vec<u8>) {
    let hello = Hello {
        t_us,
        eui: tag.into(),
        address: tag,
        role: Role::Tag,
        board: Board::Dwm1001,
        build: [0; 8],
        keyed: false,
    };
    put(&hello.into(), to);
}

/// A round of a tag that walks round the room.
pub fn round(tag: u16, number: u64, t_us: u64, to: &mut Vec<u8>) {
    let phase = t_us as f64 / 1e7 + f64::from(tag);
    let at = [100_000.0 + 80_000.0 * phase.sin(), 60_000.0 + 45_000.0 * (0.7 * phase).cos()];
    let round = (number % 0x1_0000) as u16;
    for (peer, position) in ANCHORS {
        let [x, y] = [0, 1].map(|axis| at[axis] - f64::from(position[axis]));
        let diagnostics = Diagnostics {
            rx_power_cdbm: -7925,
            first_path_power_cdbm: -8150,
            first_path_index_64ths: 47_712,
            first_path_amplitudes: [9000, 10_500, 8000],
            cir_power: 12_000,
            preamble_count: 118,
            noise_deviation: 52,
            clock_offset_cppm: -235,
        };
        let range = Range {
            t_us,
            round,
            peer,
            distance_tenth_mm: x.hypot(y) as i32,
            deviation_tenth_mm: 350,
            position_tenth_mm: Some(position),
            diagnostics,
        };
        put(&range.into(), to);
    }
    let outcome = Outcome::Position {
        position_tenth_mm: [at[0] as i32, at[1] as i32, now_tenths()],
        deviation_tenth_mm: [1500, 1000, 3000],
        correlation_127ths: [32, 0, 0],
        used: 0b1111,
        quality_255ths: 230,
    };
    put(&Fix { t_us, round, age_us: 2000, asked: 4, outcome, solver: Solver::Track, doubt: Doubt::None }.into(), to);
}

fn put(message: &Message, to: &mut Vec<u8>) {
    to.extend_from_slice(encode(message, &mut [0; MAX_FRAME]));
}

/// Sends the rounds of many tags, a datagram each, for a time. Each tag has a socket of its own, and its turn in the
/// round of all.
///
/// # Errors
/// There is no socket, or nobody takes datagrams.
pub fn send(to: SocketAddr, tags: u16, rate_hz: f64, time: Duration) -> Result<()> {
    let sockets = (0..tags).map(|_| UdpSocket::bind("127.0.0.1:0")).collect::<std::io::Result<Vec<_>>>();
    let sockets = sockets.context("no socket for each tag")?;
    let begun = Instant::now();
    let mut datagram = Vec::new();
    for number in 0.. {
        for (turn, (tag, socket)) in (0x1001..).zip(&sockets).enumerate() {
            let share = turn as f64 / f64::from(tags);
            let due = Duration::from_secs_f64((number as f64 + share) / rate_hz);
            if due > time {
                return Ok(());
            }
            std::thread::sleep(due.saturating_sub(begun.elapsed()));
            let t_us = u64::try_from(begun.elapsed().as_micros())?;
            datagram.clear();
            if number % HELLO_EVERY == 0 {
                hello(tag, t_us, &mut datagram);
            }
            round(tag, number, t_us, &mut datagram);
            socket.send_to(&datagram, to).context("a datagram cannot be sent")?;
        }
    }
    Ok(())
}
