//! A part of the station's history in files: the tables of a recording ([`write_folder`]), tracks on the earth
//! ([`write_gpx`]), or what Foxglove draws (`write_mcap`).
//!
//! The input is the store and a [`Selection`] of it. The memory that an export takes does not depend on the span:
//! positions are read a part after the other.

mod gpx;
#[cfg(feature = "foxglove")]
mod mcap;
mod measurements;
mod recording_tables;

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use anyhow::Result;
use station_core::model::{SiteMap, TagPosition, TagStatus};
use station_core::store::Span;
use station_core::{Store, Utc};

pub use gpx::write_gpx;
#[cfg(feature = "foxglove")]
pub use mcap::write_mcap;
pub use recording_tables::{is_of_export, write_folder};

use recording::UserError;

/// The parts of the span that are read together: the shortest and the longest.
const LENGTHS: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(86_400)];
/// With more rows, a part is too long.
const MANY: usize = 50_000;
/// With fewer rows, a part is too short.
const FEW: usize = MANY / 8;

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// The site.
    pub site: String,
    /// The number of tags that have positions.
    pub tags: usize,
    /// The number of positions.
    pub positions: usize,
    /// The number of ranges and sightings.
    pub measurements: usize,
    /// The number of measurements that were left out because the place of their node is not known, by node.
    pub left_out: BTreeMap<String, usize>,
}

impl Exported {
    fn nothing_of(site: &SiteMap) -> Self {
        Self { site: site.name.clone(), tags: 0, positions: 0, measurements: 0, left_out: BTreeMap::new() }
    }

    /// Refuses an export without positions and measurements.
    fn some(self) -> Result<Self, UserError> {
        if self.positions + self.measurements == 0 {
            let what = format!("the site {} has no positions in this time", self.site);
            return Err(UserError::flag("--from", what));
        }
        Ok(self)
    }
}

/// The part of the history that is exported: tags of a site, and a span in which they have reported.
#[derive(Clone, Debug)]
pub struct Selection {
    site: SiteMap,
    tags: Vec<TagStatus>,
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
        Ok(Self { site: known.unwrap_or_else(|| SiteMap::new(site)), tags, span })
    }

    /// Gives `take` the positions of `tags` in the order of time.
    async fn each(
        &self,
        store: &Store,
        tags: &[TagStatus],
        mut take: impl FnMut(&TagPosition) -> Result<()>,
    ) -> Result<Exported> {
        let mut exported = Exported::nothing_of(&self.site);
        let mut with_positions = BTreeSet::new();
        let mut parts = Parts::of(self.span);
        while let Some(part) = parts.next() {
            let mut rows = self.positions(store, tags, part, &mut with_positions).await?;
            rows.sort_by(|a, b| (a.t, &a.tag).cmp(&(b.t, &b.tag)));
            rows.iter().try_for_each(&mut take)?;
            exported.positions += rows.len();
            parts.adapt_to(rows.len());
        }
        exported.tags = with_positions.len();
        Ok(exported)
    }

    /// The positions of `tags` in a part; the tags that have some are added to `with_positions`.
    async fn positions<'t>(
        &self,
        store: &Store,
        tags: &'t [TagStatus],
        part: Span,
        with_positions: &mut BTreeSet<&'t str>,
    ) -> Result<Vec<TagPosition>> {
        let mut rows = Vec::new();
        // A tag that was not there need not be searched for.
        for tag in tags.iter().filter(|tag| tag.first_seen < part.to && tag.last_seen >= part.from) {
            let of_tag = store.positions(&self.site.name, &tag.tag, part, u32::MAX).await?;
            if !of_tag.is_empty() {
                with_positions.insert(tag.tag.as_str());
            }
            rows.extend(of_tag);
        }
        Ok(rows)
    }
}

/// The parts of a span, one after the other: each has about as many rows as fit in memory.
struct Parts {
    from: Utc,
    to: Utc,
    length: Duration,
}

impl Parts {
    fn of(span: Span) -> Self {
        Self { from: span.from, to: span.to, length: LENGTHS[0] }
    }

    /// The next part.
    fn next(&mut self) -> Option<Span> {
        let part = Span { from: self.from, to: (self.from + self.length).min(self.to) };
        self.from = part.to;
        (part.from < part.to).then_some(part)
    }

    /// Adapts the length of the next parts to the number of rows of the last one.
    fn adapt_to(&mut self, rows: usize) {
        let length = match rows {
            ..FEW => self.length * 4,
            FEW..=MANY => self.length,
            _ => self.length / 4,
        };
        self.length = length.clamp(LENGTHS[0], LENGTHS[1]);
    }
}

/// The site that a person names, or the only one.
fn site_of(tags: &[TagStatus], site: Option<&str>) -> Result<String, UserError> {
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
