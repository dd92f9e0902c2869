//! The choice of the serial port: built-in USB if the chip has it and a host is connected to it, else UART0.

use esp_hal::Async;
use esp_hal::peripherals::UART0;
use esp_hal::uart::{Config, UartTx};
#[cfg(not(feature = "esp32"))]
use esp_hal::{peripherals::USB_DEVICE, usb::usb_serial_jtag::UsbSerialJtag};

#[cfg(feature = "esp32")]
use esp_hal::peripherals::GPIO1 as ConsolePin;
#[cfg(feature = "esp32c6")]
use esp_hal::peripherals::GPIO16 as ConsolePin;
#[cfg(feature = "esp32c3")]
use esp_hal::peripherals::GPIO21 as ConsolePin;

/// The ports to choose from.
pub struct Port {
    /// Built-in USB.
    #[cfg(not(feature = "esp32"))]
    pub usb: USB_DEVICE<'static>,
    /// UART0, whose output is the console's pin.
    pub uart: UART0<'static>,
}

/// The chosen port.
pub enum Opened {
    #[cfg(not(feature = "esp32"))]
    Usb(UsbSerialJtag<'static, Async>),
    Uart(UartTx<'static, Async>),
}

impl Port {
    /// Chooses the port. With USB this takes some milliseconds.
    pub async fn open(self) -> Opened {
        #[cfg(not(feature = "esp32"))]
        if host_is_there().await {
            return Opened::Usb(UsbSerialJtag::new(self.usb).into_async());
        }
        // SAFETY: this is the console's pin, which the board gives to no other driver.
        let pin = unsafe { ConsolePin::steal() };
        let uart = UartTx::new(self.uart, Config::default()).expect("115,200 bit/s is the default");
        Opened::Uart(uart.with_tx(pin).into_async())
    }
}

/// The next byte that the host has sent by USB. At a UART, the node receives nothing.
#[cfg(not(feature = "esp32"))]
pub fn received() -> Option<u8> {
    let device = USB_DEVICE::regs();
    let is_there = device.ep1_conf().read().serial_out_ep_data_avail().bit_is_set();
    is_there.then(|| device.ep1().read().rdwr_byte().bits())
}

/// The same for a chip without USB: none.
#[cfg(feature = "esp32")]
pub const fn received() -> Option<u8> {
    None
}

/// Whether a host is connected: a host on USB starts a frame each millisecond.
#[cfg(not(feature = "esp32"))]
async fn host_is_there() -> bool {
    let device = USB_DEVICE::regs();
    device.int_clr().write(|w| w.sof().clear_bit_by_one());
    embassy_time::Timer::after_millis(10).await;
    device.int_raw().read().sof().bit_is_set()
}
