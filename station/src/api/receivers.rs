//! Fixed receivers that post what they receive, to reports for the hub.

use std::time::Duration;

use axum::extract::{DefaultBodyLimit, State};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::campaigns::{SAMPLES, check_rssi};
use super::extract::{Json, Name, Path};
use super::problem::Problem;
use super::rtls::is_address;
use super::{SAMPLES_BODY, Shared};
use crate::bounds::{LONGEST_NAME, is_name};
use crate::model::NodeRole;
use crate::{ReportKind, SourceReport, Utc};

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(sightings)).layer(DefaultBodyLimit::max(SAMPLES_BODY))
}

/// What a receiver received.
#[derive(Debug, Deserialize, ToSchema)]
struct ReceiverSightings {
    /// The site.
    #[schema(inline)]
    scenario: Name,
    /// At most 10,000.
    #[schema(max_items = 10_000)]
    samples: Vec<DeviceSighting>,
}

/// The RSSI of a device's advertisement, as a receiver received it.
#[derive(Debug, Deserialize, ToSchema)]
struct DeviceSighting {
    /// How the device is to be called among the tags; at most 64 bytes, and not like the address of a tag (`0x1001`).
    #[schema(inline)]
    device: Name,
    #[schema(minimum = -200, maximum = 100)]
    rssi_dbm: f64,
    /// What receivers measure at one metre from the device, where it is known.
    #[serde(default)]
    #[schema(minimum = -200, maximum = 100)]
    rssi_1m_dbm: Option<f64>,
    /// Seconds of the receiver's own clock. The latest sample counts as one of now.
    #[schema(minimum = -1e12, maximum = 1e12)]
    t_s: f64,
}

/// What was done with them.
#[derive(Debug, Serialize, ToSchema)]
struct Taken {
    /// The number of samples that were passed on to the locator.
    taken: usize,
}

/// What a fixed receiver at a known place received. Devices that are received well enough are located once a second,
/// and appear on the map.
#[utoipa::path(post, path = "/api/v1/receivers/{receiver}/sightings", tag = "nodes",
    security(("token" = ["operate"])),
    params(("receiver" = Name, Path, description = "a node whose role is receiver")),
    request_body = ReceiverSightings, responses((status = 200, body = Taken)))]
async fn sightings(
    State(station): State<Shared>,
    Path(receiver): Path<Name>,
    Json(received): Json<ReceiverSightings>,
) -> Result<axum::Json<Taken>, Problem> {
    let site = station.site(&received.scenario).await?.name;
    let (receiver, samples) = (String::from(receiver), received.samples);
    if !station.app.hub.read(|live| live.known(&site, NodeRole::Receiver)).contains_key(&receiver) {
        let how = "PUT /api/v1/nodes/{site}/{node} places one";
        return Err(Problem::missing(format_args!("receiver {receiver:?} at a known place in {site:?}; {how}")));
    }
    if samples.len() > SAMPLES {
        return Err(Problem::wrong(format!("at most {SAMPLES} samples a request")));
    }
    for DeviceSighting { device, rssi_dbm, rssi_1m_dbm, t_s } in &samples {
        check_rssi(*rssi_dbm, *t_s)?;
        if let Some(rssi_1m_dbm) = rssi_1m_dbm {
            check_rssi(*rssi_1m_dbm, *t_s)?;
        }
        if is_address(device.as_str()) || !is_name(device.as_str()) {
            let what = format!("device {:?} looks like the address of a tag, or is too long", device.as_str());
            return Err(Problem::wrong(format!("{what}: choose another name of at most {LONGEST_NAME} bytes")));
        }
    }
    let (now, taken) = (Utc::now(), samples.len());
    let latest_s = samples.iter().map(|sample| sample.t_s).fold(f64::NEG_INFINITY, f64::max);
    let reports = samples.into_iter().map(|DeviceSighting { device, rssi_dbm, rssi_1m_dbm, t_s }| {
        let t = now - Duration::from_secs_f64((latest_s - t_s).max(0.0));
        let what =
            ReportKind::ReceiverSighting { receiver: receiver.clone(), device: device.into(), rssi_dbm, rssi_1m_dbm };
        SourceReport { t, site: site.clone(), what }
    });
    station.report(reports).await?;
    Ok(axum::Json(Taken { taken }))
}
