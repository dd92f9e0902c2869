//! The fuzz targets of `baliza_fuzz::nodes`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: baliza_fuzz::choose(&baliza_fuzz::nodes::TARGETS), |input: &[u8]| baliza_fuzz::run(input));
