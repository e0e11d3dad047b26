use nalgebra::Vector3;
use rand::Rng;

use crate::SceneLook;

/// Light and surface: any time of day, sunny to overcast, fresh to worn paint.
pub(super) fn draw(rng: &mut impl Rng) -> SceneLook {
    let elevation: f64 = rng.random_range(0.2..1.35);
    let azimuth: f64 = rng.random_range(0.0..std::f64::consts::TAU);
    let haze: f64 = rng.random_range(0.0..1.0);
    SceneLook {
        sun_direction: Vector3::new(
            elevation.cos() * azimuth.cos(),
            elevation.cos() * azimuth.sin(),
            elevation.sin(),
        ),
        direct_light: if rng.random_bool(0.35) {
            rng.random_range(0.0..0.2)
        } else {
            rng.random_range(0.3..1.0)
        },
        paint_wear: rng.random_range(0.1..0.6),
        asphalt_albedo: rng.random_range(0.15..0.5),
        haze_per_m: 0.008 * haze * haze,
        wetness: 0.0,
        damage: 0.2,
        texture_seed: rng.random(),
    }
}
