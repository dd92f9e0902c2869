//! Rooms and zones: a person's outlines to the store and from there to the live state, and back with who is in them.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::{Coordinate, Json, Name, Path, Query, point_m};
use super::problem::Problem;
use super::tags::OfSite;
use super::{Shared, answer};
use crate::model::{TagStatus, Zone, ZoneKind};
use crate::shapes::PlanePoint;

/// The greatest number of zones of a site.
const ZONES: usize = 1_000;
/// How many corners an outline has.
const CORNERS: std::ops::RangeInclusive<usize> = 3..=1_000;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(put, delete))
}

/// A room or a zone, and who is in it.
#[derive(Debug, Serialize, ToSchema)]
struct Occupied {
    #[serde(flatten)]
    zone: Zone,
    /// The tags that are in it.
    tags: Vec<String>,
}

/// The rooms and zones, with the tags that are in them.
#[utoipa::path(get, path = "/api/v1/rooms", tag = "rooms", security(("token" = ["view"])),
    params(OfSite), responses((status = 200, body = [Occupied])))]
async fn list(
    State(station): State<Shared>,
    Query(of): Query<OfSite>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let zones = station.app.store.zones().await?;
    let tags = station.app.hub.read(|live| live.tags());
    let zones = zones.into_iter().filter(|zone| of.site.as_ref().is_none_or(|site| site.as_str() == zone.site));
    let occupied = zones.map(|zone| {
        let inside = tags.iter().filter(|tag| tag.site == zone.site && is_in(tag, &zone));
        Occupied { tags: inside.map(|tag| tag.tag.clone()).collect(), zone }
    });
    answer::tagged_json(&headers, &occupied.collect::<Vec<_>>())
}

fn is_in(tag: &TagStatus, zone: &Zone) -> bool {
    match zone.kind {
        ZoneKind::Room => tag.last_position.as_ref().and_then(|position| position.room.as_ref()) == Some(&zone.name),
        ZoneKind::Zone => tag.zones.contains(&zone.name),
    }
}

/// An outline that is drawn.
#[derive(Debug, Deserialize, ToSchema)]
struct Drawn {
    /// As in the path, where given.
    #[serde(default)]
    #[schema(inline)]
    site: Option<Name>,
    /// As in the path, where given.
    #[serde(default)]
    #[schema(inline)]
    name: Option<Name>,
    kind: ZoneKind,
    /// The outline's corners in their order.
    #[schema(value_type = Vec<PlanePoint>, min_items = 3, max_items = 1000)]
    corners_m: Vec<[Coordinate; 2]>,
    /// An alarm is raised when a tag enters.
    #[serde(default)]
    alarm: bool,
}

/// Makes or replaces a room or a zone.
#[utoipa::path(put, path = "/api/v1/rooms/{site}/{name}", tag = "rooms", security(("token" = ["operate"])),
    params(("site" = Name, Path, description = "the site"), ("name" = Name, Path, description = "the room or the zone")),
    request_body = Drawn,
    responses((status = 200, body = Zone), (status = 201, description = "it is new", body = Zone)))]
async fn put(
    State(station): State<Shared>,
    Path((site, name)): Path<(Name, Name)>,
    Json(drawn): Json<Drawn>,
) -> Result<(StatusCode, axum::Json<Zone>), Problem> {
    if drawn.site.is_some_and(|other| other != site) || drawn.name.is_some_and(|other| other != name) {
        return Err(Problem::wrong("site or name in the body is not that in the path"));
    }
    if !CORNERS.contains(&drawn.corners_m.len()) {
        return Err(Problem::wrong(format!("an outline has {} to {} corners", CORNERS.start(), CORNERS.end())));
    }
    let corners_m = drawn.corners_m.into_iter().map(point_m).collect();
    let (kind, alarm) = (drawn.kind, drawn.alarm);
    station
        .configure(async move |station| {
            let site = station.site(&site).await?.name;
            let zones = station.app.store.zones().await?;
            let new = !zones.iter().any(|zone| zone.site == site && zone.name == name.as_str());
            if new && zones.iter().filter(|zone| zone.site == site).count() >= ZONES {
                return Err(Problem::new(StatusCode::CONFLICT, format!("the site has already {ZONES} zones")));
            }
            let zone = Zone { site, name: name.into(), kind, corners_m, alarm };
            station.app.store.put_zone(&zone).await?;
            station.reload().await?;
            Ok((if new { StatusCode::CREATED } else { StatusCode::OK }, axum::Json(zone)))
        })
        .await
}

/// Deletes a room or a zone.
#[utoipa::path(delete, path = "/api/v1/rooms/{site}/{name}", tag = "rooms", security(("token" = ["operate"])),
    params(("site" = Name, Path, description = "the site"), ("name" = Name, Path, description = "the room or the zone")),
    responses((status = 204, description = "it is deleted")))]
async fn delete(State(station): State<Shared>, Path((site, name)): Path<(Name, Name)>) -> Result<StatusCode, Problem> {
    station
        .configure(async move |station| {
            station.app.store.delete_zone(site.as_str(), name.as_str()).await?;
            station.reload().await?;
            Ok(StatusCode::NO_CONTENT)
        })
        .await
}
