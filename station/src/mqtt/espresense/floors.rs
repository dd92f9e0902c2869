//! On which floor a device is: that of the receiver that receives it best.

use std::collections::HashMap;
use std::time::Duration;

use crate::Utc;

/// What a receiver said counts for this time.
const FRESH: Duration = Duration::from_secs(15);
/// Another floor counts when its RSSI is better by this, dB.
const BETTER_DB: f64 = 6.0;
/// A device that is not received for this time is forgotten where there are too many.
const FORGOTTEN: Duration = Duration::from_secs(600);
/// The most devices.
const MOST: usize = 10_000;

/// The devices of a house.
#[derive(Debug, Default)]
pub(super) struct Floors {
    devices: HashMap<String, Device>,
}

/// A device.
#[derive(Debug)]
struct Device {
    floor: usize,
    last: Utc,
    /// By floor: the best RSSI of the last time, and when it was.
    best: HashMap<usize, (f64, Utc)>,
    name: Option<String>,
}

impl Floors {
    /// Notes that receivers on `floors` received a device. Returns its floor, and whether its name is a new one; none
    /// where there are too many devices.
    pub(super) fn note(
        &mut self,
        device: &str,
        name: Option<&str>,
        floors: &[usize],
        rssi_dbm: f64,
        t: Utc,
    ) -> Option<(usize, bool)> {
        if !self.devices.contains_key(device) {
            if self.devices.len() >= MOST {
                self.devices.retain(|_, device| t.since(device.last) < FORGOTTEN);
            }
            if self.devices.len() >= MOST {
                return None;
            }
            let floor = *floors.first()?;
            let new = Device { floor, last: t, best: HashMap::new(), name: None };
            self.devices.insert(device.to_owned(), new);
        }
        let device = self.devices.get_mut(device)?;
        device.last = t;
        device.best.retain(|_, (_, at)| t.since(*at) < FRESH);
        for floor in floors {
            let best = device.best.entry(*floor).or_insert((rssi_dbm, t));
            if rssi_dbm >= best.0 {
                *best = (rssi_dbm, t);
            }
        }
        let here_dbm = device.best.get(&device.floor).map_or(f64::NEG_INFINITY, |(dbm, _)| *dbm);
        let best = device.best.iter().max_by(|(_, (one, _)), (_, (other, _))| one.total_cmp(other));
        if let Some((floor, (dbm, _))) = best
            && *dbm >= here_dbm + BETTER_DB
        {
            device.floor = *floor;
        }
        let is_new = name.is_some() && device.name.as_deref() != name;
        if is_new {
            device.name = name.map(str::to_owned);
        }
        Some((device.floor, is_new))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: u64) -> Utc {
        Utc::clamped(1_000_000_000_000_000) + Duration::from_secs(s)
    }

    #[test]
    fn a_device_changes_floors_when_another_one_receives_it_clearly_better() {
        let mut floors = Floors::default();
        let mut floor =
            |floor: usize, dbm: f64, s: u64| floors.note("phone", None, &[floor], dbm, at(s)).expect("few").0;
        assert_eq!(floor(0, -60.0, 0), 0);
        // Through the ceiling, better by less than 6 dB.
        assert_eq!(floor(1, -56.0, 1), 0);
        assert_eq!(floor(1, -54.0, 2), 1);
        // What the old floor said is fresh until it is 15 s old.
        assert_eq!(floor(0, -49.0, 3), 1);
        assert_eq!(floor(0, -80.0, 16), 1);
        assert_eq!(floor(0, -58.0, 40), 0);
    }

    #[test]
    fn a_name_is_new_once() {
        let mut floors = Floors::default();
        let mut is_new = |name: Option<&str>| floors.note("phone", name, &[0], -60.0, at(0)).expect("few").1;
        assert_eq!(
            [None, Some("Ana"), Some("Ana"), None, Some("Eva")].map(&mut is_new),
            [false, true, false, false, true]
        );
    }

    #[test]
    fn the_number_of_devices_is_bounded_and_silent_ones_make_room() {
        let mut floors = Floors::default();
        for device in 0..MOST {
            assert!(floors.note(&device.to_string(), None, &[0], -60.0, at(0)).is_some());
        }
        assert_eq!(floors.note("one more", None, &[0], -60.0, at(599)), None);
        assert!(floors.note("one more", None, &[0], -60.0, at(600)).is_some());
    }
}
