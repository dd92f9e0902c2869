//! Survey campaigns, their points and samples.

use std::collections::{BTreeMap, HashSet};
use std::sync::LazyLock;

use sqlx::AnyConnection;
use sqlx::any::AnyRow;

use super::rows::{MultiRowInsert, get};
use super::{Result, Store, StoreError};
use crate::Utc;
use crate::model::{Campaign, CampaignPoint, SurveySample};

static INSERT_SAMPLES: LazyLock<MultiRowInsert> =
    LazyLock::new(|| MultiRowInsert::new("INSERT INTO samples (point, number, beacon, rssi_dbm, t_s)", 5, ""));

fn no_point(campaign: &str, point: &str) -> StoreError {
    StoreError::Missing(format!("point {point:?} of campaign {campaign:?}"))
}

impl Store {
    /// The campaigns, by name.
    pub async fn campaigns(&self) -> Result<Vec<Campaign>> {
        let mut tx = self.read().await?;
        let campaigns = sqlx::query("SELECT id, name, site, created_us FROM campaigns ORDER BY name");
        let campaigns = campaigns.fetch_all(&mut *tx).await?;
        let points = sqlx::query("SELECT campaign, name, x_m, y_m, z_m, room, samples FROM points ORDER BY id");
        let mut by_campaign = BTreeMap::<i64, Vec<CampaignPoint>>::new();
        for row in points.fetch_all(&mut *tx).await? {
            by_campaign.entry(get(&row, 0)?).or_default().push(point(&row)?);
        }
        tx.commit().await?;
        campaigns.iter().map(|row| campaign(row, by_campaign.remove(&get(row, 0)?).unwrap_or_default())).collect()
    }

    /// A campaign.
    pub async fn campaign(&self, name: &str) -> Result<Campaign> {
        let mut tx = self.read().await?;
        let row = sqlx::query("SELECT id, name, site, created_us FROM campaigns WHERE name = $1")
            .bind(name)
            .fetch_optional(&mut *tx)
            .await?
            .ok_or_else(|| StoreError::Missing(format!("campaign {name:?}")))?;
        let points = sqlx::query(
            "SELECT campaign, name, x_m, y_m, z_m, room, samples FROM points WHERE campaign = $1 ORDER BY id",
        );
        let points = points.bind(get::<i64>(&row, 0)?).fetch_all(&mut *tx).await?;
        tx.commit().await?;
        campaign(&row, points.iter().map(point).collect::<Result<_>>()?)
    }

    /// Makes a campaign with its points; they have no samples yet.
    pub async fn create_campaign(&self, campaign: &Campaign) -> Result<()> {
        let mut names = HashSet::new();
        if let Some(twice) = campaign.points.iter().find(|point| !names.insert(&point.id)) {
            return Err(StoreError::Exists(format!("a point {:?} in the campaign", twice.id)));
        }
        let mut writing = self.begin().await?;
        let id: Option<i64> = sqlx::query_scalar(
            "INSERT INTO campaigns (id, name, site, created_us) \
             SELECT COALESCE(MAX(id), 0) + 1, $1, $2, $3 FROM campaigns WHERE true \
             ON CONFLICT (name) DO NOTHING RETURNING id",
        )
        .bind(&campaign.name)
        .bind(&campaign.scenario)
        .bind(campaign.created.us())
        .fetch_optional(&mut *writing.tx)
        .await?;
        let id = id.ok_or_else(|| StoreError::Exists(format!("a campaign {:?}", campaign.name)))?;
        for point in &campaign.points {
            insert_point(&mut writing.tx, id, point).await?;
        }
        Ok(writing.tx.commit().await?)
    }

    /// Deletes a campaign with its points and samples.
    pub async fn delete_campaign(&self, name: &str) -> Result<()> {
        let delete = sqlx::query("DELETE FROM campaigns WHERE name = $1").bind(name);
        self.change(delete, || format!("campaign {name:?}")).await
    }

    /// A point of a campaign.
    pub async fn point(&self, campaign: &str, id: &str) -> Result<CampaignPoint> {
        let row = sqlx::query(
            "SELECT p.campaign, p.name, x_m, y_m, z_m, room, samples \
             FROM points AS p JOIN campaigns AS c ON c.id = p.campaign WHERE c.name = $1 AND p.name = $2",
        );
        let row = row.bind(campaign).bind(id).fetch_optional(&self.pool).await?;
        point(&row.ok_or_else(|| no_point(campaign, id))?)
    }

    /// The samples of a point, in the order of their arrival, after the first `skip`.
    pub async fn samples(&self, campaign: &str, point: &str, skip: u64, limit: u32) -> Result<Vec<SurveySample>> {
        let mut tx = self.read().await?;
        let id = point_id(&mut tx, campaign, point).await?;
        // Samples are numbered without gaps, from zero.
        let rows = sqlx::query(
            "SELECT beacon, rssi_dbm, t_s FROM samples WHERE point = $1 AND number >= $2 ORDER BY number LIMIT $3",
        )
        .bind(id)
        .bind(i64::try_from(skip).unwrap_or(i64::MAX))
        .bind(i64::from(limit))
        .fetch_all(&mut *tx)
        .await?;
        tx.commit().await?;
        rows.iter()
            .map(|row| Ok(SurveySample { beacon: get(row, 0)?, rssi_dbm: get(row, 1)?, t_s: get(row, 2)? }))
            .collect()
    }

    /// Adds samples to a point.
    pub async fn add_samples(&self, campaign: &str, point: &str, samples: &[SurveySample]) -> Result<()> {
        let mut writing = self.begin().await?;
        let id = point_id(&mut writing.tx, campaign, point).await?;
        let count = i64::try_from(samples.len()).unwrap_or(i64::MAX);
        let after: i64 = sqlx::query_scalar("UPDATE points SET samples = samples + $1 WHERE id = $2 RETURNING samples")
            .bind(count)
            .bind(id)
            .fetch_one(&mut *writing.tx)
            .await?;
        let numbered: Vec<_> = (after - count..).zip(samples).collect();
        INSERT_SAMPLES
            .run(&mut writing.tx, &numbered, |query, (number, sample)| {
                query.bind(id).bind(*number).bind(sample.beacon.clone()).bind(sample.rssi_dbm).bind(sample.t_s)
            })
            .await?;
        Ok(writing.tx.commit().await?)
    }
}

async fn insert_point(connection: &mut AnyConnection, campaign: i64, point: &CampaignPoint) -> Result<()> {
    // Not an `Option` for z: sqlx tells PostgreSQL that the column of such a NULL has another width.
    sqlx::query(
        "INSERT INTO points (id, campaign, name, x_m, y_m, z_m, room, samples) \
         SELECT COALESCE(MAX(id), 0) + 1, $1, $2, $3, $4, CASE WHEN $5 = 1 THEN $6 END, $7, 0 FROM points",
    )
    .bind(campaign)
    .bind(&point.id)
    .bind(point.x_m)
    .bind(point.y_m)
    .bind(i64::from(point.z_m.is_some()))
    .bind(point.z_m.unwrap_or_default())
    .bind(&point.room)
    .execute(connection)
    .await?;
    Ok(())
}

async fn point_id(connection: &mut AnyConnection, campaign: &str, point: &str) -> Result<i64> {
    let id = sqlx::query_scalar(
        "SELECT p.id FROM points AS p JOIN campaigns AS c ON c.id = p.campaign WHERE c.name = $1 AND p.name = $2",
    );
    id.bind(campaign).bind(point).fetch_optional(connection).await?.ok_or_else(|| no_point(campaign, point))
}

fn campaign(row: &AnyRow, points: Vec<CampaignPoint>) -> Result<Campaign> {
    Ok(Campaign { name: get(row, 1)?, scenario: get(row, 2)?, created: Utc::clamped(get(row, 3)?), points })
}

fn point(row: &AnyRow) -> Result<CampaignPoint> {
    Ok(CampaignPoint {
        id: get(row, 1)?,
        x_m: get(row, 2)?,
        y_m: get(row, 3)?,
        z_m: get(row, 4)?,
        room: get(row, 5)?,
        samples: u64::try_from(get::<i64>(row, 6)?).unwrap_or(0),
    })
}
