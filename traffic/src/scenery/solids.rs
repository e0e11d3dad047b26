//! Convex solids in a body's own frame.

use nalgebra::{Point3, Vector2, Vector3};
use rand::Rng;

use crate::{ConvexPart, Material};

/// An upright block between two corners.
pub(super) fn block(
    [x0, x1]: [f64; 2],
    [y0, y1]: [f64; 2],
    [z0, z1]: [f64; 2],
    material: Material,
) -> ConvexPart {
    let vertices = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        .into_iter()
        .flat_map(|(x, y)| [z0, z1].map(|z| Point3::new(x, y, z)))
        .collect();
    ConvexPart { vertices, material }
}

/// A block of this length and width about the z axis.
pub(super) fn centered_block(
    [length, width]: [f64; 2],
    z: [f64; 2],
    material: Material,
) -> ConvexPart {
    let half = |size: f64| [-size / 2.0, size / 2.0];
    block(half(length), half(width), z, material)
}

/// An upright prism, or a frustum when its two radii differ.
pub(super) fn frustum(
    foot: Vector2<f64>,
    radii_m: [f64; 2],
    z: [f64; 2],
    sides: u32,
    material: Material,
) -> ConvexPart {
    let vertices = (0..sides)
        .flat_map(|side| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(side) / f64::from(sides)).sin_cos();
            [0, 1].map(|end| {
                let radius_m: f64 = radii_m[end];
                Point3::new(foot.x + radius_m * cos, foot.y + radius_m * sin, z[end])
            })
        })
        .collect();
    ConvexPart { vertices, material }
}

/// A wheel-like disc whose axle is the y axis.
pub(super) fn disc(
    center: Point3<f64>,
    radius_m: f64,
    thickness_m: f64,
    material: Material,
) -> ConvexPart {
    let vertices = (0..12)
        .flat_map(|side| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(side) / 12.0).sin_cos();
            [-0.5, 0.5]
                .map(|end| center + Vector3::new(radius_m * cos, end * thickness_m, radius_m * sin))
        })
        .collect();
    ConvexPart { vertices, material }
}

/// A limb from one point to another: four-sided, with a half width at each end.
pub(super) fn limb(
    ends: [Point3<f64>; 2],
    half_widths_m: [f64; 2],
    material: Material,
) -> ConvexPart {
    let axis = ends[1] - ends[0];
    let aside = if axis.x.abs() + axis.y.abs() < 1e-6 {
        Vector3::x()
    } else {
        axis.cross(&Vector3::z()).normalize()
    };
    let up = aside.cross(&axis).normalize();
    let vertices = ends
        .into_iter()
        .zip(half_widths_m)
        .flat_map(|(end, half_m)| {
            [aside + up, aside - up, -aside - up, up - aside].map(|corner| end + half_m * corner)
        })
        .collect();
    ConvexPart { vertices, material }
}

/// An irregular ellipsoid, such as a bush or a crown.
pub(super) fn blob(
    center: Point3<f64>,
    radii_m: Vector3<f64>,
    material: Material,
    rng: &mut impl Rng,
) -> ConvexPart {
    let rings = [(-0.85_f64, 5), (-0.3, 8), (0.35, 7), (0.88, 4)];
    let mut vertices = Vec::new();
    for (level, count) in rings {
        let ring = (1.0 - level * level).sqrt();
        for corner in 0..count {
            let angle = std::f64::consts::TAU * (f64::from(corner) + rng.random_range(0.0..0.6))
                / f64::from(count);
            let reach = ring * rng.random_range(0.8..1.1);
            let (sin, cos) = angle.sin_cos();
            let unit = Vector3::new(
                reach * cos,
                reach * sin,
                level + rng.random_range(-0.1..0.1),
            );
            vertices.push(center + radii_m.component_mul(&unit));
        }
    }
    ConvexPart { vertices, material }
}

/// A roof along x on a rectangle: from the eaves up to a ridge that is shorter by `hip_m` at
/// either end (0: a gable).
pub(super) fn roof(
    [length, width]: [f64; 2],
    [eaves_m, ridge_m]: [f64; 2],
    hip_m: f64,
    material: Material,
) -> ConvexPart {
    let (x, y) = (length / 2.0, width / 2.0);
    let ridge = (x - hip_m).max(0.1);
    let vertices = vec![
        Point3::new(x, y, eaves_m),
        Point3::new(-x, y, eaves_m),
        Point3::new(-x, -y, eaves_m),
        Point3::new(x, -y, eaves_m),
        Point3::new(ridge, 0.0, ridge_m),
        Point3::new(-ridge, 0.0, ridge_m),
    ];
    ConvexPart { vertices, material }
}
