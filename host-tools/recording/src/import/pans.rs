//! The output of a DWM1001 tag with Decawave's PANS, as text of its shell: the commands `lec` and `les`.
//!
//! ```text
//! DIST,2,AN0,0F90,0.00,0.00,2.00,4.05,AN1,1B24,6.00,0.00,2.00,3.98,POS,2.90,2.71,0.80,87
//! 0F90[0.00,0.00,2.00]=4.05 1B24[6.00,0.00,2.00]=3.98 le_us=2576 est[2.90,2.71,0.80,87]
//! ```
//!
//! Lengths are metres. A line has no time, so rounds come at the tag's rate, unless a program has written seconds
//! before the lines. Then a line without seconds is left out.

use std::collections::BTreeMap;
use std::path::Path;

use super::{Imported, Round, number, numbers};
use crate::UserError;
use crate::{LOG_BYTES, read_limited};

/// A line: its time, seconds, where it has one; its anchors' names, positions and ranges, metres; its position, metres.
#[derive(Clone, Debug, Default, PartialEq)]
struct Line {
    t_s: Option<f64>,
    anchors: Vec<(String, [f64; 3], f64)>,
    position_m: Option<[f64; 3]>,
}

/// Reads a file. Lines without times come `rate_hz` times a second.
///
/// # Errors
/// The file cannot be read, or no line has a range.
pub fn read(file: &Path, rate_hz: f64) -> Result<Imported, UserError> {
    let bytes = read_limited(file, LOG_BYTES)?;
    // A serial line may begin with damaged bytes.
    parse(&String::from_utf8_lossy(&bytes), rate_hz).with_ranges(file)
}

fn parse(text: &str, rate_hz: f64) -> Imported {
    let mut imported = Imported::default();
    let mut lines = Vec::new();
    for (index, text) in text.lines().enumerate().filter(|(_, text)| !text.trim().is_empty()) {
        match line(text.trim()) {
            Ok(line) => lines.push((index as u64 + 1, line)),
            Err(what) => imported.left_out.count(index as u64 + 1, what),
        }
    }
    // The rest of a torn line may look like the time of the next one.
    let has_times = lines.iter().filter(|(_, line)| line.t_s.is_some()).count() * 2 > lines.len();
    let mut anchors = BTreeMap::new();
    for (index, (number, line)) in lines.into_iter().enumerate() {
        let t_s = if has_times { line.t_s } else { Some(index as f64 / rate_hz) };
        let Some(t_s) = t_s else {
            imported.left_out.count(number, "no seconds before it, which most other lines have");
            continue;
        };
        let ranges_m = line.anchors.iter().map(|(name, _, range_m)| (name.clone(), *range_m)).collect();
        anchors.extend(line.anchors.into_iter().map(|(name, place_m, _)| (name, place_m)));
        imported.rounds.push(Round { t_s, ranges_m, position_m: line.position_m });
    }
    Imported { anchors, ..imported }
}

fn line(text: &str) -> Result<Line, String> {
    if let Some((before, rest)) = text.split_once("DIST,") {
        return lec(rest).map(|line| Line { t_s: seconds(before), ..line });
    }
    les(text)
}

/// The seconds before a line.
fn seconds(before: &str) -> Option<f64> {
    number(before.trim_end_matches([',', ';', ':', ' ', '\t']))
}

/// A line of `lec` after `DIST,`.
fn lec(rest: &str) -> Result<Line, String> {
    let fields: Vec<&str> = rest.split(',').map(str::trim).collect();
    let (count, mut fields) = fields.split_first().ok_or("no number of anchors after DIST")?;
    let count: usize = count.parse().map_err(|_| format!("{count:?} is no number of anchors"))?;
    let mut line = Line::default();
    while let [name, rest @ ..] = fields
        && name.starts_with("AN")
    {
        let ([address, x, y, z, range, ..], Some(rest)) = (rest, rest.get(5..)) else {
            return Err(format!("{name} has no address, position and distance"));
        };
        let measured = numbers([*x, y, z].into_iter()).zip(number(range));
        let (place_m, range_m) = measured.ok_or_else(|| format!("{name} has no three coordinates and distance"))?;
        line.anchors.push(((*address).to_owned(), place_m, range_m));
        fields = rest;
    }
    if line.anchors.len() != count {
        return Err(format!("{} of {count} anchors are there", line.anchors.len()));
    }
    match fields {
        [] | [""] => {}
        ["POS", x, y, z, ..] => line.position_m = numbers([*x, y, z].into_iter()),
        [other, ..] => return Err(format!("{other:?} is neither an anchor nor POS")),
    }
    Ok(line)
}

/// A line of `les`.
fn les(text: &str) -> Result<Line, String> {
    let mut line = Line::default();
    for (index, part) in text.split_whitespace().enumerate() {
        if let Some(estimate) = part.strip_prefix("est[") {
            line.position_m = numbers(estimate.trim_end_matches(']').split(',').take(3));
        } else if let Some((anchor, range)) = part.split_once("]=") {
            let place = anchor.split_once('[').and_then(|(name, at)| Some((name, numbers(at.split(','))?)));
            let measured = place.zip(number(range));
            let ((name, place_m), range_m) = measured.ok_or_else(|| format!("{part:?} is no anchor with a range"))?;
            line.anchors.push((name.to_owned(), place_m, range_m));
        } else if index == 0 {
            line.t_s = seconds(part);
        }
    }
    if line.anchors.is_empty() { Err("neither a line of lec nor of les".to_owned()) } else { Ok(line) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEC: &str = "DIST,2,AN0,0F90,0.00,0.00,2.00,4.05,AN1,1B24,6.00,0.50,2.00,3.98,POS,2.90,2.71,0.80,87";
    const LES: &str = "0F90[0.00,0.00,2.00]=4.05 1B24[6.00,0.50,2.00]=3.98 le_us=2576 est[2.90,2.71,0.80,87]";

    #[test]
    fn both_commands_say_the_same() {
        let expected = Line {
            t_s: None,
            anchors: vec![("0F90".to_owned(), [0.0, 0.0, 2.0], 4.05), ("1B24".to_owned(), [6.0, 0.5, 2.0], 3.98)],
            position_m: Some([2.9, 2.71, 0.8]),
        };
        assert_eq!(line(LEC), Ok(expected.clone()));
        assert_eq!(line(LES), Ok(expected));
    }

    #[test]
    fn times_before_the_lines_are_taken_if_most_have_one() {
        let times = |text: &str| parse(text, 10.0).rounds.iter().map(|round| round.t_s).collect::<Vec<_>>();
        assert_eq!(times(&format!("12.5,{LEC}\n12.75 {LES}\n")), [12.5, 12.75]);
        assert_eq!(times(&format!("12.5,{LEC}\n{LES}\n")), [0.0, 0.1]);
        let most = format!("12.5,{LEC}\n{LES}\n12.75,{LEC}\n");
        assert_eq!(times(&most), [12.5, 12.75]);
        let left_out = parse(&most, 10.0).left_out;
        assert_eq!((left_out.lines, left_out.first.map(|(line, _)| line)), (1, Some(2)));
    }

    #[test]
    fn damaged_lines_are_counted_with_the_first_ones_number() {
        let torn = LEC.split_once(",AN1").expect("two anchors").0;
        let found = parse(&format!("dwm> lec\n{LEC}\n{torn}\n{LEC}\n"), 10.0);
        assert_eq!((found.rounds.len(), found.left_out.lines), (2, 2));
        assert_eq!(found.left_out.first, Some((1, "neither a line of lec nor of les".to_owned())));
        assert_eq!(line(torn), Err("1 of 2 anchors are there".to_owned()));
        assert!(
            line("DIST,1,AN0,0F90,0.00,0.00,2.00,four").is_err() && line("DIST,x").is_err() && line("DIST,").is_err()
        );
    }
}
