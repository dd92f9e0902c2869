//! Files that are read whole: each kind has a largest size, because a name may be that of a device or of another file.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::UserError;
use crate::inputs::note_read;

/// The largest site file, scenario, map or file of models, bytes.
pub const DOCUMENT_BYTES: u64 = 8 << 20;
/// The largest image for a board, with its debug information, bytes.
pub const IMAGE_BYTES: u64 = 1 << 30;
/// The largest text of another program that is read whole, bytes: some days of a tag that measures ten times a second.
pub const LOG_BYTES: u64 = 1 << 30;

/// Reads a whole file of at most `most` bytes.
///
/// # Errors
/// The file cannot be read, or it is larger.
pub fn read_limited(file: &Path, most: u64) -> Result<Vec<u8>, UserError> {
    limited_bytes(file, most).map_err(|what| UserError::file(file, what))
}

/// Does the same, for callers that name the file themselves.
///
/// # Errors
/// As for [`read_limited`]. The error is a message.
pub fn limited_bytes(file: &Path, most: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let read = File::open(file).and_then(|input| input.take(most + 1).read_to_end(&mut bytes));
    read.map_err(|error| format!("cannot open it: {error}"))?;
    note_read(file);
    if bytes.len() as u64 > most {
        return Err(format!("it is larger than {} MiB: is it the right file?", most >> 20));
    }
    Ok(bytes)
}

/// Reads a whole text of at most [`DOCUMENT_BYTES`].
///
/// # Errors
/// The file cannot be read, is larger, or is not UTF-8.
pub fn read_text(file: &Path) -> Result<String, UserError> {
    String::from_utf8(read_limited(file, DOCUMENT_BYTES)?)
        .map_err(|error| UserError::file(file, format!("not a text file: {}", error.utf8_error())))
}

#[cfg(all(test, unix))]
mod tests {
    use std::path::Path;

    use super::{DOCUMENT_BYTES, read_limited};

    #[test]
    fn a_device_without_end_is_refused() {
        let refused = read_limited(Path::new("/dev/zero"), DOCUMENT_BYTES).expect_err("endless").to_string();
        assert_eq!(refused, "/dev/zero: it is larger than 8 MiB: is it the right file?");
    }
}
