//! The values of keys that only a simulation has: numbers that are checked against their ranges. Each function serves
//! for a key and for an optional key.

use std::fmt::Display;

use positioning_core::Method;
use serde::Deserialize;
use serde::de::{Deserializer, Error as _};

use crate::document::choice;

/// The largest number without a range of its own: seconds (eleven days), metres per second, metres, decibels.
const MOST: f64 = 1.0e6;
/// The slowest processor. Far beyond, durations do not fit into the clock.
const SLOWEST: f64 = 1000.0;

/// A list of exactly N numbers. An array of `serde` would drop what a longer list has more.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exactly<T, const N: usize>(pub(crate) [T; N]);

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for Exactly<T, N> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let list = Vec::<T>::deserialize(from)?;
        let length = list.len();
        let must = format!("an array of length {N}");
        list.try_into().map(Self).map_err(|_| D::Error::invalid_length(length, &must.as_str()))
    }
}

/// An error that `baliza_report::explain` completes with the key and its value.
fn must_be<E: serde::de::Error>(what: impl Display) -> E {
    E::custom(format!("invalid value: of the key, expected {what}"))
}

/// A number that passes the check. The error says what the number must be.
fn number<'de, D: Deserializer<'de>>(from: D, what: &str, passes: impl Fn(f64) -> bool) -> Result<f64, D::Error> {
    let value = f64::deserialize(from)?;
    if passes(value) { Ok(value) } else { Err(must_be(what)) }
}

fn at_most<T: From<f64>, E: serde::de::Error>(value: f64, most: f64) -> Result<T, E> {
    if value <= most { Ok(value.into()) } else { Err(must_be(format_args!("at most {most}"))) }
}

pub(crate) fn positive<'de, D: Deserializer<'de>, T: From<f64>>(from: D) -> Result<T, D::Error> {
    at_most(number(from, "a positive number", |x| x > 0.0)?, MOST)
}

pub(crate) fn slowdown<'de, D: Deserializer<'de>, T: From<f64>>(from: D) -> Result<T, D::Error> {
    at_most(number(from, "a positive number", |x| x > 0.0)?, SLOWEST)
}

pub(crate) fn not_negative<'de, D: Deserializer<'de>, T: From<f64>>(from: D) -> Result<T, D::Error> {
    at_most(number(from, "zero or a positive number", |x| x >= 0.0)?, MOST)
}

/// How many nodes a table stands for: addresses are sixteen bits, and a file must not ask for all memory.
pub(crate) fn count<'de, D: Deserializer<'de>>(from: D) -> Result<u16, D::Error> {
    let count = u16::deserialize(from)?;
    if (1..=4096).contains(&count) { Ok(count) } else { Err(must_be("from 1 to 4096")) }
}

pub(crate) fn rssi<'de, D: Deserializer<'de>, T: From<f64>>(from: D) -> Result<T, D::Error> {
    number(from, "from -127 to 20 dBm", |x| (-127.0..=20.0).contains(&x)).map(T::from)
}

pub(crate) fn decibels<'de, D: Deserializer<'de>, T: From<f64>>(from: D) -> Result<T, D::Error> {
    number(from, "from -50 to 50 dB", |x| (-50.0..=50.0).contains(&x)).map(T::from)
}

pub(crate) fn probability<'de, D: Deserializer<'de>, T: From<f64>>(from: D) -> Result<T, D::Error> {
    number(from, "a probability from 0 to 1", |x| (0.0..=1.0).contains(&x)).map(T::from)
}

pub(crate) fn clock_offset<'de, D: Deserializer<'de>, T: From<f64>>(from: D) -> Result<T, D::Error> {
    number(from, "a clock's offset from 0 to 100 millionths", |x| (0.0..=100.0).contains(&x)).map(T::from)
}

pub(crate) fn antenna_delay<'de, D: Deserializer<'de>, T: From<f64>>(from: D) -> Result<T, D::Error> {
    number(from, "from 0 to 65535 ticks", |x| (0.0..=65_535.0).contains(&x)).map(T::from)
}

/// A method by which each round is solved by itself; `None`: `track`, as a tag does.
pub(crate) fn method<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Method>, D::Error> {
    let all: Vec<Option<Method>> = std::iter::once(None).chain(Method::ALL.map(Some)).collect();
    choice(from, &all, |method| method.map_or("track", Method::as_str))
}

pub(crate) fn position<'de, D: Deserializer<'de>, const N: usize>(from: D) -> Result<[f64; N], D::Error> {
    within_reach(Exactly::deserialize(from)?.0)
}

pub(crate) fn path<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<[f64; 3]>>, D::Error> {
    let points = Vec::<Exactly<f64, 3>>::deserialize(from)?;
    if points.is_empty() {
        return Err(must_be("a list of at least one point"));
    }
    points.into_iter().map(|Exactly(point)| within_reach(point)).collect::<Result<_, _>>().map(Some)
}

/// Frames carry millimetres in 24 bits, which reach 8388 m.
fn within_reach<const N: usize, E: serde::de::Error>(position: [f64; N]) -> Result<[f64; N], E> {
    let is_within = |x: &f64| x.abs() <= 8388.0;
    if position.iter().all(is_within) { Ok(position) } else { Err(must_be("coordinates within 8388 m")) }
}
