//! The health of nodes: to the store once a minute, and out of it as a history.

use std::sync::LazyLock;

use sqlx::any::AnyRow;

use super::key::{MINUTE_MS, ms, utc};
use super::rows::{MultiRowInsert, UnboundStatement, get, real, whole};
use super::{Result, Span, Store};
use crate::model::{HealthFigures, NodeHealth};

static INSERT: LazyLock<MultiRowInsert> = LazyLock::new(|| {
    let before = "INSERT INTO health \
         (site, node, minute, rate_chz, success_permille, residual_mean_mm, residual_sigma_mm, \
         first_path_minus_received_cdb, clock_offset_ppb, supply_mv, moved)";
    MultiRowInsert::new(before, 11, "ON CONFLICT (site, node, minute) DO NOTHING")
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
        let rows = sqlx::query(
            "SELECT minute, rate_chz, success_permille, residual_mean_mm, residual_sigma_mm, \
             first_path_minus_received_cdb, clock_offset_ppb, supply_mv, moved FROM health \
             WHERE site = $1 AND node = $2 AND minute >= $3 AND minute < $4 ORDER BY minute DESC LIMIT $5",
        );
        let rows = rows.bind(site).bind(node).bind(up(from)).bind(up(to)).bind(i64::from(limit));
        let rows = rows.fetch_all(&self.pool).await?;
        let health = |row| {
            let t = utc(get::<i64>(row, 0)? * MINUTE_MS);
            Ok(NodeHealth { site: site.to_owned(), node: node.to_owned(), t, health: figures(row)? })
        };
        rows.iter().map(health).collect()
    }
}

/// The figures of a row, after its minute.
fn figures(row: &AnyRow) -> Result<HealthFigures> {
    Ok(HealthFigures {
        rate_hz: get::<i64>(row, 1)? as f64 / 100.0,
        success_rate: real(row, 2, 1000.0)?,
        residual_mean_m: real(row, 3, 1000.0)?,
        residual_sigma_m: real(row, 4, 1000.0)?,
        first_path_minus_received_db: real(row, 5, 100.0)?,
        clock_offset_ppm: real(row, 6, 1000.0)?,
        supply_v: real(row, 7, 1000.0)?,
        moved: get::<i64>(row, 8)? != 0,
    })
}

fn bind<'q>(query: UnboundStatement<'q>, row: &NodeHealth) -> UnboundStatement<'q> {
    let figures = &row.health;
    query
        .bind(row.site.clone())
        .bind(row.node.clone())
        .bind(ms(row.t) / MINUTE_MS)
        .bind(whole(figures.rate_hz, 100.0))
        .bind(figures.success_rate.map(|rate| whole(rate, 1000.0)))
        .bind(figures.residual_mean_m.map(|m| whole(m, 1000.0)))
        .bind(figures.residual_sigma_m.map(|m| whole(m, 1000.0)))
        .bind(figures.first_path_minus_received_db.map(|db| whole(db, 100.0)))
        .bind(figures.clock_offset_ppm.map(|ppm| whole(ppm, 1000.0)))
        .bind(figures.supply_v.map(|v| whole(v, 1000.0)))
        .bind(i16::from(figures.moved))
}
