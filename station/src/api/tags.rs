//! Tags and where they were: the live state and the store to answers.

use std::collections::HashSet;
use std::time::Duration;

use axum::extract::State;
use axum::http::{StatusCode, Uri};
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::{Limit, Name, Path, Query, span};
use super::problem::Problem;
use super::{Shared, answer};
use crate::Utc;
use crate::gpx::Gpx;
use crate::model::{TagPosition, TagStatus};
use crate::store::Span;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(history)).routes(routes!(track)).routes(routes!(replay))
}

/// The media type of tracks: not registered, but what programs use.
const GPX: &str = "application/gpx+xml";

/// Which rows of a list.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct OfSite {
    /// Only of this site.
    #[param(inline)]
    pub site: Option<Name>,
}

/// The tags, with their last positions, by site and address.
#[utoipa::path(get, path = "/api/v1/tags", tag = "tags", security(("token" = ["view"])),
    params(OfSite), responses((status = 200, body = [TagStatus])))]
async fn list(State(station): State<Shared>, Query(of): Query<OfSite>) -> Result<Response, Problem> {
    let mut tags = station.tags();
    tags.retain(|tag| of.site.as_ref().is_none_or(|site| site.as_str() == tag.site));
    answer::page(&tags, None)
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct History {
    /// Only of this site; without it, of the site where the tag reported last.
    #[param(inline)]
    site: Option<Name>,
    /// From this time.
    #[param(inline)]
    from: Option<Utc>,
    /// Until this time, which is excluded.
    #[param(inline)]
    to: Option<Utc>,
    /// The greatest number of rows.
    #[serde(default)]
    #[param(inline, required = false)]
    limit: Limit,
}

/// A tag's positions, newest first. The header `Link` tells where older ones are.
#[utoipa::path(get, path = "/api/v1/tags/{tag}/positions", tag = "tags", security(("token" = ["view"])),
    params(("tag" = Name, Path, description = "the tag"), History),
    responses((status = 200, body = [TagPosition])))]
async fn history(
    State(station): State<Shared>,
    Path(tag): Path<Name>,
    Query(asked): Query<History>,
    uri: Uri,
) -> Result<Response, Problem> {
    let (_, rows, next) = station.history(&tag, asked, &uri).await?;
    answer::page(&rows, next)
}

/// The same positions as a track in GPX 1.1, in the order of time, for maps. The site needs a geographic origin.
#[utoipa::path(get, path = "/api/v1/tags/{tag}/positions.gpx", tag = "tags", security(("token" = ["view"])),
    params(("tag" = Name, Path, description = "the tag"), History),
    responses((status = 200, description = "the track", content_type = GPX, body = String)))]
async fn track(
    State(station): State<Shared>,
    Path(tag): Path<Name>,
    Query(asked): Query<History>,
    uri: Uri,
) -> Result<Response, Problem> {
    let (site, rows, next) = station.history(&tag, asked, &uri).await?;
    let none = || {
        let path = format!("PUT /api/v1/sites/{site}/geographic-origin");
        Problem::missing(format_args!("geographic origin of the site {site}: {path} says where it is on the earth"))
    };
    let origin = station.app.hub.read(|live| live.geographic_origin(&site)).ok_or_else(none)?;
    let written = || {
        let mut gpx = Gpx::new(Vec::new(), origin)?;
        gpx.track(tag.as_str(), &site)?;
        rows.iter().rev().try_for_each(|row| gpx.point(row))?;
        gpx.finish()
    };
    let body = written().map_err(|error: std::io::Error| {
        log::error!("a track cannot be written: {error}");
        Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "the track cannot be written")
    })?;
    Ok(answer::page_of(GPX, body, next))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct Replay {
    /// The site.
    #[param(inline)]
    site: Name,
    /// From this time; without it, from one hour before `to`.
    #[param(inline)]
    from: Option<Utc>,
    /// Until this time, which is excluded; without it, until now.
    #[param(inline)]
    to: Option<Utc>,
    /// At most one position a tag in this time; 0: all.
    #[serde(default)]
    #[param(inline, required = false)]
    step_s: Step,
    /// The greatest number of rows. Steps are not separated: one that has more is a page of its own.
    #[serde(default)]
    #[param(inline, required = false)]
    limit: Limit,
}

#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(try_from = "f64")]
#[schema(value_type = f64, minimum = 0.0, maximum = 86_400.0)]
struct Step(Duration);

impl Default for Step {
    fn default() -> Self {
        Self(Duration::from_secs(1))
    }
}

impl TryFrom<f64> for Step {
    type Error = &'static str;

    fn try_from(seconds: f64) -> Result<Self, Self::Error> {
        let step = Duration::try_from_secs_f64(seconds).ok().filter(|step| step.as_secs_f64() <= 86_400.0);
        step.map(Self).ok_or("step_s is 0 to 86400")
    }
}

/// The positions of all tags of a site, oldest first. The header `Link` tells where newer ones are.
#[utoipa::path(get, path = "/api/v1/positions", tag = "tags", security(("token" = ["view"])),
    params(Replay), responses((status = 200, body = [TagPosition])))]
async fn replay(State(station): State<Shared>, Query(asked): Query<Replay>, uri: Uri) -> Result<Response, Problem> {
    let to = asked.to.unwrap_or_else(Utc::now);
    let span = span(asked.from.or(Some(to - Duration::from_secs(3600))), Some(to))?;
    let limit = asked.limit.get();
    let (store, site, step) = (&station.app.store, asked.site.as_str(), asked.step_s.0);
    let mut rows = store.replay(site, span, step, limit + 1).await?;
    let next = whole_steps(&mut rows, limit as usize, step);
    let (rows, next) = match next {
        // One step has more positions than the page: all of them then.
        Some(begin) if rows.is_empty() => {
            let end = begin + step.max(FINEST);
            let one = Span { from: begin.max(span.from), to: end.min(span.to) };
            (store.replay(site, one, step, Limit::MOST).await?, Some(end).filter(|end| *end < span.to))
        }
        next => (rows, next),
    };
    answer::page(&rows, next.map(|next| answer::with_parameter(&uri, "from", &next.to_string())))
}

/// The finest step of the store.
const FINEST: Duration = Duration::from_millis(1);

/// Shortens rows in the order of time to at most `limit`, without separating those of one step, which begin at
/// multiples of their length; where the next page begins, if there is one.
fn whole_steps(rows: &mut Vec<TagPosition>, limit: usize, step: Duration) -> Option<Utc> {
    let beyond = rows.get(limit)?.t.us();
    let step_us = i64::try_from(step.max(FINEST).as_millis()).ok()? * 1_000;
    let next = Utc::clamped(beyond / step_us * step_us);
    rows.retain(|row| row.t < next);
    Some(next)
}

impl super::Station {
    /// The site of a tag's history, a page of it, newest first, and where the next one is.
    async fn history(
        &self,
        tag: &Name,
        asked: History,
        uri: &Uri,
    ) -> Result<(String, Vec<TagPosition>, Option<String>), Problem> {
        let span = span(asked.from, asked.to)?;
        let site = match asked.site {
            Some(site) => String::from(site),
            None => self.site_of(tag.as_str()).await?,
        };
        let rows = self.app.store.positions(&site, tag.as_str(), span, asked.limit.get()).await?;
        // A tag has one position at a time, and `to` is excluded: the next page begins after the last row.
        let next = asked.limit.last_of_full(&rows).map(|last| answer::with_parameter(uri, "to", &last.t.to_string()));
        Ok((site, rows, next))
    }

    /// The site where a tag reported last.
    async fn site_of(&self, tag: &str) -> Result<String, Problem> {
        let last = |tags: Vec<TagStatus>| tags.into_iter().filter(|one| one.tag == tag).max_by_key(|one| one.last_seen);
        let tag = match self.app.hub.read(|live| last(live.tags())) {
            Some(tag) => tag,
            None => last(self.app.store.tags().await?).ok_or_else(|| Problem::missing(format_args!("tag {tag}")))?,
        };
        Ok(tag.site)
    }

    /// The tags of the live state, and those that have not reported since the station started.
    fn tags(&self) -> Vec<TagStatus> {
        let mut tags = self.app.hub.read(|live| live.tags());
        let live: HashSet<_> = tags.iter().map(|tag| (tag.site.clone(), tag.tag.clone())).collect();
        let is_gone = |tag: &&TagStatus| !live.contains(&(tag.site.clone(), tag.tag.clone()));
        tags.extend(self.app.earlier.iter().filter(is_gone).cloned());
        tags.sort_unstable_by(|a, b| (&a.site, &a.tag).cmp(&(&b.site, &b.tag)));
        tags
    }
}
