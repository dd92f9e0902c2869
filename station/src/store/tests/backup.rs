//! Back-up, restoring, upgrade.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64};

use sqlx::migrate::Migrator;

use super::measurements::{RANGE, measurement, node};
use super::*;
use crate::model::{
    Campaign, CampaignPoint, FloorPlan, HealthFigures, MeasuredValue, NodeHealth, NodeMeasurement, NodeRole,
    PlacedNode, SiteMap, SurveySample, TagStatus, Zone, ZoneKind,
};
use crate::store::migrations::migrations;

/// A place of the same engine, empty.
async fn another(place: &Place) -> Place {
    match &place.schema {
        Some((database, _)) => Place::postgres(database.clone()).await,
        None => Place::sqlite(),
    }
}

fn name(file: &Path) -> &str {
    file.to_str().unwrap()
}

/// Nothing half is left in the folder of a place.
fn assert_no_parts(folder: &Path) {
    let names: Vec<_> = folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(names.iter().all(|name| !name.to_string_lossy().contains(".part")), "{names:?}");
}

/// All that the store answers.
type Answers = (
    Vec<TagStatus>,
    Vec<TagPosition>,
    Vec<StationEvent>,
    Vec<SiteMap>,
    Vec<u8>,
    Vec<Zone>,
    Vec<PlacedNode>,
    Vec<Campaign>,
    Vec<SurveySample>,
    Vec<NodeHealth>,
    Vec<NodeMeasurement>,
    Vec<PlacedNode>,
);

async fn answers(store: &Store) -> Answers {
    (
        store.tags().await.unwrap(),
        store.positions("hall", "a", EVER(), u32::MAX).await.unwrap(),
        store.events(None, EVER(), &[], None, u32::MAX).await.unwrap(),
        store.sites().await.unwrap(),
        store.picture("hall").await.unwrap(),
        store.zones().await.unwrap(),
        store.nodes().await.unwrap(),
        store.campaigns().await.unwrap(),
        store.samples("survey", "p1", 0, u32::MAX).await.unwrap(),
        store.health("hall", "0x0101", EVER(), u32::MAX).await.unwrap(),
        store.measurements("hall", EVER()).await.unwrap(),
        store.peers("hall").await.unwrap(),
    )
}

/// Something of everything; positions both in `history` and in `recent`, more than are copied at once.
async fn fill(store: &Store) {
    let rows: Vec<_> = (0..5000)
        .map(|i| TagPosition {
            z_m: (i % 2 == 0).then_some(-1.5),
            sigma_z_m: (i % 2 == 0).then_some(0.25),
            room: (i % 3 == 0).then(|| "lab \u{1f9ed}; 'x'".to_owned()),
            ..position("a", i * 100)
        })
        .collect();
    store.write(&rows, &[event(1, 5, EventKind::Entered)]).await.unwrap();
    store.compact(at(100_000)).await.unwrap();
    let bare = StationEvent { zone: None, dwell_s: None, alarm: false, ..event(2, 6, EventKind::Moved) };
    store.write(&[position("b", 600_000)], &[bare]).await.unwrap();
    let site = SiteMap { walls_m: vec![[[0.0, 0.1], [5.0, 0.3]]], ..SiteMap::new("hall") };
    store.put_site(&site).await.unwrap();
    store.put_site(&SiteMap { name: "bare".to_owned(), ..site }).await.unwrap();
    let plan = FloorPlan {
        origin_m: [0.1, -2.0],
        metres_per_pixel: 0.01,
        rotation_rad: 0.0,
        width_px: 10,
        height_px: 20,
        media_type: "image/png".to_owned(),
    };
    store.put_plan("hall", &plan, Some(&[0, 1, 255, 0, 10])).await.unwrap();
    let origin = r#"{"latitude_deg": -33.8568, "longitude_deg": 151.2153, "y_azimuth_deg": 30}"#;
    store.put_geographic_origin("hall", Some(&serde_json::from_str(origin).unwrap())).await.unwrap();
    let corners_m = vec![[0.0, 0.0], [1.0, 0.0], [0.1, 2.0]];
    let zone = Zone { site: "hall".to_owned(), name: "lab".to_owned(), kind: ZoneKind::Zone, corners_m, alarm: true };
    store.put_zone(&zone).await.unwrap();
    for (node, rssi_1m_dbm, path_loss_exponent) in [("1-1", Some(-59.5), None), ("1-2", None, Some(2.2))] {
        let placed = PlacedNode {
            site: "hall".to_owned(),
            node: node.to_owned(),
            name: rssi_1m_dbm.map(|_| "door".to_owned()),
            role: NodeRole::Beacon,
            position_m: [0.1, 0.2, 0.3],
            rssi_1m_dbm,
            path_loss_exponent,
        };
        store.put_node(&placed).await.unwrap();
    }
    let point = |id: &str, z_m| CampaignPoint {
        id: id.to_owned(),
        x_m: 0.1 + 0.2,
        y_m: -1e-9,
        z_m,
        room: z_m.map(|_| "lab".to_owned()),
        samples: 0,
    };
    let points = vec![point("p1", Some(1.0 / 3.0)), point("p0", None)];
    let campaign = Campaign { name: "survey".to_owned(), scenario: "hall".to_owned(), created: at(1), points };
    store.create_campaign(&campaign).await.unwrap();
    let samples = [-61.0, -62.5].map(|rssi_dbm| SurveySample { beacon: "1-1".to_owned(), rssi_dbm, t_s: 0.1 });
    store.add_samples("survey", "p1", &samples).await.unwrap();
    let mut bare = health("0x0101", 60_000);
    bare.health = HealthFigures { success_rate: None, residual_mean_m: None, supply_v: None, ..bare.health };
    store.write_health(&[health("0x0101", 0), bare]).await.unwrap();
    let ranges = [measurement("a", "0x0101", 10, RANGE), measurement("b", "1-7", 20, MeasuredValue::Rssi(-60.5))];
    store.write_measurements(&ranges).await.unwrap();
    store.write_peers(&[node("0x0101", NodeRole::Anchor, Some([1.0, 2.0, 2.5]), None)]).await.unwrap();
}

on_both! {
    async fn a_back_up_is_a_store_and_never_replaces_a_file(place) {
        let store = place.open().await;
        let folder = place.folder.path();
        store.write(&[position("a", 1)], &[]).await.unwrap();
        let file = folder.join("back up.db");
        Store::back_up(&place.url, &file).await.unwrap();
        store.write(&[position("a", 2)], &[]).await.unwrap();
        assert!(matches!(Store::back_up(&place.url, &file).await, Err(StoreError::Exists(_))));
        let copy = Store::open(name(&file)).await.unwrap();
        assert_eq!(times(&copy.positions("hall", "a", EVER(), 10).await.unwrap()), [1]);
        copy.close().await;
        assert!(Store::back_up(&place.url, &folder.join("no folder/back up.db")).await.is_err());
        assert_no_parts(folder);
    }

    async fn a_restored_store_answers_as_the_one_that_was_backed_up(place) {
        let store = place.open().await;
        fill(&store).await;
        let expected = answers(&store).await;
        let file = place.folder.path().join("back-up.db");
        Store::back_up(&place.url, &file).await.unwrap();
        let before = std::fs::read(&file).unwrap();
        // To a SQLite file, and to a store of the same engine: for PostgreSQL these are both directions.
        let [sqlite, other] = [Place::sqlite(), another(place).await];
        for to in [&sqlite, &other] {
            Store::restore(&file, &to.url, place.folder.path()).await.unwrap();
            let restored = to.open().await;
            assert_eq!(answers(&restored).await, expected);
            // It goes on as a store: numbers of tags, points and events go on.
            restored.write(&[position("c", 700_000), position("a", 700_000)], &[event(3, 9, EventKind::Back)]).await.unwrap();
            assert_eq!(times(&restored.positions("hall", "c", EVER(), 10).await.unwrap()), [700_000]);
            restored.compact(at(1_000_000)).await.unwrap();
            assert_eq!(restored.positions("hall", "a", EVER(), u32::MAX).await.unwrap().len(), 5001);
            restored.close().await;
            assert_no_parts(to.folder.path());
        }
        assert_eq!(std::fs::read(&file).unwrap(), before, "the back-up was changed");
        assert_no_parts(place.folder.path());
        other.remove().await;
    }

    async fn a_back_up_of_a_store_that_is_written_holds_whole_batches(place) {
        let store = place.open().await;
        let (written, stop) = (Arc::new(AtomicI64::new(0)), Arc::new(AtomicBool::new(false)));
        let task = {
            let (store, written, stop) = (store.clone(), Arc::clone(&written), Arc::clone(&stop));
            tokio::spawn(async move {
                while !stop.load(Ordering::SeqCst) {
                    let batch = written.load(Ordering::SeqCst);
                    let rows: Vec<_> = (batch * 50..(batch + 1) * 50).map(|s| position("a", s * 1000)).collect();
                    store.write(&rows, &[event(batch + 1, batch, EventKind::Moved)]).await.unwrap();
                    store.compact(at((batch + 1) * 50_000)).await.unwrap();
                    written.fetch_add(1, Ordering::SeqCst);
                }
            })
        };
        for number in 0..3 {
            while written.load(Ordering::SeqCst) < 5 * (number + 1) {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            let acknowledged = written.load(Ordering::SeqCst);
            let file = place.folder.path().join(format!("{number}.db"));
            Store::back_up(&place.url, &file).await.unwrap();
            let copy = Store::open(name(&file)).await.unwrap();
            let batches = copy.last_event().await.unwrap();
            assert!(batches >= acknowledged, "{acknowledged} were acknowledged, {batches} are there");
            let read = copy.positions("hall", "a", EVER(), u32::MAX).await.unwrap();
            assert_eq!(times(&read), (0..batches * 50).rev().map(|s| s * 1000).collect::<Vec<_>>());
            copy.close().await;
        }
        stop.store(true, Ordering::SeqCst);
        task.await.unwrap();
    }

    async fn a_back_up_is_restored_to_an_empty_store_only(place) {
        let store = place.open().await;
        store.write(&[position("a", 1)], &[]).await.unwrap();
        let folder = place.folder.path();
        let file = folder.join("back-up.db");
        Store::back_up(&place.url, &file).await.unwrap();
        store.write(&[position("a", 2)], &[]).await.unwrap();
        let error = Store::restore(&file, &place.url, folder).await.unwrap_err();
        let is_refused = matches!(error, StoreError::Exists(_) | StoreError::Occupied("tags"));
        assert!(is_refused, "{error}");
        assert_eq!(times(&store.positions("hall", "a", EVER(), 10).await.unwrap()), [2, 1]);

        let other = another(place).await;
        let no_file = Store::restore(&folder.join("none.db"), &other.url, folder).await.unwrap_err();
        assert!(matches!(no_file, StoreError::Missing(_)), "{no_file}");
        let text = folder.join("notes.txt");
        std::fs::write(&text, "not a database, but long enough to be read as the head of one: ".repeat(20)).unwrap();
        let no_store = Store::restore(&text, &other.url, folder).await.unwrap_err();
        assert!(no_store.to_string().contains("notes.txt"), "{no_store}");
        let newer = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
                     SELECT 99, 'later', success, checksum, 0 FROM _sqlx_migrations WHERE version = 1";
        execute(&format!("sqlite://{}", file.display()).replace(' ', "%20"), newer.to_owned()).await;
        let too_new = Store::restore(&file, &other.url, folder).await.unwrap_err();
        assert!(matches!(too_new, StoreError::Newer(_)), "{too_new}");
        assert_no_parts(folder);
        assert_no_parts(other.folder.path());
        if other.schema.is_none() {
            assert!(!Path::new(&other.url).exists());
        }
        other.remove().await;
    }

    async fn every_table_is_copied(place) {
        let store = place.open().await;
        let statement = match store.engine {
            Engine::Sqlite => "SELECT name FROM sqlite_master WHERE type = 'table'",
            Engine::Postgres => "SELECT table_name::TEXT FROM information_schema.tables \
                                 WHERE table_schema = current_schema()",
        };
        let mut found: Vec<String> = sqlx::query_scalar(statement).fetch_all(&store.pool).await.unwrap();
        found.retain(|table| table != "_sqlx_migrations");
        found.sort();
        let mut copied = copy::TABLES.map(|(table, _)| table);
        copied.sort_unstable();
        assert_eq!(found, copied);
    }

    async fn a_store_of_the_first_version_is_upgraded_with_what_it_has(place) {
        let pool = of_version(place, 1).await;
        // Minute 29,453,760 since 1970 is the beginning of 2026; tag 7; 250 ms: 29453760 << 36 | 7 << 16 | 250.
        let rows = "INSERT INTO tags VALUES (7, 'hall', 'a', 1767225600250, 1767225600250);
            INSERT INTO rooms VALUES (3, 'lab');
            INSERT INTO minutes VALUES (29453760, 0);
            INSERT INTO history VALUES (2024046975108186362, 1500, -250, NULL, 100, 200, NULL, 0, 3, 5);
            INSERT INTO events VALUES (41, 1767225600250000, 'hall', 'entered', 'a', 'lab', NULL, 0);";
        sqlx::raw_sql(rows).execute(&pool).await.unwrap();
        pool.close().await;
        let expected = TagPosition {
            x_m: 1.5,
            y_m: -0.25,
            room: Some("lab".to_owned()),
            used: 5,
            ..position("a", 250)
        };
        let file = place.folder.path().join("back-up.db");
        Store::back_up(&place.url, &file).await.unwrap();
        let store = place.open().await;
        assert_eq!(store.positions("hall", "a", EVER(), 10).await.unwrap(), std::slice::from_ref(&expected));
        assert_eq!(store.last_event().await.unwrap(), 41);
        // A back-up of that version, too.
        let other = another(place).await;
        Store::restore(&file, &other.url, place.folder.path()).await.unwrap();
        assert_eq!(other.open().await.positions("hall", "a", EVER(), 10).await.unwrap(), [expected]);
        other.remove().await;
    }

    async fn a_store_of_the_second_version_is_upgraded_with_what_it_has(place) {
        let pool = of_version(place, 2).await;
        let rows = "INSERT INTO sites (name, walls) VALUES ('hall', '[[[0.0,0.5],[5.0,0.25]]]');
            INSERT INTO nodes VALUES ('hall', '1-7', NULL, 'beacon', 1.5, -2.0, 0.25, NULL, 2.5);";
        sqlx::raw_sql(rows).execute(&pool).await.unwrap();
        pool.close().await;
        let other = restored(place).await;
        for store in [place.open().await, other.open().await] {
            let hall = SiteMap { walls_m: vec![[[0.0, 0.5], [5.0, 0.25]]], ..SiteMap::new("hall") };
            assert_eq!(store.sites().await.unwrap(), std::slice::from_ref(&hall));
            assert_eq!(store.nodes().await.unwrap()[0].position_m, [1.5, -2.0, 0.25]);
            let origin = r#"{"latitude_deg": 40.5, "longitude_deg": -3.75, "y_azimuth_deg": 0}"#;
            let geographic_origin = Some(serde_json::from_str(origin).unwrap());
            store.put_geographic_origin("hall", geographic_origin.as_ref()).await.unwrap();
            assert_eq!(store.sites().await.unwrap(), [SiteMap { geographic_origin, ..hall }]);
        }
        other.remove().await;
    }

    async fn a_store_of_the_third_version_is_upgraded_with_what_it_has(place) {
        let pool = of_version(place, 3).await;
        let rows = "INSERT INTO events VALUES (7, 1767225600250000, 'hall', 'moved', '0x0101', NULL, NULL, 1);";
        sqlx::raw_sql(rows).execute(&pool).await.unwrap();
        pool.close().await;
        let other = restored(place).await;
        for store in [place.open().await, other.open().await] {
            assert_eq!(store.last_event().await.unwrap(), 7);
            assert_eq!(store.health("hall", "0x0101", EVER(), 10).await.unwrap(), []);
            store.write_health(&[health("0x0101", 0)]).await.unwrap();
            assert_eq!(store.health("hall", "0x0101", EVER(), 10).await.unwrap(), [health("0x0101", 0)]);
        }
        other.remove().await;
    }
}

/// Another place, with what a back-up of this one has.
async fn restored(place: &Place) -> Place {
    let file = place.folder.path().join("back-up.db");
    Store::back_up(&place.url, &file).await.unwrap();
    let other = another(place).await;
    Store::restore(&file, &other.url, place.folder.path()).await.unwrap();
    other
}

/// A place with the tables of an earlier version: its migrations alone.
async fn of_version(place: &Place, version: usize) -> sqlx::AnyPool {
    sqlx::any::install_default_drivers();
    let url = if place.schema.is_some() { place.url.clone() } else { first_file(place) };
    let pool = sqlx::any::AnyPoolOptions::new().max_connections(1).connect(&url).await.unwrap();
    let engine = if place.schema.is_some() { Engine::Postgres } else { Engine::Sqlite };
    let first = migrations(engine).into_iter().take(version).collect();
    Migrator::with_migrations(first).run(&pool).await.unwrap();
    pool
}

/// The URL by which a new SQLite file of a place is made.
fn first_file(place: &Place) -> String {
    let plain: PathBuf = place.url.clone().into();
    format!("{}?mode=rwc", super::super::open::url_of_file(&plain).unwrap())
}
