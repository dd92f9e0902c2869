//! The serial port: built-in USB if a host is connected to it, else UART0 at 115,200 bit/s.
//!
//! Log and telemetry share the port. A log line is sent in the format of `espflash monitor --log-format defmt`: FF 00,
//! then defmt's own bytes, which end in 00. A frame of telemetry is sent unchanged, and ends in 00 as well. Each is
//! written whole or not at all into a queue, which a task of the main thread empties. The bytes after a 00 are a log
//! line if they begin with FF 00. No frame begins so.

use core::cell::RefCell;

use critical_section::{Mutex, RestoreState};
use embassy_executor::Spawner;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::Write;
use firmware_common::HostChannel;

use port::Opened;
pub use port::Port;

use crate::frames::Frames;

mod port;

/// The capacity of the queue, bytes.
const QUEUE: usize = 2048;
/// The bytes that go to the port at once: a packet of USB.
const PACKET: usize = 64;

struct Shared {
    frames: Frames<QUEUE>,
    /// A host has read all frames of telemetry.
    is_read: bool,
    encoder: defmt::Encoder,
    /// Set while a log line is being written: the critical section is then held.
    section: Option<RestoreState>,
}

/// No other symbol has this name: `_baliza_serial_log` shows that this image's log is on the serial port.
#[unsafe(export_name = "_baliza_serial_log")]
static SHARED: Mutex<RefCell<Shared>> = Mutex::new(RefCell::new(Shared {
    frames: Frames::new(),
    is_read: false,
    encoder: defmt::Encoder::new(),
    section: None,
}));
static NEWS: Signal<CriticalSectionRawMutex, ()> = Signal::new();

#[defmt::global_logger]
struct Logger;

// SAFETY: the critical section is held from `acquire` to `release`.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: released in `release`.
        let section = unsafe { critical_section::acquire() };
        with(|shared| {
            assert!(shared.section.is_none(), "a log line within a log line");
            shared.section = Some(section);
            shared.frames.write(&[0xFF, 0x00]);
            shared.encoder.start_frame(|bytes| shared.frames.write(bytes));
        });
    }

    unsafe fn write(bytes: &[u8]) {
        with(|shared| shared.encoder.write(bytes, |bytes| shared.frames.write(bytes)));
    }

    unsafe fn flush() {}

    unsafe fn release() {
        let section = with(|shared| {
            shared.encoder.end_frame(|bytes| shared.frames.write(bytes));
            shared.frames.end();
            shared.section.take()
        });
        NEWS.signal(());
        if let Some(section) = section {
            // SAFETY: acquired in `acquire`.
            unsafe { critical_section::release(section) };
        }
    }
}

fn with<T>(f: impl FnOnce(&mut Shared) -> T) -> T {
    critical_section::with(|section| f(&mut SHARED.borrow_ref_mut(section)))
}

/// The channel of telemetry: frames between the lines of the log.
pub struct TelemetryChannel(());

impl HostChannel for TelemetryChannel {
    fn write(&mut self, frame: &[u8]) -> bool {
        let written = with(|shared| {
            shared.is_read = false;
            shared.frames.write(frame);
            shared.frames.end()
        });
        NEWS.signal(());
        written
    }

    fn is_read(&self) -> bool {
        with(|shared| shared.is_read)
    }

    fn read(&mut self, into: &mut [u8]) -> usize {
        let received = into.iter_mut().zip(core::iter::from_fn(port::received));
        received.map(|(place, byte)| *place = byte).count()
    }
}

/// Starts the task that empties the queue.
pub fn start(spawner: Spawner, port: Port) -> TelemetryChannel {
    match empty(port) {
        Ok(task) => spawner.spawn(task),
        Err(_) => unreachable!("a board is taken once"),
    }
    TelemetryChannel(())
}

#[embassy_executor::task]
async fn empty(port: Port) {
    match port.open().await {
        #[cfg(not(feature = "esp32"))]
        // USB takes a packet after the host has read the one before. Nobody knows who reads a UART.
        Opened::Usb(usb) => empty_into(usb, true).await,
        Opened::Uart(uart) => empty_into(uart, false).await,
    }
}

async fn empty_into(mut port: impl Write, shows_reader: bool) {
    let mut packet = [0; PACKET];
    loop {
        let taken = with(|shared| {
            let taken = shared.frames.take(&mut packet);
            shared.is_read |= shows_reader && taken == 0;
            taken
        });
        match packet.get(..taken) {
            None | Some([]) => NEWS.wait().await,
            // Bytes that the port loses are not repeated: the host resynchronises at the next 00.
            Some(bytes) => drop(port.write_all(bytes).await),
        }
    }
}
