//! Beacons and receivers that a person has placed.

use super::rows::{get, name_of, variant};
use super::{Result, Store};
use crate::model::PlacedNode;

impl Store {
    /// The nodes that a person has placed, by site and name.
    pub async fn nodes(&self) -> Result<Vec<PlacedNode>> {
        let rows = sqlx::query(
            "SELECT site, node, name, role, x_m, y_m, z_m, rssi_1m_dbm, path_loss_exponent FROM nodes \
             ORDER BY site, node",
        );
        let rows = rows.fetch_all(&self.pool).await?;
        let node = |row| {
            Ok(PlacedNode {
                site: get(row, 0)?,
                node: get(row, 1)?,
                name: get(row, 2)?,
                role: variant(row, 3)?,
                position_m: [get(row, 4)?, get(row, 5)?, get(row, 6)?],
                rssi_1m_dbm: get(row, 7)?,
                path_loss_exponent: get(row, 8)?,
            })
        };
        rows.iter().map(node).collect()
    }

    /// Places a node, or places it anew.
    pub async fn put_node(&self, node: &PlacedNode) -> Result<()> {
        let [x_m, y_m, z_m] = node.position_m;
        let put = sqlx::query(
            "INSERT INTO nodes (site, node, name, role, x_m, y_m, z_m, rssi_1m_dbm, path_loss_exponent) \
             VALUES ($1, $2, $3, $4, $5, $6, $7, CASE WHEN $8 = 1 THEN $9 END, CASE WHEN $10 = 1 THEN $11 END) \
             ON CONFLICT (site, node) DO UPDATE SET \
             name = excluded.name, role = excluded.role, x_m = excluded.x_m, y_m = excluded.y_m, z_m = excluded.z_m, \
             rssi_1m_dbm = excluded.rssi_1m_dbm, path_loss_exponent = excluded.path_loss_exponent",
        );
        let put = put.bind(&node.site).bind(&node.node).bind(&node.name).bind(name_of(node.role)?);
        let put = [node.rssi_1m_dbm, node.path_loss_exponent].into_iter().fold(
            put.bind(x_m).bind(y_m).bind(z_m),
            // sqlx tells PostgreSQL that a number that is missing has four bytes.
            |put, number| put.bind(i64::from(number.is_some())).bind(number.unwrap_or_default()),
        );
        self.run(put).await.map(drop)
    }

    /// Forgets a node that a person has placed.
    pub async fn delete_node(&self, site: &str, node: &str) -> Result<()> {
        let delete = sqlx::query("DELETE FROM nodes WHERE site = $1 AND node = $2").bind(site).bind(node);
        self.change(delete, || format!("placed node {node:?} of site {site:?}")).await
    }
}
