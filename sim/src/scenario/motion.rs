//! A walk through way-points at constant speed that begins at once or later.

/// Way-points and a speed, which give a node's position at any time.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    points: Vec<[f64; 3]>,
    /// The time at which each point is reached, seconds. A closed walk has one more time, for the return to the first
    /// point.
    times: Vec<f64>,
    closed: bool,
    /// When it begins, seconds.
    leaves_s: f64,
    /// How far along it begins, seconds.
    ahead_s: f64,
}

impl Walk {
    /// A walk through `points`, metres, at `speed_m_s`. A closed walk returns to the first point and goes round for
    /// ever; an open one stops at the last point. `None` without points, or with a speed that is not positive.
    pub fn new(points: Vec<[f64; 3]>, speed_m_s: f64, closed: bool) -> Option<Self> {
        let first = *points.first()?;
        if speed_m_s.is_nan() || speed_m_s <= 0.0 {
            return None;
        }
        let closed = closed && points.len() > 1;
        let mut times = vec![0.0];
        let (mut time, mut last) = (0.0, first);
        for &point in points.iter().skip(1).chain(closed.then_some(&first)) {
            time += distance(last, point) / speed_m_s;
            times.push(time);
            last = point;
        }
        Some(Self { points, times, closed, leaves_s: 0.0, ahead_s: 0.0 })
    }

    /// A node that stays at one point.
    pub fn standing(point: [f64; 3]) -> Self {
        Self { points: vec![point], times: vec![0.0], closed: false, leaves_s: 0.0, ahead_s: 0.0 }
    }

    /// The same walk, begun at `leaves_s`; before, the node stays at the first point.
    pub fn leaving_at(self, leaves_s: f64) -> Self {
        Self { leaves_s, ..self }
    }

    /// The same walk, begun at this part of its way.
    pub fn ahead(self, part: f64) -> Self {
        let ahead_s = part * self.times.last().copied().unwrap_or(0.0);
        Self { ahead_s, ..self }
    }

    /// The position after `seconds`.
    pub fn at(&self, seconds: f64) -> [f64; 3] {
        let seconds = (seconds - self.leaves_s).max(0.0) + self.ahead_s;
        let lap = self.times.last().copied().unwrap_or(0.0);
        let along = if self.closed && lap > 0.0 { seconds.rem_euclid(lap) } else { seconds };
        let next = self.times.partition_point(|&time| time <= along).max(1);
        let from = self.points[next - 1];
        let Some(&arrival) = self.times.get(next) else { return from };
        let to = self.points[next % self.points.len()];
        let part = (along - self.times[next - 1]) / (arrival - self.times[next - 1]);
        std::array::from_fn(|axis| from[axis] + part * (to[axis] - from[axis]))
    }

    /// The position, if the walk never leaves it.
    pub fn place(&self) -> Option<[f64; 3]> {
        match self.points[..] {
            [only] => Some(only),
            _ => None,
        }
    }
}

/// Metres between two positions.
pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A right angle: 4 m along x, then 3 m along y, then 5 m back, at 0.5 m/s: corners at 0, 8, 14, 24 s.
    fn triangle(closed: bool) -> Walk {
        Walk::new(vec![[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [4.0, 3.0, 1.0]], 0.5, closed).unwrap()
    }

    #[test]
    fn a_closed_walk_goes_round() {
        let walk = triangle(true);
        for (seconds, place) in [
            (0.0, [0.0, 0.0, 1.0]),
            (4.0, [2.0, 0.0, 1.0]),
            (8.0, [4.0, 0.0, 1.0]),
            (11.0, [4.0, 1.5, 1.0]),
            (19.0, [2.0, 1.5, 1.0]),
            (24.0, [0.0, 0.0, 1.0]),
            (28.0, [2.0, 0.0, 1.0]),
        ] {
            assert!(distance(walk.at(seconds), place) < 1e-9, "{seconds} s: {:?}", walk.at(seconds));
        }
    }

    #[test]
    fn an_open_walk_ends_and_one_point_stands() {
        assert_eq!(triangle(false).at(100.0), [4.0, 3.0, 1.0]);
        assert_eq!(triangle(false).at(14.0), [4.0, 3.0, 1.0]);
        let standing = Walk::new(vec![[1.0, 2.0, 3.0]], 1.0, true).unwrap();
        assert_eq!((standing.at(7.0), standing.place()), ([1.0, 2.0, 3.0], Some([1.0, 2.0, 3.0])));
        assert_eq!(standing, Walk::standing([1.0, 2.0, 3.0]));
        assert_eq!(triangle(true).place(), None);
    }

    #[test]
    fn a_walk_that_begins_later_stands_until_then() {
        let walk = triangle(true).leaving_at(10.0);
        for (seconds, place) in [(0.0, [0.0, 0.0, 1.0]), (10.0, [0.0, 0.0, 1.0]), (14.0, [2.0, 0.0, 1.0])] {
            assert!(distance(walk.at(seconds), place) < 1e-9, "{seconds} s: {:?}", walk.at(seconds));
        }
    }

    #[test]
    fn a_walk_that_begins_in_the_middle_waits_there() {
        let walk = triangle(true).leaving_at(10.0).ahead(0.5);
        // Half of 24 s: 4 s behind the corner at 8 s, and 2 s before the next one.
        for (seconds, place) in [(0.0, [4.0, 2.0, 1.0]), (10.0, [4.0, 2.0, 1.0]), (12.0, [4.0, 3.0, 1.0])] {
            assert!(distance(walk.at(seconds), place) < 1e-9, "{seconds} s: {:?}", walk.at(seconds));
        }
    }

    #[test]
    fn no_points_or_no_speed_is_no_walk() {
        assert_eq!(Walk::new(vec![], 1.0, false), None);
        for speed in [0.0, -1.0, f64::NAN] {
            assert_eq!(Walk::new(vec![[0.0; 3]], speed, false), None);
        }
    }
}
