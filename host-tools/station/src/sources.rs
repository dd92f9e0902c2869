//! The sources of telemetry, and how a person names them.

use std::fmt;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::thread;
use std::time::Duration;

use anyhow::{Result, bail};
use station_core::{SourceReport, Utc};

use super::NodeReporter;
use super::gateways::Admission;
use super::udp::{bind, listen};
use node_link::decode::{Pacing, Stamp, Stream, node_streams};
use node_link::monitor::{Event, Files, NodeChannel, Pace, Piped, Port, Serial, Source};
use node_link::recorder::STREAM;
use wire::telemetry::Message;

use crate::piped_probe::PipedProbe;

/// The longest wait for a source, so that the end of the program is seen.
pub(super) const PATIENCE: Duration = Duration::from_millis(100);

/// A source of telemetry.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SourceSpec {
    /// `probe` or `probe:VID:PID[:SERIAL]`: a node behind a debug probe.
    Probe(Option<String>),
    /// `serial:PORT[@BAUD]`: a node on a serial port.
    Serial(String, u32),
    /// `udp:ADDRESS:PORT`: datagrams of gateways with any number of nodes, or the bytes of one node's stream a sender.
    Udp(SocketAddr),
    /// `-`: standard input.
    Stdin,
    /// A path: a device is a serial port; a file or the folder of a recording is played at the pace of its times.
    File(PathBuf),
}

impl FromStr for SourceSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "-" {
            return Ok(Self::Stdin);
        }
        if text == "probe" {
            return Ok(Self::Probe(None));
        }
        if let Some(selector) = text.strip_prefix("probe:") {
            return Ok(Self::Probe(Some(selector.to_owned())));
        }
        if let Some(address) = text.strip_prefix("udp:") {
            let address =
                address.parse().map_err(|_| format!("{address:?} is not ADDRESS:PORT, such as 0.0.0.0:7000"))?;
            return Ok(Self::Udp(address));
        }
        if let Some(port) = text.strip_prefix("serial:") {
            let (port, baud) = match port.rsplit_once('@') {
                Some((port, baud)) => (port, baud.parse().ok().filter(|baud| *baud > 0)),
                None => (port, Some(Port::BAUD)),
            };
            let baud = baud.ok_or_else(|| format!("{text:?}: behind @ stands the number of bits a second"))?;
            return if port.is_empty() {
                Err("serial:PORT: the port is missing".into())
            } else {
                Ok(Self::Serial(port.into(), baud))
            };
        }
        let path = PathBuf::from(text);
        Ok(if is_device(&path) { Self::Serial(text.to_owned(), Port::BAUD) } else { Self::File(path) })
    }
}

impl fmt::Display for SourceSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Probe(None) => f.write_str("probe"),
            Self::Probe(Some(selector)) => write!(f, "probe:{selector}"),
            Self::Serial(port, _) => write!(f, "serial:{port}"),
            Self::Udp(address) => write!(f, "udp:{address}"),
            Self::Stdin => f.write_str("standard input"),
            Self::File(path) => path.display().fmt(f),
        }
    }
}

#[cfg(unix)]
fn is_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    path.metadata().is_ok_and(|metadata| metadata.file_type().is_char_device())
}

/// Only a port's name tells: `COM3`.
#[cfg(not(unix))]
fn is_device(path: &Path) -> bool {
    path.to_str().is_some_and(|name| name.starts_with("COM"))
}

/// Where reports go. It returns whether the station still takes them.
pub type ReportSender<'a> = &'a mut dyn FnMut(SourceReport) -> bool;

/// What the nodes of a source are to get: the next frame, if there is one now.
pub type Outgoing<'a> = &'a mut dyn FnMut() -> Option<Vec<u8>>;

/// A source that is ready: its file is open, and datagrams to it are received.
pub enum OpenSource {
    /// As in [`SourceSpec`].
    Probe(Option<String>),
    /// As in [`SourceSpec`].
    Serial(String, u32),
    /// The socket of the address.
    Udp(UdpSocket),
    /// As in [`SourceSpec`].
    Stdin,
    /// The file.
    File(Box<Files>),
}

impl OpenSource {
    /// Whether its nodes take messages: a file's and a pipe's do not.
    pub const fn takes_messages(&self) -> bool {
        match self {
            Self::Probe(_) | Self::Serial(..) | Self::Udp(_) => true,
            Self::Stdin | Self::File(_) => false,
        }
    }

    /// The name of a source that was opened as this says. Port 0 becomes the one that the system has chosen.
    pub fn name_of(&self, spec: &SourceSpec) -> String {
        match self {
            Self::Udp(socket) => {
                socket.local_addr().map_or_else(|_| spec.to_string(), |address| format!("udp:{address}"))
            }
            Self::Probe(_) | Self::Serial(..) | Self::Stdin | Self::File(_) => spec.to_string(),
        }
    }
}

impl SourceSpec {
    /// The sources that this names: one for each node of a simulation's folder.
    ///
    /// # Errors
    /// A file of the folder cannot be read.
    pub fn each(&self) -> Result<Vec<Self>> {
        match self {
            Self::File(path) => {
                let streams = node_streams(path)?.into_iter().map(|stream| stream.path);
                // The first tag's is called as the folder is.
                let named = streams.map(|stream| if stream == path.join(STREAM) { path.clone() } else { stream });
                Ok(named.map(Self::File).collect())
            }
            Self::Probe(_) | Self::Serial(..) | Self::Udp(_) | Self::Stdin => Ok(vec![self.clone()]),
        }
    }

    /// Opens what must be there before the station starts. Probes and serial ports may come later.
    ///
    /// # Errors
    /// A file cannot be opened, or the address of datagrams is in use.
    pub fn open(&self) -> Result<OpenSource> {
        Ok(match self {
            Self::Probe(probe) => OpenSource::Probe(probe.clone()),
            Self::Serial(port, baud) => OpenSource::Serial(port.clone(), *baud),
            Self::Udp(address) => OpenSource::Udp(bind(*address)?),
            Self::Stdin => OpenSource::Stdin,
            Self::File(path) => OpenSource::File(Box::new(Files::open(path, None)?)),
        })
    }
}

/// Reads a source until its end, or until the station ends. `note` takes messages for the user.
///
/// # Errors
/// The source cannot be read.
pub fn run(
    source: OpenSource,
    admission: &Admission,
    site: &str,
    (send, outgoing): (ReportSender<'_>, Outgoing<'_>),
    note: &mut dyn FnMut(&str),
) -> Result<()> {
    if let OpenSource::Udp(socket) = source {
        return listen(&socket, admission, site, (send, outgoing), note);
    }
    let mut reporter = NodeReporter::new(site);
    let mut take = |input: NodeInput| match input {
        NodeInput::Message(stamp, message) => reporter.reports(stamp, &message, Utc::now()).into_iter().all(&mut *send),
        NodeInput::Nothing | NodeInput::Lost => true,
    };
    read_node(source, &mut take, outgoing, note)
}

/// What comes of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NodeInput {
    /// A message.
    Message(Stamp, Message),
    /// Nothing for a moment.
    Nothing,
    /// The connection was lost: perhaps another node comes next.
    Lost,
}

/// Reads the one node of a source, until its end or until `take` returns false. A frame for which the node has no room is
/// lost: who sends it sends it again.
///
/// # Errors
/// The source cannot be read.
pub(super) fn read_node(
    source: OpenSource,
    take: &mut dyn FnMut(NodeInput) -> bool,
    outgoing: Outgoing<'_>,
    note: &mut dyn FnMut(&str),
) -> Result<()> {
    let mut read = |source: &mut dyn Source, pacing| read(source, pacing, take, outgoing, note);
    match source {
        OpenSource::Probe(probe) => read(&mut PipedProbe::start(probe.as_deref())?, None),
        OpenSource::Serial(name, baud) => {
            let port = Port { name: name.clone(), baud };
            read(&mut Serial::new(port, name, Pace::default()), None)
        }
        OpenSource::Stdin => read(&mut Piped::new(std::io::stdin()), None),
        OpenSource::File(mut files) => {
            let pacing = (!files.is_live()).then(|| Pacing::new(1.0));
            read(files.as_mut(), pacing)
        }
        OpenSource::Udp(_) => bail!("datagrams are of many nodes"),
    }
}

/// A recording has `pacing`.
fn read(
    source: &mut dyn Source,
    mut pacing: Option<Pacing>,
    take: &mut dyn FnMut(NodeInput) -> bool,
    outgoing: Outgoing<'_>,
    note: &mut dyn FnMut(&str),
) -> Result<()> {
    let mut stream = Stream::default();
    loop {
        while let Some(frame) = outgoing() {
            source.send(&frame);
        }
        match source.next(PATIENCE)? {
            Some(Event::Bytes(NodeChannel::Telemetry, bytes)) => {
                for byte in bytes {
                    let Some((stamp, message)) = stream.feed(byte) else { continue };
                    if let Some(wait) = pacing.as_mut().and_then(|pacing| pacing.until(stamp.t_s)) {
                        thread::sleep(wait);
                    }
                    if !take(NodeInput::Message(stamp, message)) {
                        return Ok(());
                    }
                }
            }
            Some(Event::Connected(to)) => note(&format!("connected to {to}")),
            Some(Event::Lost(why)) => {
                stream.interrupted();
                if !take(NodeInput::Lost) {
                    return Ok(());
                }
                note(&format!("connection lost ({why}); trying to connect again"));
            }
            Some(Event::Restarted) => stream.restarted(),
            Some(Event::Silent) => note("the chip has no RTT control block: is a baliza image flashed and running?"),
            Some(Event::Bytes(NodeChannel::Log, _) | Event::Text(_) | Event::Flashed { .. }) => {}
            Some(Event::End) => return Ok(()),
            None => {
                if !take(NodeInput::Nothing) {
                    return Ok(());
                }
            }
        }
    }
}
