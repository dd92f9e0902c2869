//! What counts as worth an alarm.

use std::time::Duration;

use clap::ValueEnum;
use station_core::state::{Alarms, StateLimits};

use host_tools::cli::numbers::positive;

/// The limits of events, and which of them are alarms.
#[derive(clap::Args)]
pub struct Limiting {
    /// A tag that does not report for this time is silent, seconds
    #[arg(long, value_name = "S", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    silent_s: u64,
    /// Positions by ranges with a greater standard deviation are uncertain, metres
    #[arg(long, value_name = "M", default_value_t = StateLimits::default().uncertain_m, value_parser = positive)]
    uncertain_m: f64,
    /// The same of positions by RSSI alone, metres
    #[arg(long, value_name = "M", default_value_t = StateLimits::default().uncertain_rssi_m, value_parser = positive)]
    uncertain_rssi_m: f64,
    /// An anchor with a greater mean residual was moved, metres
    #[arg(long, value_name = "M", default_value_t = StateLimits::default().moved_m, value_parser = positive)]
    moved_m: f64,
    /// The supply of a node is low below this voltage, volts
    #[arg(long, value_name = "V", default_value_t = StateLimits::default().low_supply_v, value_parser = positive)]
    low_supply_v: f64,
    /// Events that are no alarms; all of these kinds are, and a zone's entry as the zone says
    #[arg(long, value_name = "KINDS", value_delimiter = ',')]
    no_alarm: Vec<Kind>,
}

/// The kinds of events that are alarms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    Silent,
    Moved,
    Uncertain,
    LowSupply,
    Refusals,
}

impl Limiting {
    /// The limits of the live state.
    pub fn limits(&self) -> StateLimits {
        let is_alarm = |kind| !self.no_alarm.contains(&kind);
        StateLimits {
            silent_after: Duration::from_secs(self.silent_s),
            uncertain_m: self.uncertain_m,
            uncertain_rssi_m: self.uncertain_rssi_m,
            moved_m: self.moved_m,
            low_supply_v: self.low_supply_v,
            alarms: Alarms {
                silent: is_alarm(Kind::Silent),
                moved: is_alarm(Kind::Moved),
                uncertain: is_alarm(Kind::Uncertain),
                low_supply: is_alarm(Kind::LowSupply),
                refusals: is_alarm(Kind::Refusals),
            },
            ..StateLimits::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        limiting: Limiting,
    }

    #[test]
    fn each_flag_sets_its_limit() {
        let limits = |arguments: &str| Command::parse_from(arguments.split(' ')).limiting.limits();
        assert_eq!(limits("serve"), StateLimits::default());
        let given = limits("serve --uncertain-m 1 --uncertain-rssi-m 2 --moved-m 4 --low-supply-v 5 --silent-s 6");
        assert_eq!(
            given,
            StateLimits {
                silent_after: Duration::from_secs(6),
                uncertain_m: 1.0,
                uncertain_rssi_m: 2.0,
                moved_m: 4.0,
                low_supply_v: 5.0,
                ..StateLimits::default()
            }
        );
    }
}
