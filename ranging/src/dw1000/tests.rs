//! Tests of the driver on the bus's bytes.
