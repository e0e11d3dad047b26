use nalgebra::{Point3, Vector3};
use rand::Rng;

use super::solids::{blob, disc, limb};
use crate::{Body, Material};

/// A bicycle that stands along x.
pub fn bicycle(color: [u8; 3]) -> Body {
    let frame = Material::CarPaint(color);
    let at = |x: f64, z: f64| Point3::new(x, 0.0, z);
    let wheel = |x: f64| disc(at(x, 0.34), 0.34, 0.04, Material::Rubber);
    let handles = [
        Point3::new(0.42, -0.28, 1.02),
        Point3::new(0.42, 0.28, 1.02),
    ];
    Body {
        parts: vec![
            wheel(-0.52),
            wheel(0.54),
            limb([at(-0.5, 0.36), at(0.42, 0.95)], [0.025; 2], frame),
            limb([at(-0.05, 0.3), at(-0.2, 0.95)], [0.025; 2], frame),
            limb([at(0.54, 0.34), at(0.4, 1.02)], [0.025; 2], frame),
            limb(handles, [0.02; 2], Material::Metal),
        ],
    }
}

/// A parked motorcycle or scooter along x.
pub fn motorcycle(color: [u8; 3], rng: &mut impl Rng) -> Body {
    let paint = Material::CarPaint(color);
    let size = rng.random_range(0.85..1.05);
    let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z) * size;
    let wheel = |x: f64| disc(at(x, 0.0, 0.3), 0.3 * size, 0.13 * size, Material::Rubber);
    let tank = Vector3::new(0.38, 0.17, 0.24) * size;
    Body {
        parts: vec![
            wheel(-0.7),
            wheel(0.7),
            blob(at(0.1, 0.0, 0.72), tank, paint, rng),
            limb(
                [at(-0.85, 0.0, 0.8), at(-0.1, 0.0, 0.75)],
                [0.08, 0.12],
                Material::Rubber,
            ),
            limb(
                [at(-0.3, 0.0, 0.4), at(0.35, 0.0, 0.42)],
                [0.18, 0.16],
                Material::Metal,
            ),
            limb(
                [at(0.7, 0.0, 0.3), at(0.45, 0.0, 1.05)],
                [0.05, 0.06],
                Material::Metal,
            ),
            limb(
                [at(0.42, -0.35, 1.05), at(0.42, 0.35, 1.05)],
                [0.03; 2],
                Material::Metal,
            ),
        ],
    }
}
