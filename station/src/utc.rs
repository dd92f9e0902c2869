//! Instants of the world's clock.

use std::fmt;
use std::str::FromStr;
use std::time::{Duration, SystemTime};

use jiff::Timestamp;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Microseconds since 1970-01-01T00:00:00Z. As text it is RFC 3339 in UTC: `2026-11-22T21:27:01.25Z`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Utc(i64);

/// A text is no instant in RFC 3339 between the years 1970 and 2200.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no time in RFC 3339, such as 2026-11-22T21:27:01Z")]
pub struct NoUtc(String);

impl Utc {
    /// The beginning of the year 2200.
    const END_US: i64 = 7_258_118_400_000_000;

    /// The current instant of the host's clock, within the years that are allowed.
    pub fn now() -> Self {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        Self::clamped(i64::try_from(since.as_micros()).unwrap_or(i64::MAX))
    }

    /// An instant from microseconds since 1970; the nearest one that is allowed.
    pub fn clamped(us: i64) -> Self {
        Self(us.clamp(0, Self::END_US))
    }

    /// Microseconds since 1970.
    pub fn us(self) -> i64 {
        self.0
    }

    /// An instant from milliseconds since 1970; the nearest one that is allowed.
    pub(crate) fn of_ms(ms: i64) -> Self {
        Self::clamped(ms.saturating_mul(1000))
    }

    /// Milliseconds since 1970, rounded down, as positions are stored.
    pub(crate) fn ms(self) -> i64 {
        self.0 / 1000
    }

    /// Date and time of day, UTC.
    pub(crate) fn civil(self) -> jiff::civil::DateTime {
        // Only instants outside the years -9999 to 9999 are errors.
        let t = Timestamp::from_microsecond(self.0).unwrap_or_default();
        jiff::tz::Offset::UTC.to_datetime(t)
    }

    /// The time from `earlier` to here; zero where `earlier` is later.
    pub fn since(self, earlier: Self) -> Duration {
        Duration::from_micros(u64::try_from(self.0.saturating_sub(earlier.0)).unwrap_or(0))
    }
}

impl std::ops::Add<Duration> for Utc {
    type Output = Self;

    fn add(self, duration: Duration) -> Self {
        Self::clamped(self.0.saturating_add(i64::try_from(duration.as_micros()).unwrap_or(i64::MAX)))
    }
}

impl std::ops::Sub<Duration> for Utc {
    type Output = Self;

    fn sub(self, duration: Duration) -> Self {
        Self::clamped(self.0.saturating_sub(i64::try_from(duration.as_micros()).unwrap_or(i64::MAX)))
    }
}

impl fmt::Display for Utc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Timestamp::from_microsecond(self.0).map_err(|_| fmt::Error)?.fmt(f)
    }
}

impl FromStr for Utc {
    type Err = NoUtc;

    fn from_str(text: &str) -> Result<Self, NoUtc> {
        let us = text.parse::<Timestamp>().map_err(|_| NoUtc(text.to_owned()))?.as_microsecond();
        if (0..=Self::END_US).contains(&us) { Ok(Self(us)) } else { Err(NoUtc(text.to_owned())) }
    }
}

impl Serialize for Utc {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Utc {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.parse().map_err(serde::de::Error::custom)
    }
}

impl utoipa::PartialSchema for Utc {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::schema::Schema> {
        use utoipa::openapi::schema::{KnownFormat, ObjectBuilder, SchemaFormat, Type};
        ObjectBuilder::new()
            .schema_type(Type::String)
            .format(Some(SchemaFormat::KnownFormat(KnownFormat::DateTime)))
            .description(Some("RFC 3339, in UTC"))
            .into()
    }
}

impl utoipa::ToSchema for Utc {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_written_in_rfc_3339() {
        // 20,000 days of 86,400 s after 1970 is 2024-10-04.
        assert_eq!(Utc::clamped(20_000 * 86_400 * 1_000_000 + 250_000).to_string(), "2024-10-04T00:00:00.25Z");
    }

    #[test]
    fn offsets_are_read_and_years_far_away_refused() {
        assert_eq!("2024-10-04T02:00:00+02:00".parse(), Ok(Utc::clamped(20_000 * 86_400 * 1_000_000)));
        for wrong in ["", "yesterday", "1969-12-31T23:59:59Z", "2201-01-01T00:00:00Z", "2024-10-04"] {
            assert_eq!(wrong.parse::<Utc>(), Err(NoUtc(wrong.to_owned())));
        }
    }
}
