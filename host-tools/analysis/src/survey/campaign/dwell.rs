//! What a node receives at a point, from its first message until the dwell is long enough, in the node's own time.

use baliza_report::mean;
use std::collections::BTreeMap;

use positioning_core::ble::signal::rssi;

/// A received advert.
#[derive(Clone, Debug, PartialEq)]
pub struct Advert {
    /// The beacon that sent it.
    pub beacon: String,
    /// Its RSSI, dBm.
    pub rssi_dbm: f64,
    /// When it was received, seconds since the dwell began.
    pub t_s: f64,
}

/// A dwell at a point.
#[derive(Clone, Debug)]
pub struct Dwell {
    from_s: Option<f64>,
    /// Its length, seconds.
    pub length_s: f64,
    /// The received adverts.
    pub adverts: Vec<Advert>,
    /// Number of adverts with an RSSI that no receiver can have measured.
    pub refused: usize,
    now_s: f64,
}

impl Dwell {
    /// A dwell of this length; it begins at `from_s`, or with the first message.
    pub fn new(from_s: Option<f64>, length_s: f64) -> Self {
        Self { from_s, length_s, adverts: Vec::new(), refused: 0, now_s: 0.0 }
    }

    /// A message of any kind was received at that time; returns true once the dwell is over.
    pub fn at(&mut self, t_s: f64) -> bool {
        let since_s = t_s - *self.from_s.get_or_insert(t_s);
        self.now_s = self.now_s.max(since_s);
        since_s >= self.length_s
    }

    /// An advert; it counts if it was received within the dwell.
    pub fn receive(&mut self, t_s: f64, beacon: &str, rssi_dbm: f64) {
        let since_s = t_s - self.from_s.unwrap_or(t_s);
        if !(0.0..self.length_s).contains(&since_s) {
            return;
        }
        match rssi(rssi_dbm) {
            Ok(rssi_dbm) => self.adverts.push(Advert { beacon: beacon.to_owned(), rssi_dbm, t_s: since_s }),
            Err(_) => self.refused += 1,
        }
    }

    /// The adverts of each beacon, in order of time.
    pub fn by_beacon(&self) -> BTreeMap<&str, Vec<(f64, f64)>> {
        let mut beacons: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
        for advert in &self.adverts {
            beacons.entry(&advert.beacon).or_default().push((advert.t_s, advert.rssi_dbm));
        }
        beacons.values_mut().for_each(|adverts| adverts.sort_by(|a, b| a.0.total_cmp(&b.0)));
        beacons
    }

    /// Progress: seconds, and the count and mean RSSI of each beacon.
    pub fn status(&self) -> String {
        let mut text = format!("{:.0} of {:.0} s", self.now_s.min(self.length_s), self.length_s);
        for (beacon, adverts) in self.by_beacon() {
            let mean = mean(adverts.iter().map(|(_, rssi)| *rssi));
            text += &format!(", {beacon}: {} at {mean:.0} dBm", adverts.len());
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::Dwell;

    #[test]
    fn a_stay_begins_with_the_first_message_and_ends_by_the_nodes_time() {
        let mut stay = Dwell::new(None, 10.0);
        assert!(!stay.at(100.0));
        stay.receive(100.5, "1", -60.0);
        stay.receive(101.0, "1", 127.0);
        assert!(!stay.at(109.9));
        stay.receive(109.9, "2", -70.0);
        assert!(stay.at(110.0));
        stay.receive(110.0, "2", -70.0);
        assert_eq!((stay.adverts.len(), stay.refused), (2, 1));
        assert_eq!(stay.status(), "10 of 10 s, 1: 1 at -60 dBm, 2: 1 at -70 dBm");
    }

    #[test]
    fn what_came_before_a_stay_of_a_recording_is_not_its() {
        let mut stay = Dwell::new(Some(50.0), 10.0);
        assert!(!stay.at(49.0));
        stay.receive(49.0, "1", -60.0);
        stay.receive(50.0, "1", -60.0);
        assert_eq!(stay.adverts.len(), 1);
    }
}
