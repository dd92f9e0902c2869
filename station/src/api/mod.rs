//! HTTP: REST, live updates, the page.
//!
//! | route | what |
//! |---|---|
//! | `GET /` | the page |
//! | `GET /openapi.json`, `/healthz`, `/metrics` | description, health (200 or 503), Prometheus |
//! | `GET /scenarios`, `GET /blueprints/{scenario}` | sites (`Site`), the picture of a site's plan |
//! | `GET`, `POST /campaigns`; `GET`, `DELETE /campaigns/{name}`; `GET /campaigns/{name}/points`, `…/points/{id}`; `GET`, `POST …/points/{id}/samples` | surveys |
//! | `POST /rtls`, `POST /rtls/{scenario}` | a terminal's RSSI values to its position and room |
//! | `GET /api/v1/tags?site=`, `GET /api/v1/tags/{tag}/positions?site=&from=&to=&limit=` | tags with their last position; history, newest first |
//! | `GET /api/v1/positions?site=&from=&to=&step_s=&limit=` | all tags of a site, oldest first, at most one a tag and step |
//! | `GET /api/v1/nodes?site=`, `GET /api/v1/rooms?site=`, `GET /api/v1/events?site=&from=&to=&kind=&before=&limit=` | health of anchors and beacons; rooms and zones with who is in them; events, newest first |
//! | `PUT`, `DELETE /api/v1/rooms/{site}/{name}` | draws, deletes a room or a zone (`Zone`) |
//! | `PUT /api/v1/sites/{site}/walls` | replaces the walls (a list of pairs of points) |
//! | `PUT /api/v1/sites/{site}/plan?origin_x_m=&origin_y_m=&metres_per_pixel=&rotation_rad=` | the body is the picture |
//! | `PUT /api/v1/sites/{site}/plan/scale` | JSON: `origin_m`, `metres_per_pixel`, `rotation_rad` |
//! | `GET /api/v1/live?site=` | WebSocket: one `TagPosition` a message |
//! | `GET /api/v1/updates?site=` | server-sent events `position`, `event`, `changed`, `missed` |
//! | `POST /login`, `POST /logout`, `GET /api/v1/me` | a token becomes a cookie; who one is: role, and whether tokens are asked for |

use crate::{Hub, Store};

/// What the routes need.
#[derive(Clone, Debug)]
pub struct App {
    /// Live state and updates.
    pub hub: Hub,
    /// History and configuration.
    pub store: Store,
}

/// All routes.
pub fn router(app: App) -> axum::Router {
    let _ = app;
    todo!()
}
