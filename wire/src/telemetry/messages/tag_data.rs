//! Data of a tag's user, as an anchor received them in the tag's poll.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::{Address, Body};
use crate::uwb::native::UserData;

/// Data of a tag's user, as an anchor received them in the tag's poll. A tag may send the same data in several polls,
/// and several anchors may receive them: they have one number. A number that is left out was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagData {
    /// When they are reported, since the reporting anchor started, microseconds.
    pub t_us: u64,
    /// Short address of the tag.
    pub tag: u16,
    /// Counts the tag's data, wrapping.
    pub number: u8,
    /// How long before that another anchor received the poll and passed it on, microseconds; 0 of an own reception.
    pub age_us: u32,
    /// How many bytes there are.
    pub length: u8,
    /// The bytes, with zeros after the last.
    pub bytes: [u8; UserData::MOST],
}

impl TagData {
    /// Data that are reported at `t_us`, and were received `age_us` before.
    pub fn new(t_us: u64, age_us: u32, tag: u16, data: &UserData) -> Self {
        let mut bytes = [0; UserData::MOST];
        bytes.iter_mut().zip(data.bytes()).for_each(|(to, from)| *to = *from);
        Self { t_us, tag, number: data.number(), age_us, length: data.bytes().len() as u8, bytes }
    }

    /// The data. More bytes than there can be are all of them.
    pub fn data(&self) -> &[u8] {
        self.bytes.get(..self.length.into()).unwrap_or(&self.bytes)
    }
}

/// Bytes as hexadecimal digits.
struct Hexadecimal<'a>(&'a [u8]);

impl fmt::Display for Hexadecimal<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(out, "{byte:02X}"))
    }
}

impl fmt::Display for TagData {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{} number {}: {}", Address(self.tag), self.number, Hexadecimal(self.data()))
    }
}

impl Body for TagData {
    const KIND: &'static str = "tag-data";
    const LABEL: &'static str = "data";
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = Some(crate::telemetry::Table {
        name: "tag-data",
        rows: "tag_data",
        counted: "data of tags",
        about: "Data of users that an anchor received in the polls of tags",
        columns: &["tag", "number", "data"],
    });

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "tag": std::format!("{}", Address(self.tag)),
            "number": self.number,
            "age_s": f64::from(self.age_us) / 1e6,
            "data": std::format!("{}", Hexadecimal(self.data())),
        })
    }

    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        use std::string::ToString;
        let data = Hexadecimal(self.data()).to_string();
        [Address(self.tag).to_string(), self.number.to_string(), data].into()
    }
}
