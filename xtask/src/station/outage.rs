//! PostgreSQL killed under a station that runs: what the station has acknowledged is there afterwards, what came
//! meanwhile is written, and it is back soon.

use std::collections::{HashMap, HashSet};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;

use super::Postgres;
use super::server::Server;

/// The station writes and reads again within this time after the database is back.
const BACK: Duration = Duration::from_secs(5);
/// How long the database is away: long enough that the station's pauses between two tries are at their longest.
const AWAY: Duration = Duration::from_secs(8);
/// Positions of each tag before the kill.
const BEFORE: usize = 50;
/// The tags of the simulation.
const TAGS: [&str; 5] = ["0x1001", "0x1002", "0x1003", "0x1004", "0x1005"];
/// The longest time between two positions of a simulated tag, which has some fifty a second.
const STEP_MS: i64 = 1000;
/// Milliseconds of a day.
const DAY_MS: i64 = 86_400_000;
/// A room that is drawn just before the kill.
const ROOM: (&str, &str) = (
    "/api/v1/rooms/simulation/drawn",
    r#"{"site":"simulation","name":"drawn","kind":"zone","corners_m":[[0,0],[1,0],[1,1]],"alarm":false}"#,
);

/// Kills the database while the station writes and is read, starts it again, and compares.
///
/// # Errors
/// Something that was acknowledged is lost, a position that came meanwhile is missing, or the station is late.
pub fn survived(database: &Postgres) -> Result<()> {
    let station = Server::start(&["--simulate", "--store", &database.url()], ("unused", ""))?;
    let known = station.wait("positions", |station| {
        let histories = TAGS.map(|tag| Ok((tag, history(station, tag)?)));
        let histories = histories.into_iter().collect::<Result<HashMap<_, _>>>()?;
        let is_long = |rows: &Option<Vec<Value>>| rows.as_ref().is_some_and(|rows| rows.len() >= BEFORE);
        Ok(histories.values().all(is_long).then_some(histories))
    })?;
    let (status, said) = station.ask("PUT", ROOM.0, ROOM.1)?;
    ensure!(status < 300, "a room is refused with {status}: {said}");
    database.kill()?;
    let killed = Instant::now();
    station.wait("a refusal", |station| Ok(history(station, TAGS[0])?.is_none().then_some(())))?;
    let tags = station.json("/api/v1/tags?site=simulation")?.context("no live state without the database")?;
    ensure!(tags.as_array().is_some_and(|tags| tags.len() == TAGS.len()), "live tags without the database: {tags}");
    thread::sleep(AWAY.saturating_sub(killed.elapsed()));
    database.serve_again()?;
    let back = Instant::now();
    let tags = station.json("/api/v1/tags?site=simulation")?.context("no live state")?;
    let since = tags.as_array().into_iter().flatten().find(|tag| tag["tag"] == TAGS[0]);
    let since = since.and_then(|tag| tag.get("last_position")).map(time_ms).context("no position")??;
    station.wait("rows after the outage", |station| {
        let rows = history(station, TAGS[0])?.unwrap_or_default();
        let newest = rows.first().map(time_ms).transpose()?;
        Ok(newest.filter(|newest| (1..DAY_MS / 2).contains(&since_ms(*newest, since))))
    })?;
    let late = back.elapsed();
    ensure!(late < BACK, "the station is back {:.1} s after the database", late.as_secs_f64());
    let rooms = station.json("/api/v1/rooms?site=simulation")?.context("no rooms")?;
    ensure!(rooms.to_string().contains("\"drawn\""), "the room that was acknowledged is lost: {rooms}");
    let metrics = station.ask("GET", "/metrics", "")?.1;
    let dropped = metrics.lines().find(|line| line.starts_with("baliza_rows_dropped_total "));
    ensure!(dropped == Some("baliza_rows_dropped_total 0"), "rows were dropped: {dropped:?}");
    let mut kept = 0;
    for tag in TAGS {
        let rows = history(&station, tag)?.context("no history")?;
        let now: HashSet<String> = rows.iter().map(Value::to_string).collect();
        let before = known[tag].iter().flatten();
        let lost: Vec<&Value> = before.filter(|row| !now.contains(&row.to_string())).collect();
        ensure!(lost.is_empty(), "{tag}: {} rows that were read are lost: {lost:?}", lost.len());
        let times = rows.iter().map(time_ms).collect::<Result<Vec<i64>>>()?;
        let gap_ms = times.windows(2).map(|pair| since_ms(pair[0], pair[1])).max().unwrap_or(0);
        ensure!(gap_ms < STEP_MS, "{tag}: no position for {gap_ms} ms");
        kept += rows.len();
    }
    station.stop()?;
    println!(
        "PostgreSQL was killed and away for {} s: {kept} positions, none lost; back after {:.1} s",
        AWAY.as_secs(),
        late.as_secs_f64()
    );
    Ok(())
}

/// The history of a tag, newest first; None: it is refused.
fn history(station: &Server, tag: &str) -> Result<Option<Vec<Value>>> {
    let path = format!("/api/v1/tags/{tag}/positions?site=simulation&limit=10000");
    let rows = station.json(&path)?;
    Ok(rows.map(|rows| rows.as_array().cloned().unwrap_or_default()))
}

/// The time of the day of a row, whose `t` is like `2026-11-22T21:27:01.25Z`.
fn time_ms(row: &Value) -> Result<i64> {
    let text = row["t"].as_str().and_then(|text| text.split_once('T')?.1.strip_suffix('Z'));
    let parts = text.map(|text| text.splitn(3, ':').map(str::parse::<f64>).collect::<Result<Vec<_>, _>>());
    match parts.transpose()?.as_deref() {
        Some([hours, minutes, seconds]) => Ok((1000.0 * (3600.0 * hours + 60.0 * minutes + seconds)) as i64),
        _ => bail!("no time: {row}"),
    }
}

/// From one time of the day to a later one, beyond midnight where necessary.
fn since_ms(later: i64, earlier: i64) -> i64 {
    (later - earlier).rem_euclid(DAY_MS)
}
