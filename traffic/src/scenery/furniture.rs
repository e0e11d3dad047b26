use covista_world::{FrenetPoint, Road, Se2Pose};
use nalgebra::{Point3, Vector2};

use super::solids::{block, centered_block, frustum, limb};
use crate::{Body, ConvexPart, Material};

/// How far feet of what spans the road reach into the ground, so that none hangs over a ditch.
const FOUNDATION_M: f64 = 8.0;

/// A metal pole: a lamp post or a sign's mast.
pub fn pole(road: &Road, foot: FrenetPoint, height_m: f64, radius_m: f64) -> Body {
    let foot = road.from_frenet(foot);
    let body = Body {
        parts: vec![mast(height_m, radius_m)],
    };
    body.at(Se2Pose::new(foot.x, foot.y, 0.0), 0.0)
}

fn mast(height_m: f64, radius_m: f64) -> ConvexPart {
    frustum(
        Vector2::zeros(),
        [radius_m; 2],
        [0.0, height_m],
        8,
        Material::Metal,
    )
}

/// A street lamp with an arm of `arm_m` along x.
pub fn lamp(height_m: f64, arm_m: f64) -> Body {
    let top = Point3::new(0.0, 0.0, height_m - 0.1);
    let tip = Point3::new(arm_m, 0.0, height_m);
    Body {
        parts: vec![
            mast(height_m, 0.08),
            limb([top, tip], [0.05, 0.05], Material::Metal),
            block(
                [arm_m - 0.4, arm_m + 0.2],
                [-0.13, 0.13],
                [height_m - 0.08, height_m + 0.08],
                Material::Metal,
            ),
        ],
    }
}

/// A sign that looks along x: a plate of `size_m` (width, height) with its lower edge at
/// `clear_m`, on one post or, when wider than 1.5 m, two.
pub fn sign(clear_m: f64, [width, height]: [f64; 2], color: [u8; 3]) -> Body {
    let half_m = width / 2.0;
    let plate = block(
        [0.05, 0.09],
        [-half_m, half_m],
        [clear_m, clear_m + height],
        Material::Reflector(color),
    );
    let posts: &[f64] = if width > 1.5 { &[-0.35, 0.35] } else { &[0.0] };
    let mut parts = vec![plate];
    parts.extend(posts.iter().map(|share| {
        let foot = Vector2::new(0.0, share * width);
        let top_m = clear_m + 0.9 * height;
        frustum(foot, [0.045; 2], [0.0, top_m], 6, Material::Metal)
    }));
    Body { parts }
}

/// A sign gantry across the road (along y) with plates that look against x, on legs at
/// `legs_m` (left, right).
pub fn gantry(legs_m: [f64; 2], clear_m: f64, plates: &[(f64, f64, [u8; 3])]) -> Body {
    let [left, right] = legs_m;
    let leg = |y: f64| {
        let foot = Vector2::new(0.0, y);
        let z = [-FOUNDATION_M, clear_m + 1.2];
        frustum(foot, [0.22; 2], z, 6, Material::Metal)
    };
    let beam_m = [clear_m + 0.4, clear_m + 1.1];
    let mut parts = vec![
        leg(left),
        leg(right),
        block([-0.3, 0.3], [right, left], beam_m, Material::Metal),
    ];
    parts.extend(plates.iter().map(|&(y, width, color)| {
        let across = [y - width / 2.0, y + width / 2.0];
        let z = [clear_m, clear_m + 0.55 * width.clamp(2.0, 5.0)];
        block([-0.42, -0.36], across, z, Material::Reflector(color))
    }));
    Body { parts }
}

/// A bridge over the road (its deck along y) with abutments from `feet_m` (left, right) outwards.
pub fn bridge(feet_m: [f64; 2], clear_m: f64, width_m: f64) -> Body {
    const ABUTMENT_M: f64 = 1.5;
    const OVERHANG_M: f64 = 25.0;
    let [left, right] = feet_m;
    let across = [-width_m / 2.0, width_m / 2.0];
    let deck = [right - OVERHANG_M, left + OVERHANG_M];
    let concrete = |x: [f64; 2], y: [f64; 2], z: [f64; 2]| block(x, y, z, Material::Concrete);
    let pillar_m = [-FOUNDATION_M, clear_m];
    let rail_m = [clear_m + 1.1, clear_m + 2.0];
    Body {
        parts: vec![
            concrete(across, [left, left + ABUTMENT_M], pillar_m),
            concrete(across, [right - ABUTMENT_M, right], pillar_m),
            concrete(across, deck, [clear_m, clear_m + 1.1]),
            concrete([across[0], across[0] + 0.25], deck, rail_m),
            concrete([across[1] - 0.25, across[1]], deck, rail_m),
        ],
    }
}

/// A wheeled dustbin.
pub fn dustbin(size: f64, color: [u8; 3]) -> Body {
    let (half_m, height_m) = (0.28 * size, 1.05 * size);
    let (x, y) = ([-half_m, half_m], [-half_m, half_m]);
    let plastic = Material::Plaster(color);
    Body {
        parts: vec![
            block(x, y, [0.0, height_m], plastic),
            block(
                [-1.1 * half_m, 1.15 * half_m],
                [-1.1 * half_m, 1.1 * half_m],
                [height_m, height_m + 0.06],
                plastic,
            ),
        ],
    }
}

/// A steel container or skip of `size_m` along x, y and z.
pub fn container([length, width, height]: [f64; 3], color: [u8; 3]) -> Body {
    Body {
        parts: vec![centered_block(
            [length, width],
            [0.0, height],
            Material::CarPaint(color),
        )],
    }
}

/// A fire hydrant.
pub fn hydrant(color: [u8; 3]) -> Body {
    let paint = Material::CarPaint(color);
    let column = frustum(Vector2::zeros(), [0.12, 0.1], [0.0, 0.75], 8, paint);
    let arms = block([-0.08, 0.08], [-0.2, 0.2], [0.48, 0.62], paint);
    Body {
        parts: vec![column, arms],
    }
}
