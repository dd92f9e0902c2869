//! Events out of the store.

use sqlx::AssertSqlSafe;
use sqlx::any::AnyRow;

use super::rows::{get, name_of, real, variant};
use super::{Result, Span, Store};
use crate::Utc;
use crate::model::{EventKind, StationEvent};

const ALL: [EventKind; 8] = [
    EventKind::Entered,
    EventKind::Left,
    EventKind::Silent,
    EventKind::Back,
    EventKind::Moved,
    EventKind::Uncertain,
    EventKind::LowSupply,
    EventKind::Refusals,
];

impl Store {
    /// Events in a span, newest first; of all sites where none is given, of all kinds where `kinds` is empty. With
    /// `before`, the id of the last event of a page, the next page.
    pub async fn events(
        &self,
        site: Option<&str>,
        span: Span,
        kinds: &[EventKind],
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<StationEvent>> {
        let mut tx = self.read().await?;
        let before = match before {
            None => (i64::MAX, i64::MAX),
            // The event itself, or what is left next to where it was.
            Some(id) => {
                let t = sqlx::query_scalar("SELECT t_us FROM events WHERE id <= $1 ORDER BY id DESC LIMIT 1");
                match t.bind(id).fetch_optional(&mut *tx).await? {
                    Some(t) => (t, id),
                    None => return Ok(Vec::new()),
                }
            }
        };
        let asked: Vec<String> = (8..).take(ALL.len()).map(|number| format!("${number}")).collect();
        let mut query = sqlx::query(AssertSqlSafe(format!(
            "SELECT id, t_us, site, kind, node, zone, dwell_us, alarm FROM events \
             WHERE t_us >= $1 AND t_us < $2 AND (t_us, id) < ($3, $4) AND ($5 = 0 OR site = $6) \
             AND kind IN ({}) ORDER BY t_us DESC, id DESC LIMIT $7",
            asked.join(", ")
        )))
        .bind(span.from.us())
        .bind(span.to.us())
        .bind(before.0)
        .bind(before.1)
        .bind(i64::from(site.is_some()))
        .bind(site.unwrap_or_default().to_owned())
        .bind(i64::from(limit));
        for kind in ALL {
            let asked = kinds.is_empty() || kinds.contains(&kind);
            query = query.bind(if asked { name_of(kind)? } else { String::new() });
        }
        let rows = query.fetch_all(&mut *tx).await?;
        tx.commit().await?;
        let event = |row: &AnyRow| {
            Ok(StationEvent {
                id: get(row, 0)?,
                t: Utc::clamped(get(row, 1)?),
                site: get(row, 2)?,
                kind: variant(row, 3)?,
                node: get(row, 4)?,
                zone: get(row, 5)?,
                dwell_s: real(row, 6, 1e6)?,
                alarm: get::<i64>(row, 7)? != 0,
            })
        };
        rows.iter().map(event).collect()
    }

    /// The greatest id of an event; 0 where there is none.
    pub async fn last_event(&self) -> Result<i64> {
        Ok(sqlx::query_scalar("SELECT COALESCE(MAX(id), 0) FROM events").fetch_one(&self.pool).await?)
    }
}
