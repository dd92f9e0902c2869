//! A process that is killed while it writes; a disk that is full; a database that another process locks.

use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

use super::*;

/// Positions of a batch, one a second.
const BATCH: i64 = 50;

/// Starts this test binary again as the process that writes, and kills it after some acknowledgements. The number of
/// the last batch that it acknowledged.
fn write_and_kill(url: &str, acknowledgements: usize) -> i64 {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "store::tests::crash::writes_until_it_is_killed", "--ignored", "--nocapture"])
        .env("BALIZA_TEST_STORE", url)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(std::result::Result::ok);
    let mut last = None;
    for (count, line) in lines.filter_map(|line| line.strip_prefix("written ")?.parse().ok()).enumerate() {
        last = Some(line);
        if count + 1 == acknowledgements {
            child.kill().unwrap();
        }
    }
    assert!(!child.wait().unwrap().success());
    last.unwrap()
}

#[tokio::test]
#[ignore = "the process that the test of a crash starts"]
async fn writes_until_it_is_killed() {
    let Ok(url) = std::env::var("BALIZA_TEST_STORE") else { return };
    let store = Store::open(&url).await.unwrap();
    for batch in store.last_event().await.unwrap().. {
        let positions: Vec<_> = (batch * BATCH..(batch + 1) * BATCH).map(|s| position("a", s * 1000)).collect();
        store.write(&positions, &[event(batch + 1, batch, EventKind::Moved)]).await.unwrap();
        writeln!(std::io::stdout(), "\nwritten {batch}").unwrap();
        store.compact(at((batch + 1) * BATCH * 1000)).await.unwrap();
    }
}

on_both! {
    async fn what_was_acknowledged_survives_a_kill_of_the_process(place) {
        for acknowledgements in [1, 7, 40] {
            let url = place.url.clone();
            let last = tokio::task::spawn_blocking(move || write_and_kill(&url, acknowledgements)).await.unwrap();
            let store = place.open().await;
            // Each batch has one event, and is there as a whole: the acknowledged ones, and perhaps one more.
            let batches = store.last_event().await.unwrap();
            assert!(batches > last, "{last} was acknowledged, {batches} are there");
            let read = store.positions("hall", "a", EVER(), u32::MAX).await.unwrap();
            assert_eq!(times(&read), (0..batches * BATCH).rev().map(|s| s * 1000).collect::<Vec<_>>());
            store.close().await;
        }
    }

    async fn a_transaction_that_the_database_ended_by_itself_spoils_no_connection(place) {
        let store = place.open().await;
        for _ in 0..8 {
            let mut writing = store.begin().await.unwrap();
            // As SQLite does where the disk is full; what sqlx rolls back afterwards is no transaction.
            sqlx::raw_sql("ROLLBACK").execute(&mut *writing.tx).await.unwrap();
        }
        store.write(&[position("a", 1000)], &[]).await.unwrap();
        assert_eq!(store.positions("hall", "a", EVER(), u32::MAX).await.unwrap().len(), 1);
        store.close().await;
    }
}

/// Runs a statement on each of a SQLite store's connections.
async fn on_all_connections(store: &Store, statement: &'static str) {
    let mut connections = Vec::new();
    while connections.len() < 4 {
        connections.push(store.pool.acquire().await.unwrap());
    }
    for connection in &mut connections {
        sqlx::raw_sql(statement).execute(&mut **connection).await.unwrap();
    }
}

/// A store of 500 positions refuses three batches more where its connections have this setting, and has nothing of them.
/// After `back` it takes them, once each.
async fn assert_comes_back(store: &Store, setting: &'static str, back: impl Future<Output = ()>) {
    let batch = |number: i64| (0..500).map(|s| position("a", (500 * number + s) * 1000)).collect::<Vec<_>>();
    let batches = [1, 2, 3].map(|number| (number, batch(number)));
    // More often than there are connections.
    for (number, batch) in &batches {
        for _ in 0..3 {
            on_all_connections(store, setting).await;
            let refused = store.write(batch, &[event(*number, 0, EventKind::Moved)]).await;
            assert!(matches!(refused, Err(StoreError::Database(_))), "{refused:?}");
        }
    }
    let before = store.positions("hall", "a", EVER(), u32::MAX).await.unwrap();
    assert_eq!((before.len(), store.last_event().await.unwrap()), (500, 0));
    back.await;
    for (number, batch) in &batches {
        assert_eq!(store.write(batch, &[event(*number, 0, EventKind::Moved)]).await.unwrap(), 0);
    }
    let after = store.positions("hall", "a", EVER(), u32::MAX).await.unwrap();
    assert_eq!(times(&after), (0..2000).rev().map(|s| s * 1000).collect::<Vec<_>>());
    assert_eq!(store.last_event().await.unwrap(), 3);
}

/// A store with the first 500 positions.
async fn begun(place: &Place) -> Store {
    let store = place.open().await;
    let first: Vec<_> = (0..500).map(|s| position("a", s * 1000)).collect();
    store.write(&first, &[]).await.unwrap();
    store
}

#[tokio::test]
async fn a_disk_that_was_full_is_written_again() {
    let place = Place::sqlite();
    let store = begun(&place).await;
    // SQLITE_FULL, as where the disk is full: there is no other page.
    let back = on_all_connections(&store, "PRAGMA max_page_count = 4294967294");
    assert_comes_back(&store, "PRAGMA max_page_count = 1", back).await;
}

#[tokio::test]
async fn a_database_that_another_process_locked_is_written_again() {
    let place = Place::sqlite();
    let store = begun(&place).await;
    let other = place.open().await;
    let writing = other.begin().await.unwrap();
    assert!(store.is_well().await, "who reads does not wait");
    assert_comes_back(&store, "PRAGMA busy_timeout = 0", async { writing.tx.rollback().await.unwrap() }).await;
}
