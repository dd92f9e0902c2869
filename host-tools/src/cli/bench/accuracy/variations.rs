//! Variations of the engine's settings, for the choice that leaves a site out.

use positioning_core::Motion;
use positioning_core::engine::Settings;

/// A variation: its name, and what it changes. The first is the default.
pub type Variation = (&'static str, fn(&mut Settings<f32>));

/// The variations that are tried.
pub const VARIATIONS: &[Variation] = &[
    ("default", |_| ()),
    ("link errors × 0.7", |settings| link_errors(settings, 0.7)),
    ("link errors × 1.4", |settings| link_errors(settings, 1.4)),
    ("blocked link errors × 2", |settings| settings.filter.noise.blocked_link_sigma *= 2.0),
    ("motion × 0.5", |settings| motion(settings, 0.5)),
    ("motion × 2", |settings| motion(settings, 2.0)),
];

fn link_errors(settings: &mut Settings<f32>, factor: f32) {
    settings.filter.noise.link_sigma *= factor;
    settings.filter.noise.unasked_link_sigma *= factor;
}

fn motion(settings: &mut Settings<f32>, factor: f32) {
    settings.filter.motion = match settings.filter.motion {
        Motion::Static { wander } => Motion::Static { wander: factor * wander },
        Motion::ConstantVelocity { acceleration } => Motion::ConstantVelocity { acceleration: factor * acceleration },
        Motion::Adaptive { calm, brisk } => Motion::Adaptive { calm: factor * calm, brisk: factor * brisk },
    };
}
