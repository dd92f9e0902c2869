//! The supply voltage of a node, and whether it is low.

/// A node's supply is no longer low when it is this much above the limit, volts: a radio's converter has steps of 6 mV,
/// and a battery recovers a little between loads.
const RECOVERED_V: f64 = 0.1;

/// The supply of a node.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Supply {
    pub(super) volts: Option<f64>,
    is_low: bool,
}

impl Supply {
    /// Takes a voltage. Returns whether the supply is low from now on.
    pub(super) fn take(&mut self, volts: f64, low_v: f64) -> bool {
        self.volts = Some(volts);
        let was_low = self.is_low;
        self.is_low = volts < if was_low { low_v + RECOVERED_V } else { low_v };
        self.is_low && !was_low
    }
}

#[cfg(test)]
mod tests {
    use super::Supply;

    #[test]
    fn a_supply_becomes_low_once_until_it_has_recovered() {
        let mut supply = Supply::default();
        let steps = [(3.3, false), (2.91, false), (2.89, true), (2.85, false), (2.95, false), (2.89, false)];
        for (volts, is_news) in steps.into_iter().chain([(3.05, false), (2.89, true)]) {
            assert_eq!(supply.take(volts, 2.9), is_news, "{volts}");
        }
        assert_eq!(supply.volts, Some(2.89));
    }
}
