//! The channel impulse response of the last frame, as the receiver accumulated it (DW1000 user manual, 7.2.38).

use embedded_hal_async::{delay::DelayNs, digital::Wait};

use super::bus::{ClockedSpi, ResetLine};
use super::register as reg;
use super::startup::{CLOCK_SEQUENCED, CLOCKS_DEFAULT};
use super::{Dw1000, Error, Transceiver};

/// PMSC_CTRL0 that lets the accumulator be read: its clock forced on (FACE), the receiver's clock from the PLL; its
/// memory's clock on (AMCE).
const CLOCK_ACCUMULATOR: u8 = 0x48;
const CLOCK_ACCUMULATOR_MEMORY: u8 = 0x80;
/// Samples in a transaction: a buffer on the stack, against four bytes of header and dummy each.
const CHUNK: usize = 32;

/// One complex sample of the accumulator; samples are 1.0016 ns apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sample {
    /// Real part.
    pub i: i16,
    /// Imaginary part.
    pub q: i16,
}

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    /// Fills `window` with samples, the first of them `before` samples ahead of the sample of the first path, whose
    /// index is in the frame's diagnostics. Near the ends of the accumulator the window is moved inside; the index of
    /// its first sample is returned. Samples that the accumulator (992 or 1016 of them) does not have are zero.
    ///
    /// The receiver must be off since the frame: received without `keep_listening`.
    pub async fn impulse_response(
        &mut self,
        first_path_index: f32,
        before: u16,
        window: &mut [Sample],
    ) -> Result<u16, Error<S::Error>> {
        match self.transceiver {
            Transceiver::Off => {}
            Transceiver::Listening | Transceiver::Unknown => return Err(Error::ReceiverOn),
            Transceiver::NotReady => return Err(Error::NotReady),
        }
        let all = self.config.accumulator_samples();
        let length = u16::try_from(window.len()).unwrap_or(all).min(all);
        let start = (first_path_index as u16).saturating_sub(before).min(all - length);
        window.fill(Sample::default());

        self.transceiver = Transceiver::Unknown;
        let [low, high] = [CLOCK_ACCUMULATOR, CLOCK_ACCUMULATOR_MEMORY | CLOCKS_DEFAULT];
        self.set_clocks(low, high).await?;
        let mut at = reg::ACC_MEM.plus(4 * start);
        for samples in window[..usize::from(length)].chunks_mut(CHUNK) {
            // The first byte is of no meaning, wherever the reading starts.
            let mut bytes = [0; 1 + 4 * CHUNK];
            let bytes = &mut bytes[..1 + 4 * samples.len()];
            self.bus.read_into(at, bytes).await?;
            for (sample, [i0, i1, q0, q1]) in samples.iter_mut().zip(bytes[1..].as_chunks::<4>().0) {
                *sample = Sample { i: i16::from_le_bytes([*i0, *i1]), q: i16::from_le_bytes([*q0, *q1]) };
            }
            at = at.plus(4 * samples.len() as u16);
        }
        self.set_clocks(CLOCK_SEQUENCED, CLOCKS_DEFAULT).await?;
        self.transceiver = Transceiver::Off;
        Ok(start)
    }
}
