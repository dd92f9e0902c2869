//! An image of a floor plan beneath a map.

use std::sync::Arc;

use super::drawing::Area;
use super::image::Image;
use super::view::View;

/// A floor plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The image.
    pub image: Arc<Image>,
    /// The places of its lower left and upper right corners, metres.
    pub corners_m: [[f64; 2]; 2],
}

impl Plan {
    /// Puts the plan beneath a map that shows the view.
    pub fn put_beneath(&self, map: Area, view: &View) {
        let [[x0, y0], [x1, y1]] = self.corners_m;
        let metres_a_unit = view.sides()[0] / f64::from(map.size()[0]);
        // On paper y goes down.
        let at = [x0 - view.least[0], view.greatest[1] - y1].map(|metres| metres / metres_a_unit);
        let size = [x1 - x0, y1 - y0].map(|metres| metres / metres_a_unit);
        map.put_beneath(Arc::clone(&self.image), at, size);
    }
}
