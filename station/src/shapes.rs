//! How the API's description writes points and walls: lists of a fixed number of numbers, which the description of a
//! Rust array leaves open.

use utoipa::openapi::schema::{ArrayBuilder, KnownFormat, ObjectBuilder, Schema, SchemaFormat, Type};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{PartialSchema, ToSchema};

/// Two metres or more, in the order of the axes.
fn point(axes: usize, description: &str) -> RefOr<Schema> {
    let format = SchemaFormat::KnownFormat(KnownFormat::Double);
    list(axes, ObjectBuilder::new().schema_type(Type::Number).format(Some(format)).build(), description)
}

fn list(items: usize, of: impl Into<RefOr<Schema>>, description: &str) -> RefOr<Schema> {
    let list = ArrayBuilder::new().items(of.into()).min_items(Some(items)).max_items(Some(items));
    list.description(Some(description)).into()
}

/// A point in the plane: `[f64; 2]`.
#[derive(Debug)]
pub(crate) struct PlanePoint;

impl PartialSchema for PlanePoint {
    fn schema() -> RefOr<Schema> {
        point(2, "A point in the plane: x and y, metres in the site's frame.")
    }
}

impl ToSchema for PlanePoint {}

/// A point in space: `[f64; 3]`.
#[derive(Debug)]
pub(crate) struct SpacePoint;

impl PartialSchema for SpacePoint {
    fn schema() -> RefOr<Schema> {
        point(3, "A point in space: x, y and z, metres in the site's frame.")
    }
}

impl ToSchema for SpacePoint {}

/// A wall: `[[f64; 2]; 2]`.
#[derive(Debug)]
pub(crate) struct WallLine;

impl PartialSchema for WallLine {
    fn schema() -> RefOr<Schema> {
        list(2, Ref::from_schema_name(PlanePoint::name()), "A wall, from one end to the other.")
    }
}

impl ToSchema for WallLine {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((PlanePoint::name().into_owned(), PlanePoint::schema()));
    }
}
