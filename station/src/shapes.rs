//! How the API's description writes points and walls, lists of a fixed number of numbers, which the description of a
//! Rust array leaves open; and a geographic origin, with its bounds.

use positioning_core::geodesy::GeographicOrigin as Origin;
use utoipa::openapi::schema::{
    AdditionalProperties, ArrayBuilder, KnownFormat, ObjectBuilder, Schema, SchemaFormat, SchemaType, Type,
};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{PartialSchema, ToSchema};

use crate::model::GeographicOrigin;

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

impl PartialSchema for GeographicOrigin {
    fn schema() -> RefOr<Schema> {
        let number = |(least, greatest), is_required: bool, description: &str| {
            let null = (!is_required).then_some(Type::Null);
            ObjectBuilder::new()
                .schema_type(SchemaType::from_iter([Type::Number].into_iter().chain(null)))
                .minimum(Some(least))
                .maximum(Some(greatest))
                .description(Some(description))
        };
        let separation = "The height of the geoid (mean sea level) above the ellipsoid there. Without it, points 1 km \
                          from the origin are up to 17 mm off.";
        ObjectBuilder::new()
            .property("latitude_deg", number(Origin::LATITUDES_DEG, true, "North of the equator, WGS 84"))
            .property("longitude_deg", number(Origin::LONGITUDES_DEG, true, "East of Greenwich, WGS 84"))
            .property(
                "y_azimuth_deg",
                number(Origin::AZIMUTHS_DEG, true, "The azimuth of the y axis: clockwise from true north"),
            )
            .property("height_m", number(Origin::HEIGHTS_M, false, "The height of z = 0 above mean sea level"))
            .property("geoid_separation_m", number(Origin::SEPARATIONS_M, false, separation))
            .additional_properties(Some(AdditionalProperties::FreeForm(false)))
            .required("latitude_deg")
            .required("longitude_deg")
            .required("y_azimuth_deg")
            .description(Some("Where the origin of a site's frame is on the earth, and how the frame is turned."))
            .into()
    }
}

impl ToSchema for GeographicOrigin {}
