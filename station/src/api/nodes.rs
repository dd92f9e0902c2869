//! Anchors, beacons and receivers: their health in the live state and its history in the store to answers, and where a
//! person places them to the store and the live state.

use axum::extract::State;
use axum::http::{StatusCode, Uri};
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::{Coordinate, Json, Limit, Name, Path, Query, span};
use super::problem::Problem;
use super::tags::OfSite;
use super::{Shared, answer};
use crate::Utc;
use crate::bounds::{EXPONENTS, FARTHEST_M, LONGEST_NAME, is_name};
use crate::model::{NodeHealth, NodeRole, NodeStatus, PlacedNode};
use crate::shapes::SpacePoint;

/// The greatest number of placed nodes of all sites.
const NODES: usize = 5_000;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(health)).routes(routes!(put, delete))
}

/// The anchors, beacons and receivers, with their health, by site and address.
#[utoipa::path(get, path = "/api/v1/nodes", tag = "nodes", security(("token" = ["view"])),
    params(OfSite), responses((status = 200, body = [NodeStatus])))]
async fn list(State(station): State<Shared>, Query(of): Query<OfSite>) -> Result<Response, Problem> {
    let mut nodes = station.app.hub.read(|live| live.nodes());
    nodes.retain(|node| of.site.as_ref().is_none_or(|site| site.as_str() == node.site));
    answer::page(&nodes, None)
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct History {
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

/// A node's health, minute by minute, newest first; none of a minute in which no tag measured to it. The header `Link`
/// tells where older ones are.
#[utoipa::path(get, path = "/api/v1/nodes/{site}/{node}/health", tag = "nodes", security(("token" = ["view"])),
    params(("site" = Name, Path, description = "the site"), ("node" = Name, Path, description = "the node"), History),
    responses((status = 200, body = [NodeHealth])))]
async fn health(
    State(station): State<Shared>,
    Path((site, node)): Path<(Name, Name)>,
    Query(asked): Query<History>,
    uri: Uri,
) -> Result<Response, Problem> {
    let span = span(asked.from, asked.to)?;
    let rows = station.app.store.health(site.as_str(), node.as_str(), span, asked.limit.get()).await?;
    let next = asked.limit.last_of_full(&rows);
    answer::page(&rows, next.map(|last| answer::with_parameter(&uri, "to", &last.t.to_string())))
}

/// What a node that is placed does: anchors say themselves where they are.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
enum PlacedRole {
    Beacon,
    Receiver,
}

/// Where a beacon or a receiver is.
#[derive(Debug, Deserialize, ToSchema)]
struct Place {
    /// Its name for people; at most 64 bytes.
    #[serde(default)]
    #[schema(inline)]
    name: Option<Name>,
    role: PlacedRole,
    /// At most 1,000 km from the origin.
    #[schema(value_type = SpacePoint)]
    position_m: [Coordinate; 3],
    /// RSSI at one metre, dBm: of the beacon, or of devices at the receiver.
    #[serde(default)]
    #[schema(minimum = -127, maximum = -1)]
    rssi_1m_dbm: Option<f64>,
    /// 2 in free space.
    #[serde(default)]
    #[schema(minimum = 0.1, maximum = 20)]
    path_loss_exponent: Option<f64>,
}

/// Places a beacon or a receiver, or places it anew.
#[utoipa::path(put, path = "/api/v1/nodes/{site}/{node}", tag = "nodes", security(("token" = ["administer"])),
    params(("site" = Name, Path, description = "the site"),
        ("node" = Name, Path, description = "major and minor number of a beacon (`1-7`), or a receiver's name")),
    request_body = Place,
    responses((status = 200, body = PlacedNode), (status = 201, description = "it is new", body = PlacedNode)))]
async fn put(
    State(station): State<Shared>,
    Path((site, node)): Path<(Name, Name)>,
    Json(place): Json<Place>,
) -> Result<(StatusCode, axum::Json<PlacedNode>), Problem> {
    let position_m = place.position_m.map(f64::from);
    if [Some(&site), Some(&node), place.name.as_ref()].into_iter().flatten().any(|name| !is_name(name.as_str())) {
        return Err(Problem::wrong(format!("a name has at most {LONGEST_NAME} bytes")));
    }
    if position_m.iter().any(|at| at.abs() > FARTHEST_M) {
        return Err(Problem::wrong(format!("a node is at most {FARTHEST_M} m from the origin")));
    }
    if place.rssi_1m_dbm.is_some_and(|dbm| !(-127.0..=-1.0).contains(&dbm)) {
        return Err(Problem::wrong("rssi_1m_dbm is -127 to -1"));
    }
    if place.path_loss_exponent.is_some_and(|exponent| !EXPONENTS.contains(&exponent)) {
        return Err(Problem::wrong("path_loss_exponent is 0.1 to 20"));
    }
    let role = match place.role {
        PlacedRole::Beacon => NodeRole::Beacon,
        PlacedRole::Receiver => NodeRole::Receiver,
    };
    let (rssi_1m_dbm, path_loss_exponent) = (place.rssi_1m_dbm, place.path_loss_exponent);
    let name = place.name.map(String::from);
    station
        .configure(async move |station| {
            let site = station.site(&site).await?.name;
            let nodes = station.app.store.nodes().await?;
            let new = !nodes.iter().any(|other| other.site == site && other.node == node.as_str());
            if new && nodes.len() >= NODES {
                return Err(Problem::new(StatusCode::CONFLICT, format!("there are already {NODES} placed nodes")));
            }
            let node = node.into();
            let node = PlacedNode { site, node, name, role, position_m, rssi_1m_dbm, path_loss_exponent };
            station.app.store.put_node(&node).await?;
            station.app.hub.change(|live| node.reports(Utc::now()).iter().for_each(|report| drop(live.apply(report))));
            Ok((if new { StatusCode::CREATED } else { StatusCode::OK }, axum::Json(node)))
        })
        .await
}

/// Forgets where a node was placed. It is listed again when a source reports it.
#[utoipa::path(delete, path = "/api/v1/nodes/{site}/{node}", tag = "nodes", security(("token" = ["administer"])),
    params(("site" = Name, Path, description = "the site"), ("node" = Name, Path, description = "the node")),
    responses((status = 204, description = "it is forgotten")))]
async fn delete(State(station): State<Shared>, Path((site, node)): Path<(Name, Name)>) -> Result<StatusCode, Problem> {
    station
        .configure(async move |station| {
            station.app.store.delete_node(site.as_str(), node.as_str()).await?;
            station.app.hub.change(|live| live.forget_node(site.as_str(), node.as_str()));
            Ok(StatusCode::NO_CONTENT)
        })
        .await
}
