//! The serial port: built-in USB where a host is on it, else UART0 at 115,200 bit/s.
//!
//! Log and telemetry share the port. A log line goes out as `espflash monitor --log-format defmt` wants it, FF 00 before
//! defmt's own bytes, which end in 00; a frame of telemetry as it is, ended by 00 as well. Each is written whole or not at all
//! into a queue, which a task of the main thread empties: what follows a 00 is a log line if it begins with FF 00, which no frame
//! does.

use core::cell::RefCell;

use critical_section::{Mutex, RestoreState};
use embassy_executor::Spawner;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::Write;

use port::Opened;
pub use port::Port;

use crate::frames::Frames;

mod port;

/// Bytes that wait for the port.
const QUEUE: usize = 2048;
/// Bytes that go to the port at once: a packet of USB.
const PACKET: usize = 64;

struct Shared {
    frames: Frames<QUEUE>,
    encoder: defmt::Encoder,
    /// A log line is being written, and the critical section held since.
    section: Option<RestoreState>,
}

/// No other is called so: `_baliza_serial_log` tells that this image's log is on the serial port.
#[unsafe(export_name = "_baliza_serial_log")]
static SHARED: Mutex<RefCell<Shared>> =
    Mutex::new(RefCell::new(Shared { frames: Frames::new(), encoder: defmt::Encoder::new(), section: None }));
static NEWS: Signal<CriticalSectionRawMutex, ()> = Signal::new();

#[defmt::global_logger]
struct Logger;

// SAFETY: from `acquire` to `release` the critical section is held.
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

/// Frames of telemetry, between the lines of the log.
pub struct TelemetryChannel(());

impl TelemetryChannel {
    /// Writes a whole frame, or nothing where it has no room now.
    pub fn write(&mut self, frame: &[u8]) -> bool {
        let written = with(|shared| {
            shared.frames.write(frame);
            shared.frames.end()
        });
        NEWS.signal(());
        written
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
        Opened::Usb(usb) => empty_into(usb).await,
        Opened::Uart(uart) => empty_into(uart).await,
    }
}

async fn empty_into(mut port: impl Write) {
    let mut packet = [0; PACKET];
    loop {
        let taken = with(|shared| shared.frames.take(&mut packet));
        match packet.get(..taken) {
            None | Some([]) => NEWS.wait().await,
            // What a port has lost, it has lost: the host finds its way at the next 00.
            Some(bytes) => drop(port.write_all(bytes).await),
        }
    }
}
