//! Each test runs on SQLite in a temporary folder, and on PostgreSQL in a schema of its own where
//! `BALIZA_TEST_POSTGRES` has the URL of a database.

mod backup;
mod crash;
mod dashboard;
mod history;
mod keeping;
mod measurements;
mod size;
mod things;

use std::io::Write;
use std::sync::Once;
use std::sync::atomic::{AtomicU32, Ordering};

use super::health::FIGURES;
use super::*;
use crate::model::{Doubt, EventKind, HealthFigures, NodeHealth, StationEvent, TagPosition};

/// A place for a store, empty at first.
pub struct Place {
    url: String,
    folder: tempfile::TempDir,
    /// PostgreSQL: URL of the database, and the name of the schema.
    schema: Option<(String, String)>,
}

impl Place {
    pub fn sqlite() -> Self {
        let folder = tempfile::tempdir().unwrap();
        // A name of which every part means something in a URL.
        let url = folder.path().join("a store?100%#ü.db").to_str().unwrap().to_owned();
        Self { url, folder, schema: None }
    }

    async fn postgres(database: String) -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("baliza_{}_{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        execute(&database, format!("CREATE SCHEMA {name}")).await;
        let joined = if database.contains('?') { '&' } else { '?' };
        let url = format!("{database}{joined}options=-csearch_path%3D{name}");
        Self { url, folder: tempfile::tempdir().unwrap(), schema: Some((database, name)) }
    }

    pub async fn open(&self) -> Store {
        Store::open(&self.url).await.unwrap()
    }

    async fn remove(self) {
        if let Some((database, name)) = self.schema {
            execute(&database, format!("DROP SCHEMA {name} CASCADE")).await;
        }
    }
}

async fn execute(database: &str, statement: String) {
    sqlx::any::install_default_drivers();
    let pool = sqlx::AnyPool::connect(database).await.unwrap();
    sqlx::raw_sql(sqlx::AssertSqlSafe(statement)).execute(&pool).await.unwrap();
    pool.close().await;
}

fn on_sqlite<F: Future<Output = Place>>(test: impl FnOnce(Place) -> F) {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async { test(Place::sqlite()).await.remove().await });
}

fn on_postgres<F: Future<Output = Place>>(test: impl FnOnce(Place) -> F) {
    static LEFT_OUT: Once = Once::new();
    let Ok(database) = std::env::var("BALIZA_TEST_POSTGRES") else {
        let line = "tests of the store on PostgreSQL are left out: BALIZA_TEST_POSTGRES is not set";
        return LEFT_OUT.call_once(|| writeln!(std::io::stderr(), "{line}").unwrap());
    };
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async { test(Place::postgres(database).await).await.remove().await });
}

/// Tests on both; each gets a [`Place`] by reference.
macro_rules! on_both {
    ($($(#[$doc:meta])* async fn $name:ident($place:ident) $body:block)*) => {
        mod sqlite {
            $(#[test] fn $name() {
                super::super::on_sqlite(|place| async { super::$name(&place).await; place });
            })*
        }
        mod postgres {
            $(#[test] fn $name() {
                super::super::on_postgres(|place| async { super::$name(&place).await; place });
            })*
        }
        $($(#[$doc])* async fn $name($place: &super::Place) $body)*
    };
}
use on_both;

/// A position at (t in seconds, 0) metres, milliseconds after the beginning of 2026.
pub fn position(tag: &str, ms: i64) -> TagPosition {
    TagPosition {
        site: "hall".to_owned(),
        tag: tag.to_owned(),
        t: at(ms),
        x_m: ms as f64 / 1000.0,
        y_m: 0.0,
        z_m: None,
        sigma_x_m: 0.1,
        sigma_y_m: 0.2,
        sigma_z_m: None,
        cov_xy_m2: 0.0,
        room: None,
        used: 4,
        doubt: None,
    }
}

/// Milliseconds after the beginning of 2026, which is the beginning of a minute.
pub fn at(ms: i64) -> Utc {
    "2026-01-01T00:00:00Z".parse::<Utc>().unwrap() + Duration::from_millis(u64::try_from(ms).unwrap())
}

pub fn span(from_ms: i64, to_ms: i64) -> Span {
    Span { from: at(from_ms), to: at(to_ms) }
}

pub const EVER: fn() -> Span = || Span { from: Utc::clamped(0), to: Utc::clamped(i64::MAX) };

/// When positions were, in milliseconds after the beginning of 2026.
pub fn times(positions: &[TagPosition]) -> Vec<i64> {
    positions.iter().map(|position| (position.t.us() - at(0).us()) / 1000).collect()
}

pub fn event(id: i64, ms: i64, kind: EventKind) -> StationEvent {
    StationEvent {
        id,
        t: at(ms),
        site: "hall".to_owned(),
        kind,
        node: "0x1001".to_owned(),
        zone: Some("kitchen".to_owned()),
        dwell_s: Some(12.345_678),
        alarm: true,
    }
}

/// The health of an anchor, of which all that is stored is known.
pub fn health(node: &str, ms: i64) -> NodeHealth {
    let least = HealthFigures { rate_hz: 9.7, moved: true, ..HealthFigures::default() };
    let mut health = HealthFigures {
        success_rate: Some(0.985),
        residual_mean_m: Some(-0.125),
        residual_sigma_m: Some(0.083),
        first_path_minus_received_db: Some(-2.75),
        clock_offset_ppm: Some(-12.345),
        supply_v: Some(3.281),
        ..least
    };
    // Whatever else has a column: a whole number, whatever parts of a unit the column counts.
    for figure in FIGURES {
        (figure.of)(&mut health).get_or_insert(2.0);
    }
    NodeHealth { site: "hall".to_owned(), node: node.to_owned(), t: at(ms), health }
}
