//! The anchor on an ESP32-C3.
#![no_std]
#![no_main]

#[path = "esp/anchor.rs"]
mod anchor;

boards::esp_entry!(anchor::start);
