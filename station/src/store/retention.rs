//! What happens to rows with time: positions move to history and are thinned, all are deleted.

use std::time::Duration;

use super::key::{MINUTE, MINUTE_MS};
use super::{Result, Retention, Store};
use crate::Utc;

/// How long after its end a minute still gets rows in `recent`: what comes later makes pages of `history` split.
const OVER_AFTER: Duration = Duration::from_secs(5);

/// Minutes that are deleted in one transaction; writers wait for it.
const MINUTES_AT_ONCE: i64 = 10;

impl Store {
    /// Moves the minutes that are over from `recent` to `history`.
    pub async fn compact(&self, now: Utc) -> Result<()> {
        // Rows of a clock that is far ahead are moved too, or they would be read again at each search of `recent`.
        let current = (now - OVER_AFTER).ms() / MINUTE_MS;
        let mut writing = self.begin().await?;
        let [first_kept, first_ahead] = [current, current + 2].map(|minute| minute * MINUTE);
        sqlx::query(
            "INSERT INTO minutes (minute, thinned) \
             SELECT DISTINCT key >> 36, 0 FROM recent WHERE key < $1 OR key >= $2 \
             ON CONFLICT (minute) DO UPDATE SET thinned = 0",
        )
        .bind(first_kept)
        .bind(first_ahead)
        .execute(&mut *writing.tx)
        .await?;
        sqlx::query(
            "INSERT INTO history \
             (key, x_mm, y_mm, z_mm, sigma_x_mm, sigma_y_mm, sigma_z_mm, correlation, room, used, doubt) \
             SELECT key, x_mm, y_mm, z_mm, sigma_x_mm, sigma_y_mm, sigma_z_mm, correlation, room, used, doubt \
             FROM recent WHERE key < $1 OR key >= $2 ORDER BY key, id ON CONFLICT (key) DO NOTHING",
        )
        .bind(first_kept)
        .bind(first_ahead)
        .execute(&mut *writing.tx)
        .await?;
        sqlx::query("DELETE FROM recent WHERE key < $1 OR key >= $2")
            .bind(first_kept)
            .bind(first_ahead)
            .execute(&mut *writing.tx)
            .await?;
        Ok(writing.tx.commit().await?)
    }

    /// Thins and deletes what is old, by whole minutes.
    pub async fn retain(&self, retention: Retention, now: Utc) -> Result<()> {
        let measurements = [retention.measurements, retention.delete_after];
        if let Some(age) = measurements.into_iter().flatten().min() {
            let before = (now - age).ms() / MINUTE_MS;
            while self.delete_measurements(before, MINUTES_AT_ONCE).await? {}
        }
        if let Some(age) = retention.delete_after {
            let before = now - age;
            while self.delete_minutes(before.ms() / MINUTE_MS).await? {}
            self.delete_rest(before).await?;
        }
        if let Some(age) = retention.thin_after {
            while self.thin_minute((now - age).ms() / MINUTE_MS).await? {}
        }
        Ok(())
    }

    /// Deletes the oldest minutes before one. Whether there were any.
    async fn delete_minutes(&self, before: i64) -> Result<bool> {
        let mut writing = self.begin().await?;
        let last: Option<i64> = sqlx::query_scalar(
            "SELECT MAX(minute) FROM \
             (SELECT minute FROM minutes WHERE minute < $1 ORDER BY minute LIMIT $2) AS oldest",
        )
        .bind(before)
        .bind(MINUTES_AT_ONCE)
        .fetch_one(&mut *writing.tx)
        .await?;
        let Some(last) = last else { return Ok(false) };
        let end = (last + 1) * MINUTE;
        sqlx::query("DELETE FROM history WHERE key < $1").bind(end).execute(&mut *writing.tx).await?;
        sqlx::query("DELETE FROM minutes WHERE minute <= $1").bind(last).execute(&mut *writing.tx).await?;
        writing.tx.commit().await?;
        Ok(true)
    }

    /// Deletes late rows, events, the health of nodes, and tags.
    async fn delete_rest(&self, before: Utc) -> Result<()> {
        let mut writing = self.begin().await?;
        let minute = before.ms() / MINUTE_MS;
        sqlx::query("DELETE FROM recent WHERE key < $1").bind(minute * MINUTE).execute(&mut *writing.tx).await?;
        sqlx::query("DELETE FROM events WHERE t_us < $1").bind(before.us()).execute(&mut *writing.tx).await?;
        sqlx::query("DELETE FROM health WHERE minute < $1").bind(minute).execute(&mut *writing.tx).await?;
        // Tags without any position left: their numbers may be given again.
        sqlx::query("DELETE FROM tags WHERE last_ms < $1").bind(minute * MINUTE_MS).execute(&mut *writing.tx).await?;
        *writing.numbers = super::Numbers::default();
        Ok(writing.tx.commit().await?)
    }

    /// Keeps a tag's first position of each second in the oldest minute before one that is not yet thinned. Whether
    /// there was any.
    async fn thin_minute(&self, before: i64) -> Result<bool> {
        let mut writing = self.begin().await?;
        let minute: Option<i64> =
            sqlx::query_scalar("SELECT MIN(minute) FROM minutes WHERE thinned = 0 AND minute < $1")
                .bind(before)
                .fetch_one(&mut *writing.tx)
                .await?;
        let Some(minute) = minute else { return Ok(false) };
        let [start, end] = [minute * MINUTE, (minute + 1) * MINUTE];
        sqlx::query(
            "DELETE FROM history WHERE key >= $1 AND key < $2 AND key NOT IN (SELECT MIN(key) FROM history \
             WHERE key >= $1 AND key < $2 GROUP BY key >> 16, (key & 65535) / 1000)",
        )
        .bind(start)
        .bind(end)
        .execute(&mut *writing.tx)
        .await?;
        let done = sqlx::query("UPDATE minutes SET thinned = 1 WHERE minute = $1").bind(minute);
        done.execute(&mut *writing.tx).await?;
        writing.tx.commit().await?;
        Ok(true)
    }
}
