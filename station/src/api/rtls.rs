//! Terminals that cannot solve themselves: a request's RSSI values to its position, which is also reported to the hub.

use axum::extract::{DefaultBodyLimit, State};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::campaigns::{self, NewSample};
use super::extract::{Json, Name, Path};
use super::problem::Problem;
use super::{SAMPLES_BODY, Shared, Station};
use crate::bounds::{LONGEST_NAME, is_name};
use crate::model::NodeRole;
use crate::state::Gaussian;
use crate::terminal::locate;
use crate::{ReportKind, SourceReport, Utc};

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    let routes = OpenApiRouter::new().routes(routes!(rtls)).routes(routes!(rtls_of));
    routes.layer(DefaultBodyLimit::max(SAMPLES_BODY))
}

/// What a terminal received.
#[derive(Debug, Deserialize, ToSchema)]
struct Received {
    /// How the terminal calls itself; not like the address of a tag (`0x1001`).
    #[schema(inline)]
    terminal: Name,
    /// The site.
    #[schema(inline)]
    scenario: Name,
    /// At most 10,000.
    #[schema(max_items = 10_000)]
    samples: Vec<NewSample>,
}

/// What a terminal received, at the site in the path.
#[derive(Debug, Deserialize, ToSchema)]
struct ReceivedHere {
    /// How the terminal calls itself; not like the address of a tag (`0x1001`).
    #[schema(inline)]
    terminal: Name,
    /// As in the path, where given.
    #[serde(default)]
    #[schema(inline)]
    scenario: Option<Name>,
    /// At most 10,000.
    #[schema(max_items = 10_000)]
    samples: Vec<NewSample>,
}

/// Where a terminal is.
#[derive(Debug, Default, Serialize, ToSchema)]
struct Located {
    x_m: Option<f64>,
    y_m: Option<f64>,
    /// Standard deviations.
    sigma_x_m: Option<f64>,
    sigma_y_m: Option<f64>,
    /// The room, where one is more probable than not.
    room: Option<String>,
    /// Why there is no position.
    reason: Option<&'static str>,
}

/// A terminal's position and room, from the RSSI values of beacons at known places. The terminal appears on the map.
#[utoipa::path(post, path = "/rtls", tag = "rtls", security(("token" = ["operate"])), request_body = Received,
    responses((status = 200, body = Located)))]
async fn rtls(State(station): State<Shared>, Json(received): Json<Received>) -> Result<axum::Json<Located>, Problem> {
    station.position(received.terminal, received.scenario, received.samples).await.map(axum::Json)
}

/// The same, with the site in the path.
#[utoipa::path(post, path = "/rtls/{scenario}", tag = "rtls", security(("token" = ["operate"])),
    params(("scenario" = Name, Path, description = "the site")), request_body = ReceivedHere,
    responses((status = 200, body = Located)))]
async fn rtls_of(
    State(station): State<Shared>,
    Path(scenario): Path<Name>,
    Json(received): Json<ReceivedHere>,
) -> Result<axum::Json<Located>, Problem> {
    if received.scenario.is_some_and(|other| other != scenario) {
        return Err(Problem::wrong("scenario in the body is not that in the path"));
    }
    station.position(received.terminal, scenario, received.samples).await.map(axum::Json)
}

impl Station {
    async fn position(&self, terminal: Name, site: Name, samples: Vec<NewSample>) -> Result<Located, Problem> {
        if is_address(terminal.as_str()) {
            return Err(Problem::wrong("terminal looks like the address of a tag: choose another name"));
        }
        if !is_name(terminal.as_str()) {
            return Err(Problem::wrong(format!("terminal has at most {LONGEST_NAME} bytes")));
        }
        let site = self.site(&site).await?.name;
        let samples = campaigns::checked(samples)?;
        let tag = String::from(terminal);
        // Numbers of rooms and beacons are small, but a least-squares solution of 10,000 samples takes a while.
        let beacons = self.app.hub.read(|live| live.known(&site, NodeRole::Beacon));
        let located = tokio::task::spawn_blocking(move || locate(&beacons, &samples)).await;
        let located = located.unwrap_or_else(|panic| std::panic::resume_unwind(panic.into_panic()));
        let (what, answer) = match located {
            Ok(at) => {
                let [[x_m, y_m], [sigma_x_m, sigma_y_m]] = [at.position_m, at.sigma_m];
                let covariance_m2 = [sigma_x_m * sigma_x_m, at.cov_xy_m2, sigma_y_m * sigma_y_m];
                let gaussian = Gaussian { mean_m: at.position_m, covariance_m2 };
                let answer = Located {
                    x_m: Some(x_m),
                    y_m: Some(y_m),
                    sigma_x_m: Some(sigma_x_m),
                    sigma_y_m: Some(sigma_y_m),
                    room: self.app.hub.read(|live| live.room_of(&site, &gaussian)),
                    reason: None,
                };
                (at.of(tag), answer)
            }
            Err(reason) => (
                ReportKind::NoPosition { tag, round: None, reason: reason.to_owned() },
                Located { reason: Some(reason), ..Located::default() },
            ),
        };
        self.report([SourceReport { t: Utc::now(), site, what }]).await?;
        Ok(answer)
    }
}

/// Whether a name is `0x` and hexadecimal digits.
pub fn is_address(name: &str) -> bool {
    let digits = name.strip_prefix("0x").or_else(|| name.strip_prefix("0X"));
    digits.is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_hexdigit()))
}
