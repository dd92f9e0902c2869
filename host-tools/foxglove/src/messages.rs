//! The messages of a [`View`](super::View): scenes and poses with Foxglove's schemas, positions and ranges as JSON with
//! schemas of this project.

use foxglove::bytes::BufMut;
use foxglove::messages::{
    Color, CubePrimitive, Pose, PoseInFrame, Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, TextPrimitive,
    Timestamp, Vector3,
};
use foxglove::messages::{LocationFix, location_fix::PositionCovarianceType};
use foxglove::{Encode, Schema};
use positioning_core::geodesy::Geographic;
use serde_json::{Value, json};

use recording::Coordinates;

/// The frame of all coordinates.
const FRAME: &str = "map";
const NANOSECONDS: u64 = 1_000_000_000;
/// The edge of an anchor's cube, metres.
const ANCHOR_M: f64 = 0.12;
const ANCHOR: Color = Color { r: 0.1, g: 0.3, b: 0.8, a: 1.0 };
const ELLIPSOID: Color = Color { r: 0.9, g: 0.5, b: 0.1, a: 0.3 };

/// A position, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate<'a> {
    /// Seconds.
    pub t_s: f64,
    /// The epoch's name.
    pub epoch: &'a str,
    /// The position.
    pub place: Option<Coordinates>,
    /// Standard deviations of x, y, z, metres.
    pub sigma_m: [Option<f64>; 3],
    /// Why there is no position.
    pub reason: Option<&'a str>,
}

/// A range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeRow<'a> {
    /// Seconds.
    pub t_s: f64,
    /// The epoch's name.
    pub epoch: &'a str,
    /// The anchor's name.
    pub anchor: &'a str,
    /// Metres.
    pub range_m: f64,
    /// Whether the line of sight is known to be free.
    pub los: Option<bool>,
}

impl Estimate<'_> {
    pub(super) fn message(&self) -> PositionMessage {
        let [sigma_x_m, sigma_y_m, sigma_z_m] = self.sigma_m;
        PositionMessage(json!({
            "t_s": self.t_s,
            "epoch": self.epoch,
            "x_m": self.place.map(|place| place.x_m),
            "y_m": self.place.map(|place| place.y_m),
            "z_m": self.place.and_then(|place| place.z_m),
            "sigma_x_m": sigma_x_m,
            "sigma_y_m": sigma_y_m,
            "sigma_z_m": sigma_z_m,
            "reason": self.reason,
        }))
    }
}

impl RangeRow<'_> {
    pub(super) fn message(&self) -> RangeMessage {
        let Self { t_s, epoch, anchor, range_m, los } = self;
        RangeMessage(json!({ "t_s": t_s, "epoch": epoch, "anchor": anchor, "range_m": range_m, "los": los }))
    }
}

/// `baliza.Position`.
pub(super) struct PositionMessage(Value);
/// `baliza.Range`.
pub(super) struct RangeMessage(Value);

/// JSON with the schema of an object whose keys have these types.
macro_rules! json_message {
    ($message:ident, $name:literal, { $($key:literal: $types:tt),* $(,)? }) => {
        impl Encode for $message {
            type Error = serde_json::Error;

            fn get_schema() -> Option<Schema> {
                let schema = json!({
                    "title": $name,
                    "type": "object",
                    "properties": { $($key: { "type": $types }),* },
                });
                Some(Schema::new($name, "jsonschema", schema.to_string().into_bytes()))
            }

            fn get_message_encoding() -> String {
                "json".to_owned()
            }

            fn encode(&self, buffer: &mut impl BufMut) -> Result<(), serde_json::Error> {
                buffer.put_slice(&serde_json::to_vec(&self.0)?);
                Ok(())
            }
        }
    };
}

json_message!(PositionMessage, "baliza.Position", {
    "t_s": "number", "epoch": "string",
    "x_m": ["number", "null"], "y_m": ["number", "null"], "z_m": ["number", "null"],
    "sigma_x_m": ["number", "null"], "sigma_y_m": ["number", "null"], "sigma_z_m": ["number", "null"],
    "reason": ["string", "null"],
});
json_message!(RangeMessage, "baliza.Range", {
    "t_s": "number", "epoch": "string", "anchor": "string", "range_m": "number", "los": ["boolean", "null"],
});

fn timestamp(t_ns: u64) -> Timestamp {
    let seconds = u32::try_from(t_ns / NANOSECONDS).unwrap_or(u32::MAX);
    Timestamp::new(seconds, (t_ns % NANOSECONDS) as u32)
}

fn at([x, y, z]: [f64; 3]) -> Pose {
    let orientation = Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
    Pose { position: Some(Vector3 { x, y, z }), orientation }
}

fn in_space(place: &Coordinates) -> [f64; 3] {
    [place.x_m, place.y_m, place.z_m.unwrap_or(0.0)]
}

pub(super) fn pose(t_ns: u64, place: &Coordinates) -> PoseInFrame {
    PoseInFrame { timestamp: Some(timestamp(t_ns)), frame_id: FRAME.to_owned(), pose: Some(at(in_space(place))) }
}

fn entity(t_ns: u64, id: &str) -> SceneEntity {
    SceneEntity {
        timestamp: Some(timestamp(t_ns)),
        frame_id: FRAME.to_owned(),
        id: id.to_owned(),
        ..SceneEntity::default()
    }
}

/// A cube and a name for each anchor, metres.
pub(super) fn anchors<'a>(t_ns: u64, anchors: impl Iterator<Item = (&'a str, [f64; 3])>) -> SceneUpdate {
    let entities = anchors.map(|(name, [x, y, z])| SceneEntity {
        cubes: vec![CubePrimitive {
            pose: Some(at([x, y, z])),
            size: Some(Vector3 { x: ANCHOR_M, y: ANCHOR_M, z: ANCHOR_M }),
            color: Some(ANCHOR),
        }],
        texts: vec![TextPrimitive {
            pose: Some(at([x, y, z + 1.5 * ANCHOR_M])),
            billboard: true,
            font_size: 1.5 * ANCHOR_M,
            scale_invariant: false,
            color: Some(ANCHOR),
            text: name.to_owned(),
        }],
        ..entity(t_ns, name)
    });
    SceneUpdate { deletions: Vec::new(), entities: entities.collect() }
}

/// A place on the earth with the covariance of its error: east-east, north-north and east-north, m².
pub(super) fn location(
    t_ns: u64,
    place: Geographic,
    [east, north, both]: [f64; 3],
    sigma_z_m: Option<f64>,
) -> LocationFix {
    let kind = if sigma_z_m.is_some() { PositionCovarianceType::Known } else { PositionCovarianceType::Approximated };
    let up = sigma_z_m.unwrap_or_default().powi(2);
    LocationFix {
        timestamp: Some(timestamp(t_ns)),
        frame_id: FRAME.to_owned(),
        latitude: place.latitude_deg,
        longitude: place.longitude_deg,
        altitude: place.height_m.unwrap_or_default(),
        position_covariance: vec![east, both, 0.0, both, north, 0.0, 0.0, 0.0, up],
        position_covariance_type: kind.into(),
        ..LocationFix::default()
    }
}

/// The ellipsoid of two standard deviations along the axes; flat where the height has none.
pub(super) fn ellipsoid(t_ns: u64, id: &str, place: &Coordinates, sigma_m: [Option<f64>; 3]) -> Option<SceneUpdate> {
    let [x, y, z] = sigma_m.map(|sigma_m| sigma_m.map(|sigma_m| 4.0 * sigma_m));
    let sphere = SpherePrimitive {
        pose: Some(at(in_space(place))),
        size: Some(Vector3 { x: x?, y: y?, z: z.unwrap_or(0.01) }),
        color: Some(ELLIPSOID),
    };
    let entity = SceneEntity { spheres: vec![sphere], ..entity(t_ns, id) };
    Some(SceneUpdate { deletions: Vec::new(), entities: vec![entity] })
}
