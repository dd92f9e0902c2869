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

/// Whether a host is connected: a host on USB starts a frame each millisecond.
#[cfg(not(feature = "esp32"))]
async fn host_is_there() -> bool {
    let device = USB_DEVICE::regs();
    device.int_clr().write(|w| w.sof().clear_bit_by_one());
    embassy_time::Timer::after_millis(10).await;
    device.int_raw().read().sof().bit_is_set()
}
