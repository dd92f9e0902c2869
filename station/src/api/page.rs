//! The page: its files, which are part of the program, to answers.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::Response;
use sha2::{Digest, Sha256};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::problem::Problem;
use super::{Shared, answer};

/// Scripts, styles and connections are of this host only, and no other page may embed this one.
const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; font-src 'self'; \
     connect-src 'self'; manifest-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'self'; \
     frame-ancestors 'none'",
);

/// The built page.
#[derive(rust_embed::RustEmbed)]
#[folder = "web/dist"]
#[allow_missing = true]
struct Built;

/// The files of a page, by their paths without the slash at the beginning.
#[derive(Clone, Debug, Default)]
pub struct Page {
    files: Arc<BTreeMap<String, File>>,
}

#[derive(Debug)]
struct File {
    content: Bytes,
    media_type: &'static str,
    tag: String,
}

impl Page {
    /// The page that is part of the program.
    pub fn built() -> Self {
        let content = |path: &str| Built::get(path).map(|file| file.data);
        Self::of(Built::iter().filter_map(|path| content(&path).map(|content| (path, content))))
    }

    /// A page of these files.
    pub fn of<P: Into<String>>(files: impl IntoIterator<Item = (P, Cow<'static, [u8]>)>) -> Self {
        let file = |path: &str, content: Cow<'static, [u8]>| {
            let hash = Sha256::digest(&content);
            let tag = format!("W/\"{}\"", hash.iter().take(16).map(|byte| format!("{byte:02x}")).collect::<String>());
            let content = match content {
                Cow::Borrowed(content) => Bytes::from_static(content),
                Cow::Owned(content) => Bytes::from(content),
            };
            File { content, media_type: media_type(path), tag }
        };
        let files = files.into_iter().map(|(path, content)| {
            let path = path.into();
            let file = file(&path, content);
            (path, file)
        });
        Self { files: Arc::new(files.collect()) }
    }
}

/// The route of the page itself. Its other files are found by [`file`].
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(index))
}

/// The page.
#[utoipa::path(get, path = "/", tag = "page", security(()),
    responses((status = 200, description = "the page", content_type = "text/html", body = String)))]
async fn index(State(station): State<Shared>, headers: HeaderMap) -> Result<Response, Problem> {
    station.app.page.answer("index.html", &headers)
}

/// What no route has: a file of the page, or a refusal.
pub async fn file(
    State(station): State<Shared>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let path = uri.path().trim_start_matches('/');
    if !station.app.page.files.contains_key(path) {
        return Err(Problem::missing(format_args!("{}", uri.path())));
    }
    if method != Method::GET && method != Method::HEAD {
        return Err(Problem::new(StatusCode::METHOD_NOT_ALLOWED, "this is a file: GET and HEAD only"));
    }
    station.app.page.answer(path, &headers)
}

impl Page {
    fn answer(&self, path: &str, headers: &HeaderMap) -> Result<Response, Problem> {
        let file = self.files.get(path).ok_or_else(|| Problem::missing("page in this build"))?;
        let mut response = answer::kept(headers, file.media_type, &file.tag, file.content.clone());
        response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, POLICY);
        Ok(response)
    }
}

fn media_type(path: &str) -> &'static str {
    match path.rsplit_once('.').map(|(_, extension)| extension) {
        Some("html") => "text/html; charset=utf-8",
        Some("js" | "mjs") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("json" | "map") => "application/json",
        Some("webmanifest") => "application/manifest+json",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        Some("webp") => "image/webp",
        Some("ico") => "image/vnd.microsoft.icon",
        Some("woff2") => "font/woff2",
        Some("txt") => "text/plain; charset=utf-8",
        Some(_) | None => "application/octet-stream",
    }
}
