//! What every node has in common above its board: settings from the record, the journal (telemetry and log), crash reports, supervision.
#![no_std]
#![forbid(unsafe_code)]
