//! Positions and events into the store.

use std::collections::{BTreeMap, HashMap};
use std::sync::LazyLock;

use sqlx::any::AnyArguments;
use sqlx::query::QueryScalar;
use sqlx::{Any, AnyConnection};

use super::key::{LAST_TAG, key};
use super::rows::{MultiRowInsert, UnboundStatement, name_of, whole};
use super::{Result, Store, position_text};
use crate::Utc;
use crate::model::{StationEvent, TagPosition};

static INSERT_POSITIONS: LazyLock<MultiRowInsert> = LazyLock::new(|| {
    let before = "INSERT INTO recent \
         (key, x_mm, y_mm, z_mm, sigma_x_mm, sigma_y_mm, sigma_z_mm, correlation, room, used, doubt)";
    MultiRowInsert::new(before, 11, "")
});

static INSERT_EVENTS: LazyLock<MultiRowInsert> = LazyLock::new(|| {
    let before = "INSERT INTO events (id, t_us, site, kind, node, zone, dwell_us, alarm)";
    MultiRowInsert::new(before, 8, "ON CONFLICT (id) DO NOTHING")
});

static WIDEN_TAGS: LazyLock<MultiRowInsert> = LazyLock::new(|| {
    let before = "UPDATE tags SET \
         first_ms = CASE WHEN column2 < first_ms THEN column2 ELSE first_ms END, \
         last_ms = CASE WHEN column3 > last_ms THEN column3 ELSE last_ms END FROM (";
    MultiRowInsert::new(before, 3, ") AS seen WHERE tags.id = seen.column1")
});

/// The numbers of tags, peers and rooms that have been looked up.
#[derive(Debug, Default)]
pub struct Numbers {
    /// By site, then by name.
    tags: HashMap<String, HashMap<String, i64>>,
    peers: HashMap<String, HashMap<String, i64>>,
    rooms: HashMap<String, i64>,
}

impl Numbers {
    /// None where no number is left for a new tag.
    pub(super) async fn tag(
        &mut self,
        connection: &mut AnyConnection,
        site: &str,
        tag: &str,
        t: Utc,
    ) -> Result<Option<i64>> {
        if let Some(&id) = self.tags.get(site).and_then(|tags| tags.get(tag)) {
            return Ok(Some(id));
        }
        let known = sqlx::query_scalar("SELECT id FROM tags WHERE site = $1 AND tag = $2").bind(site).bind(tag);
        let made = sqlx::query_scalar(
            "INSERT INTO tags (id, site, tag, first_ms, last_ms) SELECT next, $1, $2, $3, $3 \
             FROM (SELECT COALESCE(MAX(id), 0) + 1 AS next FROM tags) AS numbers WHERE next <= $4 RETURNING id",
        );
        let made = made.bind(site).bind(tag).bind(t.ms()).bind(LAST_TAG);
        let Some(id) = known_or_made(connection, known, made).await? else { return Ok(None) };
        self.tags.entry(site.to_owned()).or_default().insert(tag.to_owned(), id);
        Ok(Some(id))
    }

    pub(super) async fn peer(&mut self, connection: &mut AnyConnection, site: &str, node: &str) -> Result<i64> {
        if let Some(&id) = self.peers.get(site).and_then(|peers| peers.get(node)) {
            return Ok(id);
        }
        let known = sqlx::query_scalar("SELECT id FROM peers WHERE site = $1 AND node = $2").bind(site).bind(node);
        let made = sqlx::query_scalar(
            "INSERT INTO peers (id, site, node) SELECT COALESCE(MAX(id), 0) + 1, $1, $2 FROM peers RETURNING id",
        );
        let made = made.bind(site).bind(node);
        let id = known_or_made(connection, known, made).await?.ok_or(sqlx::Error::RowNotFound)?;
        self.peers.entry(site.to_owned()).or_default().insert(node.to_owned(), id);
        Ok(id)
    }

    async fn room(&mut self, connection: &mut AnyConnection, name: &str) -> Result<i64> {
        if let Some(&id) = self.rooms.get(name) {
            return Ok(id);
        }
        let known = sqlx::query_scalar("SELECT id FROM rooms WHERE name = $1").bind(name);
        let made = "INSERT INTO rooms (id, name) SELECT COALESCE(MAX(id), 0) + 1, $1 FROM rooms RETURNING id";
        let made = sqlx::query_scalar(made).bind(name);
        let id = known_or_made(connection, known, made).await?.ok_or(sqlx::Error::RowNotFound)?;
        self.rooms.insert(name.to_owned(), id);
        Ok(id)
    }
}

/// The number that is known, or else that which is made.
async fn known_or_made(
    connection: &mut AnyConnection,
    known: QueryScalar<'_, Any, i64, AnyArguments>,
    made: QueryScalar<'_, Any, i64, AnyArguments>,
) -> Result<Option<i64>> {
    match known.fetch_optional(&mut *connection).await? {
        Some(id) => Ok(Some(id)),
        None => Ok(made.fetch_optional(connection).await?),
    }
}

/// The first and the last time at which tags were seen, milliseconds, by their numbers.
#[derive(Debug, Default)]
pub(super) struct Seen(BTreeMap<i64, (i64, i64)>);

impl Seen {
    pub(super) fn note(&mut self, tag: i64, t: Utc) {
        let t = t.ms();
        let span = self.0.entry(tag).or_insert((t, t));
        *span = (span.0.min(t), span.1.max(t));
    }

    pub(super) async fn write(self, connection: &mut AnyConnection) -> Result<()> {
        let seen: Vec<_> = self.0.into_iter().collect();
        WIDEN_TAGS.run(connection, &seen, |query, &(tag, (first, last))| query.bind(tag).bind(first).bind(last)).await
    }
}

/// A position as it is stored.
struct Stored {
    key: i64,
    mm: [i32; 2],
    z_mm: Option<i32>,
    sigma_mm: [i32; 2],
    sigma_z_mm: Option<i32>,
    correlation: i16,
    room: Option<i64>,
    used: u8,
    doubt: Option<String>,
}

impl Stored {
    fn new(position: &TagPosition, tag: i64, room: Option<i64>) -> Self {
        Self {
            key: key(position.t.ms(), tag),
            mm: [position.x_m, position.y_m].map(millimetres),
            z_mm: position.z_m.filter(|z| z.is_finite()).map(millimetres),
            sigma_mm: [position.sigma_x_m, position.sigma_y_m].map(sigma_millimetres),
            sigma_z_mm: position.sigma_z_m.filter(|sigma| sigma.is_finite()).map(sigma_millimetres),
            correlation: correlation(position),
            room,
            used: position.used,
            doubt: position.doubt.map(position_text::of_doubt),
        }
    }

    fn bind<'q>(query: UnboundStatement<'q>, row: &Self) -> UnboundStatement<'q> {
        query
            .bind(row.key)
            .bind(row.mm[0])
            .bind(row.mm[1])
            .bind(row.z_mm)
            .bind(row.sigma_mm[0])
            .bind(row.sigma_mm[1])
            .bind(row.sigma_z_mm)
            .bind(row.correlation)
            .bind(row.room)
            .bind(i16::from(row.used))
            .bind(row.doubt.clone())
    }
}

/// The nearest number of millimetres; beyond 2,147 km the last one.
pub(super) fn millimetres(m: f64) -> i32 {
    whole(m, 1000.0)
}

/// A standard deviation is never rounded to zero: nothing is exact.
fn sigma_millimetres(m: f64) -> i32 {
    millimetres(m).max(1)
}

/// 127ths, short of ±1: the covariance that is read again is that of an ellipse, not of a line.
fn correlation(position: &TagPosition) -> i16 {
    let correlation = position.cov_xy_m2 / (position.sigma_x_m * position.sigma_y_m);
    (correlation * 127.0).round().clamp(-126.0, 126.0) as i16
}

impl Store {
    /// Writes positions and events together; after it returns, they survive a crash of the process and a power cut.
    /// What is written again is not stored twice. A position that is not finite is left out, and one of a new tag for
    /// which the key of positions has no number. Returns how many were left out.
    pub async fn write(&self, positions: &[TagPosition], events: &[StationEvent]) -> Result<u64> {
        let mut writing = self.begin().await?;
        // Numbers of this transaction hold only if it is committed.
        let mut numbers = std::mem::take(&mut *writing.numbers);
        let mut rows = Vec::with_capacity(positions.len());
        let mut left_out = 0;
        let mut seen = Seen::default();
        for position in positions {
            let values = [position.x_m, position.y_m, position.sigma_x_m, position.sigma_y_m];
            if !values.iter().all(|value| value.is_finite()) {
                log::warn!("a position of {:?} that is no number is not stored", position.tag);
                left_out += 1;
                continue;
            }
            let Some(tag) = numbers.tag(&mut writing.tx, &position.site, &position.tag, position.t).await? else {
                left_out += 1;
                continue;
            };
            let room = match &position.room {
                Some(room) => Some(numbers.room(&mut writing.tx, room).await?),
                None => None,
            };
            seen.note(tag, position.t);
            rows.push(Stored::new(position, tag, room));
        }
        INSERT_POSITIONS.run(&mut writing.tx, &rows, Stored::bind).await?;
        seen.write(&mut writing.tx).await?;
        insert_events(&mut writing.tx, events).await?;
        writing.tx.commit().await?;
        *writing.numbers = numbers;
        Ok(left_out)
    }
}

async fn insert_events(connection: &mut AnyConnection, events: &[StationEvent]) -> Result<()> {
    let events = events.iter().map(|event| Ok((event, name_of(event.kind)?))).collect::<Result<Vec<_>>>()?;
    INSERT_EVENTS
        .run(connection, &events, |query, (event, kind)| {
            query
                .bind(event.id)
                .bind(event.t.us())
                .bind(event.site.clone())
                .bind(kind.clone())
                .bind(event.node.clone())
                .bind(event.zone.clone())
                .bind(event.dwell_s.map(|s| (s * 1e6).round() as i64))
                .bind(i16::from(event.alarm))
        })
        .await
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Utc;

    fn position(cov_xy_m2: f64) -> TagPosition {
        TagPosition {
            site: "hall".to_owned(),
            tag: "0x1001".to_owned(),
            t: Utc::clamped(61_000_000),
            x_m: 1.234_6,
            y_m: -3_000_000.0,
            z_m: Some(f64::NAN),
            sigma_x_m: 0.000_1,
            sigma_y_m: 0.2,
            sigma_z_m: None,
            cov_xy_m2,
            room: None,
            used: 255,
            doubt: None,
        }
    }

    #[test]
    fn lengths_are_rounded_and_limited_and_no_deviation_becomes_zero() {
        let stored = Stored::new(&position(0.0), 1, None);
        assert_eq!((stored.mm, stored.z_mm, stored.sigma_mm), ([1235, i32::MIN], None, [1, 200]));
    }

    #[test]
    fn a_correlation_stays_within_one() {
        // 0.5 of 0.0001 m times 0.2 m; 0.5 * 127 = 63.5.
        assert_eq!(correlation(&position(0.5 * 0.000_02)), 64);
        assert_eq!(correlation(&position(-1.0)), -126);
        assert_eq!(correlation(&TagPosition { sigma_x_m: 0.0, ..position(0.0) }), 0);
    }
}
