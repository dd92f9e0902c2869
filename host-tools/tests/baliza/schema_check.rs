//! The schemas of `docs/reference/schema`. Every document of `--json` that a test reads is checked against them.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use jsonschema::{Registry, Validator};
use serde_json::Value;

use crate::support::root;

/// The folder's base address, against which one schema names another.
const BASE: &str = "file:///schema/";

/// The schemas by their files' names.
static SCHEMAS: LazyLock<BTreeMap<String, Value>> = LazyLock::new(|| {
    let files = std::fs::read_dir(root().join("docs/reference/schema")).expect("the folder of schemas");
    let paths = files.map(|file| file.expect("an entry").path());
    let schemas = paths.filter(|path| path.extension().is_some_and(|extension| extension == "json")).map(|path| {
        let name = path.file_name().and_then(|name| name.to_str()).expect("a name").to_owned();
        let text = std::fs::read_to_string(&path).expect("a file");
        (name, serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
    });
    schemas.collect()
});

static REGISTRY: LazyLock<Registry<'static>> = LazyLock::new(|| {
    let schemas = SCHEMAS.iter().map(|(name, schema)| (format!("{BASE}{name}"), schema));
    let registry = schemas.fold(Registry::new(), |registry, (uri, schema)| registry.add(uri, schema).expect("a URI"));
    registry.prepare().expect("references to schemas that are there")
});

pub static VALIDATORS: LazyLock<BTreeMap<&str, Validator>> = LazyLock::new(|| {
    let of = |name: &str, schema: &Value| {
        let options = jsonschema::options().with_registry(&REGISTRY).with_base_uri(format!("{BASE}{name}"));
        options.build(schema).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    SCHEMAS.iter().map(|(name, schema)| (name.as_str(), of(name, schema))).collect()
});

/// The file of a command's schema.
fn file_of(command: &str) -> Option<&'static str> {
    let commands = |schema: &Value| schema["properties"]["command"]["enum"].as_array().cloned().unwrap_or_default();
    let mut files = SCHEMAS.iter().filter(|(_, schema)| commands(schema).contains(&command.into()));
    let file = files.next().map(|(name, _)| name.as_str());
    assert_eq!(files.next(), None, "{command} has two schemas");
    file
}

/// Asserts that a value agrees with a schema, and that it would not with one more key in any of its objects.
fn check_against(file: &str, value: &Value) {
    let validator = &VALIDATORS[file];
    let wrong: Vec<_> =
        validator.iter_errors(value).map(|error| format!("{}: {error}", error.instance_path())).collect();
    assert!(wrong.is_empty(), "docs/reference/schema/{file}: {}\n{value:#}", wrong.join("\n"));
    let mut objects = Vec::new();
    objects_of(value, String::new(), &mut objects);
    for pointer in objects {
        let mut changed = value.clone();
        let object = changed.pointer_mut(&pointer).and_then(Value::as_object_mut).expect("an object");
        object.insert("surplus".to_owned(), "a value".into());
        assert!(!validator.is_valid(&changed), "docs/reference/schema/{file} takes any key in {pointer:?}");
    }
}

/// The pointers to the objects of a value; of a list, to those of its first element.
fn objects_of(value: &Value, pointer: String, found: &mut Vec<String>) {
    match value {
        Value::Object(fields) => {
            for (key, field) in fields {
                objects_of(field, format!("{pointer}/{key}"), found);
            }
            found.push(pointer);
        }
        Value::Array(values) => {
            values.iter().take(1).for_each(|first| objects_of(first, format!("{pointer}/0"), found))
        }
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}

/// Asserts that a document of `--json` agrees with the schema of its command. Errors in the name of a command have no
/// more than the envelope.
pub fn check(document: &Value) {
    let command = document["command"].as_str().expect("a command");
    match file_of(command) {
        Some(file) => check_against(file, document),
        None if document["results"].is_null() => check_against("envelope.schema.json", document),
        None => panic!("no file of docs/reference/schema is about {command:?}"),
    }
}

/// Asserts that each line agrees with the schema of positions.
pub fn check_positions(lines: &[Value]) {
    lines.iter().for_each(|line| check_against("position.schema.json", line));
}
