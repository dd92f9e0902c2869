//! Bytes and times, with positions as a hall of 100 m by 60 m gives them.

use std::time::Instant;

use super::*;

/// A day of 100 tags at 10 Hz, 86.4 million positions, in 4 GB.
const BYTES_A_POSITION: f64 = 4e9 / 86.4e6;

/// 100 tags at 10 Hz, tenth `i` of a second after the beginning of 2026.
fn tenth(i: i64) -> impl Iterator<Item = TagPosition> {
    (0..100).map(move |tag| {
        // Numbers without a pattern: a multiplicative hash (Knuth, volume 3, section 6.4).
        let random = u64::try_from(i * 100 + tag).unwrap().wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let part = |shift: u32, most: u32| f64::from((random >> shift) as u32 % most) / 1000.0;
        TagPosition {
            t: at(i * 100 + tag % 90),
            x_m: part(32, 100_000),
            y_m: part(24, 60_000),
            z_m: Some(part(16, 3_000)),
            sigma_x_m: 0.03 + part(28, 300),
            sigma_y_m: 0.03 + part(20, 300),
            sigma_z_m: Some(0.1 + part(12, 900)),
            cov_xy_m2: (part(8, 2000) - 1.0) * 0.001,
            room: Some(format!("room {}", tag % 20)),
            ..position(&format!("0x{:04x}", 0x1000 + tag), 0)
        }
    })
}

/// Writes tenths of a second as the hub does, compacting each minute; the time that each of both took.
async fn write(store: &Store, tenths: i64, at_once: usize) -> [Duration; 2] {
    let mut took = [Duration::ZERO; 2];
    for minute in 0..(tenths + 599) / 600 {
        let rows: Vec<_> = (minute * 600..tenths.min((minute + 1) * 600)).flat_map(tenth).collect();
        let start = Instant::now();
        for some in rows.chunks(at_once) {
            store.write(some, &[]).await.unwrap();
        }
        took[0] += start.elapsed();
        let start = Instant::now();
        store.compact(at((minute + 1) * 60_000 + 5_000)).await.unwrap();
        took[1] += start.elapsed();
    }
    took
}

/// Bytes of the file that hold something, and its free pages.
async fn bytes(store: &Store) -> [i64; 2] {
    sqlx::raw_sql("PRAGMA wal_checkpoint(TRUNCATE)").execute(&store.pool).await.unwrap();
    let value = async |pragma: &'static str| sqlx::query_scalar::<_, i64>(pragma).fetch_one(&store.pool).await.unwrap();
    let page = value("PRAGMA page_size").await;
    let free = value("PRAGMA freelist_count").await;
    [(value("PRAGMA page_count").await - free) * page, free * page]
}

#[tokio::test]
async fn a_day_of_100_tags_at_10_hz_fits_into_4_gb() {
    let place = Place::sqlite();
    let store = place.open().await;
    write(&store, 2000, 5000).await;
    let [used, free] = bytes(&store).await;
    let each = used as f64 / 200_000.0;
    assert!(each <= BYTES_A_POSITION, "{each} bytes a position");
    // The pages of `recent` are used again: no more of them than a minute's rows need.
    assert!(free as f64 <= 60_000.0 * 2.0 * BYTES_A_POSITION, "{free} free bytes");
    let file = std::fs::metadata(&place.url).unwrap().len();
    assert_eq!(i64::try_from(file).unwrap(), used + free);
}

#[tokio::test]
async fn a_day_of_the_health_of_8_anchors_fits_into_1_mb() {
    let place = Place::sqlite();
    let store = place.open().await;
    let [empty, _] = bytes(&store).await;
    for minute in 0..1440 {
        let rows: Vec<_> = (1..=8).map(|anchor| health(&format!("0x010{anchor}"), minute * 60_000)).collect();
        store.write_health(&rows).await.unwrap();
    }
    let [used, _] = bytes(&store).await;
    assert!(used - empty <= 1_000_000, "{} bytes", used - empty);
}

#[tokio::test]
#[ignore = "measures; with optimisation: cargo test --release -p baliza-station -- --ignored --nocapture measures"]
async fn measures_an_hour_of_100_tags_at_10_hz() {
    let place = match std::env::var("BALIZA_TEST_POSTGRES") {
        Ok(database) => Place::postgres(database).await,
        Err(_) => Place::sqlite(),
    };
    let store = place.open().await;
    let rows = 3_600_000.0;
    let [writing, compacting] = write(&store, 36_000, 20_000).await;
    println!("write {:.0} rows/s, compact {:.0} rows/s", rows / writing.as_secs_f64(), rows / compacting.as_secs_f64());
    if place.schema.is_none() {
        println!("{:.1} bytes a position", bytes(&store).await[0] as f64 / rows);
    }
    let mut slowest = Duration::ZERO;
    for tag in 0..100 {
        let start = Instant::now();
        let tag = format!("0x{:04x}", 0x1000 + tag);
        let read = store.positions("hall", &tag, span(0, 3_600_000), 100_000).await.unwrap();
        slowest = slowest.max(start.elapsed());
        assert_eq!(read.len(), 36_000);
    }
    println!("a tag's hour: {slowest:?} at most");
    for step in [1, 10, 60] {
        let start = Instant::now();
        let read = store.replay("hall", span(0, 3_600_000), Duration::from_secs(step), 1_000_000).await.unwrap();
        assert_eq!(read.len() as u64, 100 * 3600 / step);
        println!("a replay of the hour, one each {step} s: {:?} for {} positions", start.elapsed(), read.len());
    }
    let start = Instant::now();
    store.retain(Retention { thin_after: Some(Duration::ZERO), ..Retention::default() }, at(3_700_000)).await.unwrap();
    println!("thinning of the hour: {:?}", start.elapsed());
    // The figure of SQLite, which has no network in between.
    assert!(place.schema.is_some() || slowest <= Duration::from_millis(200), "{slowest:?}");
    place.remove().await;
}
