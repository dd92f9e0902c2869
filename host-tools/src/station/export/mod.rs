//! A part of the station's history in files: the tables of a recording ([`write_folder`]), tracks on the earth
//! ([`write_gpx`]), or what Foxglove draws (`write_mcap`).
//!
//! The input is the store and a [`Selection`] of it. The memory that an export takes does not depend on the span:
//! positions are read a part after the other.

mod folder;
mod gpx;
#[cfg(feature = "foxglove")]
mod mcap;

use std::collections::BTreeSet;
use std::time::Duration;

use anyhow::Result;
use baliza_station::model::{Site, Tag, TagPosition};
use baliza_station::store::Span;
use baliza_station::{Store, Utc};

pub use folder::{is_of_export, write_folder};
pub use gpx::write_gpx;
#[cfg(feature = "foxglove")]
pub use mcap::write_mcap;

use crate::UserError;

/// The parts of the span that are read together: the shortest and the longest.
const PARTS: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(86_400)];
/// With more positions, a part is too long.
const MANY: usize = 50_000;

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// The site.
    pub site: String,
    /// The number of tags that have positions.
    pub tags: usize,
    /// The number of positions.
    pub positions: usize,
}

/// The part of the history that is exported: tags of a site, and a span in which they have reported.
#[derive(Clone, Debug)]
pub struct Selection {
    site: Site,
    tags: Vec<Tag>,
    span: Span,
}

impl Selection {
    /// The positions of a site, or of one tag: without a site, those of the only one with tags.
    ///
    /// # Errors
    /// There is no such site or tag, or there are several sites; the store returns an error.
    pub async fn of(store: &Store, site: Option<&str>, tag: Option<&str>, span: Span) -> Result<Self> {
        let mut tags = store.tags().await?;
        let site = site_of(&tags, site)?;
        tags.retain(|known| known.site == site && tag.is_none_or(|tag| known.tag == tag));
        if let (Some(tag), true) = (tag, tags.is_empty()) {
            return Err(UserError::flag("--tag", format!("the site {site} has no tag {tag}")).into());
        }
        let span = Span {
            from: tags.iter().map(|tag| tag.first_seen).min().unwrap_or_default().max(span.from),
            to: tags.iter().map(|tag| tag.last_seen + Duration::from_millis(1)).max().unwrap_or_default().min(span.to),
        };
        let known = store.sites().await?.into_iter().find(|known| known.name == site);
        Ok(Self { site: known.unwrap_or_else(|| Site::new(site)), tags, span })
    }

    /// Gives `take` the positions of `tags` in the order of time.
    async fn each(
        &self,
        store: &Store,
        tags: &[Tag],
        mut take: impl FnMut(&TagPosition) -> Result<()>,
    ) -> Result<Exported> {
        let (mut with_positions, mut positions) = (BTreeSet::new(), 0);
        let (mut from, mut part) = (self.span.from, PARTS[0]);
        while from < self.span.to {
            let until = (from + part).min(self.span.to);
            let mut rows = Vec::new();
            // A tag that was not there need not be searched for.
            for tag in tags.iter().filter(|tag| tag.first_seen < until && tag.last_seen >= from) {
                let of_tag = store.positions(&self.site.name, &tag.tag, Span { from, to: until }, u32::MAX).await?;
                if !of_tag.is_empty() {
                    with_positions.insert(tag.tag.as_str());
                }
                rows.extend(of_tag);
            }
            rows.sort_by(|a, b| (a.t, &a.tag).cmp(&(b.t, &b.tag)));
            rows.iter().try_for_each(&mut take)?;
            positions += rows.len();
            // The next part has about as many positions as fit in memory.
            part = if rows.len() > MANY {
                part / 4
            } else if rows.len() < MANY / 8 {
                part * 4
            } else {
                part
            };
            part = part.clamp(PARTS[0], PARTS[1]);
            from = until;
        }
        Ok(Exported { site: self.site.name.clone(), tags: with_positions.len(), positions })
    }

    /// Refuses an export without positions.
    fn some(exported: Exported) -> Result<Exported> {
        if exported.positions == 0 {
            let what = format!("the site {} has no positions in this time", exported.site);
            return Err(UserError::flag("--from", what).into());
        }
        Ok(exported)
    }
}

/// The site that a person names, or the only one.
fn site_of(tags: &[Tag], site: Option<&str>) -> Result<String, UserError> {
    let mut sites: Vec<_> = tags.iter().map(|tag| tag.site.as_str()).collect();
    sites.sort_unstable();
    sites.dedup();
    let is_known = |site: &&str| sites.contains(site);
    match (site, sites.as_slice()) {
        (None, [only]) => Ok((*only).to_owned()),
        (Some(site), _) if is_known(&site) => Ok(site.to_owned()),
        (_, []) => Err(UserError::flag("--store", "it has no positions")),
        (None, several) => Err(UserError::flag("--site", format!("which one of {}?", several.join(", ")))),
        (Some(site), known) => Err(UserError::flag("--site", format!("{site:?} is none of {}", known.join(", ")))),
    }
}

/// Seconds since 1970, to a millisecond.
fn seconds(t: Utc) -> String {
    let ms = t.us() / 1000;
    format!("{}.{:03}", ms / 1000, ms % 1000)
}
