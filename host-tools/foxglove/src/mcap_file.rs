//! A view in an MCAP file.

use std::collections::BTreeMap;
use std::io::Write;

use anyhow::{Context, Result};
use mcap::WriteOptions;
use mcap::records::MessageHeader;
use mcap::write::{NoSeek, Writer};

use super::{Sink, Topic};

/// An MCAP file that is being written. It is not compressed.
pub struct McapFile<W: Write> {
    writer: Writer<NoSeek<W>>,
    sequence: u32,
}

impl<W: Write> McapFile<W> {
    /// Begins a file.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn new(to: W) -> Result<Self> {
        let options = WriteOptions::new().compression(None).library("baliza").disable_seeking(true);
        Ok(Self { writer: options.create(NoSeek::new(to)).context("cannot write MCAP")?, sequence: 0 })
    }

    /// Writes the file's end, and returns what it is written to.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn finish(mut self) -> Result<W> {
        self.writer.finish().context("cannot write MCAP")?;
        Ok(self.writer.into_inner().into_inner())
    }
}

impl<W: Write> Sink for McapFile<W> {
    type Channel = u16;

    fn open(&mut self, topic: Topic<'_>) -> Result<u16> {
        let Topic { name, encoding, schema } = topic;
        let opened = self
            .writer
            .add_schema(&schema.name, &schema.encoding, &schema.data)
            .and_then(|schema| self.writer.add_channel(schema, name, &encoding, &BTreeMap::new()));
        opened.with_context(|| format!("cannot write the channel {name}"))
    }

    fn put(&mut self, channel: &u16, t_ns: u64, message: &[u8]) -> Result<()> {
        let header =
            MessageHeader { channel_id: *channel, sequence: self.sequence, log_time: t_ns, publish_time: t_ns };
        self.sequence = self.sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, message).context("cannot write MCAP")
    }
}
