//! The store: SQLite or PostgreSQL, by URL.
//!
//! New positions go into the table `recent`, which only grows at its end. Once a minute, [`Store::compact`] moves the
//! minutes that are over into `history`, in the order of its key (minute, tag, time), so that pages are full. Lengths are
//! whole millimetres, times whole milliseconds.

use std::path::Path;
use std::time::Duration;

use crate::Utc;
use crate::model::{Campaign, CampaignPoint, Event, EventKind, Plan, Sample, Site, Tag, TagPosition, Zone};

/// An error of the store.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// There is already one of this name.
    #[error("there is already {0}")]
    Exists(String),
    /// There is none of this name.
    #[error("there is no {0}")]
    Missing(String),
    /// The database was written by a newer version.
    #[error("{0} was written by a newer version of baliza")]
    Newer(String),
    /// The database.
    #[error(transparent)]
    Database(#[from] sqlx::Error),
}

/// The result of an operation.
pub type Result<T> = std::result::Result<T, StoreError>;

/// A part of a tag's history: from `from` (included) to `to` (excluded).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    pub from: Utc,
    pub to: Utc,
}

/// How long positions are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Retention {
    /// Positions older than this are thinned to one a second and tag.
    pub thin_after: Option<Duration>,
    /// Positions, events older than this are deleted.
    pub delete_after: Option<Duration>,
}

/// The store.
#[derive(Clone, Debug)]
pub struct Store {
    pool: sqlx::AnyPool,
}

impl Store {
    /// Opens `sqlite://FILE`, a plain path of a file, or `postgres://…`; makes or upgrades the tables.
    pub async fn open(url: &str) -> Result<Self> {
        let _ = url;
        todo!()
    }

    /// Whether the database answers.
    pub async fn is_well(&self) -> bool {
        todo!("{:?}", self.pool)
    }

    /// Writes positions and events together; after it returns, they survive a crash of the process.
    pub async fn write(&self, positions: &[TagPosition], events: &[Event]) -> Result<()> {
        let _ = (positions, events);
        todo!()
    }

    /// A tag's positions in a span, newest first.
    pub async fn positions(&self, site: &str, tag: &str, span: Span, limit: u32) -> Result<Vec<TagPosition>> {
        let _ = (site, tag, span, limit);
        todo!()
    }

    /// The positions of all tags of a site in a span, oldest first, at most one a tag in each `step`: what a replay and a
    /// heat map need.
    pub async fn replay(&self, site: &str, span: Span, step: Duration, limit: u32) -> Result<Vec<TagPosition>> {
        let _ = (site, span, step, limit);
        todo!()
    }

    /// Tags that ever reported, with the times of their first and last position.
    pub async fn tags(&self) -> Result<Vec<Tag>> {
        todo!()
    }

    /// Events in a span, newest first, before `before` where given.
    pub async fn events(
        &self,
        site: Option<&str>,
        span: Span,
        kinds: &[EventKind],
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Event>> {
        let _ = (site, span, kinds, before, limit);
        todo!()
    }

    /// The greatest id of an event.
    pub async fn last_event(&self) -> Result<i64> {
        todo!()
    }

    /// The sites.
    pub async fn sites(&self) -> Result<Vec<Site>> {
        todo!()
    }

    /// Makes or replaces a site, but for its plan.
    pub async fn put_site(&self, site: &Site) -> Result<()> {
        let _ = site;
        todo!()
    }

    /// Replaces a site's plan and its picture.
    pub async fn put_plan(&self, site: &str, plan: &Plan, picture: Option<&[u8]>) -> Result<()> {
        let _ = (site, plan, picture);
        todo!()
    }

    /// The picture of a site's plan.
    pub async fn picture(&self, site: &str) -> Result<Vec<u8>> {
        let _ = site;
        todo!()
    }

    /// The rooms and zones of all sites.
    pub async fn zones(&self) -> Result<Vec<Zone>> {
        todo!()
    }

    /// Makes or replaces a zone.
    pub async fn put_zone(&self, zone: &Zone) -> Result<()> {
        let _ = zone;
        todo!()
    }

    /// Deletes a zone.
    pub async fn delete_zone(&self, site: &str, name: &str) -> Result<()> {
        let _ = (site, name);
        todo!()
    }

    /// The campaigns.
    pub async fn campaigns(&self) -> Result<Vec<Campaign>> {
        todo!()
    }

    /// A campaign.
    pub async fn campaign(&self, name: &str) -> Result<Campaign> {
        let _ = name;
        todo!()
    }

    /// Makes a campaign.
    pub async fn create_campaign(&self, campaign: &Campaign) -> Result<()> {
        let _ = campaign;
        todo!()
    }

    /// Deletes a campaign with its points and samples.
    pub async fn delete_campaign(&self, name: &str) -> Result<()> {
        let _ = name;
        todo!()
    }

    /// A point of a campaign.
    pub async fn point(&self, campaign: &str, id: &str) -> Result<CampaignPoint> {
        let _ = (campaign, id);
        todo!()
    }

    /// The samples of a point, in the order of their arrival, after the first `skip`.
    pub async fn samples(&self, campaign: &str, point: &str, skip: u64, limit: u32) -> Result<Vec<Sample>> {
        let _ = (campaign, point, skip, limit);
        todo!()
    }

    /// Adds samples to a point.
    pub async fn add_samples(&self, campaign: &str, point: &str, samples: &[Sample]) -> Result<()> {
        let _ = (campaign, point, samples);
        todo!()
    }

    /// Moves the minutes that are over from `recent` to `history`.
    pub async fn compact(&self, now: Utc) -> Result<()> {
        let _ = now;
        todo!()
    }

    /// Thins and deletes what is old.
    pub async fn retain(&self, retention: Retention, now: Utc) -> Result<()> {
        let _ = (retention, now);
        todo!()
    }

    /// Copies a SQLite store, while it is in use, to a new file.
    pub async fn back_up(&self, file: &Path) -> Result<()> {
        let _ = file;
        todo!()
    }
}
