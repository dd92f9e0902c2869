//! What nodes run: frames, advertisements, telemetry, records and models in flash, and the protocols' state machines.

mod flash;
mod models;
mod protocols;
mod received;

use crate::Target;
#[cfg(feature = "host")]
pub(crate) use received::{framed, telemetry_seeds as stream_seeds};

/// All targets.
pub const TARGETS: [Target; 14] = [
    Target { name: "frames", run: received::frames, seeds: received::frame_seeds },
    Target { name: "advertisements", run: received::advertisements, seeds: received::advertisement_seeds },
    Target { name: "datagrams", run: received::datagrams, seeds: received::datagram_seeds },
    Target { name: "telemetry", run: received::telemetry, seeds: received::telemetry_seeds },
    Target { name: "record", run: flash::record, seeds: flash::record_seeds },
    Target { name: "site-models", run: flash::site_models, seeds: flash::site_model_seeds },
    Target { name: "nlos-model", run: models::nlos, seeds: models::nlos_seeds },
    Target { name: "room-model", run: models::rooms, seeds: models::room_seeds },
    Target { name: "map", run: models::map, seeds: models::map_seeds },
    Target { name: "tag", run: protocols::tag, seeds: protocols::seeds },
    Target { name: "anchor", run: protocols::anchor, seeds: protocols::seeds },
    Target { name: "tdoa-tag", run: protocols::tdoa_tag, seeds: protocols::seeds },
    Target { name: "decaranging-tag", run: protocols::decaranging_tag, seeds: protocols::seeds },
    Target { name: "decaranging-anchor", run: protocols::decaranging_anchor, seeds: protocols::seeds },
];
