//! Events: the store to answers.

use std::str::FromStr;

use axum::extract::State;
use axum::http::Uri;
use axum::response::Response;
use serde::Deserialize;
use serde::de::IntoDeserializer;
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::{Limit, Name, Query, span};
use super::problem::Problem;
use super::{Shared, answer};
use crate::Utc;
use crate::model::{EventKind, StationEvent};

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(list))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct Asked {
    /// Only of this site.
    #[param(inline)]
    site: Option<Name>,
    /// From this time.
    #[param(inline)]
    from: Option<Utc>,
    /// Until this time, which is excluded.
    #[param(inline)]
    to: Option<Utc>,
    /// Only of these kinds, separated by commas.
    #[param(value_type = Option<Vec<EventKind>>, style = Form, explode = false)]
    kind: Option<Kinds>,
    /// Only events that are older than this one.
    before: Option<i64>,
    /// The greatest number of rows.
    #[serde(default)]
    #[param(inline, required = false)]
    limit: Limit,
}

/// Kinds, separated by commas.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(try_from = "String")]
struct Kinds(#[schema(inline)] Vec<EventKind>);

impl TryFrom<String> for Kinds {
    type Error = serde::de::value::Error;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.split(',').map(EventKind::from_str).collect::<Result<_, _>>().map(Self)
    }
}

impl FromStr for EventKind {
    type Err = serde::de::value::Error;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::deserialize(text.into_deserializer())
    }
}

/// Events, newest first. The header `Link` tells where older ones are.
#[utoipa::path(get, path = "/api/v1/events", tag = "events", security(("token" = ["view"])),
    params(Asked), responses((status = 200, body = [StationEvent])))]
async fn list(State(station): State<Shared>, Query(asked): Query<Asked>, uri: Uri) -> Result<Response, Problem> {
    let span = span(asked.from, asked.to)?;
    let kinds = asked.kind.unwrap_or_default().0;
    let site = asked.site.as_ref().map(Name::as_str);
    let rows = station.app.store.events(site, span, &kinds, asked.before, asked.limit.get()).await?;
    let next = asked.limit.last_of_full(&rows).map(|last| answer::with_parameter(&uri, "before", &last.id.to_string()));
    answer::page(&rows, next)
}
