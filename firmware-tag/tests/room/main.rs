//! The complete program of a tag, from its record to telemetry, in the small air's room: six anchors, and two per cent
//! of the receptions are lost.

mod doze;
mod pace;
mod walk;

use std::sync::{Mutex, PoisonError};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_common::Reporter;
use firmware_tag::TaskChannels;
use firmware_tag::simulated::{self, TagIn};
use small_air::uptime_us;
use wire::config::Record;
use wire::telemetry::{Decoder, Message};

/// What a tag reports in `life_us` microseconds, and how often its radio sleeps.
fn live(record: Record, life_us: u64, tag_in: TagIn) -> (Vec<Message>, u32) {
    /// One run at a time: the world's clock is global to the program.
    static CLOCK: Mutex<()> = Mutex::new(());
    let _clock = CLOCK.lock().unwrap_or_else(PoisonError::into_inner);
    let (channels, reporter) = (TaskChannels::new(), Reporter::<NoopRawMutex, 4096>::new(uptime_us));
    let (mut decoder, mut told) = (Decoder::new(), Vec::new());
    let life = simulated::live(Ok(record), life_us, tag_in, (&channels, &reporter), || {
        reporter.event_log.drain(|frame| {
            told.extend(frame.iter().filter_map(|byte| decoder.feed(*byte)).map(|message| message.unwrap()));
            true
        });
    });
    (told, life.expect("the record can be followed").naps)
}
