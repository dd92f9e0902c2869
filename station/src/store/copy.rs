//! Copies all rows of a store to another one, whatever their engines.

use std::sync::Arc;

use futures_util::TryStreamExt;
use sqlx::any::{AnyRow, AnyTypeInfoKind};
use sqlx::{Any, AnyConnection, AssertSqlSafe, Column, Database, Row};

use super::rows::{MultiRowInsert, UnboundStatement, get};
use super::{Result, Store, StoreError};

type AnyColumn = <Any as Database>::Column;

/// All tables, with the columns by which their rows are ordered; those that others refer to come first.
pub const TABLES: [(&str, &str); 15] = [
    ("tags", "id"),
    ("rooms", "id"),
    ("recent", "id"),
    ("history", "key"),
    ("minutes", "minute"),
    ("events", "id"),
    ("health", "site, node, minute"),
    ("sites", "name"),
    ("zones", "site, name"),
    ("nodes", "site, node"),
    ("peers", "id"),
    ("measurements", "key, peer, before_ms"),
    ("campaigns", "id"),
    ("points", "id"),
    ("samples", "point, number"),
];

/// The column of a table to which a database gives new numbers, in the same order.
const NUMBERED: (&str, &str) = ("recent", "id");

/// Rows that are in memory at a time.
const AT_ONCE: usize = 4096;

/// A value of a row.
#[derive(Clone, Debug)]
enum Value {
    Int(Option<i64>),
    Text(Option<String>),
    Bytes(Option<Vec<u8>>),
    Real(Option<f64>),
}

/// Copies all rows, as they are at this moment, to a store that is empty. On an error it stays empty.
pub async fn copy(from: &Store, to: &Store) -> Result<()> {
    let mut reading = from.read().await?;
    let mut writing = to.begin().await?;
    for (table, _) in TABLES {
        let any = sqlx::query(AssertSqlSafe(format!("SELECT 1 FROM {table} LIMIT 1")));
        if any.fetch_optional(&mut *writing.tx).await?.is_some() {
            return Err(StoreError::Occupied(table));
        }
    }
    for (table, order) in TABLES {
        let select = AssertSqlSafe(format!("SELECT * FROM {table} ORDER BY {order}"));
        let mut chunks = sqlx::query(select).fetch(&mut *reading).try_chunks(AT_ONCE);
        while let Some(rows) = chunks.try_next().await.map_err(|error| error.1)? {
            insert(&mut writing.tx, table, &rows).await?;
        }
    }
    reading.commit().await?;
    Ok(writing.tx.commit().await?)
}

/// Inserts rows of a table of the same name.
async fn insert(connection: &mut AnyConnection, table: &str, rows: &[AnyRow]) -> Result<()> {
    let Some(first) = rows.first() else { return Ok(()) };
    let is_copied = |column: &&AnyColumn| (table, column.name()) != NUMBERED;
    let columns: Vec<_> = first.columns().iter().filter(is_copied).collect();
    let names: Vec<_> = columns.iter().map(|column| column.name()).collect();
    let mut whole = Vec::with_capacity(rows.len());
    for row in rows {
        let values = columns.iter().map(|column| value(row, column)).collect::<Result<Vec<_>>>()?;
        if values.iter().any(is_unknown_real) {
            insert_known(connection, table, &names, values).await?;
        } else {
            whole.push(values);
        }
    }
    let statement = MultiRowInsert::new(&format!("INSERT INTO {table} ({})", names.join(", ")), names.len(), "");
    statement.run(connection, &whole, |query, row| row.iter().cloned().fold(query, bind)).await
}

/// Inserts a row without its unknown reals: sqlx tells PostgreSQL that the column of such a NULL has another width.
async fn insert_known(connection: &mut AnyConnection, table: &str, names: &[&str], values: Vec<Value>) -> Result<()> {
    let known = names.iter().zip(values).filter(|(_, value)| !is_unknown_real(value));
    let (names, values): (Vec<&str>, Vec<Value>) = known.unzip();
    let placeholders: Vec<_> = (1..=names.len()).map(|number| format!("${number}")).collect();
    let (names, placeholders) = (names.join(", "), placeholders.join(", "));
    let statement: Arc<str> = format!("INSERT INTO {table} ({names}) VALUES ({placeholders})").into();
    values.into_iter().fold(sqlx::query(AssertSqlSafe(statement)), bind).execute(connection).await?;
    Ok(())
}

fn is_unknown_real(value: &Value) -> bool {
    matches!(value, Value::Real(None))
}

fn value(row: &AnyRow, column: &AnyColumn) -> Result<Value> {
    let at = column.ordinal();
    Ok(match column.type_info().kind() {
        AnyTypeInfoKind::SmallInt | AnyTypeInfoKind::Integer | AnyTypeInfoKind::BigInt => Value::Int(get(row, at)?),
        AnyTypeInfoKind::Real | AnyTypeInfoKind::Double => Value::Real(get(row, at)?),
        AnyTypeInfoKind::Text => Value::Text(get(row, at)?),
        AnyTypeInfoKind::Blob => Value::Bytes(get(row, at)?),
        AnyTypeInfoKind::Null | AnyTypeInfoKind::Bool => {
            return Err(StoreError::Damaged(format!("the column {} has another type", column.name())));
        }
    })
}

fn bind(query: UnboundStatement<'_>, value: Value) -> UnboundStatement<'_> {
    match value {
        Value::Int(value) => query.bind(value),
        Value::Text(value) => query.bind(value),
        Value::Bytes(value) => query.bind(value),
        Value::Real(value) => query.bind(value),
    }
}
