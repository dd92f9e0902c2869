//! The health of nodes: to the store once a minute, and out of it as a history.

use std::sync::LazyLock;

use sqlx::AssertSqlSafe;
use sqlx::any::AnyRow;

use super::key::MINUTE_MS;
use super::rows::{MultiRowInsert, StoredNumber, UnboundStatement, columns_of, get, whole};
use super::{Result, Span, Store};
use crate::Utc;
use crate::model::{HealthFigures, NodeHealth};

/// Figures that may be unknown: their columns, and how many parts of a unit these count.
pub(super) const FIGURES: &[StoredNumber<HealthFigures>] = &[
    StoredNumber { column: "success_permille", parts: 1000.0, of: |figures| &mut figures.success_rate },
    StoredNumber { column: "residual_mean_mm", parts: 1000.0, of: |figures| &mut figures.residual_mean_m },
    StoredNumber { column: "residual_sigma_mm", parts: 1000.0, of: |figures| &mut figures.residual_sigma_m },
    StoredNumber {
        column: "first_path_minus_received_cdb",
        parts: 100.0,
        of: |figures| &mut figures.first_path_minus_received_db,
    },
    StoredNumber { column: "clock_offset_ppb", parts: 1000.0, of: |figures| &mut figures.clock_offset_ppm },
    StoredNumber { column: "supply_mv", parts: 1000.0, of: |figures| &mut figures.supply_v },
];

static INSERT: LazyLock<MultiRowInsert> = LazyLock::new(|| {
    let before = format!("INSERT INTO health (site, node, minute, rate_chz, moved, {})", columns_of(FIGURES));
    MultiRowInsert::new(&before, 5 + FIGURES.len(), "ON CONFLICT (site, node, minute) DO NOTHING")
});

impl Store {
    /// Writes how nodes are, each for the minute of its time. A node has one row a minute: the first that was written.
    pub async fn write_health(&self, rows: &[NodeHealth]) -> Result<()> {
        let mut writing = self.begin().await?;
        INSERT.run(&mut writing.tx, rows, bind).await?;
        Ok(writing.tx.commit().await?)
    }

    /// The minutes of a node's health that begin in a span, newest first.
    pub async fn health(&self, site: &str, node: &str, span: Span, limit: u32) -> Result<Vec<NodeHealth>> {
        let (from, to) = span.ms();
        let up = |ms: i64| (ms + MINUTE_MS - 1) / MINUTE_MS;
        let rows = sqlx::query(AssertSqlSafe(format!(
            "SELECT minute, rate_chz, moved, {} FROM health \
             WHERE site = $1 AND node = $2 AND minute >= $3 AND minute < $4 ORDER BY minute DESC LIMIT $5",
            columns_of(FIGURES)
        )));
        let rows = rows.bind(site).bind(node).bind(up(from)).bind(up(to)).bind(i64::from(limit));
        let rows = rows.fetch_all(&self.pool).await?;
        let health = |row: &AnyRow| {
            let t = Utc::of_ms(get::<i64>(row, 0)? * MINUTE_MS);
            let (rate_hz, moved) = (get::<i64>(row, 1)? as f64 / 100.0, get::<i64>(row, 2)? != 0);
            let mut health = HealthFigures { rate_hz, moved, ..HealthFigures::default() };
            FIGURES.iter().zip(3..).try_for_each(|(figure, column)| figure.read(row, column, &mut health))?;
            Ok(NodeHealth { site: site.to_owned(), node: node.to_owned(), t, health })
        };
        rows.iter().map(health).collect()
    }
}

fn bind<'q>(query: UnboundStatement<'q>, row: &NodeHealth) -> UnboundStatement<'q> {
    let query = query
        .bind(row.site.clone())
        .bind(row.node.clone())
        .bind(row.t.ms() / MINUTE_MS)
        .bind(whole(row.health.rate_hz, 100.0))
        .bind(i16::from(row.health.moved));
    FIGURES.iter().fold(query, |query, figure| query.bind(figure.whole(row.health)))
}
