//! Surveys: points and samples of a person's terminal to the store, and back.

use std::collections::BTreeSet;

use axum::extract::{DefaultBodyLimit, State};
use axum::http::{StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::{Coordinate, Json, Limit, Name, Path, Query};
use super::problem::Problem;
use super::{SAMPLES_BODY, Shared, answer};
use crate::Utc;
use crate::model::{Campaign, CampaignPoint, SurveySample};

/// The greatest number of campaigns.
const CAMPAIGNS: usize = 1_000;
/// The greatest number of points of a campaign.
const POINTS: usize = 1_000;
/// The greatest number of samples of a request.
pub const SAMPLES: usize = 10_000;
/// The greatest number of samples of a point.
const SAMPLES_OF_POINT: u64 = 1_000_000;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new()
        .routes(routes!(list, create))
        .routes(routes!(get, delete))
        .routes(routes!(points))
        .routes(routes!(point))
        .merge(OpenApiRouter::new().routes(routes!(samples, add_samples)).layer(DefaultBodyLimit::max(SAMPLES_BODY)))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct Page {
    /// How many rows are left out.
    #[serde(default)]
    #[param(required = false)]
    skip: u32,
    /// The greatest number of rows.
    #[serde(default)]
    #[param(inline, required = false)]
    limit: Limit,
}

impl Page {
    fn next(&self, uri: &Uri, is_full: bool) -> Option<String> {
        let next = self.skip.checked_add(self.limit.get()).filter(|_| is_full)?;
        Some(answer::with_parameter(uri, "skip", &next.to_string()))
    }
}

/// The campaigns. The header `Link` tells where further ones are.
#[utoipa::path(get, path = "/campaigns", tag = "campaigns", security(("token" = ["view"])),
    params(Page), responses((status = 200, body = [Campaign])))]
async fn list(State(station): State<Shared>, Query(page): Query<Page>, uri: Uri) -> Result<Response, Problem> {
    let campaigns = station.app.store.campaigns().await?;
    let rows: Vec<_> = campaigns.iter().skip(page.skip as usize).take(page.limit.get() as usize).collect();
    let more = campaigns.len() > page.skip as usize + rows.len();
    answer::page(&rows, page.next(&uri, more))
}

/// A campaign that is to be made.
#[derive(Debug, Deserialize, ToSchema)]
struct NewCampaign {
    #[schema(inline)]
    name: Name,
    /// The site.
    #[schema(inline)]
    scenario: Name,
    /// The points to survey: at most 1,000.
    #[serde(default)]
    #[schema(max_items = 1000)]
    points: Vec<NewPoint>,
}

/// A point to survey.
#[derive(Debug, Deserialize, ToSchema)]
struct NewPoint {
    /// Unique in the campaign.
    #[schema(inline)]
    id: Name,
    #[schema(inline)]
    x_m: Coordinate,
    #[schema(inline)]
    y_m: Coordinate,
    #[serde(default)]
    #[schema(inline)]
    z_m: Option<Coordinate>,
    /// The room that it is in.
    #[serde(default)]
    #[schema(inline)]
    room: Option<Name>,
}

/// Makes a campaign.
#[utoipa::path(post, path = "/campaigns", tag = "campaigns", security(("token" = ["operate"])),
    request_body = NewCampaign,
    responses((status = 201, body = Campaign, headers(("Location" = String, description = "its address")))))]
async fn create(State(station): State<Shared>, Json(new): Json<NewCampaign>) -> Result<Response, Problem> {
    if new.points.len() > POINTS {
        return Err(Problem::wrong(format!("a campaign has at most {POINTS} points")));
    }
    let mut ids = BTreeSet::new();
    if let Some(twice) = new.points.iter().find(|point| !ids.insert(point.id.as_str())) {
        return Err(Problem::wrong(format!("there are two points {}", twice.id.as_str())));
    }
    let point = |new: NewPoint| CampaignPoint {
        id: new.id.into(),
        x_m: new.x_m.into(),
        y_m: new.y_m.into(),
        z_m: new.z_m.map(f64::from),
        room: new.room.map(String::from),
        samples: 0,
    };
    station
        .configure(async move |station| {
            let scenario = station.site(&new.scenario).await?.name;
            if station.app.store.campaigns().await?.len() >= CAMPAIGNS {
                return Err(Problem::new(StatusCode::CONFLICT, format!("there are already {CAMPAIGNS} campaigns")));
            }
            let points = new.points.into_iter().map(point).collect();
            let campaign = Campaign { name: new.name.into(), scenario, created: Utc::now(), points };
            station.app.store.create_campaign(&campaign).await?;
            let segment = form_urlencoded::byte_serialize(campaign.name.as_bytes()).collect::<String>();
            let location = format!("/campaigns/{}", segment.replace('+', "%20"));
            Ok((StatusCode::CREATED, [(header::LOCATION, location)], axum::Json(campaign)).into_response())
        })
        .await
}

/// A campaign.
#[utoipa::path(get, path = "/campaigns/{name}", tag = "campaigns", security(("token" = ["view"])),
    params(("name" = Name, Path, description = "the campaign")), responses((status = 200, body = Campaign)))]
async fn get(State(station): State<Shared>, Path(name): Path<Name>) -> Result<axum::Json<Campaign>, Problem> {
    Ok(axum::Json(station.app.store.campaign(name.as_str()).await?))
}

/// Deletes a campaign, with its points and samples.
#[utoipa::path(delete, path = "/campaigns/{name}", tag = "campaigns", security(("token" = ["operate"])),
    params(("name" = Name, Path, description = "the campaign")),
    responses((status = 204, description = "it is deleted")))]
async fn delete(State(station): State<Shared>, Path(name): Path<Name>) -> Result<StatusCode, Problem> {
    station
        .configure(async move |station| {
            station.app.store.delete_campaign(name.as_str()).await?;
            Ok(StatusCode::NO_CONTENT)
        })
        .await
}

/// The points of a campaign.
#[utoipa::path(get, path = "/campaigns/{name}/points", tag = "campaigns", security(("token" = ["view"])),
    params(("name" = Name, Path, description = "the campaign")), responses((status = 200, body = [CampaignPoint])))]
async fn points(State(station): State<Shared>, Path(name): Path<Name>) -> Result<Response, Problem> {
    answer::page(&station.app.store.campaign(name.as_str()).await?.points, None)
}

/// A point of a campaign.
#[utoipa::path(get, path = "/campaigns/{name}/points/{id}", tag = "campaigns", security(("token" = ["view"])),
    params(("name" = Name, Path, description = "the campaign"), ("id" = Name, Path, description = "the point")),
    responses((status = 200, body = CampaignPoint)))]
async fn point(
    State(station): State<Shared>,
    Path((name, id)): Path<(Name, Name)>,
) -> Result<axum::Json<CampaignPoint>, Problem> {
    Ok(axum::Json(station.app.store.point(name.as_str(), id.as_str()).await?))
}

/// The samples of a point, in the order of their arrival. The header `Link` tells where further ones are.
#[utoipa::path(get, path = "/campaigns/{name}/points/{id}/samples", tag = "campaigns", security(("token" = ["view"])),
    params(("name" = Name, Path, description = "the campaign"), ("id" = Name, Path, description = "the point"), Page),
    responses((status = 200, body = [SurveySample])))]
async fn samples(
    State(station): State<Shared>,
    Path((name, id)): Path<(Name, Name)>,
    Query(page): Query<Page>,
    uri: Uri,
) -> Result<Response, Problem> {
    let (store, limit) = (&station.app.store, page.limit.get());
    store.point(name.as_str(), id.as_str()).await?;
    let rows = store.samples(name.as_str(), id.as_str(), page.skip.into(), limit).await?;
    answer::page(&rows, page.next(&uri, rows.len() == limit as usize))
}

/// The RSSI of a beacon's advertisement, as a terminal received it.
#[derive(Debug, Deserialize, ToSchema)]
pub struct NewSample {
    /// Major and minor number (`1-7`), or another name.
    #[schema(inline)]
    pub beacon: Name,
    #[schema(minimum = -200, maximum = 100)]
    pub rssi_dbm: f64,
    /// Seconds of the terminal's own clock.
    #[schema(minimum = -1e12, maximum = 1e12)]
    pub t_s: f64,
}

/// Checks samples of a request.
pub fn checked(samples: Vec<NewSample>) -> Result<Vec<SurveySample>, Problem> {
    if samples.len() > SAMPLES {
        return Err(Problem::wrong(format!("at most {SAMPLES} samples a request")));
    }
    let samples = samples.into_iter().map(|sample| {
        check_rssi(sample.rssi_dbm, sample.t_s)?;
        Ok(SurveySample { beacon: sample.beacon.into(), rssi_dbm: sample.rssi_dbm, t_s: sample.t_s })
    });
    samples.collect()
}

/// Checks an RSSI and its time.
pub fn check_rssi(rssi_dbm: f64, t_s: f64) -> Result<(), Problem> {
    if !(-200.0..=100.0).contains(&rssi_dbm) {
        return Err(Problem::wrong(format!("an RSSI is -200 to 100 dBm, not {rssi_dbm}")));
    }
    if !(t_s.abs() <= 1e12) {
        return Err(Problem::wrong(format!("t_s is -1e12 to 1e12, not {t_s}")));
    }
    Ok(())
}

/// What was added.
#[derive(Debug, Serialize, ToSchema)]
struct Added {
    /// The number of samples that were added.
    added: u64,
    /// The number of samples of the point.
    samples: u64,
}

/// Adds samples to a point: at most 10,000 a request.
#[utoipa::path(post, path = "/campaigns/{name}/points/{id}/samples", tag = "campaigns",
    security(("token" = ["operate"])),
    params(("name" = Name, Path, description = "the campaign"), ("id" = Name, Path, description = "the point")),
    request_body = Vec<NewSample>, responses((status = 201, body = Added)))]
async fn add_samples(
    State(station): State<Shared>,
    Path((name, id)): Path<(Name, Name)>,
    Json(samples): Json<Vec<NewSample>>,
) -> Result<(StatusCode, axum::Json<Added>), Problem> {
    let samples = checked(samples)?;
    station
        .configure(async move |station| {
            let (store, added) = (&station.app.store, samples.len() as u64);
            let point = store.point(name.as_str(), id.as_str()).await?;
            if point.samples + added > SAMPLES_OF_POINT {
                let detail = format!("a point has at most {SAMPLES_OF_POINT} samples");
                return Err(Problem::new(StatusCode::CONFLICT, detail));
            }
            store.add_samples(name.as_str(), id.as_str(), &samples).await?;
            Ok((StatusCode::CREATED, axum::Json(Added { added, samples: point.samples + added })))
        })
        .await
}
