//! A part of the station's history as tracks of GPX 1.1, one a tag.

use std::io::Write;

use anyhow::{Context, Result};
use station_core::Store;
use station_core::gpx::Gpx;

use super::{Exported, Selection};
use recording::UserError;

/// Writes a selection as tracks; returns what it is written to.
///
/// # Errors
/// The site has no geographic origin, or there are no positions; the store or the output returns an error.
pub async fn write_gpx<W: Write>(store: &Store, selection: &Selection, to: W) -> Result<(Exported, W)> {
    let site = &selection.site;
    let Some(origin) = site.geographic_origin else {
        let what = format!(
            "gpx has latitudes and longitudes, and the site {name} has no geographic origin: give it one with PUT \
             /api/v1/sites/{name}/geographic-origin, or with the table [geographic_origin] of the file of serve --site",
            name = site.name
        );
        return Err(UserError::flag("--format", what).into());
    };
    let cannot = || "cannot write the tracks";
    let mut gpx = Gpx::new(to, origin).with_context(cannot)?;
    let mut all = Exported::nothing_of(site);
    for tag in &selection.tags {
        let mut is_begun = false;
        let exported = selection.each(store, std::slice::from_ref(tag), |position| {
            // A tag without positions in the span has no track.
            if !std::mem::replace(&mut is_begun, true) {
                gpx.track(&tag.tag, &site.name).with_context(cannot)?;
            }
            gpx.point(position).with_context(cannot)
        });
        let exported = exported.await?;
        all.tags += exported.tags;
        all.positions += exported.positions;
    }
    Ok((all.some()?, gpx.finish().with_context(cannot)?))
}
