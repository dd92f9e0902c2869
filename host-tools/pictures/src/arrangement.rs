//! The arrangement of a picture: map, errors, legend, enlarged parts.

use super::view::{View, zooms};
use super::{Drawing, Picture, cdf, legend, map, pens, style};

/// Height of the row of enlarged parts, pixels.
const ZOOM_HEIGHT: u32 = 430;
/// Width of the legend, pixels.
const LEGEND: u32 = 500;

/// Draws the picture.
pub fn draw(picture: &Picture) -> Drawing {
    let pens = pens::of(picture);
    let view = View::of(picture);
    let zooms = zooms(picture, &view);
    let key = legend::Key::of(picture, &pens, &view, zooms.len());
    let map = map::Map { picture, pens: &pens, zooms: &zooms };
    let curves = legend::shown(picture, &pens);
    let has_errors = picture.has_errors();
    let key_height = key.height();
    let errors_height = if has_errors { 400 } else { 0 };
    let name = picture.errors.name();
    let pixels = style::pixels;
    let row = |count: usize| if count > 0 { ZOOM_HEIGHT } else { 0 };
    if view.is_wide() {
        // Below the wide map: the legend, and the errors beside it. Below them: the enlarged parts.
        let width = 1220;
        let map_height = view.height_for(width);
        let lower_height = key_height.max(errors_height.min(360));
        let size = [width, map_height + lower_height + row(zooms.len())];
        Drawing::new(size, |area| {
            let [upper, rest] = area.split_at_y(pixels(map_height));
            let [lower, zoomed] = rest.split_at_y(pixels(lower_height));
            let [left, right] = lower.split_at_x(pixels(if has_errors { width - LEGEND } else { 0 }));
            map.draw(upper, &view);
            if has_errors {
                cdf::draw(left, &curves, name);
            }
            key.draw(right);
            map.draw_zooms(zoomed);
        })
    } else {
        // Beside the map: the errors above, the legend below. Below them: the enlarged parts; a single one is beside
        // the legend. The map keeps its height beside a long legend.
        let left_width = 740;
        let (key_below, zoom_width) = match zooms.len() {
            1 if has_errors => (true, left_width),
            _ => (false, left_width + LEGEND),
        };
        let beside = errors_height + if key_below { 0 } else { key_height };
        let map_height = view.height_for(left_width);
        let upper_height = map_height.max(beside);
        let below = if key_below { key_height.max(ZOOM_HEIGHT) } else { row(zooms.len()) };
        Drawing::new([left_width + LEGEND, upper_height + below], |area| {
            let [upper, lower] = area.split_at_y(pixels(upper_height));
            let [left, right] = upper.split_at_x(pixels(left_width));
            let [left, _] = left.split_at_y(pixels(map_height));
            let [errors, under_errors] = right.split_at_y(pixels(errors_height));
            let [zoomed, beside_zoom] = lower.split_at_x(pixels(zoom_width));
            map.draw(left, &view);
            if has_errors {
                cdf::draw(errors, &curves, name);
            }
            key.draw(if key_below { beside_zoom } else { under_errors });
            map.draw_zooms(zoomed);
        })
    }
}
