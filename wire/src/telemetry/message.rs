//! What each message implements, and the enumeration that delegates to it.

use core::fmt;

use crate::telemetry::log::{self, Line};

/// The properties of a message beside its fields. Each message has a field `t_us`: its time since the node started,
/// microseconds. Its text ([`fmt::Display`]) is what a screen shows after the label.
pub trait Body: fmt::Display {
    /// Its kind: `type` in JSON.
    const KIND: &'static str;
    /// The label before its text on a screen, five letters at most.
    const LABEL: &'static str = Self::KIND;
    /// The table with a row for each message of this kind.
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = None;

    /// The round that it belongs to, as the node's wrapping number.
    fn round(&self) -> Option<u16> {
        None
    }

    /// The severity of its line in the log.
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

    /// The keys of its JSON object after `type` and `t_s`. Every key is always present, `null` if nothing is known.
    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value;

    /// The fields of its row after `epoch` and `t_s`; empty if it has no table.
    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        std::vec::Vec::new()
    }
}

/// How important a fact is to a person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// The node does not work.
    Error,
    /// Something is wrong, but the node goes on.
    Warning,
    /// It works.
    Info,
    /// A detail for debugging.
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

/// Defines the enumeration of a list of messages, and what it delegates to them.
macro_rules! messages {
    ($($(#[$doc:meta])* $name:ident,)+) => {
        /// A message of a node.
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

            /// Its kind, as `type` in JSON.
            pub fn kind(&self) -> &'static str {
                match self { $(Self::$name(_) => $name::KIND,)+ }
            }

            /// The label before its text on a screen, five letters at most.
            pub fn label(&self) -> &'static str {
                match self { $(Self::$name(_) => $name::LABEL,)+ }
            }

            /// Its time since the node started, microseconds.
            pub fn t_us(&self) -> u64 {
                match self { $(Self::$name(body) => body.t_us,)+ }
            }

            /// The round that it belongs to, as the node's wrapping number.
            pub fn round(&self) -> Option<u16> {
                match self { $(Self::$name(body) => body.round(),)+ }
            }

            /// How a screen shows it.
            pub fn tone(&self) -> Tone {
                match self { $(Self::$name(body) => body.tone(),)+ }
            }
        }

        /// The text after the label.
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

            /// The message as a JSON object.
            pub fn json(&self) -> serde_json::Value {
                match self { $(Self::$name(body) => crate::telemetry::host::object($name::KIND, body.t_us, body.json()),)+ }
            }

            /// The table that contains its row, and the row's fields after `epoch` and `t_s`.
            pub fn row(&self) -> Option<(crate::telemetry::Table, std::vec::Vec<std::string::String>)> {
                match self { $(Self::$name(body) => $name::TABLE.map(|table| (table, body.fields())),)+ }
            }
        }
    };
}
pub(crate) use messages;
