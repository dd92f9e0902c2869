//! A tag's answer to a message of a host, as an anchor received it in the tag's poll.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::{Address, Body, Tone};
use crate::uwb::native::Answer;

/// A tag's answer to a message of a host, as an anchor received it in the tag's poll. A tag may give the same answer in
/// several polls, and several anchors may receive it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagAnswer {
    /// When it is reported, since the reporting anchor started, microseconds.
    pub t_us: u64,
    /// Short address of the tag.
    pub tag: u16,
    /// The number of the message.
    pub number: u8,
    /// How long before that another anchor received the poll and passed it on, microseconds; 0 of an own reception.
    pub age_us: u32,
    /// The code of [`TagAnswer::answer`].
    pub code: u8,
}

impl TagAnswer {
    /// What became of the message.
    pub fn answer(&self) -> Answer {
        Answer::from_code(self.code)
    }
}

impl Answer {
    /// Its name: `taken`, `unknown`, `needs-key`, `full`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Taken => "taken",
            Self::Unknown => "unknown",
            Self::NeedsKey => "needs-key",
            Self::Full => "full",
        }
    }
}

impl fmt::Display for TagAnswer {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{} message {}: {}", Address(self.tag), self.number, self.answer().as_str())
    }
}

impl Body for TagAnswer {
    const KIND: &'static str = "tag-answer";
    const LABEL: &'static str = "answr";

    fn tone(&self) -> Tone {
        if self.answer() == Answer::Taken { Tone::Normal } else { Tone::Warning }
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "tag": std::format!("{}", Address(self.tag)),
            "number": self.number,
            "age_s": f64::from(self.age_us) / 1e6,
            "answer": self.answer().as_str(),
        })
    }
}
