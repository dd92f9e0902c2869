//! The table of an image's log, by which defmt's frames become text: a feature of the program, because its decoder
//! brings 36 crates along.

#[cfg(feature = "defmt")]
pub use with::Table;
#[cfg(not(feature = "defmt"))]
pub use without::Table;

use defmt_parser::Level;

/// A frame as text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decoded {
    /// The number of its statement.
    pub index: u64,
    /// Its time, as the image prints it.
    pub time: Option<String>,
    /// Its level.
    pub level: Option<Level>,
    /// Its text.
    pub text: String,
}

#[cfg(feature = "defmt")]
mod with {
    use std::cell::Cell;
    use std::panic::{self, AssertUnwindSafe};
    use std::sync::Once;

    use defmt_decoder::Encoding;

    use super::Decoded;
    use crate::monitor::elf::SourceLocation;

    /// The table.
    pub struct Table(defmt_decoder::Table);

    impl Table {
        /// Reads the table of an ELF file.
        ///
        /// # Errors
        /// There is none, or its frames cannot be told apart.
        pub fn parse(elf: &[u8]) -> Result<Self, String> {
            let table =
                defmt_decoder::Table::parse(elf).map_err(|error| format!("its log cannot be read: {error:#}"))?;
            let table = table.ok_or(
                "it has no defmt table: it was built without the feature defmt, or is no image for a board; give the ELF that was flashed",
            )?;
            if table.encoding() != Encoding::Rzcobs {
                return Err(
                    "its log is in defmt's raw encoding, which cannot be picked up midway: build it with rzcobs".into(),
                );
            }
            Ok(Self(table))
        }

        /// Where the statements are. A stripped file has no locations. Its log can be read without them.
        pub fn locations(&self, elf: &[u8]) -> impl Iterator<Item = (u64, SourceLocation)> {
            self.0.get_locations(elf).unwrap_or_default().into_iter().map(|(index, location)| {
                (index, SourceLocation { file: location.file.to_string_lossy().into_owned(), line: location.line })
            })
        }

        /// Decodes a frame; `None`: it is malformed.
        pub fn decode(&self, frame: &[u8]) -> Option<Decoded> {
            let (frame, _) = self.0.decode(frame).ok()?;
            // The decoder panics on some values, for example on a time outside the calendar, because it does not check
            // the values that it prints.
            let (time, text) = without_panic(|| {
                (frame.display_timestamp().map(|time| time.to_string()), frame.display_message().to_string())
            })?;
            Some(Decoded { index: frame.index(), time, level: frame.level(), text })
        }
    }

    /// What a function returns; `None` where it panics. The panic prints nothing.
    fn without_panic<T>(function: impl FnOnce() -> T) -> Option<T> {
        thread_local! { static QUIET: Cell<bool> = const { Cell::new(false) }; }
        static HOOK: Once = Once::new();
        HOOK.call_once(|| {
            let usual = panic::take_hook();
            panic::set_hook(Box::new(move |panic| {
                if !QUIET.get() {
                    usual(panic);
                }
            }));
        });
        QUIET.set(true);
        let returned = panic::catch_unwind(AssertUnwindSafe(function));
        QUIET.set(false);
        returned.ok()
    }
}

#[cfg(not(feature = "defmt"))]
mod without {
    use super::Decoded;
    use crate::monitor::elf::SourceLocation;

    /// There is none.
    pub enum Table {}

    impl Table {
        /// Says that this program cannot.
        ///
        /// # Errors
        /// Always.
        pub fn parse(_: &[u8]) -> Result<Self, String> {
            Err("this baliza was built without its feature defmt, so that it cannot read a log: cargo install --path \
                 host-tools --features defmt"
                .to_owned())
        }

        /// There are none.
        pub fn locations(&self, _: &[u8]) -> std::iter::Empty<(u64, SourceLocation)> {
            match *self {}
        }

        /// There is nothing to decode with.
        pub fn decode(&self, _: &[u8]) -> Option<Decoded> {
            match *self {}
        }
    }
}
