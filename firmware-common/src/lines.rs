//! Which rounds get a line in the log.

/// The least time from the line of one round to that of the next, microseconds. A person cannot read more lines, and no
/// interrupt is served while a line is written. Telemetry has every round.
const FIX_LINE_US: u64 = 40_000;

/// Decides which rounds get a line.
#[derive(Debug, Default)]
pub struct LinePace {
    last_us: Option<u64>,
}

impl LinePace {
    /// The state before the first line.
    pub const fn new() -> Self {
        Self { last_us: None }
    }

    /// Whether the round at `t_us`, microseconds, gets a line.
    pub fn is_due(&mut self, t_us: u64) -> bool {
        let due = self.last_us.is_none_or(|last_us| t_us.saturating_sub(last_us) >= FIX_LINE_US);
        if due {
            self.last_us = Some(t_us);
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_rounds_some_get_a_line_and_of_few_each() {
        let lines = |every_us: u64| {
            let mut pace = LinePace::new();
            (0..1_000_000).step_by(every_us as usize).filter(|t_us| pace.is_due(*t_us)).count()
        };
        // 400 rounds a second: a line every 40 ms. 20 rounds a second: a line for each.
        assert_eq!((lines(2_500), lines(50_000)), (25, 20));
    }
}
