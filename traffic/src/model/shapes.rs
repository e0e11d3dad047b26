use covista_world::VehicleDimensions;
use nalgebra::Point3;

use crate::{ConvexPart, Material};

pub(super) const PAINT: Material = Material::CarPaint([128, 128, 128]);
pub(super) const TAIL_LAMP: Material = Material::Reflector([170, 18, 18]);
pub(super) const HEADLAMP: Material = Material::Reflector([235, 235, 240]);
pub(super) const PLATE: Material = Material::Reflector([225, 225, 215]);
const WHEEL_SIDES: u32 = 10;

/// The hull of stations (x, z, half width), mirrored to both sides.
pub(super) fn hull(material: Material, stations: &[[f64; 3]]) -> ConvexPart {
    let vertices = stations
        .iter()
        .flat_map(|&[x, z, half]| [Point3::new(x, half, z), Point3::new(x, -half, z)])
        .collect();
    ConvexPart { vertices, material }
}

pub(super) fn block(material: Material, x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> ConvexPart {
    let vertices = (0..8)
        .map(|corner| Point3::new(x[corner & 1], y[corner >> 1 & 1], z[corner >> 2]))
        .collect();
    ConvexPart { vertices, material }
}

/// The same block on the left and on the right.
pub(super) fn pair(material: Material, x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> [ConvexPart; 2] {
    [
        block(material, x, y, z),
        block(material, x, [-y[1], -y[0]], z),
    ]
}

/// Four wheels on the ground, a little inside the body's width.
pub(super) fn wheels(size: VehicleDimensions, radius_m: f64, width_m: f64) -> Vec<ConvexPart> {
    let outer = size.width_m / 2.0 - 0.015;
    let half_side = std::f64::consts::PI / f64::from(WHEEL_SIDES);
    let corner_m = radius_m / half_side.cos();
    let wheel = |x: f64, [near, far]: [f64; 2]| ConvexPart {
        vertices: (0..WHEEL_SIDES)
            .flat_map(|side| {
                // Flat sides at the bottom and at the top.
                let (sin, cos) = (half_side * f64::from(2 * side + 1)).sin_cos();
                [near, far].map(|y| Point3::new(x + corner_m * sin, y, radius_m - corner_m * cos))
            })
            .collect(),
        material: Material::Rubber,
    };
    [0.0, size.wheelbase_m]
        .into_iter()
        .flat_map(|x| {
            [
                wheel(x, [outer - width_m, outer]),
                wheel(x, [-outer, width_m - outer]),
            ]
        })
        .collect()
}

/// A thin side window on each side: its outline (x, z), half widths at its bottom and top.
pub(super) fn side_windows(outline: [[f64; 2]; 4], half_widths: [f64; 2]) -> [ConvexPart; 2] {
    let [bottom, top] = half_widths;
    [1.0, -1.0].map(|side| {
        let vertices = outline
            .iter()
            .zip([bottom, bottom, top, top])
            .flat_map(|(&[x, z], half)| [half, half - 0.06].map(|y| Point3::new(x, side * y, z)))
            .collect();
        ConvexPart {
            vertices,
            material: Material::Glass,
        }
    })
}

pub(super) fn mirrors(x: f64, z: f64, inner: f64, outer: f64) -> [ConvexPart; 2] {
    pair(PAINT, [x, x + 0.12], [inner, outer], [z, z + 0.13])
}
