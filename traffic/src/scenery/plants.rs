use covista_world::Se2Pose;
use nalgebra::{Point3, Vector2, Vector3};
use rand::Rng;

use super::solids::{blob, frustum, limb};
use crate::{Body, Material};

const BARK: Material = Material::Plaster([92, 76, 60]);

/// A tree: a trunk and one irregular crown.
pub fn tree(foot: Vector2<f64>, height_m: f64, crown_radius_m: f64, rng: &mut impl Rng) -> Body {
    let clear_m = height_m * rng.random_range(0.2..0.4);
    let (middle, half) = ((height_m + clear_m) / 2.0, (height_m - clear_m) / 2.0);
    let trunk = frustum(
        Vector2::zeros(),
        [0.03 * height_m; 2],
        [0.0, clear_m + 0.3],
        6,
        BARK,
    );
    let crown = blob(
        Point3::new(0.0, 0.0, middle),
        Vector3::new(crown_radius_m, crown_radius_m, half),
        Material::Foliage,
        rng,
    );
    let body = Body {
        parts: vec![trunk, crown],
    };
    body.at(Se2Pose::new(foot.x, foot.y, 0.0), 0.0)
}

/// A tall tree whose trunk may lean along x, with limbs and several crowns from `clear_m` up.
pub fn avenue_tree(height_m: f64, clear_m: f64, trunk_radius_m: f64, rng: &mut impl Rng) -> Body {
    let lean_m = clear_m * rng.random_range(-0.15..0.3);
    let fork = Point3::new(lean_m, 0.0, clear_m);
    let mut parts = vec![limb(
        [Point3::origin(), fork],
        [trunk_radius_m, 0.75 * trunk_radius_m],
        BARK,
    )];
    let depth_m = height_m - clear_m;
    let crowns = rng.random_range(2..=4);
    let turn = rng.random_range(0.0..std::f64::consts::TAU);
    for crown in 0..crowns {
        let angle = turn + std::f64::consts::TAU * f64::from(crown) / f64::from(crowns);
        let (sin, cos) = angle.sin_cos();
        let radius_m = depth_m * rng.random_range(0.26..0.4);
        let center = fork
            + Vector3::new(
                0.8 * radius_m * cos,
                0.8 * radius_m * sin,
                depth_m * rng.random_range(0.4..0.6),
            );
        let radii_m = Vector3::new(radius_m, radius_m, depth_m * rng.random_range(0.35..0.45));
        parts.push(limb([fork, center], [0.5 * trunk_radius_m, 0.05], BARK));
        parts.push(blob(center, radii_m, Material::Foliage, rng));
    }
    Body { parts }
}

/// A bush of this size, of one or two rounded lumps that reach the ground.
pub fn bush([length, width, height]: [f64; 3], rng: &mut impl Rng) -> Body {
    let lumps = rng.random_range(1..=2_u32);
    let parts = (0..lumps)
        .map(|lump| {
            let share = 1.0 / (0.4 + 0.6 * f64::from(lumps));
            let x = (f64::from(lump) - 0.5 * f64::from(lumps - 1)) * 0.6 * share * length;
            let top_m = height * rng.random_range(0.75..1.0);
            blob(
                Point3::new(x, 0.0, 0.42 * top_m),
                Vector3::new(0.5 * share * length, 0.5 * width, 0.58 * top_m),
                Material::Foliage,
                rng,
            )
        })
        .collect();
    Body { parts }
}
