//! `fingerprints.csv`. What the file already holds is kept byte by byte, dwells are appended, and the file is
//! replaced as a whole.

use std::collections::HashSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::dwell::Dwell;
use super::points::SurveyPoint;
use recording::inputs::continue_read;
use recording::output;
use recording::{Table, UserError};

const COLUMNS: [&str; 7] = ["point", "room", "x_m", "y_m", "beacon", "rssi_dbm", "t_s"];

/// The file as it is on the disk.
#[derive(Clone, Debug)]
pub struct FingerprintFile {
    file: PathBuf,
    columns: Vec<String>,
    text: Vec<u8>,
    points: HashSet<String>,
}

impl FingerprintFile {
    /// Opens the file; a new file begins with its header.
    ///
    /// # Errors
    /// The file is not a file of fingerprints, or its folder does not exist.
    pub fn open(flag: &'static str, file: &Path) -> Result<Self, UserError> {
        output::check(flag, file)?;
        if file.as_os_str() == output::STANDARD {
            return Err(UserError::flag(flag, "a survey needs a file, which it can continue"));
        }
        let text = match fs::read(file) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(UserError::file(file, format!("cannot open it: {error}"))),
        };
        let mut book =
            Self { file: file.to_owned(), columns: COLUMNS.map(str::to_owned).to_vec(), text, points: HashSet::new() };
        if book.text.is_empty() {
            book.text = format!("{}\n", COLUMNS.join(",")).into_bytes();
            return Ok(book);
        }
        let mut table = Table::open(file)?;
        let point = table.column("point")?;
        for name in ["x_m", "y_m", "beacon", "rssi_dbm"] {
            table.column(name)?;
        }
        book.columns = table.header().to_vec();
        while let Some(row) = table.next_row()? {
            book.points.insert(row.text(point).to_owned());
        }
        // What was read stays in the file.
        continue_read(file);
        if book.text.last() != Some(&b'\n') {
            book.text.push(b'\n');
        }
        Ok(book)
    }

    /// Whether the file already has the point.
    pub fn has(&self, point: &str) -> bool {
        self.points.contains(point)
    }

    /// Appends a dwell, on the disk too; if that fails, the file is as before.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add(&mut self, place: &SurveyPoint, stay: &Dwell) -> Result<()> {
        let mut rows = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
        let [x, y] = place.position_m.map(|metres| metres.to_string());
        for advert in &stay.adverts {
            let (rssi, time) = (advert.rssi_dbm.to_string(), format!("{:.4}", advert.t_s));
            let fields = self.columns.iter().map(|column| match column.as_str() {
                "point" => place.name.as_str(),
                "room" => place.room.as_deref().unwrap_or(""),
                "x_m" => &x,
                "y_m" => &y,
                "beacon" => &advert.beacon,
                "rssi_dbm" => &rssi,
                "t_s" => &time,
                // A column that the user has added.
                _ => "",
            });
            rows.write_record(fields)?;
        }
        let mut text = self.text.clone();
        text.extend(rows.into_inner().map_err(|error| anyhow::Error::from(error.into_error()))?);
        output::write_file(&self.file, &text).with_context(|| format!("cannot write {}", self.file.display()))?;
        self.text = text;
        self.points.insert(place.name.clone());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::FingerprintFile;
    use crate::survey::campaign::{Dwell, parse_point};

    fn stay() -> Dwell {
        let mut stay = Dwell::new(None, 10.0);
        stay.at(3.0);
        stay.receive(3.25, "7", -61.0);
        stay
    }

    #[test]
    fn a_new_file_has_a_header_and_what_was_there_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("f.csv");
        let mut book = FingerprintFile::open("--out", &file).expect("none yet");
        assert!(!file.exists(), "nothing is written before there is anything");
        book.add(&parse_point("p 1 2.5 hall, north").expect("a point"), &stay()).expect("written");
        let first = "point,room,x_m,y_m,beacon,rssi_dbm,t_s\np,\"hall, north\",1,2.5,7,-61,0.2500\n";
        assert_eq!(std::fs::read_to_string(&file).expect("there"), first);
        let mut book = FingerprintFile::open("--out", &file).expect("good");
        assert!(book.has("p") && !book.has("q"));
        book.add(&parse_point("q 0 0").expect("a point"), &stay()).expect("written");
        assert_eq!(std::fs::read_to_string(&file).expect("there"), format!("{first}q,,0,0,7,-61,0.2500\n"));
    }

    #[test]
    fn anothers_columns_are_kept_and_what_is_no_survey_is_left_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("f.csv");
        std::fs::write(&file, "beacon,phone,rssi_dbm,y_m,x_m,point\n7,x,-60,2,1,p").expect("written");
        FingerprintFile::open("--out", &file)
            .expect("good")
            .add(&parse_point("q 3 4").expect("a point"), &stay())
            .expect("written");
        let text = std::fs::read_to_string(&file).expect("there");
        assert_eq!(text, "beacon,phone,rssi_dbm,y_m,x_m,point\n7,x,-60,2,1,p\n7,,-61,4,3,q\n");
        std::fs::write(&file, "some,thing\n1,2\n").expect("written");
        assert!(FingerprintFile::open("--out", &file).is_err());
    }
}
