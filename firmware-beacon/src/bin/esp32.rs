//! The beacon on an ESP32.
#![no_std]
#![no_main]

#[path = "esp/beacon.rs"]
mod beacon;

boards::esp_entry!(beacon::start);
