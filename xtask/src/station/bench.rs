//! What the station takes and costs: frames a second, processor time of many tags, memory over a day, and how old a
//! position is when a listener and the page have it.
//!
//! The station is `baliza serve`, built with optimisation, and is looked at from outside: by its metrics, and by the
//! processor time and the memory that the kernel counts. The machine may have other work, and the load is made on it as
//! well: processor time says more than time.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use super::BALIZA;
use super::load::{self, FRAMES};
use super::server::{self, Server};
use crate::promises::Made;
use crate::{printed, root};

/// The kernel's unit of processor time (`USER_HZ`), a second.
const TICKS: f64 = 100.0;
/// Frames through standard input, for the rate.
const FRAMES_AT_ONCE: usize = 2_000_000;
/// A day of 20 tags that send a round each second.
const DAY: (u16, u64) = (20, 86_400);
/// The day is cut into this number of parts, after each of which the memory is read.
const PARTS: u64 = 24;
/// How long many tags send.
const TIME: Duration = Duration::from_secs(20);

/// The table of the document.
///
/// # Errors
/// The program cannot be built or started, or loses positions.
pub fn made() -> Result<Made> {
    let program = match std::env::var_os(BALIZA) {
        Some(program) => PathBuf::from(program),
        None => server::optimised()?,
    };
    let mut table = String::from("| what | measured | wanted |\n|---|---:|---:|\n");
    let mut row = |what: &str, measured: String, wanted: &str| -> Result<()> {
        eprintln!("{what}: {measured}");
        Ok(writeln!(table, "| {what} | {measured} | {wanted} |")?)
    };
    let (per_cpu_s, per_s) = frames(&program)?;
    row(
        "telemetry frames a second of processor time, wire to SQLite; per second of the clock",
        format!("{per_cpu_s:.0}; {per_s:.0}"),
        "200,000 on two cores",
    )?;
    let share = many(&program, 1000, 10.0)?;
    row("1,000 tags at 10 Hz with four ranges each: share of a core", format!("{:.0} %", 100.0 * share), "25 %")?;
    let [first, last, most] = day(&program)?;
    row(
        "the frames of a day of 20 tags at 1 Hz: memory after an hour, at the end, at most",
        format!("{first:.0}, {last:.0}, {most:.0} MB"),
        "flat",
    )?;
    let ages = latency(&program, 100, 10.0)?;
    row("100 tags at 10 Hz, datagram to WebSocket: P50, P99", format!("{:.1}, {:.1} ms", ages[0], ages[1]), "100 ms")?;
    let ages = to_page(&program, 100, 10.0)?;
    row(
        "100 tags at 10 Hz, datagram to a frame of the page: P50, P99",
        format!("{:.1}, {:.1} ms", ages[0], ages[1]),
        "100 ms",
    )?;
    Ok(Made::one("station", table))
}

/// What a frame of the map costs.
///
/// # Errors
/// npm or Chromium is missing.
pub fn page() -> Result<Made> {
    let mut table = String::from(
        "| on the map | main thread a frame, ms | script of it, ms | frames a second | wanted |\n|---|---:|---:|---:|---:|\n",
    );
    for Frames { tags, rate_hz, main_thread_ms, script_ms, frames_per_s } in cost_of_frames()? {
        let wanted = if tags > 100 { 20 } else { 60 };
        writeln!(
            table,
            "| {tags} tags at {rate_hz} Hz | {main_thread_ms:.1} | {script_ms:.1} | {frames_per_s:.0} | {wanted} |"
        )?;
    }
    Ok(Made::one("page", table))
}

/// A number of the station's metrics.
fn metric(station: &Server, name: &str) -> Result<f64> {
    let metrics = station.ask("GET", "/metrics", "")?.1;
    let found = metrics.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    found.and_then(|value| value.parse().ok()).with_context(|| format!("no {name} in the metrics"))
}

/// Waits until this number of positions is written.
fn written(station: &Server, positions: f64) -> Result<()> {
    station.wait("all positions in the store", |station| {
        Ok((metric(station, "baliza_positions_total")? >= positions && metric(station, "baliza_rows_backlog")? == 0.0)
            .then_some(()))
    })
}

/// Processor time of a process so far, seconds.
fn cpu_s(station: &Server) -> Result<f64> {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", station.id()))?;
    // The second field is a name in brackets; user and system time are the 14th and the 15th (proc(5)).
    let fields = stat.rsplit_once(')').context("no name")?.1.split_whitespace().collect::<Vec<_>>();
    let ticks = |field: usize| fields.get(field - 3).and_then(|ticks| ticks.parse::<f64>().ok()).context("no time");
    Ok((ticks(14)? + ticks(15)?) / TICKS)
}

/// Memory of a process, MB: now and at most (`VmRSS`, `VmHWM`).
fn memory_mb(station: &Server) -> Result<[f64; 2]> {
    let status = std::fs::read_to_string(format!("/proc/{}/status", station.id()))?;
    let read = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
        Ok::<_, anyhow::Error>(kilobytes.with_context(|| format!("no {name}"))? / 1000.0)
    };
    Ok([read("VmRSS:")?, read("VmHWM:")?])
}

/// Frames through standard input, as fast as they are taken: per second of processor time, and per second.
fn frames(program: &Path) -> Result<(f64, f64)> {
    const TAGS: u16 = 100;
    let rounds = FRAMES_AT_ONCE / (FRAMES + 1);
    let mut bytes = Vec::new();
    for number in 0..rounds as u64 {
        let (tag, t_us) = (0x1001 + (number % u64::from(TAGS)) as u16, 1000 * number);
        load::hello(tag, t_us, &mut bytes);
        load::round(tag, number, t_us, &mut bytes);
    }
    let mut station = Server::run(program, &["--store", "frames.db", "-"], ("unused", ""))?;
    let mut input = station.input()?;
    let (begun, before) = (Instant::now(), cpu_s(&station)?);
    input.write_all(&bytes)?;
    written(&station, rounds as f64)?;
    let (time, cpu) = (begun.elapsed().as_secs_f64(), cpu_s(&station)? - before);
    drop(input);
    station.stop()?;
    let frames = ((FRAMES + 1) * rounds) as f64;
    Ok((frames / cpu, frames / time))
}

/// The share of a core that this number of tags takes, each with datagrams of its own.
fn many(program: &Path, tags: u16, rate_hz: f64) -> Result<f64> {
    let (station, to) = with_datagrams(program)?;
    load::send(to, tags, rate_hz, Duration::from_secs(3))?;
    let (before, had) = (cpu_s(&station)?, metric(&station, "baliza_positions_total")?);
    let begun = Instant::now();
    load::send(to, tags, rate_hz, TIME)?;
    let (time, cpu) = (begun.elapsed().as_secs_f64(), cpu_s(&station)? - before);
    let positions = metric(&station, "baliza_positions_total")? - had;
    let sent = f64::from(tags) * rate_hz * time;
    ensure!(positions > 0.98 * sent, "of {sent:.0} positions, {positions:.0} came: the machine is too busy");
    station.stop()?;
    Ok(cpu / time)
}

/// A day's frames through standard input: the memory after an hour, at the end, and at most, MB.
fn day(program: &Path) -> Result<[f64; 3]> {
    let (tags, seconds) = DAY;
    let mut station = Server::run(program, &["--store", "day.db", "-"], ("unused", ""))?;
    let mut input = station.input()?;
    let (mut bytes, mut rounds, mut first) = (Vec::new(), 0_u64, None);
    for part in 0..PARTS {
        for second in part * seconds / PARTS..(part + 1) * seconds / PARTS {
            bytes.clear();
            for tag in 0x1001..=0x1000 + tags {
                let t_us = 1_000_000 * second + u64::from(tag);
                load::hello(tag, t_us, &mut bytes);
                load::round(tag, second, t_us, &mut bytes);
                rounds += 1;
            }
            input.write_all(&bytes)?;
        }
        written(&station, rounds as f64)?;
        let [now, most] = memory_mb(&station)?;
        eprintln!("hour {}: {now:.1} MB, at most {most:.1} MB", part + 1);
        first.get_or_insert(now);
    }
    let [now, most] = memory_mb(&station)?;
    drop(input);
    station.stop()?;
    Ok([first.unwrap_or(now), now, most])
}

/// Ages of positions at a WebSocket, milliseconds: P50 and P99.
fn latency(program: &Path, tags: u16, rate_hz: f64) -> Result<[f64; 2]> {
    let (station, to) = with_datagrams(program)?;
    let mut socket = TcpStream::connect(&station.address)?;
    socket.set_read_timeout(Some(Duration::from_secs(30)))?;
    write!(
        socket,
        "GET /api/v1/live HTTP/1.1\r\nHost: {}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
        station.address
    )?;
    let mut from = BufReader::new(socket);
    let mut line = String::new();
    while line != "\r\n" {
        line.clear();
        ensure!(from.read_line(&mut line)? > 0, "no WebSocket");
    }
    let ended = AtomicBool::new(false);
    let mut ages = thread::scope(|scope| {
        let sending = scope.spawn(|| {
            let sent = load::send(to, tags, rate_hz, TIME);
            ended.store(true, Ordering::Relaxed);
            sent
        });
        let mut ages = Vec::new();
        while !ended.load(Ordering::Relaxed) {
            let text = message(&mut from)?;
            let position: Option<Position> = serde_json::from_slice(&text).ok();
            if let Some(Position { z_m: Some(height_m) }) = position {
                ages.push(load::age_ms(height_m));
            }
        }
        sending.join().map_err(|_| anyhow::anyhow!("the load has failed"))??;
        Ok::<_, anyhow::Error>(ages)
    })?;
    station.stop()?;
    // The first seconds have the start of the load.
    let ages = ages.split_off(ages.len() / 10);
    percentiles(ages)
}

/// What of a position is read.
#[derive(Deserialize)]
struct Position {
    z_m: Option<f64>,
}

/// The payload of the next frame of a WebSocket (RFC 6455, section 5.2); a server does not mask.
fn message(from: &mut impl Read) -> Result<Vec<u8>> {
    let mut head = [0; 2];
    from.read_exact(&mut head)?;
    let length = match head[1] & 0x7F {
        126 => {
            let mut length = [0; 2];
            from.read_exact(&mut length)?;
            u64::from(u16::from_be_bytes(length))
        }
        127 => {
            let mut length = [0; 8];
            from.read_exact(&mut length)?;
            u64::from_be_bytes(length)
        }
        length => length.into(),
    };
    let mut payload = vec![0; usize::try_from(length)?];
    from.read_exact(&mut payload)?;
    Ok(payload)
}

fn percentiles(mut values: Vec<f64>) -> Result<[f64; 2]> {
    ensure!(values.len() > 1000, "only {} positions came", values.len());
    values.sort_by(f64::total_cmp);
    Ok([0.50, 0.99].map(|share| baliza_report::percentile(&values, share)))
}

/// Ages of positions at the first frame of the page that may show them, milliseconds: P50 and P99.
fn to_page(program: &Path, tags: u16, rate_hz: f64) -> Result<[f64; 2]> {
    let (station, to) = with_datagrams(program)?;
    let url = format!("http://{}", station.address);
    let ages: Vec<f64> = thread::scope(|scope| {
        let sending = scope.spawn(|| load::send(to, tags, rate_hz, 3 * TIME));
        let ages = npm(&["ages", "--", &url, &TIME.as_secs().to_string()])?;
        sending.join().map_err(|_| anyhow::anyhow!("the load has failed"))??;
        Ok::<_, anyhow::Error>(serde_json::from_str(&ages)?)
    })?;
    station.stop()?;
    percentiles(ages)
}

/// What a frame of the map costs.
#[derive(Deserialize)]
struct Frames {
    tags: u32,
    rate_hz: f64,
    main_thread_ms: f64,
    script_ms: f64,
    frames_per_s: f64,
}

fn cost_of_frames() -> Result<Vec<Frames>> {
    npm(&["frames"])?.lines().map(|line| serde_json::from_str(line).with_context(|| line.to_owned())).collect()
}

fn npm(words: &[&str]) -> Result<String> {
    printed(Command::new("npm").args(["run", "--silent"]).args(words).current_dir(root().join("station/web")))
        .context("npm, and `npm ci` in station/web, are needed")
}

/// A station that takes datagrams, and where.
fn with_datagrams(program: &Path) -> Result<(Server, SocketAddr)> {
    let to = UdpSocket::bind("127.0.0.1:0").and_then(|free| free.local_addr()).context("no free port")?;
    let station = Server::run(program, &["--store", "tags.db", &format!("udp:{to}")], ("unused", ""))?;
    Ok((station, to))
}
