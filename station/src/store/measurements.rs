//! Measurements, and the nodes that were measured to.

use std::sync::LazyLock;
use std::time::Duration;

use sqlx::AssertSqlSafe;
use sqlx::any::AnyRow;

use super::key::{MINUTE, MINUTE_MS, key, ms_of};
use super::rows::{MultiRowInsert, StoredNumber, UnboundStatement, columns_of, get, name_of, real, variant, whole};
use super::write::{Seen, millimetres};
use super::{Result, Span, Store, StoreError};
use crate::Utc;
use crate::model::{MeasuredValue, NodeMeasurement, NodeStatus, PlacedNode, RangeMeasurement};

/// Numbers of a range that may be unknown: their columns, and how many parts of a unit these count. The power of a
/// sighting is its RSSI.
const NUMBERS: [StoredNumber<RangeMeasurement>; 3] = [
    StoredNumber { column: "power_cdbm", parts: 100.0, of: |range| &mut range.rx_power_dbm },
    StoredNumber { column: "first_path_power_cdbm", parts: 100.0, of: |range| &mut range.first_path_power_dbm },
    StoredNumber { column: "clock_offset_ppb", parts: 1000.0, of: |range| &mut range.clock_offset_ppm },
];

static INSERT: LazyLock<MultiRowInsert> = LazyLock::new(|| {
    let before = format!("INSERT INTO measurements (key, peer, before_ms, range_mm, {})", columns_of(&NUMBERS));
    MultiRowInsert::new(&before, 4 + NUMBERS.len(), "ON CONFLICT (key, peer, before_ms) DO NOTHING")
});

/// A measurement as it is stored.
struct Stored {
    key: i64,
    peer: i64,
    before_ms: i32,
    range_mm: Option<i32>,
    numbers: [Option<i32>; NUMBERS.len()],
}

impl Stored {
    fn new(measurement: &NodeMeasurement, tag: i64, peer: i64) -> Self {
        let NodeMeasurement { round, t, what, .. } = measurement;
        let (range_mm, range) = match *what {
            MeasuredValue::Range(range) => (Some(millimetres(range.range_m)), range),
            MeasuredValue::Rssi(dbm) => (None, RangeMeasurement { rx_power_dbm: Some(dbm), ..Default::default() }),
        };
        Self {
            key: key(round.ms(), tag),
            peer,
            before_ms: i32::try_from(round.ms() - t.ms()).unwrap_or_default().max(0),
            range_mm,
            numbers: NUMBERS.each_ref().map(|number| number.whole(range)),
        }
    }

    fn bind<'q>(query: UnboundStatement<'q>, row: &Self) -> UnboundStatement<'q> {
        let query = query.bind(row.key).bind(row.peer).bind(row.before_ms).bind(row.range_mm);
        row.numbers.iter().fold(query, |query, number| query.bind(*number))
    }
}

/// The measurement of a row with key, `before_ms`, tag, node, range and [`NUMBERS`].
fn measurement(site: &str, row: &AnyRow) -> Result<NodeMeasurement> {
    let round = Utc::of_ms(ms_of(get(row, 0)?));
    let before_ms: i64 = get(row, 1)?;
    let mut range = RangeMeasurement::default();
    NUMBERS.iter().zip(5..).try_for_each(|(number, column)| number.read(row, column, &mut range))?;
    let no_power = || StoreError::Damaged("a sighting has no RSSI".to_owned());
    let what = match real(row, 4, 1000.0)? {
        Some(range_m) => MeasuredValue::Range(RangeMeasurement { range_m, ..range }),
        None => MeasuredValue::Rssi(range.rx_power_dbm.ok_or_else(no_power)?),
    };
    Ok(NodeMeasurement {
        site: site.to_owned(),
        tag: get(row, 2)?,
        node: get(row, 3)?,
        round,
        t: round - Duration::from_millis(u64::try_from(before_ms).unwrap_or_default()),
        what,
    })
}

impl Store {
    /// Writes measurements; after it returns, they survive a crash of the process and a power cut. What is written
    /// again is not stored twice. Those of a new tag for which the key has no number are left out; returns how many.
    pub async fn write_measurements(&self, measurements: &[NodeMeasurement]) -> Result<u64> {
        let mut writing = self.begin().await?;
        // Numbers of this transaction hold only if it is committed.
        let mut numbers = std::mem::take(&mut *writing.numbers);
        let mut rows = Vec::with_capacity(measurements.len());
        let mut left_out = 0;
        let mut seen = Seen::default();
        for measurement in measurements {
            let NodeMeasurement { site, tag, node, round, .. } = measurement;
            let Some(tag) = numbers.tag(&mut writing.tx, site, tag, *round).await? else {
                left_out += 1;
                continue;
            };
            let peer = numbers.peer(&mut writing.tx, site, node).await?;
            seen.note(tag, *round);
            rows.push(Stored::new(measurement, tag, peer));
        }
        INSERT.run(&mut writing.tx, &rows, Stored::bind).await?;
        seen.write(&mut writing.tx).await?;
        writing.tx.commit().await?;
        *writing.numbers = numbers;
        Ok(left_out)
    }

    /// Takes what nodes do and where they are; what is written again replaces what was there.
    pub async fn write_peers(&self, nodes: &[NodeStatus]) -> Result<()> {
        let mut writing = self.begin().await?;
        let mut numbers = std::mem::take(&mut *writing.numbers);
        for node in nodes {
            let peer = numbers.peer(&mut writing.tx, &node.site, &node.node).await?;
            let [x_mm, y_mm, z_mm] = [0, 1, 2].map(|axis: usize| node.position_m.map(|at| millimetres(at[axis])));
            sqlx::query(
                "UPDATE peers SET role = $1, x_mm = $2, y_mm = $3, z_mm = $4, rssi_1m_cdbm = $5, \
                 path_loss_exponent_milli = $6 WHERE id = $7",
            )
            .bind(name_of(node.role)?)
            .bind(x_mm)
            .bind(y_mm)
            .bind(z_mm)
            .bind(node.rssi_1m_dbm.map(|dbm| whole(dbm, 100.0)))
            .bind(node.path_loss_exponent.map(|exponent| whole(exponent, 1000.0)))
            .bind(peer)
            .execute(&mut *writing.tx)
            .await?;
        }
        writing.tx.commit().await?;
        *writing.numbers = numbers;
        Ok(())
    }

    /// The measurements of a site whose rounds ended in a span, by minute, tag and time.
    pub async fn measurements(&self, site: &str, span: Span) -> Result<Vec<NodeMeasurement>> {
        let (from, to) = span.ms();
        let statement = sqlx::query(AssertSqlSafe(format!(
            "SELECT m.key, m.before_ms, g.tag, p.node, m.range_mm, {} \
             FROM measurements AS m JOIN tags AS g ON g.id = ((m.key >> 16) & 1048575) \
             JOIN peers AS p ON p.id = m.peer \
             WHERE m.key >= $1 AND m.key < $2 AND g.site = $3 ORDER BY m.key, m.before_ms DESC, p.node",
            columns_of(&NUMBERS)
        )));
        let [first, end] = [from / MINUTE_MS, to / MINUTE_MS + 1].map(|minute| minute.saturating_mul(MINUTE));
        let rows = statement.bind(first).bind(end).bind(site).fetch_all(&self.pool).await?;
        let mut found = Vec::with_capacity(rows.len());
        for row in &rows {
            if (from..to).contains(&ms_of(get(row, 0)?)) {
                found.push(measurement(site, row)?);
            }
        }
        Ok(found)
    }

    /// The nodes of a site that were measured to and whose places are known, by name.
    pub async fn peers(&self, site: &str) -> Result<Vec<PlacedNode>> {
        let statement = sqlx::query(
            "SELECT node, role, x_mm, y_mm, z_mm, rssi_1m_cdbm, path_loss_exponent_milli FROM peers \
             WHERE site = $1 AND role IS NOT NULL AND x_mm IS NOT NULL ORDER BY node",
        );
        let rows = statement.bind(site).fetch_all(&self.pool).await?;
        let peer = |row: &AnyRow| {
            let metres = |column| Ok::<_, StoreError>(get::<i64>(row, column)? as f64 / 1000.0);
            Ok(PlacedNode {
                site: site.to_owned(),
                node: get(row, 0)?,
                name: None,
                role: variant(row, 1)?,
                position_m: [metres(2)?, metres(3)?, metres(4)?],
                rssi_1m_dbm: real(row, 5, 100.0)?,
                path_loss_exponent: real(row, 6, 1000.0)?,
            })
        };
        rows.iter().map(peer).collect()
    }

    /// Deletes the measurements of the oldest minutes before one, `most` at a time. Whether there were any.
    pub(super) async fn delete_measurements(&self, before: i64, most: i64) -> Result<bool> {
        let mut writing = self.begin().await?;
        let first = sqlx::query_scalar("SELECT MIN(key) FROM measurements").fetch_one(&mut *writing.tx).await?;
        let first: Option<i64> = first;
        let Some(first) = first.map(|key| key / MINUTE).filter(|first| *first < before) else { return Ok(false) };
        let end = before.min(first + most) * MINUTE;
        sqlx::query("DELETE FROM measurements WHERE key < $1").bind(end).execute(&mut *writing.tx).await?;
        writing.tx.commit().await?;
        Ok(true)
    }
}
