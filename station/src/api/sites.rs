//! Sites: a person's plans and walls to the store, and back.

use axum::body::Bytes as Body;
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::{Bytes, Coordinate, Json, Name, Path, Query, point_m};
use super::problem::Problem;
use super::{Shared, Station, answer};
use crate::model::{FloorPlan, GeographicOrigin, SiteMap};
use crate::shapes::{PlanePoint, WallLine};

/// The greatest size of a picture, bytes.
const PICTURE: usize = 20_000_000;
/// The greatest number of pixels of a picture: browsers need four bytes for each.
const PIXELS: u64 = 100_000_000;
/// The greatest number of sites.
const SITES: usize = 1_000;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new()
        .routes(routes!(list))
        .routes(routes!(picture))
        .routes(routes!(put_walls))
        .routes(routes!(put_scale))
        .routes(routes!(put_geographic_origin, delete_geographic_origin))
        .merge(OpenApiRouter::new().routes(routes!(put_plan)).layer(DefaultBodyLimit::max(PICTURE)))
}

/// The sites, with their walls and the scale of their plans.
#[utoipa::path(get, path = "/scenarios", tag = "sites", security(("token" = ["view"])),
    responses((status = 200, body = [SiteMap])))]
async fn list(State(station): State<Shared>, headers: HeaderMap) -> Result<Response, Problem> {
    answer::tagged_json(&headers, &station.app.store.sites().await?)
}

/// The picture of a site's plan.
#[utoipa::path(get, path = "/blueprints/{scenario}", tag = "sites", security(("token" = ["view"])),
    params(("scenario" = Name, Path, description = "the site")),
    responses((status = 200, description = "the picture", content(
        (Vec<u8> = "image/png"), (Vec<u8> = "image/jpeg"), (Vec<u8> = "image/webp")))))]
async fn picture(
    State(station): State<Shared>,
    Path(scenario): Path<Name>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let site = station.site(&scenario).await?;
    let none = || Problem::missing(format_args!("plan of {}", site.name));
    let plan = site.plan.as_ref().ok_or_else(none)?;
    let picture = station.app.store.picture(scenario.as_str()).await?;
    Ok(answer::tagged(&headers, &plan.media_type, Body::from(picture)))
}

/// Replaces the walls of a site; makes the site where there is none.
#[utoipa::path(put, path = "/api/v1/sites/{site}/walls", tag = "sites", security(("token" = ["administer"])),
    params(("site" = Name, Path, description = "the site")),
    request_body = Vec<WallLine>, responses((status = 200, body = SiteMap)))]
async fn put_walls(
    State(station): State<Shared>,
    Path(site): Path<Name>,
    Json(walls): Json<Vec<[[Coordinate; 2]; 2]>>,
) -> Result<axum::Json<SiteMap>, Problem> {
    let walls_m = walls.into_iter().map(|wall| wall.map(point_m)).collect();
    station
        .configure(async move |station| {
            let site = SiteMap { walls_m, ..station.site_or_new(&site).await? };
            station.app.store.put_site(&site).await?;
            station.reload().await?;
            Ok(axum::Json(site))
        })
        .await
}

/// Where a picture is.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct Placed {
    /// Where the upper left corner is.
    #[param(inline)]
    origin_x_m: Coordinate,
    /// Where the upper left corner is.
    #[param(inline)]
    origin_y_m: Coordinate,
    /// The scale.
    #[param(inline)]
    metres_per_pixel: MetresPerPixel,
    /// The rotation, anticlockwise.
    #[serde(default)]
    #[param(inline, required = false)]
    rotation_rad: Rotation,
}

/// The scale and the position of a plan.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Scale {
    /// Where the upper left corner is.
    #[schema(value_type = PlanePoint)]
    origin_m: [Coordinate; 2],
    metres_per_pixel: MetresPerPixel,
    /// Anticlockwise.
    #[serde(default)]
    rotation_rad: Rotation,
}

#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(try_from = "f64")]
#[schema(value_type = f64, exclusive_minimum = 0.0, maximum = 1000.0)]
struct MetresPerPixel(f64);

impl TryFrom<f64> for MetresPerPixel {
    type Error = &'static str;

    fn try_from(value: f64) -> Result<Self, Self::Error> {
        if value > 0.0 && value <= 1e3 { Ok(Self(value)) } else { Err("metres_per_pixel is more than 0, at most 1000") }
    }
}

#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(try_from = "f64")]
#[schema(value_type = f64, minimum = -7.0, maximum = 7.0)]
struct Rotation(f64);

impl TryFrom<f64> for Rotation {
    type Error = &'static str;

    fn try_from(value: f64) -> Result<Self, Self::Error> {
        if value.abs() <= 7.0 { Ok(Self(value)) } else { Err("rotation_rad is -7 to 7") }
    }
}

/// Replaces the plan of a site: the body is a picture (PNG, JPEG or WebP, at most 20 MB and 100 megapixels).
#[utoipa::path(put, path = "/api/v1/sites/{site}/plan", tag = "sites", security(("token" = ["administer"])),
    params(("site" = Name, Path, description = "the site: made where there is none"), Placed),
    request_body(content((Vec<u8> = "image/png"), (Vec<u8> = "image/jpeg"), (Vec<u8> = "image/webp"))),
    responses((status = 200, body = FloorPlan)))]
async fn put_plan(
    State(station): State<Shared>,
    Path(site): Path<Name>,
    Query(placed): Query<Placed>,
    Bytes(picture): Bytes,
) -> Result<axum::Json<FloorPlan>, Problem> {
    let (media_type, width_px, height_px) = measure(&picture)?;
    let plan = FloorPlan {
        origin_m: [placed.origin_x_m.into(), placed.origin_y_m.into()],
        metres_per_pixel: placed.metres_per_pixel.0,
        rotation_rad: placed.rotation_rad.0,
        width_px,
        height_px,
        media_type: media_type.to_owned(),
    };
    station
        .configure(async move |station| {
            station.make_site(&site).await?;
            station.app.store.put_plan(site.as_str(), &plan, Some(&picture)).await?;
            station.reload().await?;
            Ok(axum::Json(plan))
        })
        .await
}

/// Changes the scale and the position of a plan.
#[utoipa::path(put, path = "/api/v1/sites/{site}/plan/scale", tag = "sites", security(("token" = ["administer"])),
    params(("site" = Name, Path, description = "the site")),
    request_body = Scale, responses((status = 200, body = FloorPlan)))]
async fn put_scale(
    State(station): State<Shared>,
    Path(site): Path<Name>,
    Json(scale): Json<Scale>,
) -> Result<axum::Json<FloorPlan>, Problem> {
    station
        .configure(async move |station| {
            let none = || Problem::missing(format_args!("plan of {}", site.as_str()));
            let plan = station.site(&site).await?.plan.ok_or_else(none)?;
            let plan = FloorPlan {
                origin_m: point_m(scale.origin_m),
                metres_per_pixel: scale.metres_per_pixel.0,
                rotation_rad: scale.rotation_rad.0,
                ..plan
            };
            station.app.store.put_plan(site.as_str(), &plan, None).await?;
            station.reload().await?;
            Ok(axum::Json(plan))
        })
        .await
}

/// Replaces where a site's frame is on the earth; makes the site where there is none.
#[utoipa::path(put, path = "/api/v1/sites/{site}/geographic-origin", tag = "sites",
    security(("token" = ["administer"])), params(("site" = Name, Path, description = "the site")),
    request_body = GeographicOrigin, responses((status = 200, body = SiteMap)))]
async fn put_geographic_origin(
    State(station): State<Shared>,
    Path(site): Path<Name>,
    Json(origin): Json<GeographicOrigin>,
) -> Result<axum::Json<SiteMap>, Problem> {
    station
        .configure(async move |station| {
            let stored = station.make_site(&site).await?;
            station.app.store.put_geographic_origin(site.as_str(), Some(&origin)).await?;
            station.reload().await?;
            Ok(axum::Json(SiteMap { geographic_origin: Some(origin), ..stored }))
        })
        .await
}

/// Forgets where a site's frame is on the earth.
#[utoipa::path(delete, path = "/api/v1/sites/{site}/geographic-origin", tag = "sites",
    security(("token" = ["administer"])), params(("site" = Name, Path, description = "the site")),
    responses((status = 204, description = "it is forgotten")))]
async fn delete_geographic_origin(
    State(station): State<Shared>,
    Path(site): Path<Name>,
) -> Result<StatusCode, Problem> {
    station
        .configure(async move |station| {
            if station.site(&site).await?.geographic_origin.is_none() {
                return Err(Problem::missing(format_args!("geographic origin of {}", site.as_str())));
            }
            station.app.store.put_geographic_origin(site.as_str(), None).await?;
            station.reload().await?;
            Ok(StatusCode::NO_CONTENT)
        })
        .await
}

/// The media type of a picture, by its content, and its size in pixels.
fn measure(picture: &[u8]) -> Result<(&'static str, u32, u32), Problem> {
    let no_picture = |detail: &str| Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, detail);
    let media_type = match imagesize::image_type(picture) {
        Ok(imagesize::ImageType::Png) => "image/png",
        Ok(imagesize::ImageType::Jpeg) => "image/jpeg",
        Ok(imagesize::ImageType::Webp) => "image/webp",
        Ok(_) | Err(_) => return Err(no_picture("the body is no picture in PNG, JPEG or WebP")),
    };
    let size = imagesize::blob_size(picture).map_err(|_| no_picture("the picture is damaged: it has no size"))?;
    let [width_px, height_px] = [size.width, size.height].map(|pixels| u32::try_from(pixels).unwrap_or(u32::MAX));
    if !(1..=PIXELS).contains(&(u64::from(width_px) * u64::from(height_px))) {
        return Err(Problem::wrong(format!(
            "the picture has {width_px} x {height_px} pixels: at most {PIXELS} can be shown"
        )));
    }
    Ok((media_type, width_px, height_px))
}

impl Station {
    /// The site of this name.
    pub(super) async fn site(&self, name: &Name) -> Result<SiteMap, Problem> {
        let sites = self.app.store.sites().await?;
        let site = sites.into_iter().find(|site| site.name == name.as_str());
        site.ok_or_else(|| Problem::missing(format_args!("site {}", name.as_str())))
    }

    /// The live state has the zones and geographic origins of the store, and tells its listeners that something has
    /// changed.
    pub(super) async fn reload(&self) -> Result<(), Problem> {
        let (zones, sites) = (self.app.store.zones().await?, self.app.store.sites().await?);
        self.app.hub.change(|live| {
            live.set_zones(zones);
            live.set_geographic_origins(&sites);
        });
        Ok(())
    }

    /// The site of this name, which is in the store from now on.
    async fn make_site(&self, name: &Name) -> Result<SiteMap, Problem> {
        let site = self.site_or_new(name).await?;
        self.app.store.put_site(&site).await?;
        Ok(site)
    }

    async fn site_or_new(&self, name: &Name) -> Result<SiteMap, Problem> {
        let sites = self.app.store.sites().await?;
        let many = sites.len() >= SITES;
        match sites.into_iter().find(|site| site.name == name.as_str()) {
            Some(site) => Ok(site),
            None if many => Err(Problem::new(StatusCode::CONFLICT, format!("there are already {SITES} sites"))),
            None => Ok(SiteMap::new(name.as_str())),
        }
    }
}
