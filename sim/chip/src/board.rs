//! Boards: the time that their processors, buses, interrupts and timers take, and the current that they draw.
//!
//! **None of these figures was measured on a board.** Clocks, bus clocks and currents are those of the data sheets.
//! Cycles per instruction are estimates from published benchmarks and the memories' wait states, as stated at each
//! board. The instructions of drivers and interrupt handlers are counted where that was possible, or read from the
//! disassembly; where they are guessed, the comment says so. (The simulation of a firmware counts the firmware's own
//! instructions, see [`Processor::charge`](crate::Processor::charge).) To check that a result does not depend on these
//! figures, run the simulation a second time with [`BoardProfile::slowed`] by two.

use std::time::Duration;

/// A kind of processor, as compilers distinguish it. It selects the instruction counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Core {
    /// Armv7E-M with single-precision FPU.
    CortexM4F,
    /// Armv7-M without FPU.
    CortexM3,
    /// RV32IMC without FPU; RV32IMAC counts as the same.
    RiscV32,
}

/// Interrupts of the chip's own radio. They come above all priorities, as a Poisson process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interrupts {
    /// Interrupts per second, in the mean.
    pub per_second: f64,
    /// How long each takes, before the board's slowdown.
    pub each: Duration,
}

impl Interrupts {
    /// While a controller scans, whichever it is: an assumption. For each advertisement, the controller serves the
    /// access address, the end and the processing after it; in addition there is a timer. With fifty advertisements a
    /// second this is two hundred interrupts of 40 µs.
    pub const SCANNING: Self = Self { per_second: 200.0, each: Duration::from_micros(40) };
    /// While a node is joined to a Wi-Fi: an assumption. It receives ten beacons a second of its access point and some
    /// frames to all, and sends ten to forty datagrams, each of which the driver serves at its start, at the access point's
    /// acknowledgement and at its end, as their receipts; in addition there are timers. This is three hundred interrupts of
    /// 40 µs. The driver's threads and the network's stack are below ranging.
    pub const WIFI: Self = Self { per_second: 300.0, each: Duration::from_micros(40) };
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
    /// A block of AES in hardware, with its set-up, nanoseconds; 0: AES in software.
    pub cipher_block_ns: u32,
    /// Mean cycles per instruction, with waits for flash. Zero: instructions take no time.
    pub cycles_per_instruction: f64,
    /// Factor on all costs of the processor and of setting things up. The time of bytes on the bus is not multiplied.
    pub slowdown: f64,
    /// SPI clock until the application changes it, Hz.
    pub spi_hz: u32,
    /// SPI clock after the chip's PLL has locked, Hz: the maximum of board and chip.
    pub spi_fast_hz: u32,
    /// Instructions per transaction: the two edges of the chip's select line.
    pub transaction_instructions: u32,
    /// Instructions for each operation of a transaction that carries bytes. Each is one start of direct memory access.
    pub operation_instructions: u32,
    /// The time of an operation besides its instructions: exceptions, start of the peripheral, detection of its end;
    /// nanoseconds.
    pub operation_ns: u32,
    /// Instructions per byte, if the processor moves the bytes. A byte takes the longer of this time and its eight
    /// bits.
    pub byte_instructions: u32,
    /// From an edge of a pin, or the end of a timer, to the first instruction of the interrupt handler, nanoseconds:
    /// waking from the sleep of the wait, and stacking.
    pub interrupt_latency_ns: u32,
    /// Instructions from there to the first instruction of the task that waited: handler, executor, and the path down
    /// to the awaited operation.
    pub wake_instructions: u32,
    /// Additional instructions if another task was running, instead of the processor sleeping.
    pub switch_instructions: u32,
    /// Instructions to begin a wait: arming timer and pin.
    pub wait_instructions: u32,
    /// The step of the timer that measures waits, nanoseconds. A wait ends up to one step late.
    pub timer_ns: u32,
    /// During waits of at least this length the processor sleeps with the fast clocks off, on a slow timer. `None`: it
    /// never does on this board.
    pub sleep_from: Option<Duration>,
    /// The step of that slow timer, nanoseconds.
    pub sleep_timer_ns: u32,
    /// Interrupts of its Bluetooth controller while it scans.
    pub scanning: Interrupts,
    /// The interrupts of Wi-Fi.
    pub wifi: Interrupts,
    /// Current while the processor runs, while it waits with its clocks on, and while it sleeps with them off,
    /// milliamperes.
    pub run_ma: f64,
    /// See [`run_ma`](Self::run_ma).
    pub wait_ma: f64,
    /// See [`run_ma`](Self::run_ma).
    pub sleep_ma: f64,
}

impl BoardProfile {
    /// DWM1001: nRF52832.
    ///
    /// * 1.5 cycles per instruction: with its cache the chip has 3.36 CoreMark/MHz (product specification), as a
    ///   Cortex-M4 without wait states, which takes about 1.25 cycles for an instruction of compiled code. A cache of 2
    ///   KB does not hold a driver, and each line that is missed waits two or three cycles for the flash. Without the
    ///   cache, as after reset, the figure is near 2.
    /// * SPI by the SPIM's own registers, one start per operation, and polling of the end's event: about 40
    ///   instructions, counted by hand, and half a microsecond from the start to the first bit and from the last bit to
    ///   the event. (embassy-nrf's transfers, each started twice for anomaly 109, take 280 instructions and two
    ///   exceptions.)
    /// * Interrupts: 3 µs from sleep to running (product specification, POWER: tIDLE2CPU), 12 cycles of stacking. The
    ///   handler of all pins and the executor take about 200 instructions by the sources, not counted.
    /// * A block of AES takes 7.2 µs (product specification, ECB), and some fifty instructions around it by the sources.
    /// * TIMER1 counts microseconds.
    /// * Long waits count on the RTC with a 32 kHz crystal; the fast crystal and TIMER1 are off (`sleep_from`).
    ///   Bluetooth keeps both on, and so does a board without that crystal.
    /// * 3.7 mA running from flash with the DC/DC converter at 3 V (product specification, CPU); about 0.6 mA waiting
    ///   with crystal, TIMER1 and GPIOTE without PPI (sum of the modules' figures); 1.9 µA in System ON with the RTC
    ///   and all RAM.
    pub const DWM1001: Self = Self {
        name: "dwm1001",
        core: Core::CortexM4F,
        clock_hz: 64_000_000,
        cipher_block_ns: 8_000,
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
        scanning: Interrupts::SCANNING,
        wifi: Interrupts::WIFI,
        run_ma: 3.7,
        wait_ma: 0.6,
        sleep_ma: 0.0019,
    };

    /// EVK1000's EVB1000: STM32F105 at 72 MHz.
    ///
    /// * Two cycles per instruction: 1.25 DMIPS/MHz without wait states (data sheet). Users report about 0.85 at 72 MHz
    ///   with two wait states and the prefetch buffer, so 1.35 cycles become 2.
    /// * SPI by embassy-stm32's blocking driver: every byte is written, awaited and read, in 25 instructions by the
    ///   sources.
    /// * Waking from WFE takes some cycles. The time driver's ticks are a microsecond.
    /// * 28.3 mA running and 6.0 mA sleeping with its peripherals off (data sheet, typical, 72 MHz). It has no sleep
    ///   with stopped clocks.
    pub const EVB1000: Self = Self {
        name: "evk1000",
        core: Core::CortexM3,
        clock_hz: 72_000_000,
        cipher_block_ns: 0,
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
        scanning: Interrupts::SCANNING,
        wifi: Interrupts::WIFI,
        run_ma: 28.3,
        wait_ma: 6.0,
        sleep_ma: 6.0,
    };

    /// ESP32-C3 at 160 MHz with a DW1000 on its IO_MUX pins.
    ///
    /// * Two cycles per instruction, an estimate: 2.55 CoreMark/MHz (data sheet) with everything in the cache is about
    ///   1.3 cycles. The cache of 16 KB does not hold a node's code. A line from the flash, 32 bytes over four wires at
    ///   80 MHz, takes a microsecond, which is 160 cycles. One miss in 230 instructions gives the rest.
    /// * SPI by esp-hal's blocking driver: registers, buffer of 64 bytes, wait. 350 instructions per operation,
    ///   estimated from the sources.
    /// * Interrupts go through a handler of all pins, the scheduler and a change of thread: 600 instructions,
    ///   estimated.
    /// * A block of AES takes some twenty accesses to its registers over the peripheral bus and 11 cycles of its own
    ///   (technical reference manual): 2 µs, estimated from esp-hal's sources.
    /// * 23 mA running and 16 mA idle at 160 MHz, radio off, peripherals off (data sheet, modem-sleep); 0.13 mA in
    ///   light sleep.
    pub const ESP32C3: Self = Self {
        name: "esp32c3",
        core: Core::RiscV32,
        clock_hz: 160_000_000,
        cipher_block_ns: 2_000,
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
        scanning: Interrupts::SCANNING,
        wifi: Interrupts::WIFI,
        run_ma: 23.0,
        wait_ma: 16.0,
        sleep_ma: 0.13,
    };

    /// ESP32-C6 at 160 MHz: as the [C3](Self::ESP32C3), with twice the cache and 2.76 CoreMark/MHz or more: 1.8 cycles.
    /// An estimate. 27 mA running and 17 mA idle (data sheet, modem-sleep), 0.18 mA in light sleep.
    pub const ESP32C6: Self = Self {
        name: "esp32c6",
        cycles_per_instruction: 1.8,
        run_ma: 27.0,
        wait_ma: 17.0,
        sleep_ma: 0.18,
        ..Self::ESP32C3
    };

    /// A processor that takes no time and draws no current. Only the bytes on the bus take time.
    pub const INSTANT: Self = Self {
        name: "instant",
        core: Core::CortexM4F,
        clock_hz: 1_000_000_000,
        cipher_block_ns: 0,
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
        scanning: Interrupts::SCANNING,
        wifi: Interrupts::WIFI,
        run_ma: 0.0,
        wait_ma: 0.0,
        sleep_ma: 0.0,
    };

    /// The boards that have firmware images, and the one without costs.
    pub const ALL: [Self; 5] = [Self::DWM1001, Self::EVB1000, Self::ESP32C3, Self::ESP32C6, Self::INSTANT];

    /// The board with a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|board| board.name == name)
    }

    /// The same board with a processor that is `times` times slower. The bus keeps its speed.
    pub const fn slowed(self, times: f64) -> Self {
        Self { slowdown: self.slowdown * times, ..self }
    }

    /// Picoseconds of `instructions` instructions.
    pub fn instructions_ps(&self, instructions: u64) -> u64 {
        let seconds = instructions as f64 * self.cycles_per_instruction / f64::from(self.clock_hz.max(1));
        (seconds * self.slowdown * 1e12) as u64
    }

    /// Picoseconds of an operation that takes `ns` nanoseconds without slowdown.
    pub fn stretched_ps(&self, ns: u32) -> u64 {
        (f64::from(ns) * self.slowdown * 1e3) as u64
    }

    /// Picoseconds to set up a transaction with this number of operations.
    pub fn setup_ps(&self, operations: usize) -> u64 {
        let instructions = u64::from(self.operation_instructions) * operations as u64;
        self.instructions_ps(u64::from(self.transaction_instructions) + instructions)
            + self.stretched_ps(self.operation_ns) * operations as u64
    }

    /// Picoseconds of `bytes` bytes at a bus clock: eight bits each, or the time that the processor needs to move them.
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
        // Ten bytes at 18 MHz take 4.4 µs on the bus; the processor takes 250 · 2 / 72 MHz = 6.944 µs.
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
