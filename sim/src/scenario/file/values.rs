//! The values of a scenario's keys: numbers that are checked against their ranges.

use std::fmt::Display;

use positioning_core::Method;
use ranging::native::Scheme;
use serde::Deserialize;
use serde::de::Deserializer;

use crate::board::BoardProfile;

/// The name of the default method.
const TRACK: &str = "track";

/// An error that `baliza_report::explain` completes with the key and its value.
fn must_be<E: serde::de::Error>(what: impl Display) -> E {
    E::custom(format!("invalid value: of the key, expected {what}"))
}

/// The error of a name that is none of these, for `baliza_report::explain`.
fn no_such<E: serde::de::Error>(name: &str, names: impl IntoIterator<Item = &'static str>) -> E {
    let names: Vec<_> = names.into_iter().map(|name| format!("`{name}`")).collect();
    E::custom(format!("unknown variant `{name}`, expected one of {}", names.join(", ")))
}

/// A number that passes the check. The error says what the number must be.
fn number<'de, D: Deserializer<'de>>(from: D, what: &str, passes: impl Fn(f64) -> bool) -> Result<f64, D::Error> {
    let value = f64::deserialize(from)?;
    if passes(value) { Ok(value) } else { Err(must_be(what)) }
}

/// The largest number without a range of its own: seconds (eleven days), metres per second, metres, decibels.
const MOST: f64 = 1.0e6;

fn at_most<E: serde::de::Error>(value: f64, most: f64) -> Result<f64, E> {
    if value <= most { Ok(value) } else { Err(must_be(format_args!("at most {most}"))) }
}

pub(super) fn positive<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    at_most(number(from, "a positive number", |x| x > 0.0)?, MOST)
}

/// How many times slower than estimated a processor is. Far beyond, durations do not fit into the clock.
pub(super) fn slowdown<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    at_most(number(from, "a positive number", |x| x > 0.0)?, 1000.0)
}

pub(super) fn optional_slowdown<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    slowdown(from).map(Some)
}

pub(super) fn board<'de, D: Deserializer<'de>>(from: D) -> Result<BoardProfile, D::Error> {
    let name = String::deserialize(from)?;
    BoardProfile::named(&name).ok_or_else(|| no_such(&name, BoardProfile::ALL.map(|board| board.name)))
}

pub(super) fn optional_board<'de, D: Deserializer<'de>>(from: D) -> Result<Option<BoardProfile>, D::Error> {
    board(from).map(Some)
}

pub(super) fn not_negative<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    at_most(number(from, "zero or a positive number", |x| x >= 0.0)?, MOST)
}

pub(super) fn level<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    number(from, "a level from -127 to 20 dBm", |x| (-127.0..=20.0).contains(&x))
}

pub(super) fn decibels<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    number(from, "from -50 to 50 dB", |x| (-50.0..=50.0).contains(&x))
}

pub(super) fn probability<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    number(from, "a probability from 0 to 1", |x| (0.0..=1.0).contains(&x))
}

pub(super) fn clock_offset<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    number(from, "a clock's offset from 0 to 100 millionths", |x| (0.0..=100.0).contains(&x))
}

pub(super) fn optional_rate<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    number(from, "a rate from 0.01 to 1000 Hz", |x| (0.01..=1000.0).contains(&x)).map(Some)
}

pub(super) fn optional_antenna_delay<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    number(from, "from 0 to 65535 ticks", |x| (0.0..=65_535.0).contains(&x)).map(Some)
}

pub(super) fn optional_finite<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f32>, D::Error> {
    number(from, "a height within 10 km", |x| x.abs() <= 1e4).map(|x| Some(x as f32))
}

pub(super) fn anchors_per_round<'de, D: Deserializer<'de>>(from: D) -> Result<u8, D::Error> {
    let count = u8::deserialize(from)?;
    if (1..=8).contains(&count) { Ok(count) } else { Err(must_be("from 1 to 8")) }
}

pub(super) fn scheme<'de, D: Deserializer<'de>>(from: D) -> Result<Scheme, D::Error> {
    let name = String::deserialize(from)?;
    let scheme = wire::config::Scheme::from_name(&name);
    scheme.map(Scheme::from).ok_or_else(|| no_such(&name, wire::config::Scheme::ALL.map(wire::config::Scheme::name)))
}

pub(super) fn method<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Method>, D::Error> {
    let name = String::deserialize(from)?;
    if name == TRACK {
        return Ok(None);
    }
    let methods = Method::ALL.iter().map(|method| method.as_str());
    name.parse().map(Some).map_err(|_| no_such(&name, std::iter::once(TRACK).chain(methods)))
}

pub(super) fn place<'de, D: Deserializer<'de>, const N: usize>(from: D) -> Result<[f64; N], D::Error>
where
    [f64; N]: Deserialize<'de>,
{
    within_reach(<[f64; N]>::deserialize(from)?)
}

pub(super) fn optional_place<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f64; 3]>, D::Error> {
    place(from).map(Some)
}

pub(super) fn places<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<[f64; 3]>, D::Error> {
    Vec::<[f64; 3]>::deserialize(from)?.into_iter().map(within_reach).collect()
}

/// Frames carry millimetres in 24 bits, which reach 8388 m.
fn within_reach<const N: usize, E: serde::de::Error>(place: [f64; N]) -> Result<[f64; N], E> {
    let is_within = |x: &f64| x.abs() <= 8388.0;
    if place.iter().all(is_within) { Ok(place) } else { Err(must_be("coordinates within 8388 m")) }
}
