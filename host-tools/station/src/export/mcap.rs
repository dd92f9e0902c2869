//! A part of the station's history as MCAP, with the topics and schemas of [`View`].

use std::io::Write;

use anyhow::Result;
use station_core::Store;

use super::{Exported, Selection};
use crate::foxglove::tag_position;
use foxglove_scenes::{McapFile, View};

/// Writes a selection as MCAP; returns what it is written to.
///
/// # Errors
/// There are no positions; the store or the output returns an error.
pub async fn write_mcap<W: Write>(store: &Store, selection: &Selection, to: W) -> Result<(Exported, W)> {
    let site = &selection.site;
    let mut view = View::new(McapFile::new(to)?);
    let begin_ns = u64::try_from(selection.span.from.us()).unwrap_or_default().saturating_mul(1000);
    for node in store.nodes().await?.iter().filter(|node| node.site == site.name) {
        view.anchor(begin_ns, node.name.as_deref().unwrap_or(&node.node), node.position_m)?;
    }
    let mut epoch = 0_u64;
    let exported = selection.each(store, &selection.tags, |position| {
        tag_position(&mut view, position, epoch, site.geographic_origin)?;
        epoch += 1;
        Ok(())
    });
    let exported = exported.await?.some()?;
    Ok((exported, view.into_sink().finish()?))
}
