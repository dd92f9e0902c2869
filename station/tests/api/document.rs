//! The description of the API.

use hyper::header;
use serde_json::Value;
use station_core::api::openapi;

use crate::api::client::open;

/// The routes of the API's table, each with the least role that may use it; `-` is everyone.
pub const ROUTES: [(&str, &str, &str); 45] = [
    ("get", "/", "-"),
    ("get", "/openapi.json", "-"),
    ("get", "/healthz", "-"),
    ("get", "/metrics", "view"),
    ("get", "/scenarios", "view"),
    ("get", "/blueprints/{scenario}", "view"),
    ("get", "/campaigns", "view"),
    ("post", "/campaigns", "operate"),
    ("get", "/campaigns/{name}", "view"),
    ("delete", "/campaigns/{name}", "operate"),
    ("get", "/campaigns/{name}/points", "view"),
    ("get", "/campaigns/{name}/points/{id}", "view"),
    ("get", "/campaigns/{name}/points/{id}/samples", "view"),
    ("post", "/campaigns/{name}/points/{id}/samples", "operate"),
    ("post", "/rtls", "operate"),
    ("post", "/rtls/{scenario}", "operate"),
    ("get", "/api/v1/tags", "view"),
    ("get", "/api/v1/tags/{tag}/positions", "view"),
    ("get", "/api/v1/tags/{tag}/positions.gpx", "view"),
    ("get", "/api/v1/tags/{tag}/messages", "view"),
    ("post", "/api/v1/tags/{tag}/messages", "operate"),
    ("delete", "/api/v1/tags/{tag}/messages/{id}", "operate"),
    ("get", "/api/v1/positions", "view"),
    ("get", "/api/v1/nodes", "view"),
    ("get", "/api/v1/nodes/{site}/{node}/health", "view"),
    ("put", "/api/v1/nodes/{site}/{node}", "administer"),
    ("delete", "/api/v1/nodes/{site}/{node}", "administer"),
    ("post", "/api/v1/receivers/{receiver}/sightings", "operate"),
    ("get", "/api/v1/rooms", "view"),
    ("get", "/api/v1/events", "view"),
    ("get", "/api/v1/findings", "view"),
    ("put", "/api/v1/rooms/{site}/{name}", "operate"),
    ("delete", "/api/v1/rooms/{site}/{name}", "operate"),
    ("put", "/api/v1/sites/{site}/walls", "administer"),
    ("put", "/api/v1/sites/{site}/plan", "administer"),
    ("put", "/api/v1/sites/{site}/plan/scale", "administer"),
    ("put", "/api/v1/sites/{site}/geographic-origin", "administer"),
    ("delete", "/api/v1/sites/{site}/geographic-origin", "administer"),
    ("get", "/api/v1/live", "view"),
    ("get", "/api/v1/updates", "view"),
    ("post", "/login", "-"),
    ("post", "/logout", "-"),
    ("get", "/api/v1/me", "-"),
    ("get", "/oidc/login", "-"),
    ("get", "/oidc/callback", "-"),
];

/// Method, path, operation of all routes in a document.
pub fn operations(document: &Value) -> Vec<(String, String, Value)> {
    let paths = document["paths"].as_object().unwrap();
    let operations = paths.iter().flat_map(|(path, item)| {
        let operations = item.as_object().unwrap().iter();
        operations.map(|(method, operation)| (method.clone(), path.clone(), operation.clone()))
    });
    operations.collect()
}

#[tokio::test]
async fn document_is_served_as_it_is_made() {
    let station = open().await;
    let answer = station.get("/openapi.json").await;
    assert_eq!(answer.header(header::CONTENT_TYPE), "application/json");
    assert_eq!(answer.json(), serde_json::to_value(openapi()).unwrap());
    assert!(answer.json()["openapi"].as_str().unwrap().starts_with("3.1."));
}

/// The page's types are made from the committed file, without a station.
#[test]
fn the_committed_description_is_that_of_the_code() {
    let committed = include_str!("../../openapi.json");
    let made = openapi().to_pretty_json().unwrap();
    assert!(
        committed.trim_end() == made,
        "station/openapi.json is not what the code describes: commit what `cargo run -p baliza-station-core --example \
         openapi > station/openapi.json` writes"
    );
}

#[test]
fn answers_have_all_keys_and_requests_only_some() {
    let document = serde_json::to_value(openapi()).unwrap();
    let required = |name: &str| {
        let schema = &document["components"]["schemas"][name];
        (schema["required"].as_array().unwrap().len(), schema["properties"].as_object().unwrap().len())
    };
    // Of a request, the name and the site, without the points; of a refusal, all but the pause.
    assert_eq!(required("NewCampaign"), (2, 3));
    assert_eq!(required("GeographicOrigin"), (3, 5));
    assert_eq!(required("Problem"), (4, 5));
    for name in ["Tag", "HealthFigures", "TagPosition", "Site", "Me"] {
        let (keys, all) = required(name);
        assert_eq!(keys, all, "{name}");
    }
}

#[test]
fn each_route_is_described_with_its_role_parameters_answers_and_refusals() {
    let document = serde_json::to_value(openapi()).unwrap();
    let operations = operations(&document);
    let mut described: Vec<(&str, &str)> =
        operations.iter().map(|(method, path, _)| (method.as_str(), path.as_str())).collect();
    let mut expected: Vec<_> = ROUTES.iter().map(|route| (route.0, route.1)).collect();
    described.sort_unstable();
    expected.sort_unstable();
    assert_eq!(described, expected);
    let mut ids = std::collections::BTreeSet::new();
    for (method, path, operation) in &operations {
        let name = format!("{method} {path}");
        assert!(operation["summary"].as_str().is_some_and(|text| !text.is_empty()), "{name}");
        assert!(ids.insert(operation["operationId"].as_str().unwrap().to_owned()), "{name}: not its own operationId");
        let responses = operation["responses"].as_object().unwrap();
        assert!(responses.keys().any(|status| status.starts_with(['2', '3'])), "{name}");
        let refused = responses["default"]["$ref"].as_str().unwrap().trim_start_matches('#');
        let refused = document.pointer(refused).unwrap();
        assert!(refused["content"]["application/problem+json"]["schema"].is_object(), "{name}");
        let parameters = operation["parameters"].as_array().cloned().unwrap_or_default();
        let in_path: Vec<_> = parameters.iter().filter(|parameter| parameter["in"] == "path").collect();
        assert_eq!(in_path.len(), path.matches('{').count(), "{name}");
        assert!(in_path.iter().all(|one| path.contains(&format!("{{{}}}", one["name"].as_str().unwrap()))), "{name}");
        assert_eq!(
            operation["requestBody"].is_object(),
            ["put", "post"].contains(&method.as_str()) && path != "/logout",
            "{name}"
        );
        let least = ROUTES.iter().find(|route| (route.0, route.1) == (method, path)).unwrap().2;
        let security = operation["security"].as_array().unwrap();
        match least {
            "-" => assert!(security.contains(&serde_json::json!({})), "{name}"),
            least => assert_eq!(security, &[serde_json::json!({"token": [least]})], "{name}"),
        }
    }
}

#[test]
fn each_reference_in_the_document_leads_somewhere() {
    fn references<'a>(value: &'a Value, found: &mut Vec<&'a str>) {
        match value {
            Value::Object(members) => {
                found.extend(members.get("$ref").and_then(Value::as_str));
                members.values().for_each(|member| references(member, found));
            }
            Value::Array(items) => items.iter().for_each(|item| references(item, found)),
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
        }
    }
    let document = serde_json::to_value(openapi()).unwrap();
    let mut found = Vec::new();
    references(&document, &mut found);
    assert!(found.len() > 50, "{}", found.len());
    for reference in found {
        let pointer = reference.strip_prefix('#').unwrap();
        assert!(document.pointer(pointer).is_some(), "{reference}");
    }
}
