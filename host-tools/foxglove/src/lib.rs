//! Anchors, positions and ranges as channels that Foxglove draws, in an MCAP file ([`McapFile`]) or live ([`Live`]).
//!
//! | topic | schema |
//! |---|---|
//! | `/anchors` | `foxglove.SceneUpdate`: a cube and a name each |
//! | `/NAME/pose` | `foxglove.PoseInFrame`, in the frame `map`; without a height at z = 0 |
//! | `/NAME/uncertainty` | `foxglove.SceneUpdate`: an ellipsoid of two standard deviations along the axes |
//! | `/NAME/position` | `baliza.Position`, JSON: also epochs without a position, with their reason |
//! | `/TAG/location` | `foxglove.LocationFix`: of the station, where its site has a geographic origin |
//! | `/ranges`, `/TAG/ranges` | `baliza.Range`, JSON |
//!
//! [`View`] makes the messages; a [`Sink`] takes them.
#![forbid(unsafe_code)]

mod conversion;
mod live;
mod mcap_file;
mod messages;

use std::collections::{BTreeMap, HashMap};

use anyhow::{Context, Result};
use foxglove::{Encode, Schema};
use positioning_core::geodesy::Geographic;
use wire::telemetry::{Address, Message};

pub use conversion::{Clock, Converted, convert, convert_stream};
pub use live::Live;
pub use mcap_file::McapFile;
pub use messages::{Estimate, RangeRow};

use node_link::decode::Stamp;
use recording::Coordinates;

/// The name of a tag that a stream of telemetry does not name.
const TAG: &str = "tag";

/// What a channel carries.
#[derive(Clone, Debug)]
pub struct Topic<'a> {
    /// Its name.
    pub name: &'a str,
    /// The encoding of messages: `protobuf` or `json`.
    pub encoding: String,
    /// Their schema.
    pub schema: Schema,
}

/// Takes messages.
pub trait Sink {
    /// A channel of it.
    type Channel;

    /// Opens a channel.
    ///
    /// # Errors
    /// The channel cannot be opened.
    fn open(&mut self, topic: Topic<'_>) -> Result<Self::Channel>;

    /// Takes a message of this time, nanoseconds since 1970 or since the recording's beginning.
    ///
    /// # Errors
    /// The message cannot be written.
    fn put(&mut self, channel: &Self::Channel, t_ns: u64, message: &[u8]) -> Result<()>;
}

/// Makes messages of anchors, positions and ranges.
pub struct View<S: Sink> {
    sink: S,
    channels: HashMap<String, S::Channel>,
    /// Metres, by name.
    anchors: BTreeMap<String, [f64; 3]>,
}

impl<S: Sink> View<S> {
    /// A view into a sink.
    pub fn new(sink: S) -> Self {
        Self { sink, channels: HashMap::new(), anchors: BTreeMap::new() }
    }

    /// The sink.
    pub fn into_sink(self) -> S {
        self.sink
    }

    /// An anchor's position, metres. It is sent where it is new.
    ///
    /// # Errors
    /// The sink returns an error.
    pub fn anchor(&mut self, t_ns: u64, name: &str, position_m: [f64; 3]) -> Result<()> {
        if self.anchors.insert(name.to_owned(), position_m) == Some(position_m) {
            return Ok(());
        }
        self.send("/anchors", t_ns, &messages::anchors(t_ns, [(name, position_m)].into_iter()))
    }

    /// Sends all anchors again, for those who have come since.
    ///
    /// # Errors
    /// The sink returns an error.
    pub fn repeat_anchors(&mut self, t_ns: u64) -> Result<()> {
        let anchors = self.anchors.iter().map(|(name, position_m)| (name.as_str(), *position_m));
        let update = messages::anchors(t_ns, anchors);
        self.send("/anchors", t_ns, &update)
    }

    /// A position, or why there is none. `name` is the tag's, the method's, or both.
    ///
    /// # Errors
    /// The sink returns an error.
    pub fn position(&mut self, t_ns: u64, name: &str, estimate: &Estimate<'_>) -> Result<()> {
        self.send(&format!("/{name}/position"), t_ns, &estimate.message())?;
        let Some(place) = &estimate.place else { return Ok(()) };
        self.pose(t_ns, name, place)?;
        match messages::ellipsoid(t_ns, name, place, estimate.sigma_m) {
            Some(update) => self.send(&format!("/{name}/uncertainty"), t_ns, &update),
            None => Ok(()),
        }
    }

    /// A position alone.
    ///
    /// # Errors
    /// The sink returns an error.
    pub fn pose(&mut self, t_ns: u64, name: &str, place: &Coordinates) -> Result<()> {
        self.send(&format!("/{name}/pose"), t_ns, &messages::pose(t_ns, place))
    }

    /// A range; `tag` where it is known.
    ///
    /// # Errors
    /// The sink returns an error.
    pub fn range(&mut self, t_ns: u64, tag: Option<&str>, range: &RangeRow<'_>) -> Result<()> {
        let topic = tag.map_or_else(|| "/ranges".to_owned(), |tag| format!("/{tag}/ranges"));
        self.send(&topic, t_ns, &range.message())
    }

    /// A message of a node's telemetry. Those without a range or a position are left out.
    ///
    /// # Errors
    /// The sink returns an error.
    pub fn telemetry(&mut self, t_ns: u64, stamp: Stamp, message: &Message) -> Result<()> {
        match message {
            Message::Range(range) => {
                let anchor = Address(range.peer).to_string();
                if let Some(position_m) = range.position_m() {
                    self.anchor(t_ns, &anchor, position_m)?;
                }
                let epoch = stamp.epoch.to_string();
                let row =
                    RangeRow { t_s: stamp.t_s, epoch: &epoch, anchor: &anchor, range_m: range.distance_m(), los: None };
                self.range(t_ns, None, &row)
            }
            Message::Fix(fix) => {
                let place = fix.position_m().map(|[x_m, y_m, z_m]| Coordinates { x_m, y_m, z_m: Some(z_m) });
                // A configured height has no deviation.
                let sigma_m =
                    fix.deviation_m().map_or([None; 3], |[x, y, z]| [Some(x), Some(y), (z > 0.0).then_some(z)]);
                let reason = fix.reason().map(|reason| reason.as_str());
                let epoch = stamp.epoch.to_string();
                self.position(t_ns, TAG, &Estimate { t_s: stamp.t_s, epoch: &epoch, place, sigma_m, reason })
            }
            _ => Ok(()),
        }
    }

    /// A place on the earth: its covariance east-east, north-north and east-north, m², and the height's deviation.
    ///
    /// # Errors
    /// The sink returns an error.
    pub fn location(
        &mut self,
        t_ns: u64,
        name: &str,
        place: Geographic,
        covariance_m2: [f64; 3],
        sigma_z_m: Option<f64>,
    ) -> Result<()> {
        self.send(&format!("/{name}/location"), t_ns, &messages::location(t_ns, place, covariance_m2, sigma_z_m))
    }

    fn send<M: Encode>(&mut self, topic: &str, t_ns: u64, message: &M) -> Result<()>
    where
        M::Error: Send + Sync + 'static,
    {
        let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or(256));
        message.encode(&mut bytes).with_context(|| format!("cannot encode a message of {topic}"))?;
        if !self.channels.contains_key(topic) {
            let schema = M::get_schema().with_context(|| format!("{topic} has no schema"))?;
            let channel = self.sink.open(Topic { name: topic, encoding: M::get_message_encoding(), schema })?;
            self.channels.insert(topic.to_owned(), channel);
        }
        let channel = self.channels.get(topic).with_context(|| format!("{topic} is not open"))?;
        self.sink.put(channel, t_ns, &bytes)
    }
}
