//! The commands of `baliza`, and what its programs share.
//!
//! | module | what is in it |
//! |---|---|
//! | [`cli`] | the commands, one file each; the frame of a program: errors, help, JSON, progress |
//! | [`simulate`] | what `baliza simulate` writes |
//! | [`wizard`] | guides a person through a survey of fingerprints |
//!
//! What the commands compute with is in the packages beside this one: `recording` (files), `analysis` (positions,
//! models), `node-link` (nodes), `pictures`, `foxglove`. These do not read arguments and do not print.
#![forbid(unsafe_code)]

pub mod cli;
pub mod simulate;
pub mod wizard;
