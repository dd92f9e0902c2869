//! Sites, their plans, their rooms and zones. A zone may name a site that has no row: one that only sources tell of.

use sqlx::any::AnyRow;

use super::rows::{get, json, maybe_json, name_of, to_json, variant};
use super::{Result, Store, StoreError};
use crate::model::{FloorPlan, GeographicOrigin, SiteMap, Zone};

impl Store {
    /// The sites, by name.
    pub async fn sites(&self) -> Result<Vec<SiteMap>> {
        let rows = sqlx::query("SELECT name, walls, plan, geographic_origin FROM sites ORDER BY name");
        let site = |row: &AnyRow| {
            let (plan, geographic_origin) = (maybe_json(row, 2)?, maybe_json(row, 3)?);
            Ok(SiteMap { name: get(row, 0)?, walls_m: json(row, 1)?, plan, geographic_origin })
        };
        rows.fetch_all(&self.pool).await?.iter().map(site).collect()
    }

    /// Makes or replaces a site, but for its plan and its geographic origin.
    pub async fn put_site(&self, site: &SiteMap) -> Result<()> {
        let put = sqlx::query(
            "INSERT INTO sites (name, walls) VALUES ($1, $2) ON CONFLICT (name) DO UPDATE SET walls = excluded.walls",
        );
        self.run(put.bind(&site.name).bind(to_json(&site.walls_m)?)).await.map(drop)
    }

    /// Replaces a site's plan, and its picture where one is given.
    pub async fn put_plan(&self, site: &str, plan: &FloorPlan, picture: Option<&[u8]>) -> Result<()> {
        let update = sqlx::query("UPDATE sites SET plan = $1, picture = COALESCE($2, picture) WHERE name = $3");
        let update = update.bind(to_json(plan)?).bind(picture).bind(site);
        self.change(update, || format!("site {site:?}")).await
    }

    /// Replaces a site's geographic origin; none: removes it.
    pub async fn put_geographic_origin(&self, site: &str, origin: Option<&GeographicOrigin>) -> Result<()> {
        let update = sqlx::query("UPDATE sites SET geographic_origin = $1 WHERE name = $2");
        let update = update.bind(origin.map(to_json).transpose()?).bind(site);
        self.change(update, || format!("site {site:?}")).await
    }

    /// The picture of a site's plan.
    pub async fn picture(&self, site: &str) -> Result<Vec<u8>> {
        sqlx::query_scalar("SELECT picture FROM sites WHERE name = $1 AND picture IS NOT NULL")
            .bind(site)
            .fetch_optional(&self.pool)
            .await?
            .ok_or_else(|| StoreError::Missing(format!("picture of site {site:?}")))
    }

    /// The rooms and zones of all sites, by site and name.
    pub async fn zones(&self) -> Result<Vec<Zone>> {
        let rows = sqlx::query("SELECT site, name, kind, corners, alarm FROM zones ORDER BY site, name");
        let zone = |row: &AnyRow| {
            let (kind, corners_m, alarm) = (variant(row, 2)?, json(row, 3)?, get::<i64>(row, 4)? != 0);
            Ok(Zone { site: get(row, 0)?, name: get(row, 1)?, kind, corners_m, alarm })
        };
        rows.fetch_all(&self.pool).await?.iter().map(zone).collect()
    }

    /// Makes or replaces a zone.
    pub async fn put_zone(&self, zone: &Zone) -> Result<()> {
        let put = sqlx::query(
            "INSERT INTO zones (site, name, kind, corners, alarm) VALUES ($1, $2, $3, $4, $5) \
             ON CONFLICT (site, name) DO UPDATE SET \
             kind = excluded.kind, corners = excluded.corners, alarm = excluded.alarm",
        );
        let put = put.bind(&zone.site).bind(&zone.name).bind(name_of(zone.kind)?);
        self.run(put.bind(to_json(&zone.corners_m)?).bind(i16::from(zone.alarm))).await.map(drop)
    }

    /// Deletes a zone.
    pub async fn delete_zone(&self, site: &str, name: &str) -> Result<()> {
        let delete = sqlx::query("DELETE FROM zones WHERE site = $1 AND name = $2").bind(site).bind(name);
        self.change(delete, || format!("zone {name:?} of site {site:?}")).await
    }
}
