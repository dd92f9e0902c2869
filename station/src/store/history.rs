//! Positions out of the store.

use std::collections::BTreeMap;
use std::time::Duration;

use sqlx::AnyConnection;

use super::key::{MINUTE_MS, TAG, key, ms_of, tag_of};
use super::position_text::{Names, PositionLine, fetch, lines};
use super::rows::{get, limit};
use super::{Result, Span, Store};
use crate::Utc;
use crate::model::{TagPosition, TagStatus};

/// Minutes that are read together at first; then four times as many, where they did not fill the answer.
const FIRST_MINUTES: usize = 16;
/// The most that are read together: a text has at most 1 GB.
const MOST_MINUTES: usize = 256;

/// Longer than the time from 1970 to the last instant: one step is all.
const LONGEST_STEP_MS: i64 = 1 << 43;

impl Store {
    /// A tag's positions in a span, newest first.
    pub async fn positions(&self, site: &str, tag: &str, span: Span, limit: u32) -> Result<Vec<TagPosition>> {
        let limit = usize::try_from(limit).unwrap_or(usize::MAX);
        let mut tx = self.read().await?;
        let Some((id, from, to)) = span_of_tag(&mut tx, site, tag, span).await? else { return Ok(Vec::new()) };
        let rooms = rooms(&mut tx).await?;
        let tags = Names::from([(id, tag.to_owned())]);
        let mut found = BTreeMap::<i64, TagPosition>::new();
        for line in recent_of_tag(&mut tx, id, from, to).await? {
            found.entry(line.key).or_insert(line.position(site, &tags, &rooms)?);
        }
        let mut minutes = Minutes::newest_first(from, to);
        // Those of `recent` do not count: late ones may be older than what is still to be read.
        let mut left = limit;
        while left > 0
            && let Some((first, last)) = minutes.next(&mut tx).await?
        {
            let lines = history_of_tag(&mut tx, id, (from, to), (first, last), left).await?;
            left = left.saturating_sub(lines.len());
            for line in lines {
                found.insert(line.key, line.position(site, &tags, &rooms)?);
            }
        }
        tx.commit().await?;
        Ok(found.into_values().rev().take(limit).collect())
    }

    /// The positions of all tags of a site in a span, oldest first, at most one a tag in each `step`, the first: what a
    /// replay and a heat map need. Steps are counted from 1970.
    pub async fn replay(&self, site: &str, span: Span, step: Duration, limit: u32) -> Result<Vec<TagPosition>> {
        let limit = usize::try_from(limit).unwrap_or(usize::MAX);
        let step = i64::try_from(step.as_millis()).unwrap_or(i64::MAX).clamp(1, LONGEST_STEP_MS);
        let (from, to) = span.ms();
        let mut tx = self.read().await?;
        let tags = tags_of_site(&mut tx, site).await?;
        let rooms = rooms(&mut tx).await?;
        // By step and tag.
        let mut found = BTreeMap::new();
        let add = |line: PositionLine, found: &mut BTreeMap<(i64, i64), PositionLine>| {
            let first = found.entry((ms_of(line.key) / step, tag_of(line.key))).or_insert(line);
            if line.key < first.key {
                *first = line;
            }
        };
        let mut minutes = Minutes::oldest_first(from, to);
        while found.len() < limit
            && let Some((first, last)) = minutes.next(&mut tx).await?
        {
            for line in steps_of_history(&mut tx, site, step, (from, to), (first, last)).await? {
                add(line, &mut found);
            }
        }
        // All of them: those that are newer than the end of the minutes that were read are cut off below.
        for line in steps_of_recent(&mut tx, site, step, from, to).await? {
            add(line, &mut found);
        }
        tx.commit().await?;
        let mut found: Vec<_> = found.into_values().collect();
        found.sort_by_key(|line| (ms_of(line.key), line.key));
        found.truncate(limit);
        found.iter().map(|line| line.position(site, &tags, &rooms)).collect()
    }

    /// Tags that ever reported, with the times of their first and last position, and the last position.
    pub async fn tags(&self) -> Result<Vec<TagStatus>> {
        let mut tx = self.read().await?;
        let rooms = rooms(&mut tx).await?;
        let rows = sqlx::query("SELECT id, site, tag, first_ms, last_ms FROM tags ORDER BY site, tag");
        let mut tags = Vec::new();
        let mut by_number = BTreeMap::new();
        for row in rows.fetch_all(&mut *tx).await? {
            let (site, tag): (String, String) = (get(&row, 1)?, get(&row, 2)?);
            let [first_seen, last_seen] = [Utc::of_ms(get(&row, 3)?), Utc::of_ms(get(&row, 4)?)];
            by_number.insert(get::<i64>(&row, 0)?, tags.len());
            tags.push(TagStatus {
                tag,
                site,
                name: None,
                first_seen,
                last_seen,
                last_position: None,
                rate_hz: 0.0,
                silent: true,
                reason: None,
                zones: Vec::new(),
                supply_v: None,
            });
        }
        for line in last_positions(&mut tx).await? {
            let number = tag_of(line.key);
            if let Some(tag) = by_number.get(&number).and_then(|&index| tags.get_mut(index)) {
                let name = Names::from([(number, tag.tag.clone())]);
                let last = line.position(&tag.site, &name, &rooms)?;
                if tag.last_position.as_ref().is_none_or(|known| known.t < last.t) {
                    tag.last_position = Some(last);
                }
            }
        }
        tx.commit().await?;
        Ok(tags)
    }
}

/// The minutes of history in a span, some at a time.
struct Minutes {
    /// First and last that are not yet read.
    left: (i64, i64),
    newest_first: bool,
    most: usize,
}

impl Minutes {
    fn newest_first(from_ms: i64, to_ms: i64) -> Self {
        let left = (from_ms / MINUTE_MS, (to_ms - 1).div_euclid(MINUTE_MS));
        Self { left, newest_first: true, most: FIRST_MINUTES }
    }

    /// One at first: it may hold thousands of steps of all tags.
    fn oldest_first(from_ms: i64, to_ms: i64) -> Self {
        Self { newest_first: false, most: 1, ..Self::newest_first(from_ms, to_ms) }
    }

    /// The first and the last of the next ones.
    async fn next(&mut self, connection: &mut AnyConnection) -> Result<Option<(i64, i64)>> {
        let statement = if self.newest_first {
            "SELECT MIN(minute), MAX(minute) FROM \
             (SELECT minute FROM minutes WHERE minute >= $1 AND minute <= $2 ORDER BY minute DESC LIMIT $3) AS chunk"
        } else {
            "SELECT MIN(minute), MAX(minute) FROM \
             (SELECT minute FROM minutes WHERE minute >= $1 AND minute <= $2 ORDER BY minute LIMIT $3) AS chunk"
        };
        let row = sqlx::query(statement)
            .bind(self.left.0)
            .bind(self.left.1)
            .bind(limit(self.most))
            .fetch_one(connection)
            .await?;
        let (Some(first), Some(last)) = (get::<Option<i64>>(&row, 0)?, get::<Option<i64>>(&row, 1)?) else {
            return Ok(None);
        };
        if self.newest_first {
            self.left.1 = first - 1;
        } else {
            self.left.0 = last + 1;
        }
        self.most = (self.most * 4).min(MOST_MINUTES);
        Ok(Some((first, last)))
    }
}

/// A tag's number, and the part of the span in which it has positions, milliseconds.
async fn span_of_tag(
    connection: &mut AnyConnection,
    site: &str,
    tag: &str,
    span: Span,
) -> Result<Option<(i64, i64, i64)>> {
    let known = sqlx::query("SELECT id, first_ms, last_ms FROM tags WHERE site = $1 AND tag = $2")
        .bind(site)
        .bind(tag)
        .fetch_optional(connection)
        .await?;
    let Some(row) = known else { return Ok(None) };
    let (from, to) = span.ms();
    let (from, to) = (from.max(get(&row, 1)?), to.min(get::<i64>(&row, 2)? + 1));
    Ok((from < to).then_some((get(&row, 0)?, from, to)))
}

async fn recent_of_tag(connection: &mut AnyConnection, tag: i64, from: i64, to: i64) -> Result<Vec<PositionLine>> {
    let rows = sqlx::query_scalar(lines!(recent "WHERE key >= $1 AND key < $2 AND (key >> 16) & 1048575 = $3"));
    fetch(connection, rows.bind(key(from, tag)).bind(key(to, tag)).bind(tag)).await
}

/// A search for each minute: PostgreSQL would take a join of minutes and history for one of all rows with all.
async fn history_of_tag(
    connection: &mut AnyConnection,
    tag: i64,
    (from, to): (i64, i64),
    (first, last): (i64, i64),
    rows: usize,
) -> Result<Vec<PositionLine>> {
    let statement = sqlx::query_scalar(concat!(
        "SELECT (",
        lines!("", history "FROM history AS h \
             WHERE h.key >= CASE WHEN m.low < $5 THEN $5 ELSE m.low END \
             AND h.key < CASE WHEN m.high > $6 THEN $6 ELSE m.high END ORDER BY h.key DESC LIMIT $7"),
        ") FROM (SELECT minute * 68719476736 + $3 AS low, minute * 68719476736 + $4 AS high FROM minutes \
             WHERE minute >= $1 AND minute <= $2) AS m"
    ));
    let statement = statement.bind(first).bind(last).bind(tag * TAG).bind((tag + 1) * TAG);
    fetch(connection, statement.bind(key(from, tag)).bind(key(to, tag)).bind(limit(rows))).await
}

/// The first position of each tag in each part of a step that lies in a minute. Each is searched for by its key: of ten
/// positions a second, nine are not touched.
async fn steps_of_history(
    connection: &mut AnyConnection,
    site: &str,
    step: i64,
    (from, to): (i64, i64),
    (first, last): (i64, i64),
) -> Result<Vec<PositionLine>> {
    let statement = sqlx::query_scalar(lines!("WITH RECURSIVE \
         step (n) AS (SELECT CAST(0 AS BIGINT) UNION ALL SELECT n + 1 FROM step WHERE (n + 1) * $3 < 60000 + $3), \
         part (minute, low, high, start, stop) AS (\
             SELECT minute, CASE WHEN minute * 60000 < $4 THEN $4 ELSE minute * 60000 END, \
                 CASE WHEN minute * 60000 + 60000 > $5 THEN $5 ELSE minute * 60000 + 60000 END, \
                 (minute * 60000 / $3 + n) * $3, (minute * 60000 / $3 + n + 1) * $3 \
             FROM minutes CROSS JOIN step WHERE minute >= $1 AND minute <= $2), \
         clipped (minute, start, stop) AS (\
             SELECT minute, CASE WHEN start < low THEN low ELSE start END - minute * 60000, \
                 CASE WHEN stop > high THEN high ELSE stop END - minute * 60000 \
             FROM part WHERE start < high AND stop > low), \
         first_key (key) AS (\
             SELECT (SELECT MIN(h.key) FROM history AS h \
                 WHERE h.key >= c.minute * 68719476736 + g.id * 65536 + c.start \
                 AND h.key < c.minute * 68719476736 + g.id * 65536 + c.stop) \
             FROM clipped AS c CROSS JOIN tags AS g WHERE g.site = $6 \
             AND g.last_ms >= c.minute * 60000 AND g.first_ms < c.minute * 60000 + 60000)",
        history "FROM first_key AS f CROSS JOIN history AS h WHERE h.key = f.key"));
    fetch(connection, statement.bind(first).bind(last).bind(step).bind(from).bind(to).bind(site)).await
}

/// The same of `recent`, which has no order: one pass.
async fn steps_of_recent(
    connection: &mut AnyConnection,
    site: &str,
    step: i64,
    from: i64,
    to: i64,
) -> Result<Vec<PositionLine>> {
    let statement = sqlx::query_scalar(lines!(recent "WHERE key IN (SELECT MIN(key) FROM (\
                 SELECT key, (key >> 16) & 1048575 AS tag, (key >> 36) * 60000 + (key & 65535) AS t \
                 FROM recent) AS timed \
             WHERE t >= $1 AND t < $2 AND tag IN (SELECT id FROM tags WHERE site = $3) GROUP BY tag, t / $4)"));
    fetch(connection, statement.bind(from).bind(to).bind(site).bind(step)).await
}

/// The last position of each tag in `history` and that in `recent`. Thinning may have taken the very last one.
async fn last_positions(connection: &mut AnyConnection) -> Result<Vec<PositionLine>> {
    let history = sqlx::query_scalar(lines!("", history "FROM (SELECT (SELECT MAX(key) FROM history \
                 WHERE key >= (g.last_ms / 60000) * 68719476736 + g.id * 65536 \
                 AND key < (g.last_ms / 60000) * 68719476736 + (g.id + 1) * 65536) AS key FROM tags AS g) AS f \
         CROSS JOIN history AS h WHERE h.key = f.key"));
    let recent =
        sqlx::query_scalar(lines!(recent "WHERE key IN (SELECT MAX(key) FROM recent GROUP BY (key >> 16) & 1048575)"));
    let mut lines = fetch(&mut *connection, history).await?;
    lines.extend(fetch(connection, recent).await?);
    Ok(lines)
}

async fn tags_of_site(connection: &mut AnyConnection, site: &str) -> Result<Names> {
    let rows = sqlx::query("SELECT id, tag FROM tags WHERE site = $1").bind(site).fetch_all(connection).await?;
    rows.iter().map(|row| Ok((get(row, 0)?, get(row, 1)?))).collect()
}

async fn rooms(connection: &mut AnyConnection) -> Result<Names> {
    let rows = sqlx::query("SELECT id, name FROM rooms").fetch_all(connection).await?;
    rows.iter().map(|row| Ok((get(row, 0)?, get(row, 1)?))).collect()
}
