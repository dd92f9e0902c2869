//! What the driver's operations put on the bus: transactions and bytes of each.

/// The driver's transactions and bytes on the bus, without the frame's bytes (`baliza_dw1000::driver`, "What goes over the
/// bus"), for sending at once and at an instant: what must be written before the frame can leave, and what follows when
/// it has left. For sending at an instant, also what is read while the frame leaves.
pub(super) const LOAD_NOW: (u64, usize) = (2, 3);
pub(super) const LOAD_AT: (u64, usize) = (3, 9);
pub(super) const ARMED: (u64, usize) = (2, 9);
pub(super) const SENT_NOW: (u64, usize) = (3, 10);
pub(super) const SENT_AT: (u64, usize) = (2, 4);
/// The same for receiving: switching the receiver on, with another wait in the chip's timer; for a frame, what precedes
/// switching the receiver on again, the switching on, and the rest; the end of a window.
pub(super) const LISTEN: (u64, usize) = (2, 6);
pub(super) const FRAME_SEEN: (u64, usize) = (2, 13);
pub(super) const LISTEN_AGAIN: (u64, usize) = (1, 3);
pub(super) const FRAME_READ: (u64, usize) = (6, 31);
pub(super) const WINDOW_OVER: (u64, usize) = (4, 17);
/// The same for switching off a receiver that listens: by itself, before a frame that is sent at once, and before a
/// frame that is sent at an instant.
pub(super) const STOP: (u64, usize) = (2, 7);
pub(super) const STOP_AND_SEND: (u64, usize) = (2, 8);
pub(super) const STOP_AND_SEND_AT: (u64, usize) = (1, 2);
/// The same for reading the chip's clock.
pub(super) const CLOCK: (u64, usize) = (1, 6);
