//! The description of the API: the routes' own descriptions to one document in OpenAPI 3.1, and from it what each route
//! asks for.

use std::collections::{HashMap, HashSet};
use std::sync::LazyLock;

use axum::body::Bytes;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use serde::{Deserialize, Serialize};
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
    components.responses = REFUSALS.map(|(name, _, words)| (name.to_owned(), refusal(words).into())).into();
    require_keys_of_answers(&mut document);
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

/// Requires all keys of objects that only answers have. What is unknown there is null, and not missing; in a request it
/// may be missing. A problem document is the exception.
fn require_keys_of_answers(document: &mut OpenApi) {
    let Some(components) = &mut document.components else { return };
    let mut names = Vec::new();
    for item in document.paths.paths.values_mut() {
        let bodies = operations(item).filter_map(|(_, operation)| operation.request_body.as_ref());
        bodies.for_each(|body| names.extend(referred(body)));
    }
    let mut open = HashSet::from(["Problem".to_owned()]);
    while let Some(name) = names.pop() {
        names
            .extend(components.schemas.get(&name).into_iter().flat_map(referred).filter(|other| !open.contains(other)));
        open.insert(name);
    }
    for (_, schema) in components.schemas.iter_mut().filter(|(name, _)| !open.contains(*name)) {
        require_keys(schema);
    }
}

/// Requires all keys of an object, or of those that it is made of.
fn require_keys(schema: &mut RefOr<Schema>) {
    match schema {
        RefOr::T(Schema::Object(object)) => object.required = object.properties.keys().cloned().collect(),
        RefOr::T(Schema::AllOf(parts)) => parts.items.iter_mut().for_each(require_keys),
        _ => {}
    }
}

/// The names of the schemas that a part of the document refers to.
fn referred(part: &impl Serialize) -> Vec<String> {
    fn add(part: &Value, names: &mut Vec<String>) {
        match part {
            Value::Object(members) => {
                let name =
                    members.get("$ref").and_then(Value::as_str).and_then(|reference| reference.rsplit('/').next());
                names.extend(name.map(str::to_owned));
                members.values().for_each(|member| add(member, names));
            }
            Value::Array(items) => items.iter().for_each(|item| add(item, names)),
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
        }
    }
    let mut names = Vec::new();
    add(&serde_json::to_value(part).unwrap_or_default(), &mut names);
    names
}

/// What routes may refuse: its name, its status and why.
const REFUSALS: [(&str, &str, &str); 13] = [
    ("Unreadable", "400", "a parameter or the body cannot be read"),
    ("NoToken", "401", "there is no token, or a wrong one"),
    ("NotAllowed", "403", "the role does not allow it, or the request comes from a page of another host"),
    ("Missing", "404", "there is none"),
    ("TooSlow", "408", "the request took too long"),
    ("Conflict", "409", "there is one already, or there are too many"),
    ("TooLarge", "413", "the body is too large"),
    ("OtherKind", "415", "the body is of another kind"),
    ("OtherHost", "421", "the host is no loopback one, and there are no tokens"),
    ("WrongValue", "422", "a value is wrong"),
    ("TooMany", "429", "too many requests or wrong tokens from this address"),
    ("NoStore", "503", "the store does not answer"),
    ("Refused", "default", "another refusal"),
];

/// What every route may answer, by what it takes.
fn add_refusals(operation: &mut Operation) {
    let is_open = operation.security.as_ref().is_none_or(|needs| needs.iter().all(|need| *need == Default::default()));
    let has_body = operation.request_body.is_some();
    let has_parameters = operation.parameters.is_some();
    for (name, status, _) in REFUSALS {
        let may_be = match status {
            "400" | "404" => has_parameters || has_body,
            "401" | "403" | "429" => !is_open || has_body,
            "409" | "413" | "415" | "422" => has_body,
            _ => true,
        };
        if may_be {
            let answers = &mut operation.responses.responses;
            answers.entry(status.to_owned()).or_insert_with(|| Ref::from_response_name(name).into());
        }
    }
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
