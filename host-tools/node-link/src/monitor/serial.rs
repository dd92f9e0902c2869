//! The source for a serial port, whose mixture [`Demux`] separates. A port that disappears (a cable, a board that
//! resets its own USB) is opened again.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};

use super::demux::Demux;
use super::source::{Event, Pace, Retry, Source};
use recording::UserError;

/// An open port.
pub trait Connection: Read + Write {}

impl<T: Read + Write + ?Sized> Connection for T {}

/// Opens a port.
pub trait Open {
    /// Opens the port. Its reads end with [`ErrorKind::TimedOut`] after a few milliseconds without bytes.
    ///
    /// # Errors
    /// The port does not exist or cannot be opened. The error is one sentence that says what to do.
    fn open(&mut self) -> Result<Box<dyn Connection>>;
}

/// A serial port by name.
#[derive(Clone, Debug)]
pub struct Port {
    /// `/dev/ttyACM0`, `COM3`.
    pub name: String,
    /// The baud rate, bits per second.
    pub baud: u32,
}

impl Port {
    /// The baud rate where none is given, bits per second.
    pub const BAUD: u32 = 115_200;
}

/// A read returns after this time without bytes.
const READ: Duration = Duration::from_millis(10);

impl Open for Port {
    fn open(&mut self) -> Result<Box<dyn Connection>> {
        let Self { name, baud } = self;
        match serialport::new(name.as_str(), *baud).timeout(READ).open() {
            Ok(port) => Ok(Box::new(port)),
            Err(error) => Err(refused(name, error)),
        }
    }
}

/// The serial ports of this computer, as `--serial` names them.
pub fn ports() -> Vec<String> {
    let mut ports: Vec<_> = serialport::available_ports().unwrap_or_default();
    ports.sort_by(|a, b| a.port_name.cmp(&b.port_name));
    ports.into_iter().map(|port| port.port_name).collect()
}

/// The error of a port that does not exist.
pub fn no_port(name: &str) -> UserError {
    let others = ports();
    let there = if others.is_empty() { "there is none".into() } else { format!("there are {}", others.join(", ")) };
    UserError::flag("--serial", format!("no port {name}: plug in the board with a cable for data; {there}"))
}

fn refused(name: &str, error: serialport::Error) -> anyhow::Error {
    use serialport::ErrorKind as Kind;
    match error.kind() {
        Kind::NoDevice | Kind::Io(ErrorKind::NotFound) if std::fs::metadata(name).is_err() => no_port(name).into(),
        Kind::Io(ErrorKind::PermissionDenied) => {
            anyhow!("no permission to open {name}: on Linux `sudo usermod -aG dialout $USER` and a new login give it")
        }
        Kind::NoDevice => anyhow::Error::new(error)
            .context(format!("{name} is in use by another program (espflash, minicom?): end that one")),
        // The system has no settings of a serial line for it.
        Kind::Io(_) | Kind::Unknown if error.description == "Not a typewriter" => {
            UserError::flag("--serial", format!("{name} is not a serial port")).into()
        }
        Kind::InvalidInput | Kind::Io(_) | Kind::Unknown => {
            anyhow::Error::new(error).context(format!("cannot open {name}"))
        }
    }
}

enum State {
    New,
    Open(Box<dyn Connection>),
    Lost(Retry),
}

/// A serial port, as a source.
pub struct Serial<O> {
    port: O,
    name: String,
    demux: Demux,
    state: State,
    pace: Pace,
    ready: VecDeque<Event>,
}

impl<O: Open> Serial<O> {
    /// A source for a port, which messages call `name`.
    pub fn new(port: O, name: String, pace: Pace) -> Self {
        Self { port, name, demux: Demux::default(), state: State::New, pace, ready: VecDeque::new() }
    }

    fn step(&mut self) -> Result<()> {
        self.state = match std::mem::replace(&mut self.state, State::New) {
            State::New => {
                let port = self.port.open()?;
                self.ready.push_back(Event::Connected(self.name.clone()));
                State::Open(port)
            }
            State::Lost(retry) if !retry.is_due() => State::Lost(retry),
            State::Lost(retry) => match self.port.open() {
                Ok(port) => {
                    self.ready.push_back(Event::Connected(self.name.clone()));
                    State::Open(port)
                }
                Err(_) => State::Lost(retry.next(&self.pace)),
            },
            State::Open(mut port) => {
                let mut bytes = [0; 4096];
                match port.read(&mut bytes) {
                    // The other end of the terminal is closed.
                    Ok(0) => self.lose("it is gone"),
                    Ok(count) => {
                        self.ready.extend(self.demux.feed(bytes.get(..count).unwrap_or_default()));
                        State::Open(port)
                    }
                    Err(error)
                        if matches!(
                            error.kind(),
                            ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock
                        ) =>
                    {
                        State::Open(port)
                    }
                    Err(error) => self.lose(&error.to_string()),
                }
            }
        };
        Ok(())
    }

    fn lose(&mut self, why: &str) -> State {
        self.ready.extend(self.demux.finish());
        self.ready.push_back(Event::Lost(why.to_owned()));
        State::Lost(Retry::first(&self.pace))
    }
}

impl<O: Open> Source for Serial<O> {
    fn next(&mut self, patience: Duration) -> Result<Option<Event>> {
        let begun = Instant::now();
        loop {
            if let Some(event) = self.ready.pop_front() {
                return Ok(Some(event));
            }
            self.step()?;
            let left = patience.saturating_sub(begun.elapsed());
            if self.ready.is_empty() {
                if left.is_zero() {
                    return Ok(None);
                }
                if matches!(self.state, State::Lost(_)) {
                    sleep(left.min(READ));
                }
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> bool {
        let State::Open(port) = &mut self.state else { return false };
        port.write_all(bytes).and_then(|()| port.flush()).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::VecDeque;
    use std::io::{self, ErrorKind, Read, Write};
    use std::rc::Rc;
    use std::time::Duration;

    use anyhow::{Result, anyhow};

    use super::super::source::{Event, NodeChannel, Pace, Source};
    use super::super::testing::{fix, frame, telemetry_frame};
    use super::{Connection, Open, Port, Serial};

    const PACE: Pace = Pace {
        poll: Duration::from_millis(1),
        retry: Duration::from_millis(1),
        longest: Duration::from_millis(2),
        silent: Duration::from_millis(20),
    };

    /// A simulated cable: what each opening gives, and what its reads give. `None`: the port does not exist.
    struct Cable(VecDeque<Option<Vec<Given>>>, Written);

    type Given = Result<Vec<u8>, ErrorKind>;

    /// What was written to the port.
    type Written = Rc<RefCell<Vec<u8>>>;

    struct Opened {
        reads: VecDeque<Given>,
        written: Written,
    }

    impl Open for Cable {
        fn open(&mut self) -> Result<Box<dyn Connection>> {
            let reads = self.0.pop_front().flatten().ok_or_else(|| anyhow!("no port"))?;
            Ok(Box::new(Opened { reads: reads.into(), written: self.1.clone() }))
        }
    }

    impl Cable {
        fn new(openings: impl Into<VecDeque<Option<Vec<Given>>>>) -> Self {
            Self(openings.into(), Written::default())
        }
    }

    impl Write for Opened {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.written.borrow_mut().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Read for Opened {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            let read = self.reads.pop_front().unwrap_or(Err(ErrorKind::TimedOut)).map_err(io::Error::from)?;
            bytes[..read.len()].copy_from_slice(&read);
            Ok(read.len())
        }
    }

    #[test]
    fn a_port_that_goes_away_is_opened_again() {
        let (line, place) = (frame(1, 5, &[1]), telemetry_frame(&fix(6, 3.21)));
        let mixture = [&[0xFF, 0], &line[..], &place, &place[..9]].concat();
        let cable = Cable::new([
            Some(vec![Ok(mixture), Err(ErrorKind::TimedOut), Err(ErrorKind::BrokenPipe)]),
            None,
            None,
            Some(vec![Ok(place.clone())]),
        ]);
        let mut source = Serial::new(cable, "port".into(), PACE);
        let mut events = Vec::new();
        while events.last() != Some(&Event::Bytes(NodeChannel::Telemetry, place.clone())) || events.len() < 5 {
            events.extend(source.next(Duration::from_millis(50)).expect("no failure"));
        }
        let torn = Event::Bytes(NodeChannel::Telemetry, place[..9].to_vec());
        let lost = Event::Lost(io::Error::from(ErrorKind::BrokenPipe).to_string());
        let place = Event::Bytes(NodeChannel::Telemetry, place);
        let connected = Event::Connected("port".into());
        assert_eq!(
            events,
            [connected.clone(), Event::Bytes(NodeChannel::Log, line), place.clone(), torn, lost, connected, place]
        );
    }

    #[test]
    fn bytes_go_to_the_node_while_it_is_connected() {
        let cable = Cable::new([Some(vec![Err(ErrorKind::TimedOut), Err(ErrorKind::BrokenPipe)])]);
        let written = cable.1.clone();
        let mut source = Serial::new(cable, "port".into(), PACE);
        assert!(!source.send(b"too early"));
        assert_eq!(source.next(Duration::ZERO).expect("no failure"), Some(Event::Connected("port".into())));
        assert!(source.send(b"now"));
        while !matches!(source.next(Duration::from_millis(20)).expect("no failure"), Some(Event::Lost(_))) {}
        assert!(!source.send(b"too late"));
        assert_eq!(*written.borrow(), b"now");
    }

    #[test]
    fn a_port_that_is_not_there_at_the_start_is_a_failure() {
        let mut source = Serial::new(Cable::new([]), "port".into(), PACE);
        assert!(source.next(Duration::ZERO).is_err());
        let port = Port { name: "/dev/nosuch".into(), baud: Port::BAUD };
        let error =
            Serial::new(port, "/dev/nosuch".into(), PACE).next(Duration::ZERO).expect_err("there is no such port");
        let wrong = error.downcast_ref::<recording::UserError>().expect("the argument is wrong").to_string();
        assert!(wrong.starts_with("--serial: no port /dev/nosuch: plug in the board"), "{wrong}");
    }
}
