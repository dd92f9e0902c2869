//! Statements for many rows at once, and the values of a row.

use std::sync::Arc;

use serde::de::DeserializeOwned;
use sqlx::any::{AnyArguments, AnyRow};
use sqlx::query::Query;
use sqlx::{Any, AnyConnection, AssertSqlSafe, Decode, Row, Type};

use super::{Result, StoreError};

/// A statement before its arguments are bound.
pub type UnboundStatement<'q> = Query<'q, Any, AnyArguments>;

/// A statement with a list of VALUES, in few sizes, so that a database prepares few texts.
pub struct MultiRowInsert {
    sqlite: [(usize, Arc<str>); 3],
    postgres: [(usize, Arc<str>); 3],
}

impl MultiRowInsert {
    /// `before` VALUES ($1, $2 …), (…) `after`.
    pub fn new(before: &str, columns: usize, after: &str) -> Self {
        let text = |rows: usize, placeholder: &dyn Fn(usize) -> String| {
            let row = |row: usize| {
                let placeholders: Vec<_> = (1..=columns).map(|column| placeholder(row * columns + column)).collect();
                format!("({})", placeholders.join(", "))
            };
            let rows_of_values: Vec<_> = (0..rows).map(row).collect();
            (rows, format!("{before} VALUES {} {after}", rows_of_values.join(", ")).into())
        };
        // sqlx asks for the name of each placeholder, for which SQLite goes through the names of all; `$1` is one, `?`
        // has none. With names, a row takes 24 times as long.
        let sqlite = [256, 16, 1].map(|rows| text(rows, &|_| "?".to_owned()));
        let postgres = [256, 16, 1].map(|rows| text(rows, &|number| format!("${number}")));
        Self { sqlite, postgres }
    }

    /// Runs it for all rows; `bind` binds a row's values.
    pub async fn run<T>(
        &self,
        connection: &mut AnyConnection,
        mut rows: &[T],
        bind: impl for<'q> Fn(UnboundStatement<'q>, &T) -> UnboundStatement<'q>,
    ) -> Result<()> {
        let sizes = if connection.backend_name() == "SQLite" { &self.sqlite } else { &self.postgres };
        for (size, text) in sizes {
            while let Some((now, later)) = rows.split_at_checked(*size) {
                let statement = sqlx::query(AssertSqlSafe(Arc::clone(text)));
                now.iter().fold(statement, &bind).execute(&mut *connection).await?;
                rows = later;
            }
        }
        Ok(())
    }
}

/// The value of a column.
pub fn get<'r, T: Decode<'r, Any> + Type<Any>>(row: &'r AnyRow, column: usize) -> Result<T> {
    Ok(row.try_get(column)?)
}

/// The value of a column that holds JSON.
pub fn json<T: DeserializeOwned>(row: &AnyRow, column: usize) -> Result<T> {
    let text: &str = get(row, column)?;
    serde_json::from_str(text).map_err(|error| StoreError::Damaged(error.to_string()))
}

/// The value of a column that holds JSON or NULL.
pub fn maybe_json<T: DeserializeOwned>(row: &AnyRow, column: usize) -> Result<Option<T>> {
    if get::<Option<String>>(row, column)?.is_some() { json(row, column).map(Some) } else { Ok(None) }
}

/// A value as JSON.
pub fn to_json<T: serde::Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value).map_err(|error| StoreError::Damaged(error.to_string()))
}

/// The value of a column that holds the name of a variant.
pub fn variant<T: DeserializeOwned>(row: &AnyRow, column: usize) -> Result<T> {
    serde_json::from_value(get::<String>(row, column)?.into()).map_err(|error| StoreError::Damaged(error.to_string()))
}

/// The name of a variant.
pub fn name_of<T: serde::Serialize>(variant: T) -> Result<String> {
    match serde_json::to_value(variant) {
        Ok(serde_json::Value::String(name)) => Ok(name),
        Ok(other) => Err(StoreError::Damaged(format!("{other} is no name"))),
        Err(error) => Err(StoreError::Damaged(error.to_string())),
    }
}

/// The nearest number of these parts of a unit; beyond 32 bits the last one.
pub fn whole(value: f64, parts: f64) -> i32 {
    (value * parts).round() as i32
}

/// The value of a column that holds a number of these parts of a unit, or NULL.
pub fn real(row: &AnyRow, column: usize, parts: f64) -> Result<Option<f64>> {
    Ok(get::<Option<i64>>(row, column)?.map(|number| number as f64 / parts))
}

/// A number of a `T` that may be unknown, and that is stored as a whole number of these parts of its unit.
pub struct StoredNumber<T> {
    pub column: &'static str,
    pub parts: f64,
    pub of: fn(&mut T) -> &mut Option<f64>,
}

impl<T> StoredNumber<T> {
    /// As it is stored.
    pub fn whole(&self, mut of: T) -> Option<i32> {
        (self.of)(&mut of).map(|value| whole(value, self.parts))
    }

    /// Reads it from a column.
    pub fn read(&self, row: &AnyRow, column: usize, into: &mut T) -> Result<()> {
        *(self.of)(into) = real(row, column, self.parts)?;
        Ok(())
    }
}

/// The names of their columns, with commas.
pub fn columns_of<T>(numbers: &[StoredNumber<T>]) -> String {
    numbers.iter().map(|number| number.column).collect::<Vec<_>>().join(", ")
}

/// A number of rows as it is bound to LIMIT.
pub fn limit(rows: usize) -> i64 {
    i64::try_from(rows).unwrap_or(i64::MAX)
}
