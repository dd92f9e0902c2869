//! The station's positions as messages for Foxglove: of its store in a file, and of its live state on a WebSocket.

use anyhow::Result;
use foxglove_scenes::{Estimate, Sink, View};
use recording::Coordinates;
use station_core::model::{GeographicOrigin, TagPosition};

/// Sends a tag's position, and its place on the earth where the site has a geographic origin. `epoch` is the position's
/// number.
///
/// # Errors
/// The sink returns an error.
pub fn tag_position<S: Sink>(
    view: &mut View<S>,
    position: &TagPosition,
    epoch: u64,
    origin: Option<GeographicOrigin>,
) -> Result<()> {
    let TagPosition { tag, t, x_m, y_m, z_m, sigma_x_m, sigma_y_m, sigma_z_m, cov_xy_m2, .. } = position;
    // No instant is before 1970.
    let us = u64::try_from(t.us()).unwrap_or_default();
    let t_ns = us.saturating_mul(1000);
    let estimate = Estimate {
        t_s: us as f64 / 1e6,
        epoch: &epoch.to_string(),
        place: Some(Coordinates { x_m: *x_m, y_m: *y_m, z_m: *z_m }),
        sigma_m: [Some(*sigma_x_m), Some(*sigma_y_m), *sigma_z_m],
        reason: None,
    };
    view.position(t_ns, tag, &estimate)?;
    let Some(GeographicOrigin(origin)) = origin else { return Ok(()) };
    let place = origin.geographic(*x_m, *y_m, *z_m);
    let covariance_m2 = origin.covariance_east_north(sigma_x_m.powi(2), sigma_y_m.powi(2), *cov_xy_m2);
    view.location(t_ns, tag, place, covariance_m2, *sigma_z_m)
}
