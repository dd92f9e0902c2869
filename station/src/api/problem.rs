//! Refusals: problem documents of RFC 9457.

use std::any::Any;

use axum::body::Body;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::store::StoreError;

/// The media type of problem documents.
pub const MEDIA_TYPE: &str = "application/problem+json";

/// Why a request was refused.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Problem {
    /// The kind of problem; `about:blank`: the status says it all.
    #[serde(rename = "type")]
    kind: &'static str,
    /// The status in words.
    title: String,
    /// The status of the answer.
    status: u16,
    /// What is wrong, and what to do.
    detail: String,
    /// After how many seconds the request may be repeated.
    #[serde(skip_serializing_if = "Option::is_none")]
    retry_after_s: Option<u64>,
}

impl Problem {
    /// A problem of this status.
    pub fn new(status: StatusCode, detail: impl Into<String>) -> Self {
        Self {
            kind: "about:blank",
            title: status.canonical_reason().unwrap_or("error").to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            retry_after_s: None,
        }
    }

    /// 404.
    pub fn missing(what: impl std::fmt::Display) -> Self {
        Self::new(StatusCode::NOT_FOUND, format!("there is no {what}"))
    }

    /// 422: the request can be read, but a value in it is wrong.
    pub fn wrong(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, detail)
    }

    /// 429.
    pub fn too_many(what: &str, retry_after_s: u64) -> Self {
        let detail = format!("too many {what} from this address: wait {retry_after_s} s");
        Self { retry_after_s: Some(retry_after_s), ..Self::new(StatusCode::TOO_MANY_REQUESTS, detail) }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_vec(&self).unwrap_or_default();
        let mut response = (status, [(header::CONTENT_TYPE, MEDIA_TYPE)], body).into_response();
        if let Some(seconds) = self.retry_after_s {
            response.headers_mut().insert(header::RETRY_AFTER, seconds.into());
        }
        if status == StatusCode::UNAUTHORIZED {
            response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Exists(_) => Self::new(StatusCode::CONFLICT, error.to_string()),
            StoreError::Missing(_) => Self::new(StatusCode::NOT_FOUND, error.to_string()),
            StoreError::Nul => Self::wrong(error.to_string()),
            StoreError::Newer(_)
            | StoreError::Foreign(_)
            | StoreError::Open(..)
            | StoreError::Occupied(_)
            | StoreError::File(..)
            | StoreError::Damaged(_)
            | StoreError::Database(_) => {
                // What the database says is for the operator, not for clients.
                log::error!("store: {error}");
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "the store does not answer: try again")
            }
        }
    }
}

/// Refusals that the framework made (405, 413, a failed upgrade …) become problem documents, and keep their headers.
pub async fn complete(response: Response) -> Response {
    let status = response.status();
    if !(status.is_client_error() || status.is_server_error()) || is_problem(&response) {
        return response;
    }
    let (mut parts, _) = response.into_parts();
    let mut problem = Problem::new(status, detail(status)).into_response();
    parts.headers.remove(header::CONTENT_LENGTH);
    parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(MEDIA_TYPE));
    parts.headers.remove(header::TRANSFER_ENCODING);
    Response::from_parts(parts, std::mem::replace(problem.body_mut(), Body::empty()))
}

fn is_problem(response: &Response) -> bool {
    response.headers().get(header::CONTENT_TYPE).is_some_and(|value| value == MEDIA_TYPE)
}

fn detail(status: StatusCode) -> &'static str {
    match status {
        StatusCode::METHOD_NOT_ALLOWED => "this route has no such method: the header Allow names those that it has",
        StatusCode::PAYLOAD_TOO_LARGE => "the body is too large",
        StatusCode::UPGRADE_REQUIRED => "this route is a WebSocket",
        StatusCode::BAD_REQUEST => "the request cannot be read",
        _ => "the request is refused",
    }
}

/// The answer where a handler panicked.
pub fn panicked(panic: Box<dyn Any + Send + 'static>) -> Response {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no text");
    log::error!("a request's handler panicked: {text}");
    Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "an error of the program, which is in its log").into_response()
}
