//! DWM1001: nRF52832 with a DW1000, as a module or on the DWM1001-DEV.
//!
//! Priorities of interrupts: 0 and 4 are the Bluetooth controller's, 2 the drivers', and 3 the ranging tasks'
//! executor's. The solver, telemetry and supervision run below all interrupts.
//!
//! Clocks: the 32 MHz crystal runs. The 32 kHz clock comes from a 32 kHz crystal if there is one, and otherwise from
//! the 32 MHz crystal. The module's documentation does not promise a 32 kHz crystal, so it is tried at the start, for a
//! second at most. The RC oscillator is not used: it may be off by 2 %, so that a tag would miss its slot after a wait
//! of half a superframe. A tag that sleeps between its rounds switches the 32 MHz crystal, which costs some 0.3 mA, and
//! TIMER1 off meanwhile, if the 32 kHz crystal runs and Bluetooth does not.
#![no_std]
#![cfg(target_os = "none")]

#[cfg(not(feature = "ble"))]
mod advertising;
#[cfg(feature = "ble")]
pub mod bluetooth;
mod cipher;
mod delay;
pub mod motion;
mod uwb;
mod watchdog;

use baliza_board_cortex_m::{self as cortex, crash, identity, reset_cause};
use baliza_board_rtt::TelemetryChannel;
use baliza_dw1000::driver::Dw1000;
use embassy_executor::{InterruptExecutor, SendSpawner};
#[cfg(not(feature = "ble"))]
use embassy_nrf::Peri;
use embassy_nrf::config::{Config, HfclkSource, LfclkSource};
use embassy_nrf::gpio::{Input, Level, Output, OutputDrive, Pull};
use embassy_nrf::interrupt::{self, InterruptExt, Priority, typelevel};
use embassy_nrf::nvmc::Nvmc;
use embassy_nrf::{bind_interrupts, pac, peripherals, spim};
use firmware_common::node::{Node, Start};
use firmware_common::supervision::Lit;

#[cfg(not(feature = "ble"))]
pub use advertising::Advertiser;
pub use baliza_board_cortex_m::{restart, uptime_us};
#[cfg(not(feature = "ble"))]
pub use cipher::make_code;
pub use delay::Delay;
pub use uwb::{Bus, Interrupt, Reset};
pub use watchdog::Watchdog;

/// The board's name in telemetry.
pub const BOARD: wire::config::Board = wire::config::Board::Dwm1001;

/// The DW1000's driver.
pub type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;

/// The DW1000's parts.
pub type Uwb = baliza_dw1000::Parts<Bus, Interrupt, Reset, Delay>;

// The Bluetooth controller provides its own.
#[cfg(not(feature = "ble"))]
critical_section::set_impl!(cortex::critical::InterruptsOff);

bind_interrupts!(struct Interrupts {
    SPI2 => spim::InterruptHandler<peripherals::SPI2>;
    TIMER1 => delay::InterruptHandler;
    EGU1_SWI1 => RangingInterrupt;
});

/// The board after its start.
pub struct Board {
    /// The DW1000's parts.
    pub uwb: Uwb,
    /// The delay for the exchange's waits.
    pub delay: Delay,
    /// Whether long waits may be [rests](Delay::rest).
    pub may_rest: bool,
    /// The parts of the supervisor.
    pub care: Care,
    /// The inputs of the node's start.
    pub start: Start,
    /// The flash with the record and the models beside it.
    pub flash: Nvmc<'static>,
    /// The parts of the motion sensor.
    pub motion: motion::Parts,
    /// The spawner of the executor for ranging, above the thread's executor.
    pub ranging: SendSpawner,
    /// The radio of the nRF52832.
    #[cfg(feature = "ble")]
    pub bluetooth: bluetooth::Parts,
    /// The radio of the nRF52832, for an [`Advertiser`].
    #[cfg(not(feature = "ble"))]
    pub bluetooth: Peri<'static, peripherals::RADIO>,
}

impl Board {
    /// Takes the board. May be called once in a program's run. From here on the log works and the watchdog runs.
    pub fn take() -> Self {
        let reset = pac::POWER.resetreas().read().0;
        // The flags add up until the program clears them by writing ones.
        pac::POWER.resetreas().write(|flags| flags.0 = reset);
        let reset = reset_cause::nrf52(reset, cortex::ram_survived());
        let crash = crash::take();
        let telemetry = baliza_board_rtt::start();
        // The cache is off after a reset. Without it each branch out of the flash's last line waits for up to two
        // cycles.
        pac::NVMC.icachecnf().write(|cache| cache.set_cacheen(true));

        let mut config = Config::default();
        config.hfclk_source = HfclkSource::ExternalXtal;
        let may_rest = cfg!(not(feature = "ble")) && slow_crystal_runs();
        config.lfclk_source = if may_rest { LfclkSource::ExternalXtal } else { LfclkSource::Synthesized };
        // The module has the inductor that the DC/DC converter needs.
        config.dcdc.reg1 = true;
        config.gpiote_interrupt_priority = Priority::P2;
        config.time_interrupt_priority = Priority::P2;
        let p = embassy_nrf::init(config);
        let watchdog = Watchdog::start(p.WDT);
        interrupt::SPI2.set_priority(Priority::P2);
        let [delay, driver_delay] = Delay::take(p.TIMER1, Interrupts);

        let mut spi = spim::Config::default();
        spi.frequency = spim::Frequency::M2;
        let uwb = Uwb {
            bus: Bus {
                spi: uwb::Master::new(spim::Spim::new(p.SPI2, Interrupts, p.P0_16, p.P0_18, p.P0_20, spi)),
                select: Output::new(p.P0_17, Level::High, OutputDrive::Standard),
                set_clock: uwb::set_clock,
                cycles_per_us: 64,
            },
            interrupt: Input::new(p.P0_19, Pull::Down),
            reset: Reset::new(p.P0_24.into()),
            delay: driver_delay,
        };
        let mut flash = Nvmc::new(p.NVMC);
        let record = wire::config::load(&mut flash, BOARD.pages().offsets);
        let eui = identity::of_random(device_id());
        Self {
            uwb,
            delay,
            may_rest,
            care: Care {
                leds: Leds {
                    state: Output::new(p.P0_30, Level::High, OutputDrive::Standard),
                    fault: Output::new(p.P0_14, Level::High, OutputDrive::Standard),
                },
                watchdog,
                telemetry,
            },
            start: Start { board: BOARD, clock: uptime_us, record, eui, reset, crash, cipher: cipher::start() },
            flash,
            motion: motion::Parts { twi: p.TWISPI0, scl: p.P0_28, sda: p.P0_29, int1: p.P0_25 },
            ranging: start_ranging(),
            #[cfg(not(feature = "ble"))]
            bluetooth: p.RADIO,
            #[cfg(feature = "ble")]
            bluetooth: bluetooth::Parts {
                rtc0: p.RTC0,
                timer0: p.TIMER0,
                temp: p.TEMP,
                rng: p.RNG,
                ppi: bluetooth::Channels {
                    ch17: p.PPI_CH17,
                    ch18: p.PPI_CH18,
                    ch19: p.PPI_CH19,
                    ch20: p.PPI_CH20,
                    ch21: p.PPI_CH21,
                    ch22: p.PPI_CH22,
                    ch23: p.PPI_CH23,
                    ch24: p.PPI_CH24,
                    ch25: p.PPI_CH25,
                    ch26: p.PPI_CH26,
                    ch27: p.PPI_CH27,
                    ch28: p.PPI_CH28,
                    ch29: p.PPI_CH29,
                    ch30: p.PPI_CH30,
                    ch31: p.PPI_CH31,
                },
            },
        }
    }
}

/// The parts of the board that the supervisor uses.
pub struct Care {
    leds: Leds,
    watchdog: Watchdog,
    telemetry: TelemetryChannel,
}

/// Runs the supervisor: see [`Node::supervise`].
#[embassy_executor::task]
pub async fn supervise(node: Node, care: Care) {
    let Care { mut leds, mut watchdog, telemetry } = care;
    node.supervise(embassy_time::Delay, telemetry, |lit| leds.show(lit), || watchdog.feed(), crash::leave).await;
}

/// The flash with the models of the beacons' RSSI, in the processor's address space: the models are read in place.
#[cfg(feature = "ble")]
pub fn models() -> &'static [u8] {
    let at = const { BOARD.pages().models_address().unwrap() };
    // SAFETY: the linker places nothing else in this flash (`memory.x`), and no program writes it while it runs.
    unsafe { core::slice::from_raw_parts(at as *const u8, wire::config::MODELS_BYTES) }
}

/// Whether the 32 kHz crystal is present and starts. Afterwards the clock is off again.
fn slow_crystal_runs() -> bool {
    const PATIENCE_MS: u32 = 1_000;
    const CYCLES_A_MS: u32 = 64_000;
    let clock = pac::CLOCK;
    clock.tasks_lfclkstop().write_value(1);
    clock.lfclksrc().write(|w| w.set_src(pac::clock::vals::Lfclksrc::Xtal));
    clock.events_lfclkstarted().write_value(0);
    clock.tasks_lfclkstart().write_value(1);
    let runs = (0..PATIENCE_MS).any(|_| {
        cortex_m::asm::delay(CYCLES_A_MS);
        clock.events_lfclkstarted().read() != 0
    });
    clock.tasks_lfclkstop().write_value(1);
    runs
}

/// FICR.DEVICEID: 64 random bits of this chip.
fn device_id() -> u64 {
    u64::from(pac::FICR.deviceid(1).read()) << 32 | u64::from(pac::FICR.deviceid(0).read())
}

static RANGING: InterruptExecutor = InterruptExecutor::new();

/// The handler of EGU1_SWI1, a software interrupt that nothing else uses.
struct RangingInterrupt;

impl typelevel::Handler<typelevel::EGU1_SWI1> for RangingInterrupt {
    unsafe fn on_interrupt() {
        // SAFETY: this is the executor's interrupt, which `start` enables.
        unsafe { RANGING.on_interrupt() }
    }
}

fn start_ranging() -> SendSpawner {
    interrupt::EGU1_SWI1.set_priority(Priority::P3);
    RANGING.start(interrupt::EGU1_SWI1)
}

/// The lights of the DWM1001-DEV. They are on when their pin is low. A bare module has none.
pub struct Leds {
    state: Output<'static>,
    fault: Output<'static>,
}

impl Leds {
    /// Shows the state in green (D9), and a fault in red (D11).
    pub fn show(&mut self, lit: Lit) {
        self.state.set_level((!lit.state).into());
        self.fault.set_level((!lit.fault).into());
    }
}
