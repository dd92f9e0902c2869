//! The LIS2DH12 as a motion sensor. It is configured once. Afterwards its line INT1 is high while it is accelerated,
//! and its bus is silent.
//!
//! The registers' names are those of the driver (`lis2dh`). Their functions are described in the data sheet
//! (DocID025056) and in AN5005. The sensor runs in low-power mode, 10 Hz, ± 2 g: samples of 8 bits, 16 mg each, at 3
//! µA. A high-pass filter of 0.08 Hz (HPCF 01 at 10 Hz) removes gravity: a push of two seconds passes the filter, and a
//! change of orientation has an effect for some seconds. The first interrupt generator compares each axis with the
//! threshold. One sample above it is enough. Nothing is latched, so that no register has to be read.

use core::future::pending;

use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::i2c::I2c;
use lis2dh::{FullScale, HighPassCutoffFrequencySelection, Lis2dh, OutputDataRate, Register};

use super::{MotionSensor, MotionSensorError};

pub use lis2dh::Sa0Pad;

/// WHO_AM_I.
const IDENTITY: u8 = 0x33;
/// In units of 16 mg, at ± 2 g. At rest a filtered sample is at most two units off: one step of quantisation up, one
/// down, and noise of some mg between. A person who picks something up, or walks with it, accelerates it by 100 mg and
/// more. A trolley that is pushed off by 1 m/s² at most is at the limit, and its wheels shake it, too.
const THRESHOLD: u8 = 3;
/// CTRL_REG1: LPen, and Xen, Yen, Zen.
const LOW_POWER: u8 = 1 << 3;
const ALL_AXES: u8 = 0b111;
/// CTRL_REG2: HP_IA1.
const FILTERED: u8 = 1 << 0;
/// CTRL_REG3: I1_IA1.
const INT1_BY_GENERATOR: u8 = 1 << 6;
/// INT1_CFG: XHIE, YHIE, ZHIE, any of them.
const ANY_HIGH: u8 = 0b10_1010;
/// All registers that matter, written whole. The driver's own operations change bits one after the other, which takes 5
/// kB more of an image, and its operation for the filter never clears a bit. Meanwhile the generator is off and the
/// sensor is powered down, so that the filter starts anew.
const SET_UP: [(Register, u8); 10] = [
    (Register::Int1Cfg, 0),
    (Register::CtrlReg3, INT1_BY_GENERATOR),
    (Register::CtrlReg1, OutputDataRate::PowerDown as u8),
    (Register::CtrlReg2, HighPassCutoffFrequencySelection::Cfg1 as u8 | FILTERED),
    (Register::CtrlReg4, FullScale::Fs2g as u8),
    // FIFO and latch are off.
    (Register::CtrlReg5, 0),
    // Active high.
    (Register::CtrlReg6, 0),
    (Register::Int1Ths, THRESHOLD),
    (Register::Int1Duration, 0),
    (Register::CtrlReg1, OutputDataRate::Hz10 as u8 | LOW_POWER | ALL_AXES),
];
/// After power-on the sensor reads its calibration for 5 ms.
const BOOT_MS: u32 = 10;
/// The time until the first samples are ready: two periods of 100 ms.
const SETTLING_MS: u32 = 200;

/// The sensor of a board: its bus, which is dropped after the set-up, and its line INT1.
pub struct Lis2dh12<B, P, D> {
    bus: Option<B>,
    address: Sa0Pad,
    int1: P,
    delay: D,
}

impl<B, P, D> Lis2dh12<B, P, D> {
    /// A sensor behind `bus`, which is dropped as soon as the sensor is set up.
    pub const fn new(bus: B, address: Sa0Pad, int1: P, delay: D) -> Self {
        Self { bus: Some(bus), address, int1, delay }
    }
}

impl<B: I2c, P: Wait, D: DelayNs> MotionSensor for Lis2dh12<B, P, D> {
    async fn start(&mut self) -> Result<(), MotionSensorError> {
        match self.bus.take() {
            Some(bus) => set_up(bus, self.address, &mut self.delay).await,
            None => Err(MotionSensorError::Silent),
        }
    }

    async fn moved(&mut self) {
        if self.int1.wait_for_high().await.is_err() {
            pending().await
        }
    }
}

/// Sets the sensor up, whatever its state: a reset of the processor leaves the sensor's registers unchanged.
///
/// # Errors
/// The sensor does not answer, or another device answers.
async fn set_up<B: I2c>(bus: B, address: Sa0Pad, delay: &mut impl DelayNs) -> Result<(), MotionSensorError> {
    delay.delay_ms(BOOT_MS).await;
    let mut sensor = Lis2dh::new(bus, address);
    match sensor.get_device_id().await {
        Ok(IDENTITY) => configure(&mut sensor, delay).await.map_err(|_| MotionSensorError::Silent),
        Ok(_) => Err(MotionSensorError::Foreign),
        Err(_) => Err(MotionSensorError::Silent),
    }
}

async fn configure<B: I2c>(sensor: &mut Lis2dh<B>, delay: &mut impl DelayNs) -> Result<(), lis2dh::Error<B::Error>> {
    for (register, value) in SET_UP {
        sensor.write_register(register, value).await?;
    }
    delay.delay_ms(SETTLING_MS).await;
    // This read makes the filter start from gravity.
    sensor.read_register(Register::Reference).await?;
    sensor.write_register(Register::Int1Cfg, ANY_HIGH).await
}
