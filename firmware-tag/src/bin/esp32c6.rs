//! The tag on an ESP32-C6.
#![no_std]
#![no_main]

#[path = "esp/tag.rs"]
mod tag;

boards::esp_entry!(tag::start);
