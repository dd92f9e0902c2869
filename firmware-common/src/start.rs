//! The start of every node: it reports why it started and its identity, and derives [`Settings`] from its record.
//!
//! Input: what the board found at its start. Output: the record and the settings of the node's parts. Boards, QEMU and
//! the simulation all start this way.

use embassy_sync::blocking_mutex::raw::RawMutex;
use wire::config::{LoadError, Record};
use wire::telemetry::{Board, Condition, Crash, Hello, Reset, ResetCause, Role};

use crate::settings::Cipher;
use crate::{Reporter, Settings, build, settings};

/// What a node finds when it starts.
pub struct Start {
    /// The config record from flash.
    pub record: Result<Record, LoadError>,
    /// The chip's own EUI-64.
    pub eui: u64,
    /// Why the node started.
    pub reset: ResetCause,
    /// The crash report of the run before, if there is one.
    pub crash: Option<Crash>,
    /// What the board has for frames with a key.
    pub cipher: Cipher,
}

/// Reports why the node started, its identity and, if so, why its record cannot be used. The node sends a hello in any
/// case.
pub fn introduce<M: RawMutex, const BYTES: usize, C: Fn() -> u64>(
    reporter: &Reporter<M, BYTES, C>,
    board: Board,
    role: Role,
    start: Start,
) -> (Hello, Option<(Record, Settings)>) {
    let Start { record, eui, reset, crash, cipher } = start;
    let t_us = reporter.now_us();
    reporter.event_log.log(Reset { t_us, cause: reset, crash });
    let followed =
        record.and_then(|record| Ok((Settings::of(&record, eui, cipher).map_err(LoadError::Invalid)?, record)));
    let (eui, address) = followed.as_ref().map_or((eui, 0xFFFF), |(settings, _)| (settings.eui, settings.address));
    let keyed = followed.as_ref().is_ok_and(|(settings, _)| settings.network.key.is_some());
    let hello = Hello { t_us, eui, address, role, board, build: *build::BUILD, keyed };
    reporter.event_log.log(hello);
    match followed {
        Ok((settings, record)) => (hello, Some((record, settings))),
        Err(fault) => {
            // Telemetry has the kind of the fault, the log has the details.
            #[cfg(feature = "defmt")]
            if let LoadError::Invalid(what) = &fault {
                defmt::error!("{}", what);
            }
            reporter.event_log.state(t_us, Condition::NoRecord(settings::told(&fault)));
            (hello, None)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use embassy_sync::blocking_mutex::raw::NoopRawMutex;
    use wire::telemetry::{Decoder, Message, RecordError, State};

    use super::*;

    #[test]
    fn a_node_without_a_record_greets_by_its_chip_and_says_what_is_missing() {
        let reporter = Reporter::<NoopRawMutex, 512>::new(|| 7);
        let cipher = Cipher { seed: 1, make_code: wire::uwb::native::software_code };
        let start =
            Start { record: Err(LoadError::Missing), eui: 0x1234, reset: ResetCause::Watchdog, crash: None, cipher };
        let (hello, followed) = introduce(&reporter, Board::Simulated, Role::Anchor, start);
        assert!(followed.is_none());
        assert_eq!((hello.eui, hello.address, hello.role), (0x1234, 0xFFFF, Role::Anchor));
        let (mut decoder, mut messages) = (Decoder::new(), Vec::new());
        reporter.event_log.drain(|frame| {
            messages.extend(frame.iter().filter_map(|byte| decoder.feed(*byte)).map(Result::unwrap));
            true
        });
        let reset = Message::Reset(Reset { t_us: 7, cause: ResetCause::Watchdog, crash: None });
        let state = Message::State(State { t_us: 7, is: Condition::NoRecord(RecordError::Missing) });
        assert_eq!(messages, [reset, Message::Hello(hello), state]);
    }
}
