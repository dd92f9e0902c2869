//! The points of a survey, from a file or typed by a person.

use std::collections::HashSet;
use std::path::Path;

use recording::{Table, UserError};

/// A point to visit.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveyPoint {
    /// Its name.
    pub name: String,
    /// Its room.
    pub room: Option<String>,
    /// Its position, metres.
    pub position_m: [f64; 2],
    /// When the dwell begins in a recording, seconds.
    pub from_s: Option<f64>,
}

/// Reads `point,x_m,y_m` and, where known, `room,from_s`.
///
/// # Errors
/// A line is wrong (the first one is reported), or a point is in the file twice.
pub fn read_points(file: &Path) -> Result<Vec<SurveyPoint>, UserError> {
    let mut table = Table::open(file)?;
    let (point, x, y) = (table.column("point")?, table.column("x_m")?, table.column("y_m")?);
    let (room, from) = (table.optional("room"), table.optional("from_s"));
    let mut places: Vec<SurveyPoint> = Vec::new();
    let mut names: HashSet<String> = HashSet::new();
    while let Some(row) = table.next_row()? {
        let name = row.some_text(point)?.to_owned();
        if !names.insert(name.clone()) {
            return Err(row.wrong(point, "stands twice"));
        }
        let room = Some(row.text(room)).filter(|room| !room.is_empty()).map(str::to_owned);
        let position_m = [row.some_number(x)?, row.some_number(y)?];
        places.push(SurveyPoint { name, room, position_m, from_s: row.number(from)? });
    }
    if places.is_empty() { Err(UserError::line(file, 1, "no points below the header")) } else { Ok(places) }
}

/// Parses a typed point: `name x y`, and the room behind, if it has one.
///
/// # Errors
/// The line has another form; the error says which one is expected.
pub fn parse_point(line: &str) -> Result<SurveyPoint, String> {
    let expected = || "a point is: name x y, in metres, and its room, if it has one".to_owned();
    let mut words = line.split_whitespace();
    let (Some(name), Some(x), Some(y)) = (words.next(), words.next(), words.next()) else { return Err(expected()) };
    let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite()).ok_or_else(expected);
    let room = words.collect::<Vec<_>>().join(" ");
    Ok(SurveyPoint {
        name: name.to_owned(),
        room: Some(room).filter(|room| !room.is_empty()),
        position_m: [number(x)?, number(y)?],
        from_s: None,
    })
}

#[cfg(test)]
mod tests {
    use super::parse_point;

    #[test]
    fn a_typed_point_has_a_name_a_place_and_perhaps_a_room() {
        let place = parse_point(" p1 2.5 -3 living room\n").expect("a point");
        assert_eq!(
            (place.name.as_str(), place.position_m, place.room.as_deref()),
            ("p1", [2.5, -3.0], Some("living room"))
        );
        assert_eq!(parse_point("p1 2.5 0").expect("a point").room, None);
        assert!(parse_point("p1 2.5").is_err() && parse_point("p1 2.5 NaN").is_err());
    }
}
