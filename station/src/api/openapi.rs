//! The description of the API: the routes' own descriptions to one document in OpenAPI 3.1, and from it what each route
//! asks for.

use std::collections::HashMap;
use std::sync::LazyLock;

use axum::body::Bytes;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use serde::Deserialize;
use serde_json::Value;
use utoipa::openapi::path::{Operation, PathItem};
use utoipa::openapi::response::{Response as Described, ResponseBuilder};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::{Components, ContentBuilder, InfoBuilder, LicenseBuilder, OpenApi, Ref, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::access::{RequiredRole, UserRole};
use super::extract::Name;
use super::problem::{self, Problem};
use super::{Shared, answer};

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(document))
}

static DOCUMENT: LazyLock<Bytes> = LazyLock::new(|| openapi().to_pretty_json().unwrap_or_default().into());

/// The description of this API, in OpenAPI 3.1.
#[utoipa::path(get, path = "/openapi.json", tag = "health", security(()),
    responses((status = 200, description = "the document", body = Object)))]
async fn document(headers: HeaderMap) -> Response {
    answer::tagged(&headers, "application/json", DOCUMENT.clone())
}

/// The description of all routes.
pub fn openapi() -> OpenApi {
    let mut document = super::routes().into_openapi();
    document.info = InfoBuilder::new()
        .title("Baliza station")
        .description(Some(
            "Indoor positions: live, their history, and what is configured. Lengths are metres, times RFC 3339. \
             Refusals are problem documents (RFC 9457). Each route says with which least role a token may use it: \
             view, operate or administer.",
        ))
        .version(env!("CARGO_PKG_VERSION"))
        .license(Some(LicenseBuilder::new().name("MIT OR Apache-2.0").identifier(Some("MIT OR Apache-2.0")).build()))
        .build();
    let components = document.components.get_or_insert_with(Components::new);
    let bearer =
        HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some("A token, or the cookie of /login."));
    components.add_security_scheme("token", SecurityScheme::Http(bearer.build()));
    components.schemas.insert("Name".to_owned(), Name::schema());
    components.schemas.insert("Problem".to_owned(), Problem::schema());
    let mut schemas = Vec::new();
    Problem::schemas(&mut schemas);
    components.schemas.extend(schemas);
    components.schemas.values_mut().for_each(describe_once);
    for (path, item) in &mut document.paths.paths {
        for (method, operation) in operations(item) {
            let words = path.split(|letter: char| !letter.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
            operation.operation_id = Some([method].into_iter().chain(words).collect::<Vec<_>>().join("_"));
            add_refusals(operation);
        }
    }
    document
}

/// Gives the properties of an object their own descriptions. A property with a description whose type has one as well
/// is made as "all of" its type and an *object* with the description, which no string and no number can be.
fn describe_once(schema: &mut RefOr<Schema>) {
    let RefOr::T(Schema::Object(object)) = schema else { return };
    for property in object.properties.values_mut() {
        let RefOr::T(Schema::AllOf(both)) = property else { continue };
        let [RefOr::T(Schema::Object(value)), RefOr::T(Schema::Object(said))] = both.items.as_slice() else { continue };
        if said.properties.is_empty() && said.required.is_empty() {
            let mut described = value.clone();
            described.description.clone_from(&said.description);
            *property = RefOr::T(Schema::Object(described));
        }
    }
}

fn operations(item: &mut PathItem) -> impl Iterator<Item = (&'static str, &mut Operation)> {
    let operations =
        [("get", &mut item.get), ("put", &mut item.put), ("post", &mut item.post), ("delete", &mut item.delete)];
    operations.into_iter().filter_map(|(method, operation)| Some((method, operation.as_mut()?)))
}

/// What every route may answer, by what it takes.
fn add_refusals(operation: &mut Operation) {
    let is_open = operation.security.as_ref().is_none_or(|needs| needs.iter().all(|need| *need == Default::default()));
    let has_body = operation.request_body.is_some();
    let refusals = [
        (400, "a parameter or the body cannot be read", has_body || operation.parameters.is_some()),
        (401, "there is no token, or a wrong one", !is_open || has_body),
        (403, "the role does not allow it, or the request comes from a page of another host", !is_open || has_body),
        (404, "there is none", operation.parameters.is_some() || has_body),
        (408, "the request took too long", true),
        (409, "there is one already, or there are too many", has_body),
        (413, "the body is too large", has_body),
        (415, "the body is of another kind", has_body),
        (421, "the host is no loopback one, and there are no tokens", true),
        (422, "a value is wrong", has_body),
        (429, "too many requests or wrong tokens from this address", !is_open || has_body),
        (503, "the store does not answer", true),
    ];
    for (status, description, may_be) in refusals {
        if may_be {
            let answers = &mut operation.responses.responses;
            answers.entry(status.to_string()).or_insert_with(|| refusal(description).into());
        }
    }
    operation.responses.responses.insert("default".to_owned(), refusal("another refusal").into());
}

fn refusal(description: &str) -> Described {
    let content = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
    ResponseBuilder::new().description(description).content(problem::MEDIA_TYPE, content).build()
}

/// What each route asks for, as the document says.
pub fn needs() -> HashMap<(Method, String), RequiredRole> {
    let document = super::routes().into_openapi();
    let mut needs = HashMap::new();
    for (path, item) in &document.paths.paths {
        let operations = [
            (Method::GET, &item.get),
            (Method::PUT, &item.put),
            (Method::POST, &item.post),
            (Method::DELETE, &item.delete),
        ];
        for (method, operation) in operations {
            let Some(operation) = operation else { continue };
            let security = serde_json::to_value(&operation.security).unwrap_or_default();
            needs.insert((method, path.clone()), need(&security));
        }
    }
    needs
}

/// `security` of an operation: `[{}]`, `[{}, {"token": …}]` or `[{"token": ["operate"]}]`. What it does not say is for
/// administrators.
fn need(security: &Value) -> RequiredRole {
    let all = security.as_array().map(Vec::as_slice).unwrap_or_default();
    let role = all.iter().find_map(|one| UserRole::deserialize(one.get("token")?.get(0)?).ok());
    let nothing = all.iter().any(|one| one.as_object().is_some_and(serde_json::Map::is_empty));
    match (nothing, role) {
        (true, Some(_)) => RequiredRole::Known,
        (true, None) => RequiredRole::Nothing,
        (false, role) => RequiredRole::Role(role.unwrap_or(UserRole::Administer)),
    }
}
