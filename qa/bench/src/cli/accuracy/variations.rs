//! Variations of the engine's settings, for the choice that leaves a site out.

use positioning_core::Motion;
use positioning_core::engine::Settings;

/// A variation: its name, and what it changes. The first is the default.
pub type Variation = (&'static str, fn(&mut Settings<f32>));

/// The variations that are tried.
pub const VARIATIONS: &[Variation] = &[
    ("default", |_| ()),
    ("direct link errors × 0.7", |settings| settings.filter.noise.direct_sigma *= 0.7),
    ("direct link errors × 1.4", |settings| settings.filter.noise.direct_sigma *= 1.4),
    ("common error × 0.7", |settings| settings.filter.noise.common_sigma *= 0.7),
    ("common error × 1.4", |settings| settings.filter.noise.common_sigma *= 1.4),
    ("noise of blocked links × 0.5", |settings| settings.filter.noise.blocked_noise_sigma *= 0.5),
    ("noise of blocked links × 2", |settings| settings.filter.noise.blocked_noise_sigma *= 2.0),
    ("memory of links × 0.5", |settings| memory(settings, 0.5)),
    ("memory of links × 2", |settings| memory(settings, 2.0)),
    ("motion × 0.5", |settings| motion(settings, 0.5)),
    ("motion × 2", |settings| motion(settings, 2.0)),
];

fn memory(settings: &mut Settings<f32>, factor: f32) {
    settings.filter.noise.link_seconds *= factor;
    settings.filter.noise.link_metres *= factor;
}

fn motion(settings: &mut Settings<f32>, factor: f32) {
    settings.filter.motion = match settings.filter.motion {
        Motion::Static { wander } => Motion::Static { wander: factor * wander },
        Motion::ConstantVelocity { acceleration } => Motion::ConstantVelocity { acceleration: factor * acceleration },
        Motion::Adaptive { calm, brisk } => Motion::Adaptive { calm: factor * calm, brisk: factor * brisk },
    };
}
