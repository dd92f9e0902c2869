//! Requests to values: bodies, queries and paths, whose errors are [`Problem`]s, and the types that bound what is in
//! them. What a handler gets has been checked.

use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::StatusCode;
use axum::http::request::Parts;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use utoipa::ToSchema;

use super::problem::Problem;

/// A body in JSON.
pub struct Json<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let read = axum::Json::from_request(request, state).await;
        read.map(|axum::Json(value)| Self(value)).map_err(|error| Problem::new(error.status(), error.body_text()))
    }
}

/// The parameters after the question mark.
pub struct Query<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequestParts<S> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let read = axum::extract::Query::from_request_parts(parts, state).await;
        read.map(|axum::extract::Query(value)| Self(value))
            .map_err(|error| Problem::new(error.status(), error.body_text()))
    }
}

/// The parameters in the path.
pub struct Path<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned + Send> FromRequestParts<S> for Path<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let read = axum::extract::Path::from_request_parts(parts, state).await;
        read.map(|axum::extract::Path(value)| Self(value))
            .map_err(|error| Problem::new(error.status(), error.body_text()))
    }
}

/// A bounded body of bytes.
pub struct Bytes(pub axum::body::Bytes);

impl<S: Send + Sync> FromRequest<S> for Bytes {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let read = axum::body::Bytes::from_request(request, state).await;
        read.map(Self).map_err(|error| Problem::new(error.status(), error.body_text()))
    }
}

/// A name: 1 to 100 characters, none of them a control character.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, ToSchema)]
#[serde(try_from = "String")]
#[schema(value_type = String, min_length = 1, max_length = 100, pattern = "^[^\\u0000-\\u001f\\u007f-\\u009f]+$")]
pub struct Name(String);

impl Name {
    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

impl TryFrom<String> for Name {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        if text.is_empty() || text.chars().count() > 100 {
            return Err("a name has 1 to 100 characters");
        }
        if text.chars().any(char::is_control) {
            return Err("a name has no control characters");
        }
        Ok(Self(text))
    }
}

/// A coordinate in metres: at most 10,000 km from the origin.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(try_from = "f64")]
#[schema(value_type = f64, minimum = -1e7, maximum = 1e7)]
pub struct Coordinate(f64);

impl Coordinate {
    const GREATEST_M: f64 = 1e7;
}

impl From<Coordinate> for f64 {
    fn from(coordinate: Coordinate) -> Self {
        coordinate.0
    }
}

impl TryFrom<f64> for Coordinate {
    type Error = &'static str;

    fn try_from(metres: f64) -> Result<Self, Self::Error> {
        if !(metres.abs() <= Self::GREATEST_M) {
            return Err("a coordinate is at most 10000000 m from the origin");
        }
        Ok(Self(metres))
    }
}

/// A point in the plane.
pub fn point_m(point: [Coordinate; 2]) -> [f64; 2] {
    point.map(f64::from)
}

/// The greatest number of rows in an answer: 1 to 10,000.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(try_from = "u32")]
#[schema(value_type = u32, minimum = 1, maximum = 10_000)]
pub struct Limit(u32);

impl Limit {
    /// The greatest.
    pub const MOST: u32 = 10_000;

    /// The number.
    pub fn get(self) -> u32 {
        self.0
    }

    /// The last of the rows where they fill an answer: there may be more behind it.
    pub fn last_of_full<T>(self, rows: &[T]) -> Option<&T> {
        rows.last().filter(|_| rows.len() == self.0 as usize)
    }
}

impl Default for Limit {
    fn default() -> Self {
        Self(1_000)
    }
}

impl TryFrom<u32> for Limit {
    type Error = &'static str;

    fn try_from(rows: u32) -> Result<Self, Self::Error> {
        if (1..=Self::MOST).contains(&rows) { Ok(Self(rows)) } else { Err("limit is 1 to 10000") }
    }
}

/// From `from` (included) to `to` (excluded), where given.
pub fn span(from: Option<crate::Utc>, to: Option<crate::Utc>) -> Result<crate::store::Span, Problem> {
    let from = from.unwrap_or(crate::Utc::clamped(0));
    let to = to.unwrap_or(crate::Utc::clamped(i64::MAX));
    if from > to {
        return Err(Problem::new(StatusCode::BAD_REQUEST, "`from` is after `to`"));
    }
    Ok(crate::store::Span { from, to })
}
