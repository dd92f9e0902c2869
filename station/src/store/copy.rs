//! Copies all rows of a store to another one, whatever their engines.

use futures_util::TryStreamExt;
use sqlx::any::AnyRow;
use sqlx::{AnyConnection, AssertSqlSafe};

use super::rows::{MultiRowInsert, UnboundStatement, get};
use super::{Result, Store, StoreError};

/// What a column holds. Only a column of these kinds can be NULL: `Int`, `Text`, `Bytes`.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Int,
    Text,
    Bytes,
    Real,
    /// A real that can be NULL. It is an integer and a real: sqlx tells PostgreSQL that the column of a NULL of this
    /// kind has another width.
    MaybeReal,
}

/// A table: its name, its columns, and the columns by which its rows are ordered.
#[derive(Debug)]
pub struct Copied {
    pub name: &'static str,
    columns: &'static [(&'static str, Kind)],
    order: &'static str,
}

/// The columns of a position.
const POSITION: &[(&str, Kind)] = &[
    ("key", Kind::Int),
    ("x_mm", Kind::Int),
    ("y_mm", Kind::Int),
    ("z_mm", Kind::Int),
    ("sigma_x_mm", Kind::Int),
    ("sigma_y_mm", Kind::Int),
    ("sigma_z_mm", Kind::Int),
    ("correlation", Kind::Int),
    ("room", Kind::Int),
    ("used", Kind::Int),
];

/// All tables; those that others refer to come first. `recent` gets new numbers in the same order.
pub const TABLES: [Copied; 15] = [
    Copied {
        name: "tags",
        columns: &[
            ("id", Kind::Int),
            ("site", Kind::Text),
            ("tag", Kind::Text),
            ("first_ms", Kind::Int),
            ("last_ms", Kind::Int),
        ],
        order: "id",
    },
    Copied { name: "rooms", columns: &[("id", Kind::Int), ("name", Kind::Text)], order: "id" },
    Copied { name: "recent", columns: POSITION, order: "id" },
    Copied { name: "history", columns: POSITION, order: "key" },
    Copied { name: "minutes", columns: &[("minute", Kind::Int), ("thinned", Kind::Int)], order: "minute" },
    Copied {
        name: "events",
        columns: &[
            ("id", Kind::Int),
            ("t_us", Kind::Int),
            ("site", Kind::Text),
            ("kind", Kind::Text),
            ("node", Kind::Text),
            ("zone", Kind::Text),
            ("dwell_us", Kind::Int),
            ("alarm", Kind::Int),
        ],
        order: "id",
    },
    Copied {
        name: "health",
        columns: &[
            ("site", Kind::Text),
            ("node", Kind::Text),
            ("minute", Kind::Int),
            ("rate_chz", Kind::Int),
            ("success_permille", Kind::Int),
            ("residual_mean_mm", Kind::Int),
            ("residual_sigma_mm", Kind::Int),
            ("first_path_minus_received_cdb", Kind::Int),
            ("clock_offset_ppb", Kind::Int),
            ("supply_mv", Kind::Int),
            ("moved", Kind::Int),
        ],
        order: "site, node, minute",
    },
    Copied {
        name: "sites",
        columns: &[
            ("name", Kind::Text),
            ("walls", Kind::Text),
            ("plan", Kind::Text),
            ("picture", Kind::Bytes),
            ("geographic_origin", Kind::Text),
        ],
        order: "name",
    },
    Copied {
        name: "zones",
        columns: &[
            ("site", Kind::Text),
            ("name", Kind::Text),
            ("kind", Kind::Text),
            ("corners", Kind::Text),
            ("alarm", Kind::Int),
        ],
        order: "site, name",
    },
    Copied {
        name: "nodes",
        columns: &[
            ("site", Kind::Text),
            ("node", Kind::Text),
            ("name", Kind::Text),
            ("role", Kind::Text),
            ("x_m", Kind::Real),
            ("y_m", Kind::Real),
            ("z_m", Kind::Real),
            ("rssi_1m_dbm", Kind::MaybeReal),
            ("path_loss_exponent", Kind::MaybeReal),
        ],
        order: "site, node",
    },
    Copied {
        name: "peers",
        columns: &[
            ("id", Kind::Int),
            ("site", Kind::Text),
            ("node", Kind::Text),
            ("role", Kind::Text),
            ("x_mm", Kind::Int),
            ("y_mm", Kind::Int),
            ("z_mm", Kind::Int),
            ("rssi_1m_cdbm", Kind::Int),
            ("path_loss_exponent_milli", Kind::Int),
        ],
        order: "id",
    },
    Copied {
        name: "measurements",
        columns: &[
            ("key", Kind::Int),
            ("peer", Kind::Int),
            ("before_ms", Kind::Int),
            ("range_mm", Kind::Int),
            ("power_cdbm", Kind::Int),
            ("first_path_power_cdbm", Kind::Int),
            ("clock_offset_ppb", Kind::Int),
        ],
        order: "key, peer, before_ms",
    },
    Copied {
        name: "campaigns",
        columns: &[("id", Kind::Int), ("name", Kind::Text), ("site", Kind::Text), ("created_us", Kind::Int)],
        order: "id",
    },
    Copied {
        name: "points",
        columns: &[
            ("id", Kind::Int),
            ("campaign", Kind::Int),
            ("name", Kind::Text),
            ("x_m", Kind::Real),
            ("y_m", Kind::Real),
            ("z_m", Kind::MaybeReal),
            ("room", Kind::Text),
            ("samples", Kind::Int),
        ],
        order: "id",
    },
    Copied {
        name: "samples",
        columns: &[
            ("point", Kind::Int),
            ("number", Kind::Int),
            ("beacon", Kind::Text),
            ("rssi_dbm", Kind::Real),
            ("t_s", Kind::Real),
        ],
        order: "point, number",
    },
];

/// Rows that are in memory at a time.
const AT_ONCE: usize = 4096;

/// A value of a row.
#[derive(Clone, Debug)]
enum Value {
    Int(Option<i64>),
    Text(Option<String>),
    Bytes(Option<Vec<u8>>),
    Real(f64),
    MaybeReal(Option<f64>),
}

/// Copies all rows, as they are at this moment, to a store that is empty. On an error it stays empty.
pub async fn copy(from: &Store, to: &Store) -> Result<()> {
    let mut reading = from.read().await?;
    let mut writing = to.begin().await?;
    for table in &TABLES {
        if !is_empty(&mut writing.tx, table).await? {
            return Err(StoreError::Occupied(table.name));
        }
    }
    for table in &TABLES {
        table.copy(&mut reading, &mut writing.tx).await?;
    }
    reading.commit().await?;
    Ok(writing.tx.commit().await?)
}

async fn is_empty(connection: &mut AnyConnection, table: &Copied) -> Result<bool> {
    let any = sqlx::query(AssertSqlSafe(format!("SELECT 1 FROM {} LIMIT 1", table.name)));
    Ok(any.fetch_optional(connection).await?.is_none())
}

impl Copied {
    /// Its columns, each with the table's name.
    #[cfg(test)]
    pub fn names(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let name = self.name;
        self.columns.iter().map(move |(column, _)| (name, *column))
    }

    async fn copy(&self, from: &mut AnyConnection, to: &mut AnyConnection) -> Result<()> {
        let Self { name, columns, order } = self;
        let names: Vec<_> = columns.iter().map(|(column, _)| *column).collect();
        let names = names.join(", ");
        let has_null_reals = columns.iter().any(|(_, kind)| matches!(kind, Kind::MaybeReal));
        let insert = MultiRowInsert::new(&format!("INSERT INTO {name} ({names})"), columns.len(), "");
        let select = sqlx::query(AssertSqlSafe(format!("SELECT {names} FROM {name} ORDER BY {order}")));
        let mut rows = select.fetch(from);
        let mut some = Vec::with_capacity(AT_ONCE);
        loop {
            let row = rows.try_next().await?;
            let is_end = row.is_none();
            if let Some(row) = row {
                some.push(self.values(&row)?);
            }
            if is_end || some.len() >= AT_ONCE {
                if has_null_reals {
                    for row in &some {
                        let statement = format!("INSERT INTO {name} ({names}) VALUES ({})", self.placeholders());
                        row.iter().fold(sqlx::query(AssertSqlSafe(statement)), bind).execute(&mut *to).await?;
                    }
                } else {
                    insert.run(to, &some, |query, row| row.iter().fold(query, bind)).await?;
                }
                some.clear();
            }
            if is_end {
                return Ok(());
            }
        }
    }

    fn values(&self, row: &AnyRow) -> Result<Vec<Value>> {
        let value = |(column, (_, kind)): (usize, &(&str, Kind))| {
            Ok(match kind {
                Kind::Int => Value::Int(get(row, column)?),
                Kind::Text => Value::Text(get(row, column)?),
                Kind::Bytes => Value::Bytes(get(row, column)?),
                Kind::Real => Value::Real(get(row, column)?),
                Kind::MaybeReal => Value::MaybeReal(get(row, column)?),
            })
        };
        self.columns.iter().enumerate().map(value).collect()
    }

    /// The placeholders of a row, in which a real that can be NULL has two.
    fn placeholders(&self) -> String {
        let mut number = 0;
        let mut next = || {
            number += 1;
            number
        };
        let placeholder = |(_, kind): &(&str, Kind)| match kind {
            Kind::MaybeReal => format!("CASE WHEN ${} = 1 THEN ${} END", next(), next()),
            Kind::Int | Kind::Text | Kind::Bytes | Kind::Real => format!("${}", next()),
        };
        self.columns.iter().map(placeholder).collect::<Vec<_>>().join(", ")
    }
}

fn bind<'q>(query: UnboundStatement<'q>, value: &Value) -> UnboundStatement<'q> {
    match value.clone() {
        Value::Int(value) => query.bind(value),
        Value::Text(value) => query.bind(value),
        Value::Bytes(value) => query.bind(value),
        Value::Real(value) => query.bind(value),
        Value::MaybeReal(value) => query.bind(i64::from(value.is_some())).bind(value.unwrap_or_default()),
    }
}
