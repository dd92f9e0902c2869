//! Anchors and beacons: their health in the live state to answers.

use axum::extract::State;
use axum::response::Response;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::Query;
use super::problem::Problem;
use super::tags::OfSite;
use super::{Shared, answer};
use crate::model::Node;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(list))
}

/// The anchors, beacons and receivers, with their health, by site and address.
#[utoipa::path(get, path = "/api/v1/nodes", tag = "nodes", security(("token" = ["view"])),
    params(OfSite), responses((status = 200, body = [Node])))]
async fn list(State(station): State<Shared>, Query(of): Query<OfSite>) -> Result<Response, Problem> {
    let mut nodes = station.app.hub.read(|live| live.nodes());
    nodes.retain(|node| of.site.as_ref().is_none_or(|site| site.as_str() == node.site));
    answer::page(&nodes, None)
}
