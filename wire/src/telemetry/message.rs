//! What each message brings, and what an enumeration of them hands on to it.

use core::fmt;

use crate::telemetry::log::{self, Line};

/// What a message brings beside its fields, of which each has `t_us`: when it was made, since the node started, microseconds. Its text ([`fmt::Display`]) is what a screen shows behind the label.
pub trait Body: fmt::Display {
    /// Its kind: `type` in JSON.
    const KIND: &'static str;
    /// What stands before its text on a screen, five letters at most.
    const LABEL: &'static str = Self::KIND;
    /// The table that has a row for each of them.
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = None;

    /// The round that it belongs to, by the node's wrapping number.
    fn round(&self) -> Option<u16> {
        None
    }

    /// The level of its line in the log.
    fn severity(&self) -> Severity {
        Severity::Info
    }

    /// How a screen shows it.
    fn tone(&self) -> Tone {
        match self.severity() {
            Severity::Error => Tone::Error,
            Severity::Warning => Tone::Warning,
            Severity::Info => Tone::Normal,
            Severity::Debug => Tone::Quiet,
        }
    }

    /// Writes its line of the log.
    fn log(&self)
    where
        Self: Line + Sized,
    {
        log::write(self.severity(), self);
    }

    /// The keys of its JSON object behind `type` and `t_s`; every key is always there, `null` where nothing is known.
    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value;

    /// The fields of its row behind `epoch` and `t_s`; empty where it has no table.
    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        std::vec::Vec::new()
    }
}

/// How much a fact matters to a person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// The node does not work.
    Error,
    /// Something is wrong, and the node goes on without it.
    Warning,
    /// It works.
    Info,
    /// For whoever looks closely.
    Debug,
}

/// How a screen shows a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// A position.
    Good,
    /// Something new.
    Normal,
    /// One of many.
    Quiet,
    /// Something is wrong.
    Warning,
    /// The node does not work, or did not.
    Error,
}

/// Makes the enumeration of a list of messages, and what it hands on to them.
macro_rules! messages {
    ($($(#[$doc:meta])* $name:ident,)+) => {
        /// What a node tells.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, MaxSize)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum Message {
            $($(#[$doc])* $name($name),)+
        }

        $(impl From<$name> for Message {
            fn from(body: $name) -> Self {
                Self::$name(body)
            }
        })+

        impl Message {
            /// All kinds, in the order of their numbers on the wire.
            pub const KINDS: &'static [&'static str] = &[$($name::KIND),+];

            /// Of which kind it is, as `type` in JSON.
            pub fn kind(&self) -> &'static str {
                match self { $(Self::$name(_) => $name::KIND,)+ }
            }

            /// What stands before its text on a screen, five letters at most.
            pub fn label(&self) -> &'static str {
                match self { $(Self::$name(_) => $name::LABEL,)+ }
            }

            /// When it was made, since the node started, microseconds.
            pub fn t_us(&self) -> u64 {
                match self { $(Self::$name(body) => body.t_us,)+ }
            }

            /// The round that it belongs to, by the node's wrapping number.
            pub fn round(&self) -> Option<u16> {
                match self { $(Self::$name(body) => body.round(),)+ }
            }

            /// How a screen shows it.
            pub fn tone(&self) -> Tone {
                match self { $(Self::$name(body) => body.tone(),)+ }
            }
        }

        /// The text behind the label.
        impl fmt::Display for Message {
            fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self { $(Self::$name(body) => body.fmt(out),)+ }
            }
        }

        #[cfg(feature = "host")]
        impl Message {
            /// All tables, in the order of their messages' numbers.
            pub fn tables() -> impl Iterator<Item = crate::telemetry::Table> {
                [$($name::TABLE),+].into_iter().flatten()
            }

            /// As an object of JSON.
            pub fn json(&self) -> serde_json::Value {
                match self { $(Self::$name(body) => crate::telemetry::host::object($name::KIND, body.t_us, body.json()),)+ }
            }

            /// The table that it is a row of, and the row's fields behind `epoch` and `t_s`.
            pub fn row(&self) -> Option<(crate::telemetry::Table, std::vec::Vec<std::string::String>)> {
                match self { $(Self::$name(body) => $name::TABLE.map(|table| (table, body.fields())),)+ }
            }
        }
    };
}
pub(crate) use messages;
