//! Positions of a statement as one text, a line a position. A row that comes through the driver for any database costs
//! some microseconds of allocations and of going from thread to thread, and an hour of a tag has 36,000 rows. As one
//! text they take 0.1 s instead of 0.24 s.

use std::collections::BTreeMap;

use sqlx::any::AnyArguments;
use sqlx::query::QueryScalar;
use sqlx::{Any, AnyConnection};

use super::key::{ms_of, tag_of};
use super::write::millimetres;
use super::{Result, StoreError};
use crate::Utc;
use crate::model::{Doubt, TagPosition};

/// A name by number: of tags, or of rooms.
pub type Names = BTreeMap<i64, String>;

/// A statement for all positions of `recent` in the order in which they were written, or of a join with `history AS h`;
/// the text is what follows the columns.
macro_rules! lines {
    (recent $rest:expr) => {
        lines!("", "id", "key", " ORDER BY n", concat!("FROM recent ", $rest))
    };
    ($with:expr, history $rest:expr) => {
        lines!($with, "h.key", "h.key", "", $rest)
    };
    ($with:expr, $n:expr, $key:expr, $order:expr, $rest:expr) => {
        concat!(
            $with,
            " SELECT string_agg(line, ';'",
            $order,
            ") FROM (SELECT ",
            $n,
            " AS n, ",
            $key,
            " || ',' || x_mm || ',' || y_mm || ',' || COALESCE(CAST(z_mm AS TEXT), '') \
             || ',' || sigma_x_mm || ',' || sigma_y_mm || ',' || COALESCE(CAST(sigma_z_mm AS TEXT), '') \
             || ',' || correlation || ',' || COALESCE(CAST(room AS TEXT), '') || ',' || used \
             || ',' || COALESCE(doubt, '') AS line ",
            $rest,
            ") AS lines"
        )
    };
}
pub(super) use lines;

/// A position's columns.
#[derive(Clone, Copy, Debug)]
pub struct PositionLine {
    pub key: i64,
    columns: [Option<i64>; 9],
    doubt: Option<Doubt>,
}

const SUSPECT: &str = "suspect";

/// A doubt as it is stored.
pub fn of_doubt(doubt: Doubt) -> String {
    doubt.alternative_m().map_or(SUSPECT.to_owned(), |place| place.map(|m| millimetres(m).to_string()).join(" "))
}

/// A stored doubt: none of an empty text.
fn parse_doubt(text: &str) -> Option<Option<Doubt>> {
    if matches!(text, "" | SUSPECT) {
        return Some((text == SUSPECT).then_some(Doubt::Suspect));
    }
    let mm: Vec<i64> = text.split(' ').map(|mm| mm.parse().ok()).collect::<Option<_>>()?;
    let mm: [i64; 3] = mm.try_into().ok()?;
    Some(Some(Doubt::Ambiguous { alternative_m: mm.map(metres) }))
}

fn metres(mm: i64) -> f64 {
    mm as f64 / 1000.0
}

/// A statement's lines; none where it finds no position.
pub async fn fetch(
    connection: &mut AnyConnection,
    statement: QueryScalar<'_, Any, Option<String>, AnyArguments>,
) -> Result<Vec<PositionLine>> {
    let texts = statement.fetch_all(connection).await?;
    let lines = texts.iter().flatten().flat_map(|text| text.split(';'));
    lines.map(|line| PositionLine::parse(line).ok_or_else(|| damaged(line))).collect()
}

fn damaged(line: &str) -> StoreError {
    StoreError::Damaged(format!("a position is {line:?}"))
}

impl PositionLine {
    fn parse(line: &str) -> Option<Self> {
        let mut values = line.split(',');
        let key = values.next()?.parse().ok()?;
        let mut columns = [None; 9];
        for column in &mut columns {
            let value = values.next()?;
            if !value.is_empty() {
                *column = Some(value.parse().ok()?);
            }
        }
        let doubt = parse_doubt(values.next()?)?;
        values.next().is_none().then_some(Self { key, columns, doubt })
    }

    /// The position, with the names of its site, tag and room.
    pub fn position(&self, site: &str, tags: &Names, rooms: &Names) -> Result<TagPosition> {
        let [x, y, z, sigma_x, sigma_y, sigma_z, correlation, room, used] = self.columns;
        let all = (x, y, sigma_x, sigma_y, correlation, used);
        let (Some(x), Some(y), Some(sigma_x), Some(sigma_y), Some(correlation), Some(used)) = all else {
            return Err(StoreError::Damaged(format!("the position with the key {} is incomplete", self.key)));
        };
        let [sigma_x_m, sigma_y_m] = [sigma_x, sigma_y].map(metres);
        let no_name = |what, number| StoreError::Damaged(format!("{what} {number} has no name"));
        let tag = tag_of(self.key);
        let room = match room {
            Some(number) => Some(rooms.get(&number).ok_or_else(|| no_name("room", number))?.clone()),
            None => None,
        };
        Ok(TagPosition {
            site: site.to_owned(),
            tag: tags.get(&tag).ok_or_else(|| no_name("tag", tag))?.clone(),
            t: Utc::of_ms(ms_of(self.key)),
            x_m: metres(x),
            y_m: metres(y),
            z_m: z.map(metres),
            sigma_x_m,
            sigma_y_m,
            sigma_z_m: sigma_z.map(metres),
            cov_xy_m2: correlation as f64 / 127.0 * sigma_x_m * sigma_y_m,
            room,
            used: u8::try_from(used).unwrap_or(u8::MAX),
            doubt: self.doubt,
        })
    }
}
