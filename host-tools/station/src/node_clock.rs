//! From a node's clock to the host's.

use station_core::Utc;

/// The rate at which the mapping may be too late, parts of a second per second: twice the error of a crystal. A node's
/// clock that runs slower than the host's makes the smallest delay grow at no more than this rate.
const DRIFT: f64 = 50e-6;
/// A message that is delayed by more than this is of a clock that has jumped, or of a computer that was suspended.
const JUMP_S: f64 = 5.0;

/// Maps the time line of a node to UTC. A message arrives after a delay, so the smallest difference between arrival
/// and node time is the best estimate of the offset (Mills, RFC 5905, section 10, the clock filter).
#[derive(Clone, Copy, Debug, Default)]
pub struct NodeClock {
    /// The offset, microseconds, and the node's time when it was last estimated, seconds.
    offset: Option<(f64, f64)>,
}

impl NodeClock {
    /// When a message was sent that has arrived at `arrived`: `t_s` is its time on the node's time line, seconds.
    pub fn utc(&mut self, t_s: f64, arrived: Utc) -> Utc {
        let measured = arrived.us() as f64 - t_s * 1e6;
        let offset = match self.offset {
            Some((offset, at_s)) => {
                let drifted = offset + (t_s - at_s).max(0.0) * DRIFT * 1e6;
                if (measured - drifted).abs() > JUMP_S * 1e6 { measured } else { drifted.min(measured) }
            }
            None => measured,
        };
        self.offset = Some((offset, t_s));
        Utc::clamped((t_s * 1e6 + offset).round() as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: f64) -> Utc {
        Utc::clamped((1e15 + s * 1e6) as i64)
    }

    #[test]
    fn delays_of_the_line_are_taken_out() {
        let mut clock = NodeClock::default();
        // The node started 3 s after the host's mark; messages arrive after 1, 80 and 2 ms.
        assert_eq!(clock.utc(10.0, at(13.001)), at(13.001));
        assert_eq!(clock.utc(10.1, at(13.18)).since(at(13.1)).as_micros(), 1005);
        assert_eq!(clock.utc(10.2, at(13.202)).since(at(13.2)).as_micros(), 1010);
    }

    #[test]
    fn a_clock_that_jumps_is_followed() {
        let mut clock = NodeClock::default();
        clock.utc(10.0, at(13.0));
        assert_eq!(clock.utc(11.0, at(3600.0)), at(3600.0));
        assert_eq!(clock.utc(12.0, at(1.0)), at(1.0));
    }
}
