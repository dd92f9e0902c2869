//! Positions as GPX 1.1 (topografix.com/GPX/1/1): a track a tag, whose segments end where it was silent.
//!
//! The input is positions in the order of time and the geographic origin of their site. They are written as they come,
//! so the memory that a file takes does not depend on its length.

use std::fmt::{self, Write as _};
use std::io::{self, Write};
use std::time::Duration;

use positioning_core::geodesy::Geographic;

use crate::Utc;
use crate::model::{GeographicOrigin, TagPosition};

/// A segment ends where there is no position for longer.
const SILENCE: Duration = Duration::from_secs(60);

/// A document that is being written.
#[derive(Debug)]
pub struct Gpx<W> {
    to: W,
    origin: GeographicOrigin,
    track: Track,
}

/// The track that is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Track {
    None,
    Empty,
    /// A segment is open, whose last position is of this time.
    Segment(Utc),
}

impl<W: Write> Gpx<W> {
    /// Begins a document.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn new(mut to: W, origin: GeographicOrigin) -> io::Result<Self> {
        to.write_all(
            b"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
              <gpx version=\"1.1\" creator=\"Baliza\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n",
        )?;
        Ok(Self { to, origin, track: Track::None })
    }

    /// Begins the track of a tag.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn track(&mut self, tag: &str, site: &str) -> io::Result<()> {
        self.end_track()?;
        self.track = Track::Empty;
        writeln!(self.to, " <trk>\n  <name>{}</name>\n  <src>Baliza, site {}</src>", Text(tag), Text(site))
    }

    /// Takes the next position of the tag.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn point(&mut self, position: &TagPosition) -> io::Result<()> {
        let is_new = match self.track {
            Track::None | Track::Empty => true,
            Track::Segment(last) if position.t.since(last) > SILENCE => {
                self.to.write_all(b"  </trkseg>\n")?;
                true
            }
            Track::Segment(_) => false,
        };
        if is_new {
            self.to.write_all(b"  <trkseg>\n")?;
        }
        self.track = Track::Segment(position.t);
        let Geographic { latitude_deg, longitude_deg, height_m } =
            self.origin.0.geographic(position.x_m, position.y_m, position.z_m);
        // Nine decimals are a tenth of a millimetre. The schema has -180, and has not 180.
        let longitude = format!("{longitude_deg:.9}");
        let longitude = if longitude == "180.000000000" { "-180.000000000" } else { &longitude };
        write!(self.to, "   <trkpt lat=\"{latitude_deg:.9}\" lon=\"{longitude}\">")?;
        if let Some(height_m) = height_m {
            write!(self.to, "<ele>{height_m:.3}</ele>")?;
        }
        writeln!(self.to, "<time>{}</time></trkpt>", position.t)
    }

    /// Ends the document, and returns what it is written to.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn finish(mut self) -> io::Result<W> {
        self.end_track()?;
        self.to.write_all(b"</gpx>\n")?;
        Ok(self.to)
    }

    fn end_track(&mut self) -> io::Result<()> {
        let end: &[u8] = match self.track {
            Track::None => b"",
            Track::Empty => b" </trk>\n",
            Track::Segment(_) => b"  </trkseg>\n </trk>\n",
        };
        self.track = Track::None;
        self.to.write_all(end)
    }
}

/// A text in XML. Characters that XML 1.0 cannot have, even escaped, are replaced.
struct Text<'a>(&'a str);

impl fmt::Display for Text<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for character in self.0.chars() {
            match character {
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '&' => f.write_str("&amp;")?,
                '\t' | '\n' => f.write_char(character)?,
                '\u{fffe}' | '\u{ffff}' => f.write_char(char::REPLACEMENT_CHARACTER)?,
                _ if character < ' ' => f.write_char(char::REPLACEMENT_CHARACTER)?,
                _ => f.write_char(character)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(longitude_deg: f64) -> GeographicOrigin {
        let text = format!(
            r#"{{"latitude_deg": 40.332, "longitude_deg": {longitude_deg}, "y_azimuth_deg": 0, "height_m": 700}}"#
        );
        serde_json::from_str(&text).unwrap()
    }

    fn position(t: &str, x_m: f64, y_m: f64, z_m: Option<f64>) -> TagPosition {
        TagPosition {
            site: "hall".to_owned(),
            tag: "0x1001".to_owned(),
            t: t.parse().unwrap(),
            x_m,
            y_m,
            z_m,
            sigma_x_m: 0.1,
            sigma_y_m: 0.1,
            sigma_z_m: None,
            cov_xy_m2: 0.0,
            room: None,
            used: 4,
            doubt: None,
        }
    }

    /// A document of two tracks, the first with a silence of more than a minute.
    fn document() -> Vec<u8> {
        let mut gpx = Gpx::new(Vec::new(), origin(-3.766)).unwrap();
        gpx.track("trolley <1> & \u{1}co", "a\"hall'").unwrap();
        gpx.point(&position("2026-11-22T08:00:00Z", 1000.0, 0.0, Some(0.0))).unwrap();
        gpx.point(&position("2026-11-22T08:01:00Z", 0.0, 1000.0, None)).unwrap();
        gpx.point(&position("2026-11-22T08:02:00.25Z", 0.0, 0.0, Some(1.5))).unwrap();
        gpx.track("0x1002", "hall").unwrap();
        gpx.finish().unwrap()
    }

    #[test]
    fn another_program_reads_names_points_times_and_segments() {
        let read = gpx::read(document().as_slice()).unwrap();
        assert_eq!((read.version, read.creator.as_deref()), (gpx::GpxVersion::Gpx11, Some("Baliza")));
        let [trolley, empty] = read.tracks.as_slice() else { panic!("{read:?}") };
        assert_eq!(trolley.name.as_deref(), Some("trolley <1> & \u{fffd}co"));
        assert_eq!(trolley.source.as_deref(), Some("Baliza, site a\"hall'"));
        assert_eq!((empty.name.as_deref(), empty.segments.len()), (Some("0x1002"), 0));
        // The positions by PROJ: those of the test of `geodesy`.
        let found: Vec<Vec<_>> = trolley.segments.iter().map(|segment| segment.points.clone()).collect();
        assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [2, 1]);
        let expected = [
            (40.331_999_401_579, -3.754_233_656_681, Some(700.078), "2026-11-22T08:00:00Z"),
            (40.341_004_683_166, -3.766, None, "2026-11-22T08:01:00Z"),
            (40.332, -3.766, Some(701.5), "2026-11-22T08:02:00.25Z"),
        ];
        for (point, (latitude, longitude, elevation, time)) in found.concat().iter().zip(expected) {
            assert!((point.point().y() - latitude).abs() < 1e-9 && (point.point().x() - longitude).abs() < 1e-9);
            assert_eq!(point.elevation, elevation);
            assert_eq!(point.time.unwrap().format().unwrap().parse::<Utc>(), time.parse());
        }
    }

    #[test]
    fn a_document_without_tracks_is_one() {
        let gpx = Gpx::new(Vec::new(), origin(0.0)).unwrap();
        assert!(gpx::read(gpx.finish().unwrap().as_slice()).unwrap().tracks.is_empty());
    }

    #[test]
    fn the_date_line_is_west() {
        let mut gpx = Gpx::new(Vec::new(), origin(180.0)).unwrap();
        gpx.track("0x1001", "hall").unwrap();
        gpx.point(&position("2026-11-22T08:00:00Z", 0.0, 0.0, None)).unwrap();
        let text = String::from_utf8(gpx.finish().unwrap()).unwrap();
        assert!(text.contains("lon=\"-180.000000000\""), "{text}");
    }
}
