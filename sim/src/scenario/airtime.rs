//! How much of the time the frames of a network are on the air.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use crate::air::PortId;
use crate::{TrueTime, World};

/// The time at which at least one frame of a network was on the air.
#[derive(Clone, Copy, Debug, Default)]
struct Busy {
    /// The end of the last frame.
    until: TrueTime,
    picoseconds: u64,
}

impl Busy {
    /// Adds a frame. Frames of a network have one PHY: their RMARKERs, in whose order they come, are in the order of
    /// their starts.
    fn add(&mut self, start: TrueTime, end: TrueTime) {
        let new = start.max(self.until);
        if end > new {
            self.picoseconds += end.ps_since(new);
            self.until = end;
        }
    }

    /// The share of the time up to now.
    fn share(&self, now: TrueTime) -> f64 {
        // The last frame may still be on the air.
        let ahead = if self.until > now { self.until.ps_since(now) } else { 0 };
        let passed = now.ps_since(TrueTime::default());
        if passed > 0 { self.picoseconds.saturating_sub(ahead) as f64 / passed as f64 } else { 0.0 }
    }
}

/// The airtime of every network.
pub(super) struct Airtime(Rc<RefCell<Vec<Busy>>>);

impl Airtime {
    /// Listens to the frames from now on. `networks` has the index of each sender's network.
    pub(super) fn of(world: &World, networks: HashMap<PortId, usize>) -> Self {
        // Networks without a node have no air.
        let mut used: Vec<usize> = networks.values().copied().collect();
        used.sort_unstable();
        used.dedup();
        let place = |network: usize| used.iter().position(|known| *known == network);
        let places: HashMap<PortId, usize> =
            networks.into_iter().filter_map(|(port, network)| Some((port, place(network)?))).collect();
        let busy = Rc::new(RefCell::new(vec![Busy::default(); used.len()]));
        let heard = busy.clone();
        world.sniff(move |frame| {
            let mut heard = heard.borrow_mut();
            if let Some(busy) = places.get(&frame.sender).and_then(|place| heard.get_mut(*place)) {
                busy.add(frame.start, frame.end);
            }
        });
        Self(busy)
    }

    /// For each network with nodes, the share of the time up to now at which a frame was on its air.
    pub(super) fn shares(&self, now: TrueTime) -> Vec<f64> {
        self.0.borrow().iter().map(|busy| busy.share(now)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_overlap_count_once_and_the_future_not_at_all() {
        let at = |ms: f64| TrueTime::from_secs_f64(ms * 1e-3);
        let mut busy = Busy::default();
        // 1 to 3 ms, 2 to 4 ms and within them 2.5 to 3.5 ms: 3 ms. Then 6 to 8 ms, of which 1 ms has passed at 7 ms.
        for (start, end) in [(1.0, 3.0), (2.0, 4.0), (2.5, 3.5), (6.0, 8.0)] {
            busy.add(at(start), at(end));
        }
        assert!((busy.share(at(7.0)) - 4.0 / 7.0).abs() < 1e-9);
        assert!((busy.share(at(10.0)) - 0.5).abs() < 1e-9);
        assert_eq!(Busy::default().share(at(0.0)), 0.0);
    }
}
