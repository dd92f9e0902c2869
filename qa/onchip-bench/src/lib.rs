//! Measures the cost of the positioning methods on the chip.
//!
//! The bare-metal images in `src/bin/` run in QEMU and print their results through semihosting, or are only linked for
//! their size. `cargo xtask promises chip` builds them, runs them and remakes their tables. This library has what the
//! images share with the desktop: [`cases`], with the same samples bit for bit, so that results can be compared. With
//! the feature `image` it also has what the images share with each other: the `instrument` that counts instructions and
//! stack.
//!
//! An image prints lines of words. A call has the words that name it, the instructions and the bytes of stack that it
//! takes, and its results: the bits of an `f32` each, in hexadecimal.
//!
//! ```text
//! calibration NAME INSTRUCTIONS                     a stretch of 1000 instructions: the counter's check
//! solve METHOD DIMS ANCHORS EPOCH : INSTRUCTIONS STACK : X Y [Z]
//! solve METHOD DIMS ANCHORS EPOCH REASON : INSTRUCTIONS STACK :
//! root LIBRARY ARGUMENT : INSTRUCTIONS STACK : ROOT
//! step VARIANT ROOT_OF : INSTRUCTIONS STACK : X Y
//! frame NAME BYTES : INSTRUCTIONS STACK :
//! engine WHAT DIMS ANCHORS : INSTRUCTIONS STACK : X Y Z
//! nlos WHAT : INSTRUCTIONS STACK : VALUE
//! beacons WHAT : INSTRUCTIONS STACK : VALUE
//! range PEER METRES                                 of the round of frames
//! cost WHAT INSTRUCTIONS                            a mean: a row of `sim/src/costs.csv`
//! done                                              nothing is missing
//! ```
#![no_std]
#![deny(unsafe_code)]

pub mod beacons;
pub mod cases;
#[cfg(all(feature = "image", feature = "costs"))]
pub mod costs;
#[cfg(feature = "image")]
pub mod instrument;
pub mod response;
pub mod rooms;
pub mod step;
pub mod walk;
