//! The schemas of `docs/reference/schema` refuse what they should.

use serde_json::{Value, json};

use crate::schema_check::VALIDATORS;

#[test]
fn a_document_is_results_or_an_error_of_a_known_schema() {
    let valid = |document: Value| VALIDATORS["envelope.schema.json"].is_valid(&document);
    let error = json!({ "file": null, "line": null, "message": "no" });
    assert!(valid(json!({ "schema": 1, "command": "solve", "results": [] })));
    assert!(valid(json!({ "schema": 1, "command": "solve", "error": error })));
    assert!(!valid(json!({ "schema": 1, "command": "solve", "results": [], "error": error })), "both");
    assert!(!valid(json!({ "schema": 1, "command": "solve" })), "neither");
    assert!(!valid(json!({ "schema": 2, "command": "solve", "results": [] })), "another schema");
    assert!(!valid(json!({ "schema": 1, "command": "solve", "results": [1] })), "no object");
}

#[test]
fn a_missing_key_a_wrong_type_and_another_command_are_refused() {
    let result = json!({ "method": "nls", "epochs": 1, "fixed": 1, "rmse_m": null, "mae_m": null, "p50_m": null,
        "p90_m": null });
    let valid = |command: &str, key: &str, value: Option<Value>| {
        let mut result = result.clone();
        let fields = result.as_object_mut().expect("an object");
        match value {
            Some(value) => fields.insert(key.to_owned(), value),
            None => fields.remove(key),
        };
        VALIDATORS["solve.schema.json"].is_valid(&json!({ "schema": 1, "command": command, "results": [result] }))
    };
    assert!(valid("solve", "rmse_m", Some(0.5.into())));
    assert!(!valid("solve", "rmse_m", None), "a missing key");
    assert!(!valid("solve", "rmse_m", Some("0.5".into())), "a text");
    assert!(!valid("solve", "epochs", Some((-1).into())), "a negative count");
    assert!(!valid("ble solve", "rmse_m", Some(0.5.into())), "another command");
}
