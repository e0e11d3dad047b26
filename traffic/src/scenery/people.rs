use nalgebra::{Point3, Vector2};
use rand::Rng;

use super::{
    solids::{frustum, limb},
    two_wheelers::bicycle,
};
use crate::{Body, Material};

const SKIN: Material = Material::Cloth([196, 150, 122]);

/// A person of this height who looks along x, with a stride of 0 (standing) to 1.
pub fn person(height_m: f64, stride: f64, rng: &mut impl Rng) -> Body {
    let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z) * height_m;
    let (trousers, coat) = (draw_cloth(rng), draw_cloth(rng));
    let (hip_m, step) = (0.5, 0.16 * stride);
    let girth = rng.random_range(0.85..1.25);
    let torso = limb(
        [at(0.0, 0.0, 0.46), at(0.01, 0.0, 0.84)],
        [0.085 * girth * height_m, 0.1 * girth * height_m],
        coat,
    );
    let leg = |y: f64, reach: f64| {
        let ends = [at(reach, y, 0.0), at(0.0, y, hip_m)];
        limb(ends, [0.035 * height_m, 0.055 * girth * height_m], trousers)
    };
    let arm = |y: f64, reach: f64| {
        let ends = [at(reach, y, 0.44), at(0.0, 0.85 * y, 0.8)];
        limb(ends, [0.025 * height_m, 0.035 * height_m], coat)
    };
    let shoulder = 0.13 * girth;
    Body {
        parts: vec![
            leg(0.055, step),
            leg(-0.055, -step),
            torso,
            arm(shoulder, -0.8 * step),
            arm(-shoulder, 0.8 * step),
            head(at(0.01, 0.0, 0.86), height_m),
        ],
    }
}

/// Somebody on a bicycle, riding along x.
pub fn cyclist(rng: &mut impl Rng) -> Body {
    let (trousers, coat) = (draw_cloth(rng), draw_cloth(rng));
    let mut body = bicycle(draw_tint(rng));
    let seat = Point3::new(-0.2, 0.0, 0.95);
    let neck = Point3::new(0.15, 0.0, 1.5);
    body.parts.push(limb([seat, neck], [0.15, 0.18], coat));
    for (y, x, z) in [(0.12, 0.1, 0.2), (-0.12, -0.05, 0.4)] {
        let foot = Point3::new(x, y, z);
        body.parts.push(limb([foot, seat], [0.06, 0.09], trousers));
    }
    let handle = Point3::new(0.45, 0.0, 1.05);
    body.parts.push(limb([handle, neck], [0.1, 0.12], coat));
    body.parts
        .push(head(neck + nalgebra::Vector3::new(0.05, 0.0, 0.06), 1.75));
    body
}

fn head(chin: Point3<f64>, height_m: f64) -> crate::ConvexPart {
    let radius_m = 0.055 * height_m;
    frustum(
        Vector2::new(chin.x, chin.y),
        [0.8 * radius_m, radius_m],
        [chin.z, chin.z + 0.14 * height_m],
        6,
        SKIN,
    )
}

fn draw_tint(rng: &mut impl Rng) -> [u8; 3] {
    let tone = rng.random_range(15..190_u8);
    [0; 3].map(|_: u8| tone.saturating_add_signed(rng.random_range(-40..=40)))
}

fn draw_cloth(rng: &mut impl Rng) -> Material {
    Material::Cloth(draw_tint(rng))
}
