//! Boards: what their processors, buses, interrupts and timers take, and what current they draw.
//!
//! **None of these figures was measured on a board.** Clocks, bus clocks and currents are those of the data sheets. Cycles an
//! instruction are estimates from published benchmarks and the memories' wait states, as told at each board. Instructions of drivers
//! and interrupt handlers are counted where they could be (a firmware's own are its simulation's to count, see
//! [`Processor::charge`](crate::Processor::charge)), or read off the disassembly; where they are guessed, the comment says so.
//! A simulation that is to be believed is run a second time with [`BoardProfile::slowed`] by two.

use std::time::Duration;

/// A kind of processor, as compilers know it: by it counts of instructions are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Core {
    /// Armv7E-M with single-precision FPU.
    CortexM4F,
    /// Armv7-M without FPU.
    CortexM3,
    /// RV32IMC without FPU; RV32IMAC counts as the same.
    RiscV32,
}

/// A board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardProfile {
    /// Its name on command lines and in files.
    pub name: &'static str,
    /// Its kind of processor.
    pub core: Core,
    /// The processor's clock, Hz.
    pub clock_hz: u32,
    /// Mean cycles an instruction, waits for flash included. Zero: instructions take no time.
    pub cycles_per_instruction: f64,
    /// All costs of the processor and of setting things up are multiplied by this; the bytes on the bus are not.
    pub slowdown: f64,
    /// SPI clock until the application changes it, Hz.
    pub spi_hz: u32,
    /// SPI clock once the chip's PLL has locked, Hz: as fast as board and chip go.
    pub spi_fast_hz: u32,
    /// Instructions around a transaction: the chip's select line, its two edges.
    pub transaction_instructions: u32,
    /// Instructions around each operation of a transaction that carries bytes, one start of direct memory access each.
    pub operation_instructions: u32,
    /// What an operation takes beside instructions: exceptions, starting the peripheral, seeing that it is done; nanoseconds.
    pub operation_ns: u32,
    /// Instructions for each byte, where the processor moves them: a byte takes the longer of this and its eight bits.
    pub byte_instructions: u32,
    /// From an edge of a pin, or a timer's end, to the first instruction of the interrupt handler, nanoseconds: waking from
    /// the sleep in which it waits, stacking.
    pub interrupt_latency_ns: u32,
    /// Instructions from there to the first of the task that waited: handler, executor, and the way down to what it waited for.
    pub wake_instructions: u32,
    /// Instructions more where another task was running and not the processor sleeping.
    pub switch_instructions: u32,
    /// Instructions of beginning to wait: timer and pin armed.
    pub wait_instructions: u32,
    /// The step of the timer that waits are made by, nanoseconds; a wait ends up to one later.
    pub timer_ns: u32,
    /// Waits at least this long are slept through with the fast clocks off, on a slow timer; `None`: on this board none are.
    pub sleep_from: Option<Duration>,
    /// The step of that slow timer, nanoseconds.
    pub sleep_timer_ns: u32,
    /// Current while the processor runs, waits with its clocks on, and sleeps with them off, milliamperes.
    pub run_ma: f64,
    /// See [`run_ma`](Self::run_ma).
    pub wait_ma: f64,
    /// See [`run_ma`](Self::run_ma).
    pub sleep_ma: f64,
}

impl BoardProfile {
    /// DWM1001: nRF52832.
    ///
    /// * 1.5 cycles an instruction: with its cache the chip has 3.36 CoreMark/MHz (product specification), as a Cortex-M4 without
    ///   wait states, which takes about 1.25 cycles for an instruction of compiled code; a cache of 2 KB does not hold a
    ///   driver, and each line that is missed waits two or three cycles for the flash. Without the cache, as after reset, it is near 2.
    /// * SPI by the SPIM's own registers, one start an operation, and a look at the end's event until it is there: about 40
    ///   instructions, counted by hand, and half a microsecond from the start to the first bit and from the last to the event.
    ///   (embassy-nrf's transfers, each started twice for anomaly 109, take 280 and two exceptions.)
    /// * Interrupts: 3 µs from sleep to running (product specification, POWER: tIDLE2CPU), 12 cycles of stacking. Handler of all pins
    ///   and executor: about 200 instructions by the sources, not counted.
    /// * TIMER1 counts microseconds.
    /// * Long waits count on the RTC, of a 32 kHz crystal, with the fast crystal and TIMER1 off: `sleep_from`. Bluetooth keeps both on,
    ///   and so does a board without that crystal.
    /// * 3.7 mA running from flash with the DC/DC converter at 3 V (product specification, CPU); waiting with crystal, TIMER1
    ///   and PPI-less GPIOTE about 0.6 mA (sum of the modules' figures); 1.9 µA in System ON with the RTC and all RAM.
    pub const DWM1001: Self = Self {
        name: "dwm1001",
        core: Core::CortexM4F,
        clock_hz: 64_000_000,
        cycles_per_instruction: 1.5,
        slowdown: 1.0,
        spi_hz: 2_000_000,
        spi_fast_hz: 8_000_000,
        transaction_instructions: 20,
        operation_instructions: 40,
        operation_ns: 500,
        byte_instructions: 0,
        interrupt_latency_ns: 3_200,
        wake_instructions: 250,
        switch_instructions: 40,
        wait_instructions: 100,
        timer_ns: 1_000,
        sleep_from: Some(Duration::from_millis(3)),
        sleep_timer_ns: 30_518,
        run_ma: 3.7,
        wait_ma: 0.6,
        sleep_ma: 0.0019,
    };

    /// EVK1000's EVB1000: STM32F105 at 72 MHz.
    ///
    /// * Two cycles an instruction: 1.25 DMIPS/MHz without wait states (data sheet), and users have about 0.85 at 72 MHz with two wait
    ///   states and the prefetch buffer: 1.35 cycles become 2.
    /// * SPI by embassy-stm32's blocking driver: every byte is written, waited for and read, 25 instructions by the sources.
    /// * Waking from WFE takes some cycles. The time driver's ticks are a microsecond.
    /// * 28.3 mA running and 6.0 mA sleeping with its peripherals off (data sheet, typical, 72 MHz); no sleep with stopped clocks.
    pub const EVB1000: Self = Self {
        name: "evk1000",
        core: Core::CortexM3,
        clock_hz: 72_000_000,
        cycles_per_instruction: 2.0,
        slowdown: 1.0,
        spi_hz: 2_250_000,
        spi_fast_hz: 18_000_000,
        transaction_instructions: 30,
        operation_instructions: 90,
        operation_ns: 300,
        byte_instructions: 25,
        interrupt_latency_ns: 500,
        wake_instructions: 300,
        switch_instructions: 40,
        wait_instructions: 150,
        timer_ns: 1_000,
        sleep_from: None,
        sleep_timer_ns: 0,
        run_ma: 28.3,
        wait_ma: 6.0,
        sleep_ma: 6.0,
    };

    /// ESP32-C3 at 160 MHz with a DW1000 on its IO_MUX pins.
    ///
    /// * Two cycles an instruction: 2.55 CoreMark/MHz (data sheet) with everything in the cache is about 1.3 cycles; the 16 KB of
    ///   cache do not hold a node's code, and a line from the flash, 32 bytes over four wires at 80 MHz, takes a microsecond,
    ///   160 cycles: one miss in 230 instructions makes the rest. An estimate.
    /// * SPI by esp-hal's blocking driver: registers, buffer of 64 bytes, wait: 350 instructions an operation, estimated from
    ///   the sources.
    /// * Interrupts go through a handler of all pins, the scheduler and a change of thread: 600 instructions, estimated.
    /// * 23 mA running and 16 mA idle at 160 MHz, radio off, peripherals off (data sheet, modem-sleep); 0.13 mA in light sleep.
    pub const ESP32C3: Self = Self {
        name: "esp32c3",
        core: Core::RiscV32,
        clock_hz: 160_000_000,
        cycles_per_instruction: 2.0,
        slowdown: 1.0,
        spi_hz: 2_000_000,
        spi_fast_hz: 20_000_000,
        transaction_instructions: 60,
        operation_instructions: 350,
        operation_ns: 500,
        byte_instructions: 4,
        interrupt_latency_ns: 500,
        wake_instructions: 600,
        switch_instructions: 150,
        wait_instructions: 300,
        timer_ns: 1_000,
        sleep_from: None,
        sleep_timer_ns: 0,
        run_ma: 23.0,
        wait_ma: 16.0,
        sleep_ma: 0.13,
    };

    /// ESP32-C6 at 160 MHz: as the [C3](Self::ESP32C3), with twice the cache and 2.76 CoreMark/MHz or more: 1.8 cycles. An estimate. 27 mA
    /// running and 17 mA idle (data sheet, modem-sleep), 0.18 mA in light sleep.
    pub const ESP32C6: Self = Self {
        name: "esp32c6",
        cycles_per_instruction: 1.8,
        run_ma: 27.0,
        wait_ma: 17.0,
        sleep_ma: 0.18,
        ..Self::ESP32C3
    };

    /// A processor that takes no time and no current of its own; only the bytes on the bus take time.
    pub const INSTANT: Self = Self {
        name: "instant",
        core: Core::CortexM4F,
        clock_hz: 1_000_000_000,
        cycles_per_instruction: 0.0,
        slowdown: 1.0,
        spi_hz: 2_000_000,
        spi_fast_hz: 20_000_000,
        transaction_instructions: 0,
        operation_instructions: 0,
        operation_ns: 0,
        byte_instructions: 0,
        interrupt_latency_ns: 0,
        wake_instructions: 0,
        switch_instructions: 0,
        wait_instructions: 0,
        timer_ns: 0,
        sleep_from: None,
        sleep_timer_ns: 0,
        run_ma: 0.0,
        wait_ma: 0.0,
        sleep_ma: 0.0,
    };

    /// The boards that there are firmware images for, and the one without costs.
    pub const ALL: [Self; 5] = [Self::DWM1001, Self::EVB1000, Self::ESP32C3, Self::ESP32C6, Self::INSTANT];

    /// The board of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|board| board.name == name)
    }

    /// The same with a processor that is so many times slower; the bus is as fast as before.
    pub const fn slowed(self, times: f64) -> Self {
        Self { slowdown: self.slowdown * times, ..self }
    }

    /// Picoseconds that `instructions` take.
    pub fn instructions_ps(&self, instructions: u64) -> u64 {
        let seconds = instructions as f64 * self.cycles_per_instruction / f64::from(self.clock_hz.max(1));
        (seconds * self.slowdown * 1e12) as u64
    }

    /// Picoseconds of something that takes so long on this board as it is, nanoseconds.
    pub fn stretched_ps(&self, ns: u32) -> u64 {
        (f64::from(ns) * self.slowdown * 1e3) as u64
    }

    /// Picoseconds that setting up a transaction with so many operations takes.
    pub fn setup_ps(&self, operations: usize) -> u64 {
        let instructions = u64::from(self.operation_instructions) * operations as u64;
        self.instructions_ps(u64::from(self.transaction_instructions) + instructions)
            + self.stretched_ps(self.operation_ns) * operations as u64
    }

    /// Picoseconds that `bytes` bytes take at a clock of the bus: eight bits each, or what the processor needs to move them.
    pub fn bytes_ps(&self, bytes: usize, spi_hz: u32) -> u64 {
        let bus = bytes as u64 * 8_000_000_000_000 / u64::from(spi_hz.max(1));
        bus.max(self.instructions_ps(u64::from(self.byte_instructions) * bytes as u64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_take_cycles_and_the_slowdown() {
        // 6,400 · 1.5 / 64 MHz = 150 µs.
        assert_eq!(BoardProfile::DWM1001.instructions_ps(6_400), 150_000_000);
        assert_eq!(BoardProfile::DWM1001.slowed(2.0).instructions_ps(6_400), 300_000_000);
        assert_eq!(BoardProfile::INSTANT.instructions_ps(1_000_000), 0);
    }

    #[test]
    fn each_operation_is_set_up() {
        // (20 + 2 · 40) · 1.5 / 64 MHz = 2.34375 µs, and twice half a microsecond.
        assert_eq!(BoardProfile::DWM1001.setup_ps(2), 3_343_750);
        assert_eq!(BoardProfile::INSTANT.setup_ps(2), 0);
    }

    #[test]
    fn the_bus_is_not_slowed_but_who_moves_its_bytes() {
        // Ten bytes at 8 MHz.
        assert_eq!(BoardProfile::DWM1001.slowed(4.0).bytes_ps(10, 8_000_000), 10_000_000);
        // Ten bytes at 18 MHz are 4.4 µs on the bus, and 250 · 2 / 72 MHz = 6.944 µs of the processor.
        assert_eq!(BoardProfile::EVB1000.bytes_ps(10, 18_000_000), 6_944_444);
    }

    #[test]
    fn boards_are_found_by_their_names() {
        for board in BoardProfile::ALL {
            assert_eq!(BoardProfile::named(board.name), Some(board));
        }
        assert_eq!(BoardProfile::named("dwm1000"), None);
    }
}
