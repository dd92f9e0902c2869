//! The part of the map that is seen.

/// Where the map is: all of the site, or a part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapView {
    /// What has been seen of the site: least and greatest coordinates, metres. It only grows, so that the map does not
    /// tremble with the tags.
    extent: Option<[[f64; 2]; 2]>,
    /// The part that a person has chosen; none: all.
    part: Option<Part>,
    /// What was drawn last.
    drawn: Part,
    /// The dots of the last drawing.
    dots: [f64; 2],
}

/// A part of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// What is in the middle, metres.
    pub centre_m: [f64; 2],
    /// The distance between two dots of a Braille character. Dots are as far apart in both directions, where characters
    /// are twice as high as wide.
    pub metres_per_dot: f64,
}

impl Default for Part {
    fn default() -> Self {
        Self { centre_m: [0.0; 2], metres_per_dot: 0.1 }
    }
}

/// Dots of a character in each direction.
pub const DOTS: [u16; 2] = [2, 4];
/// The part of the extent that is left free on each side.
const MARGIN: f64 = 0.06;
/// The finest and the coarsest scale, metres a dot.
const SCALES: [f64; 2] = [1e-3, 1e5];
/// The factor of a step of the zoom.
const ZOOM: f64 = 1.25;

impl Part {
    /// The dot of a point, from the upper left corner of a map with this number of dots. It may be outside.
    pub fn dot(&self, [x_m, y_m]: [f64; 2], dots: [f64; 2]) -> [f64; 2] {
        let right = (x_m - self.centre_m[0]) / self.metres_per_dot;
        let down = (self.centre_m[1] - y_m) / self.metres_per_dot;
        [right + (dots[0] - 1.0) / 2.0, down + (dots[1] - 1.0) / 2.0]
    }

    /// The coordinates of the outermost dots: least and greatest x, then y.
    pub fn bounds(&self, dots: [f64; 2]) -> [[f64; 2]; 2] {
        [0, 1].map(|axis| {
            let half_m = (dots[axis] - 1.0) / 2.0 * self.metres_per_dot;
            [self.centre_m[axis] - half_m, self.centre_m[axis] + half_m]
        })
    }
}

impl MapView {
    /// Takes a point of the site into the extent.
    pub fn include(&mut self, [x_m, y_m]: [f64; 2]) {
        if !(x_m.is_finite() && y_m.is_finite()) {
            return;
        }
        let [least, greatest] = self.extent.unwrap_or([[x_m, y_m]; 2]);
        self.extent = Some([[least[0].min(x_m), least[1].min(y_m)], [greatest[0].max(x_m), greatest[1].max(y_m)]]);
    }

    /// The part for a map of this number of dots, with this point in its middle where one is given.
    pub fn part(&mut self, dots: [f64; 2], centre_m: Option<[f64; 2]>) -> Part {
        let mut part = self.part.unwrap_or_else(|| self.whole(dots));
        if let Some(centre_m) = centre_m {
            part.centre_m = centre_m;
        }
        (self.drawn, self.dots) = (part, dots);
        part
    }

    fn whole(&self, dots: [f64; 2]) -> Part {
        let Some([least, greatest]) = self.extent else { return Part::default() };
        let scales = [0, 1].map(|axis| {
            let span_m = (greatest[axis] - least[axis]) * (1.0 + 2.0 * MARGIN);
            span_m / (dots[axis] - 1.0).max(1.0)
        });
        let centre_m = [0, 1].map(|axis| (least[axis] + greatest[axis]) / 2.0);
        let scale = scales[0].max(scales[1]);
        // A single point has no extent: some metres around it are shown.
        let metres_per_dot = if scale > 0.0 { scale.clamp(SCALES[0], SCALES[1]) } else { 0.1 };
        Part { centre_m, metres_per_dot }
    }

    /// Shows all of the site, as far as it is known by now.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Moves the map by a share of what is seen: to the right and up.
    pub fn pan(&mut self, right: f64, up: f64) {
        let mut part = self.drawn;
        part.centre_m[0] += right * self.dots[0] * part.metres_per_dot;
        part.centre_m[1] += up * self.dots[1] * part.metres_per_dot;
        part.centre_m = part.centre_m.map(|at| at.clamp(-1e7, 1e7));
        (self.drawn, self.part) = (part, Some(part));
    }

    /// Makes things larger, or smaller for a negative number of steps.
    pub fn zoom(&mut self, steps: i32) {
        let mut part = self.drawn;
        part.metres_per_dot = (part.metres_per_dot * ZOOM.powi(-steps)).clamp(SCALES[0], SCALES[1]);
        (self.drawn, self.part) = (part, Some(part));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_of_a_site_is_seen_with_its_proportions() {
        let mut view = MapView::default();
        // A hall of 20 m by 5 m on 101 by 101 dots: the width decides. 20 m and 6 % on both sides over 100 steps.
        for point in [[0.0, 0.0], [20.0, 5.0], [f64::NAN, 1.0]] {
            view.include(point);
        }
        let part = view.part([101.0, 101.0], None);
        assert_eq!(part.centre_m, [10.0, 2.5]);
        assert!((part.metres_per_dot - 0.224).abs() < 1e-12, "{part:?}");
        // The middle is the 51st dot; y grows upwards; 1 m is 4.46 dots.
        assert_eq!(part.dot([10.0, 2.5], [101.0, 101.0]), [50.0, 50.0]);
        let [x, y] = part.dot([11.0, 3.5], [101.0, 101.0]);
        assert!((x - 54.464).abs() < 1e-3 && (y - 45.536).abs() < 1e-3, "{x} {y}");
        assert!((part.bounds([101.0, 101.0])[0][0] + 1.2).abs() < 1e-9);
    }

    #[test]
    fn the_map_moves_by_parts_of_what_is_seen_and_zooms_about_its_middle() {
        let mut view = MapView::default();
        for point in [[0.0, 0.0], [10.0, 10.0]] {
            view.include(point);
        }
        let whole = view.part([101.0, 101.0], None);
        view.zoom(2);
        let near = view.part([101.0, 101.0], None);
        assert_eq!(near.centre_m, whole.centre_m);
        // 1.25 squared.
        assert!((whole.metres_per_dot / near.metres_per_dot - 1.5625).abs() < 1e-12);
        view.pan(0.5, -0.25);
        let moved = view.part([101.0, 101.0], None);
        assert!((moved.centre_m[0] - (5.0 + 50.5 * near.metres_per_dot)).abs() < 1e-9, "{moved:?}");
        assert!((moved.centre_m[1] - (5.0 - 25.25 * near.metres_per_dot)).abs() < 1e-9, "{moved:?}");
        for _ in 0..1000 {
            view.zoom(1);
            view.pan(1.0, 1.0);
        }
        let part = view.part([101.0, 101.0], None);
        assert!(part.metres_per_dot >= 1e-3 && part.centre_m[0] <= 1e7, "{part:?}");
    }
}
