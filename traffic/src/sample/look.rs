use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::Rng;

use crate::SceneLook;

/// Light and surface: low sun to noon, ahead in one scene of five, sunny to overcast; dry to
/// soaked, new to broken. `ahead_rad` is where the ego heads.
pub(super) fn draw(rng: &mut impl Rng, ahead_rad: f64) -> SceneLook {
    let (azimuth, elevation): (f64, f64) = if rng.random_bool(0.2) {
        let aside = rng.random_range(-0.5..0.5);
        (ahead_rad + aside, rng.random_range(0.1..0.6))
    } else {
        (rng.random_range(0.0..TAU), rng.random_range(0.15..1.35))
    };
    let wetness = if rng.random_bool(0.12) {
        rng.random_range(0.3..1.0)
    } else {
        0.0
    };
    let overcast = wetness > 0.0 || rng.random_bool(0.3);
    let haze: f64 = rng.random_range(0.0..1.0);
    SceneLook {
        sun_direction: Vector3::new(
            elevation.cos() * azimuth.cos(),
            elevation.cos() * azimuth.sin(),
            elevation.sin(),
        ),
        direct_light: if overcast {
            rng.random_range(0.0..0.2)
        } else {
            rng.random_range(0.3..1.0)
        },
        paint_wear: rng.random_range(0.0..0.8),
        asphalt_albedo: rng.random_range(0.12..0.5),
        haze_per_m: 0.008 * haze * haze,
        wetness,
        damage: rng.random_range(0.0_f64..1.0).powi(2),
        texture_seed: rng.random(),
    }
}
