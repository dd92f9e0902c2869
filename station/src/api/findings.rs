//! What the ranges of the last minutes say against a site: the live state to an answer.

use axum::extract::State;
use axum::response::Response;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::Query;
use super::problem::Problem;
use super::tags::OfSite;
use super::{Shared, answer};
use crate::model::SiteFinding;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(list))
}

/// What the ranges of the last five minutes say against the site, with remedies; asked every half minute.
#[utoipa::path(get, path = "/api/v1/findings", tag = "nodes", security(("token" = ["view"])),
    params(OfSite), responses((status = 200, body = [SiteFinding])))]
async fn list(State(station): State<Shared>, Query(of): Query<OfSite>) -> Result<Response, Problem> {
    let mut findings = station.app.hub.read(|live| live.findings().to_vec());
    findings.retain(|finding| of.site.as_ref().is_none_or(|site| site.as_str() == finding.site));
    answer::page(&findings, None)
}
