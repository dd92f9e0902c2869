//! The changes of the tables. Those that a release has are never changed: a store remembers a hash of their texts.

use sqlx::SqlSafeStr;
use sqlx::migrate::{Migration, MigrationType};

use super::Engine;

/// The text of a change.
enum Text {
    /// Of both engines.
    Same(&'static str),
    /// Of SQLite and of PostgreSQL.
    Each(&'static str, &'static str),
}

/// The files of a change in the folders of both engines.
macro_rules! files {
    ($name:literal) => {
        Text::Each(
            include_str!(concat!("../../migrations/sqlite/", $name)),
            include_str!(concat!("../../migrations/postgres/", $name)),
        )
    };
}

/// Names and texts, oldest first.
const CHANGES: &[(&str, Text)] = &[
    ("first", files!("0001_first.sql")),
    ("nodes", files!("0002_nodes.sql")),
    ("geographic_origin", Text::Same(include_str!("../../migrations/0003_geographic_origin.sql"))),
    ("measurements", files!("0004_measurements.sql")),
    ("health", files!("0005_health.sql")),
    ("doubt", Text::Same(include_str!("../../migrations/0006_doubt.sql"))),
];

/// The changes for an engine, oldest first.
pub fn migrations(engine: Engine) -> Vec<Migration> {
    let migration = |(version, (name, text)): (i64, &(&'static str, Text))| {
        let sql = match (text, engine) {
            (Text::Same(sql) | Text::Each(sql, _), Engine::Sqlite) => *sql,
            (Text::Same(sql) | Text::Each(_, sql), Engine::Postgres) => *sql,
        };
        Migration::new(version, (*name).into(), MigrationType::Simple, sql.into_sql_str(), false)
    };
    (1..).zip(CHANGES).map(migration).collect()
}
