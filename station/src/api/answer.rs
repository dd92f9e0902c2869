//! Values to answers: pages of lists, and answers that a client may keep.

use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use sha2::{Digest, Sha256};

use super::problem::Problem;

/// An answer with its entity tag; 304 where the client has it already.
///
/// The tag is weak, because a layer further out may compress the answer.
pub fn tagged(request: &HeaderMap, media_type: &str, body: impl Into<Bytes>) -> Response {
    let body = body.into();
    let hash = Sha256::digest(&body);
    let tag: String = hash.iter().take(16).map(|byte| format!("{byte:02x}")).collect();
    kept(request, media_type, &format!("W/\"{tag}\""), body)
}

/// An answer whose entity tag is known.
pub fn kept(request: &HeaderMap, media_type: &str, tag: &str, body: Bytes) -> Response {
    let mut response = if matches(request, tag) {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        let mut response = body.into_response();
        let media_type = HeaderValue::from_str(media_type);
        let media_type = media_type.unwrap_or(HeaderValue::from_static("application/octet-stream"));
        response.headers_mut().insert(header::CONTENT_TYPE, media_type);
        response
    };
    if let Ok(tag) = HeaderValue::from_str(tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}

/// A value in JSON, with its entity tag.
pub fn tagged_json(request: &HeaderMap, value: &impl Serialize) -> Result<Response, Problem> {
    Ok(tagged(request, "application/json", json(value)?))
}

/// A page of a list in JSON, and where the next one is.
pub fn page(rows: &impl Serialize, next: Option<String>) -> Result<Response, Problem> {
    Ok(page_of("application/json", json(rows)?, next))
}

/// A page in another media type, and where the next one is.
pub fn page_of(media_type: &'static str, body: Vec<u8>, next: Option<String>) -> Response {
    let mut response = ([(header::CONTENT_TYPE, media_type)], body).into_response();
    if let Some(next) = next.and_then(|next| HeaderValue::from_str(&format!("<{next}>; rel=\"next\"")).ok()) {
        response.headers_mut().insert(header::LINK, next);
    }
    response
}

/// The same request with another value of a parameter.
pub fn with_parameter(uri: &Uri, name: &str, value: &str) -> String {
    let mut query = form_urlencoded::Serializer::new(String::new());
    let others = form_urlencoded::parse(uri.query().unwrap_or_default().as_bytes());
    query.extend_pairs(others.filter(|(other, _)| other != name));
    query.append_pair(name, value);
    format!("{}?{}", uri.path(), query.finish())
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, Problem> {
    serde_json::to_vec(value).map_err(|error| {
        log::error!("an answer cannot be written: {error}");
        Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "the answer cannot be written")
    })
}

/// Whether the client says that it has what has this tag (RFC 9110, 13.1.2: compared weakly).
fn matches(request: &HeaderMap, tag: &str) -> bool {
    let strong = |tag: &str| tag.trim().trim_start_matches("W/").to_owned();
    let given = request.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    given.flat_map(|value| value.split(',')).any(|given| given.trim() == "*" || strong(given) == strong(tag))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_link_to_the_next_page_keeps_the_other_parameters() {
        let uri: Uri = "/api/v1/events?site=a%20b&before=9&limit=2".parse().unwrap();
        assert_eq!(with_parameter(&uri, "before", "7"), "/api/v1/events?site=a+b&limit=2&before=7");
    }

    #[test]
    fn entity_tags_are_compared_weakly() {
        for (given, same) in [("*", true), ("\"a\"", true), ("\"b\", W/\"a\"", true), ("\"b\"", false), ("", false)] {
            let mut headers = HeaderMap::new();
            headers.insert(header::IF_NONE_MATCH, HeaderValue::from_static(given));
            assert_eq!(matches(&headers, "W/\"a\""), same, "{given}");
        }
    }
}
