//! The board, taken once at the start of a program.
//!
//! Clocks: a crystal of 12 MHz, multiplied by six, gives 72 MHz for the processor and SPI1, and 36 MHz for SPI2.
//! Priorities of interrupts: the clock and the DW1000's pin are above the ranging tasks' executor. Solver, display,
//! telemetry and supervision run below all interrupts.

use baliza_board_cortex_m::{self as cortex, crash, identity, reset_cause};
use baliza_board_rtt::TelemetryChannel;
use baliza_dw1000::driver::{Dw1000, SpiClock};
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::exti::{self, ExtiInput};
use embassy_stm32::flash;
use embassy_stm32::gpio::{Input, Level, Output, OutputOpenDrain, Pull, Speed};
use embassy_stm32::interrupt::{self, InterruptExt, Priority, typelevel};
use embassy_stm32::mode::Blocking;
use embassy_stm32::rcc::{self, AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPreDiv, PllSource, Sysclk};
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, pac, peripherals, uid};
use embassy_time::Delay;
use firmware_common::node::{Node, Start};
use firmware_common::supervision::Lit;

use crate::cipher;
use crate::panel::Switches;
use crate::uwb::{self, Bus, Interrupt, Reset};

pub use baliza_board_cortex_m::{restart, uptime_us};

/// The board's name in telemetry.
pub const BOARD: wire::config::Board = wire::config::Board::Evk1000;

/// The DW1000's driver.
pub type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;

/// The DW1000's parts.
pub type Uwb = baliza_dw1000::Parts<Bus, Interrupt, Reset, Delay>;

critical_section::set_impl!(cortex::critical::InterruptsOff);

/// The watchdog's time-out, microseconds by its own oscillator, which runs at 0.5 to 1.5 times its nominal rate.
const WATCHDOG_US: u32 = 6_000_000;

bind_interrupts!(struct Interrupts {
    EXTI9_5 => exti::InterruptHandler<typelevel::EXTI9_5>;
    UART5 => RangingInterrupt;
});

/// The chip's flash.
pub type Flash = flash::Flash<'static, flash::Blocking>;

/// The display, on SPI2.
pub type Lcd = crate::lcd::Lcd<Spi<'static, Blocking, Master>, Output<'static>>;

/// The board after its start.
pub struct Board {
    /// The DW1000's parts.
    pub uwb: Uwb,
    /// The delay for the exchange's waits: ticks of 1 µs.
    pub delay: Delay,
    /// The positions of the switches at the start.
    pub switches: Switches,
    /// The parts of the supervisor.
    pub care: Care,
    /// The display, not started.
    pub lcd: Lcd,
    /// The inputs of the node's start. There is always a record, made from the switches and the content of the flash.
    pub start: Start,
    /// The flash with the record and the models beside it.
    pub flash: Flash,
    /// The spawner of the executor for ranging, above the thread's executor.
    pub ranging: SendSpawner,
}

impl Board {
    /// Takes the board. May be called once in a program's run. From here on the log works and the watchdog runs.
    // Done once: for size.
    #[cold]
    pub fn take() -> Self {
        let reset = pac::RCC.csr().read().0;
        // The flags add up until they are cleared.
        pac::RCC.csr().modify(|flags| flags.set_rmvf(true));
        let reset = reset_cause::stm32f1(reset, cortex::ram_survived());
        let crash = crash::take();
        let telemetry = baliza_board_rtt::start();

        let p = embassy_stm32::init(configuration());
        // The watchdog stops while a debugger halts the processor: DBG_IWDG_STOP (RM0008, 31.16.3).
        pac::DBGMCU.cr().modify(|w| w.0 |= 1 << 8);
        let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG_US);
        watchdog.unleash();
        interrupt::EXTI9_5.set_priority(Priority::P1);

        let uwb = Uwb {
            bus: Bus {
                spi: Spi::new_blocking(p.SPI1, p.PA5, p.PA7, p.PA6, uwb::config(SpiClock::Slow)),
                select: Output::new(p.PA4, Level::High, Speed::VeryHigh),
                set_clock: uwb::set_clock,
                cycles_per_us: 72,
            },
            interrupt: ExtiInput::new(p.PB5, p.EXTI5, Pull::Down, Interrupts),
            reset: Reset::new(OutputOpenDrain::new(p.PA0, Level::High, Speed::Low)),
            delay: Delay,
        };
        let mut spi = spi::Config::default();
        spi.mode = spi::MODE_3;
        // 36 MHz / 128.
        spi.frequency = Hertz(281_250);
        spi.gpio_speed = Speed::Low;
        // The bus only writes. Nothing else drives the line.
        core::mem::forget(Output::new(p.PB10, Level::Low, Speed::Low));
        let lcd = Lcd::new(
            Spi::new_blocking_txonly(p.SPI2, p.PB13, p.PB15, spi),
            Output::new(p.PB12, Level::High, Speed::Low),
            Output::new(p.PB11, Level::Low, Speed::Low),
        );

        let switches = [
            Input::new(p.PC1, Pull::Up),
            Input::new(p.PC2, Pull::Up),
            Input::new(p.PC3, Pull::Up),
            Input::new(p.PC4, Pull::Up),
            Input::new(p.PC5, Pull::Up),
        ];
        // Wait until the pull-ups have charged the lines.
        cortex_m::asm::delay(72 * 50);
        let [anchor, s1_5, s1_6, s1_7, native] = switches.map(|line| line.is_low());

        let mut flash = Flash::new_blocking(p.FLASH);
        let record = wire::config::load(&mut flash, BOARD.pages().offsets);
        if let Err(fault) = &record
            && *fault != wire::config::LoadError::Missing
        {
            defmt::warn!("only the switches count, for the record in flash cannot be read: {}", fault);
        }
        let switches = Switches { anchor, mode: [s1_5, s1_6, s1_7], native };
        let record = Ok(switches.apply(record.ok()));
        let eui = identity::of_serial(&uid::uid());
        Self {
            uwb,
            delay: Delay,
            switches,
            care: Care {
                leds: Leds {
                    anchor: Output::new(p.PC6, Level::Low, Speed::Low),
                    tag: Output::new(p.PC7, Level::Low, Speed::Low),
                    state: Output::new(p.PC8, Level::Low, Speed::Low),
                    fault: Output::new(p.PC9, Level::Low, Speed::Low),
                },
                watchdog: Watchdog(watchdog),
                telemetry,
            },
            lcd,
            flash,
            start: Start { board: BOARD, clock: uptime_us, record, eui, reset, crash, cipher: cipher::start() },
            ranging: start_ranging(),
        }
    }
}

/// The parts of the board that the supervisor uses.
pub struct Care {
    /// The lights.
    pub leds: Leds,
    watchdog: Watchdog,
    telemetry: TelemetryChannel,
}

/// Runs the supervisor: see [`Node::supervise`].
#[embassy_executor::task]
pub async fn supervise(node: Node, care: Care) {
    let Care { mut leds, mut watchdog, telemetry } = care;
    node.supervise(Delay, telemetry, |lit| leds.show(lit), || watchdog.feed(), crash::leave).await;
}

fn configuration() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc = rcc::Config::default();
    config.rcc.hse = Some(Hse { freq: Hertz(12_000_000), mode: HseMode::Oscillator });
    config.rcc.pll = Some(Pll { src: PllSource::HSE, prediv: PllPreDiv::DIV1, mul: PllMul::MUL6 });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV2;
    config.rcc.apb2_pre = APBPrescaler::DIV1;
    config
}

static RANGING: InterruptExecutor = InterruptExecutor::new();

/// The handler of UART5's interrupt. UART5 itself is not used.
struct RangingInterrupt;

impl typelevel::Handler<typelevel::UART5> for RangingInterrupt {
    unsafe fn on_interrupt() {
        // SAFETY: this is the executor's interrupt, which `start` enables.
        unsafe { RANGING.on_interrupt() }
    }
}

fn start_ranging() -> SendSpawner {
    interrupt::UART5.set_priority(Priority::P6);
    RANGING.start(interrupt::UART5)
}

/// The watchdog. Once started, it cannot be stopped.
pub struct Watchdog(IndependentWatchdog<'static, peripherals::IWDG>);

impl Watchdog {
    /// Restarts its time-out of 4 to 12 s.
    pub fn feed(&mut self) {
        self.0.pet();
    }
}

/// The lights 5 to 8. They are on when their pin is high.
pub struct Leds {
    anchor: Output<'static>,
    tag: Output<'static>,
    state: Output<'static>,
    fault: Output<'static>,
}

impl Leds {
    /// Shows LED 5 for an anchor, LED 6 for a tag.
    pub fn show_role(&mut self, anchor: bool) {
        self.anchor.set_level(anchor.into());
        self.tag.set_level((!anchor).into());
    }

    /// Shows the state on LED 7, and a fault on LED 8.
    pub fn show(&mut self, lit: Lit) {
        self.state.set_level(lit.state.into());
        self.fault.set_level(lit.fault.into());
    }
}
