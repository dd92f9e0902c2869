//! The boards, one module each: clocks, pins, buses, flash, watchdog, what a reset left behind.
#![no_std]
