//! What a tag's motion sensor measures: the acceleration of its path, of the carrier and of the surface that it lies
//! on, and gravity.

use std::cell::RefCell;

use rand::Rng;
use rand_distr::StandardNormal;

use super::{Carrier, Walk, distance};
use crate::random::{Stream, gauss};

/// mg per m/s².
const MG: f64 = 1e3 / 9.806_65;
/// Noise of a sample in low-power mode, mg: an assumption. The data sheet has none for this mode; a digit is 16 mg.
const NOISE_MG: f64 = 5.0;
/// A person reaches walking speed, and turns, within twice this, seconds …
const PERSON_S: f64 = 0.25;
/// … and a trolley that is pushed gently within twice this.
const TROLLEY_S: f64 = 1.0;
/// Steps per second of a walking person, and the amplitude of the trunk's vertical acceleration at 1.2 m/s, m/s². Both
/// are of the order that studies of gait report.
const STEPS_HZ: f64 = 1.9;
const BOUNCE_M_S2: f64 = 2.5;
const BOUNCE_AT_M_S: f64 = 1.2;

/// The acceleration of one tag.
pub(super) struct Feeling {
    walk: Walk,
    carrier: Carrier,
    vibration_mg: f64,
    /// Turns the room's axes into the sensor's.
    orientation: [[f64; 3]; 3],
    random: RefCell<Stream>,
}

impl Feeling {
    /// The acceleration of a tag that lies in a random orientation.
    pub(super) fn new(walk: Walk, carrier: Carrier, vibration_mg: f64, mut random: Stream) -> Self {
        let orientation = orientation(&mut random);
        Self { walk, carrier, vibration_mg, orientation, random: RefCell::new(random) }
    }

    /// The acceleration at a time, mg along the sensor's axes.
    pub(super) fn at(&self, seconds: f64) -> [f64; 3] {
        let mut room = self.along_way(seconds);
        room[2] += self.bounce(seconds) + 1e3 / MG;
        let mut random = self.random.borrow_mut();
        let deviation_mg = self.vibration_mg.hypot(NOISE_MG);
        self.orientation.map(|axis| {
            let along: f64 = axis.iter().zip(room).map(|(turn, value)| turn * value).sum();
            let noise = gauss(&mut *random);
            MG * along + deviation_mg * noise
        })
    }

    /// The acceleration by changes of speed and direction, smoothed and delayed against the path's corners, m/s².
    fn along_way(&self, seconds: f64) -> [f64; 3] {
        let step_s = match self.carrier {
            Carrier::Person => PERSON_S,
            Carrier::Trolley => TROLLEY_S,
        };
        let [now, before, earlier] = [0.0, 1.0, 2.0].map(|steps| self.walk.at(seconds - steps * step_s));
        std::array::from_fn(|axis| (now[axis] - 2.0 * before[axis] + earlier[axis]) / (step_s * step_s))
    }

    /// The vertical acceleration of a walking person, m/s².
    fn bounce(&self, seconds: f64) -> f64 {
        match self.carrier {
            Carrier::Person => {
                let speed = distance(self.walk.at(seconds), self.walk.at(seconds - PERSON_S)) / PERSON_S;
                let share = (speed / BOUNCE_AT_M_S).min(1.0);
                BOUNCE_M_S2 * share * (std::f64::consts::TAU * STEPS_HZ * seconds).sin()
            }
            Carrier::Trolley => 0.0,
        }
    }
}

/// A random rotation, from a unit quaternion.
fn orientation(random: &mut Stream) -> [[f64; 3]; 3] {
    let [w, x, y, z]: [f64; 4] = std::array::from_fn(|_| random.sample(StandardNormal));
    let scale = 2.0 / (w * w + x * x + y * y + z * z);
    [
        [1.0 - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)],
        [scale * (x * y + w * z), 1.0 - scale * (x * x + z * z), scale * (y * z - w * x)],
        [scale * (x * z - w * y), scale * (y * z + w * x), 1.0 - scale * (x * x + y * y)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    fn feeling(walk: Walk, carrier: Carrier, vibration_mg: f64) -> Feeling {
        Feeling::new(walk, carrier, vibration_mg, stream(1, Purpose::MotionSensor, 7))
    }

    /// Mean and standard deviation of the acceleration's magnitude over a time, mg.
    fn size(feeling: &Feeling, from_s: f64, to_s: f64) -> (f64, f64) {
        let count = ((to_s - from_s) * 100.0) as usize;
        let sizes = (0..count).map(|i| feeling.at(from_s + i as f64 / 100.0).iter().map(|a| a * a).sum::<f64>().sqrt());
        let sizes: Vec<f64> = sizes.collect();
        let mean = sizes.iter().sum::<f64>() / count as f64;
        (mean, (sizes.iter().map(|size| (size - mean).powi(2)).sum::<f64>() / count as f64).sqrt())
    }

    fn straight() -> Walk {
        Walk::new(vec![[0.0, 0.0, 1.0], [100.0, 0.0, 1.0]], 1.2, false).unwrap().leaving_at(20.0)
    }

    #[test]
    fn at_rest_there_is_one_g_and_noise_in_any_orientation() {
        let (mean, deviation) = size(&feeling(straight(), Carrier::Person, 0.0), 0.0, 19.0);
        assert!((mean - 1000.0).abs() < 1.0 && (deviation - 5.0).abs() < 0.5, "{mean} ± {deviation}");
        // 60 mg and 5 mg together are √(3600 + 25) = 60.2 mg along gravity.
        let (_, shaken) = size(&feeling(straight(), Carrier::Person, 60.0), 0.0, 19.0);
        assert!((shaken - 60.2).abs() < 4.0, "{shaken}");
    }

    #[test]
    fn a_person_walks_with_a_bounce_and_a_trolley_rolls_without() {
        // An amplitude of 2.5 m/s² is 255 mg, which is a standard deviation of 255/√2 = 180 mg.
        let (_, walking) = size(&feeling(straight(), Carrier::Person, 0.0), 25.0, 45.0);
        assert!((walking - 180.0).abs() < 10.0, "{walking}");
        let (mean, rolling) = size(&feeling(straight(), Carrier::Trolley, 0.0), 25.0, 45.0);
        assert!((mean - 1000.0).abs() < 1.0 && rolling < 6.0, "{mean} ± {rolling}");
    }

    #[test]
    fn a_start_is_felt_once_it_has_begun() {
        let trolley = feeling(straight(), Carrier::Trolley, 0.0);
        // 1.2 m/s within two seconds: 0.6 m/s² in the mean, and twice that in the middle, where (1.2 m − 0) / 1 s² is
        // reached.
        let pushed = trolley.along_way(21.0);
        assert!((pushed[0] - 1.2).abs() < 1e-9 && pushed[1].abs() < 1e-9, "{pushed:?}");
        assert_eq!(trolley.along_way(20.0), [0.0; 3]);
        assert!(trolley.along_way(22.5).iter().all(|part| part.abs() < 1e-9));
    }
}
