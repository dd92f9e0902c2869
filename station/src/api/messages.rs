//! Messages to tags: what to send, and what became of it.

use std::time::Duration;

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::{Json, Name, Path};
use super::problem::Problem;
use super::{Shared, answer};
use crate::messages::{MessageContent, MessageRefusal, TagMessage};

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(list, send)).routes(routes!(withdraw))
}

/// A message that is to be sent.
#[derive(Debug, Deserialize, ToSchema)]
struct NewMessage {
    /// What it says.
    content: MessageContent,
    /// For how many seconds it is of use, 1 to 86,400: a tag that sleeps gets it when it wakes.
    #[serde(default = "ten_minutes")]
    #[schema(minimum = 1, maximum = 86_400)]
    lasts_s: u32,
}

const fn ten_minutes() -> u32 {
    600
}

/// The last messages to a tag since the station started, newest first.
#[utoipa::path(get, path = "/api/v1/tags/{tag}/messages", tag = "tags", security(("token" = ["view"])),
    params(("tag" = Name, Path, description = "the tag")),
    responses((status = 200, body = [TagMessage])))]
async fn list(State(station): State<Shared>, Path(tag): Path<Name>) -> Result<Response, Problem> {
    answer::page(&station.app.hub.messages().to(tag.as_str()), None)
}

/// Sends a message to a tag by way of all nodes that are read here: an anchor passes it on to the tag, or a tag takes its
/// own. It is sent again until the tag answers.
#[utoipa::path(post, path = "/api/v1/tags/{tag}/messages", tag = "tags", security(("token" = ["operate"])),
    params(("tag" = Name, Path, description = "the tag: its short address, such as 0x1001")),
    request_body = NewMessage,
    responses((status = 201, body = TagMessage, headers(("Location" = String, description = "its address")))))]
async fn send(
    State(station): State<Shared>,
    Path(tag): Path<Name>,
    Json(new): Json<NewMessage>,
) -> Result<Response, Problem> {
    let address = tag.as_str().strip_prefix("0x").and_then(|digits| u16::from_str_radix(digits, 16).ok());
    let address =
        address.ok_or_else(|| Problem::missing(format_args!("tag {:?} with a short address", tag.as_str())))?;
    if !(1..=86_400).contains(&new.lasts_s) {
        return Err(Problem::wrong("lasts_s is 1 to 86400"));
    }
    let lasts = Duration::from_secs(new.lasts_s.into());
    let message = station.app.hub.messages().send(address, new.content, lasts).map_err(|refusal| match refusal {
        MessageRefusal::Content => Problem::wrong(refusal.to_string()),
        MessageRefusal::TooMany => Problem::new(StatusCode::CONFLICT, refusal.to_string()),
    })?;
    let location = [(header::LOCATION, format!("/api/v1/tags/{}/messages/{}", message.tag, message.id))];
    Ok((StatusCode::CREATED, location, axum::Json(message)).into_response())
}

/// Withdraws a message that waits. The tag may get it nevertheless, if it is on its way.
#[utoipa::path(delete, path = "/api/v1/tags/{tag}/messages/{id}", tag = "tags", security(("token" = ["operate"])),
    params(("tag" = Name, Path, description = "the tag"), ("id" = u64, Path, description = "the message's number")),
    responses((status = 204, description = "it is withdrawn")))]
async fn withdraw(State(station): State<Shared>, Path((tag, id)): Path<(Name, u64)>) -> Result<StatusCode, Problem> {
    let is_withdrawn = station.app.hub.messages().withdraw(tag.as_str(), id);
    let missing = || Problem::missing(format_args!("message {id} to {:?} that waits", tag.as_str()));
    is_withdrawn.then_some(StatusCode::NO_CONTENT).ok_or_else(missing)
}
