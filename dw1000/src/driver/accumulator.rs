//! The channel impulse response of the last frame, as the receiver accumulated it (DW1000 user manual, 7.2.38).
//!
//! The chip has two receive buffers but one accumulator: it holds the last frame's response until the receiver is on
//! again. For reading, its clocks are forced on, and afterwards back: four transactions with 10 bytes. 152 samples take
//! five more transactions, each with a header of three bytes and a dummy byte: 628 bytes. The 638 bytes take 0.64 ms on
//! a bus at 8 MHz, or 0.26 ms at 20 MHz, plus a board's overhead for each transaction.

use embedded_hal_async::{delay::DelayNs, digital::Wait};

use super::bus::{ClockedSpi, ResetLine};
use super::register as reg;
use super::startup::{CLOCK_SEQUENCED, CLOCKS_DEFAULT};
use super::{Dw1000, Error, Transceiver, configuration};
use radio::{ResponseWindow, Sample};

/// PMSC_CTRL0 for reading the accumulator: its clock forced on (FACE), the receiver's clock from the PLL; its memory's
/// clock on (AMCE).
const CLOCK_ACCUMULATOR: u8 = 0x48;
const CLOCK_ACCUMULATOR_MEMORY: u8 = 0x80;
/// Samples in a transaction: as many as the bus's buffer holds, with four bytes of header and dummy each.
const CHUNK: usize = 32;

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    /// Passes the samples of a window to `take`. Near the ends of the accumulator (992 or 1016 samples) the window is
    /// moved inside. Returns the index of its first sample. The receiver must have been off since the frame.
    pub(super) async fn read_accumulator(
        &mut self,
        window: ResponseWindow,
        mut take: impl FnMut(Sample),
    ) -> Result<u16, Error<S::Error>> {
        let all = configuration::accumulator_samples(&self.config);
        let length = window.count.min(all);
        let start = (window.first_path_index as u16).saturating_sub(window.before).min(all - length);

        self.transceiver = Transceiver::Unknown;
        let [low, high] = [CLOCK_ACCUMULATOR, CLOCK_ACCUMULATOR_MEMORY | CLOCKS_DEFAULT];
        self.set_clocks(low, high).await?;
        let (mut at, mut left) = (reg::ACC_MEM.plus(4 * start), usize::from(length));
        while left > 0 {
            let samples = left.min(CHUNK);
            // The first byte is a dummy, wherever the reading starts.
            let bytes = self.bus.read_slice(at, 1 + 4 * samples).await?;
            for [i0, i1, q0, q1] in bytes[1..].as_chunks::<4>().0 {
                take(Sample { i: i16::from_le_bytes([*i0, *i1]), q: i16::from_le_bytes([*q0, *q1]) });
            }
            at = at.plus(4 * samples as u16);
            left -= samples;
        }
        self.set_clocks(CLOCK_SEQUENCED, CLOCKS_DEFAULT).await?;
        self.transceiver = Transceiver::Off;
        Ok(start)
    }
}
