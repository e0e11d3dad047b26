use std::sync::OnceLock;

use covista_world::{ObjectClass, VehicleDimensions};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::{Body, ConvexPart, Material};

const PAINT: Material = Material::CarPaint([128, 128, 128]);
const TAIL_LAMP: Material = Material::Reflector([170, 18, 18]);
const HEADLAMP: Material = Material::Reflector([235, 235, 240]);
const PLATE: Material = Material::Reflector([225, 225, 215]);
const WHEEL_SIDES: u32 = 12;

/// The kinds of vehicles on the road, each with its dimensions and body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VehicleModel {
    /// A four-door saloon; its wheelbase is the paper's L = 2.51 m.
    Sedan,
    /// A sport utility vehicle.
    Suv,
    /// A delivery van.
    Van,
    /// A box truck: cab and cargo box.
    Truck,
}

impl VehicleModel {
    /// Outer dimensions.
    pub fn dimensions(self) -> VehicleDimensions {
        let [length_m, width_m, height_m, wheelbase_m, rear_overhang_m] = match self {
            Self::Sedan => [4.7, 1.82, 1.45, 2.51, 1.10],
            Self::Suv => [4.6, 1.90, 1.70, 2.66, 1.00],
            Self::Van => [5.4, 2.00, 2.30, 3.30, 1.15],
            Self::Truck => [7.5, 2.40, 3.00, 4.20, 2.00],
        };
        VehicleDimensions {
            length_m,
            width_m,
            height_m,
            wheelbase_m,
            rear_overhang_m,
        }
    }

    /// What a detector should call it.
    pub fn class(self) -> ObjectClass {
        match self {
            Self::Sedan | Self::Suv => ObjectClass::Car,
            Self::Van | Self::Truck => ObjectClass::Truck,
        }
    }

    /// Its shape in the vehicle frame; the coated parts are grey until a paint replaces them.
    pub fn body(self) -> &'static Body {
        static BODIES: [OnceLock<Body>; 4] = [const { OnceLock::new() }; 4];
        BODIES[self as usize].get_or_init(|| Body {
            parts: match self {
                Self::Sedan => sedan(),
                Self::Suv => suv(),
                Self::Van => van(),
                Self::Truck => truck(),
            },
        })
    }
}

/// The hull of stations (x, z, half width), mirrored to both sides.
fn hull(material: Material, stations: &[[f64; 3]]) -> ConvexPart {
    let vertices = stations
        .iter()
        .flat_map(|&[x, z, half]| [Point3::new(x, half, z), Point3::new(x, -half, z)])
        .collect();
    ConvexPart { vertices, material }
}

fn block(material: Material, x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> ConvexPart {
    let vertices = (0..8)
        .map(|corner| Point3::new(x[corner & 1], y[corner >> 1 & 1], z[corner >> 2]))
        .collect();
    ConvexPart { vertices, material }
}

/// The same block on the left and on the right.
fn pair(material: Material, x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> [ConvexPart; 2] {
    [
        block(material, x, y, z),
        block(material, x, [-y[1], -y[0]], z),
    ]
}

/// Four wheels whose outer faces are flush with the body's width.
fn wheels(model: VehicleModel, radius_m: f64, width_m: f64) -> Vec<ConvexPart> {
    let VehicleDimensions {
        width_m: body_width_m,
        wheelbase_m,
        ..
    } = model.dimensions();
    let outer = body_width_m / 2.0;
    let wheel = |x: f64, [near, far]: [f64; 2]| ConvexPart {
        vertices: (0..WHEEL_SIDES)
            .flat_map(|side| {
                let angle =
                    std::f64::consts::TAU * (f64::from(side) + 0.5) / f64::from(WHEEL_SIDES);
                let (sin, cos) = angle.sin_cos();
                let z = radius_m * (1.0 + sin);
                [near, far].map(|y| Point3::new(x + radius_m * cos, y, z))
            })
            .collect(),
        material: Material::Rubber,
    };
    [0.0, wheelbase_m]
        .into_iter()
        .flat_map(|x| {
            [
                wheel(x, [outer - width_m, outer]),
                wheel(x, [-outer, width_m - outer]),
            ]
        })
        .collect()
}

fn sedan() -> Vec<ConvexPart> {
    let mut parts = vec![
        // Lower hull: boot, belt line, bonnet, nose.
        hull(
            PAINT,
            &[
                [-1.08, 0.40, 0.76],
                [-1.06, 0.92, 0.74],
                [-0.95, 0.22, 0.84],
                [-0.80, 1.01, 0.76],
                [-0.30, 0.62, 0.89],
                [0.10, 1.00, 0.84],
                [2.05, 0.97, 0.84],
                [2.70, 0.62, 0.89],
                [3.25, 0.77, 0.76],
                [3.45, 0.22, 0.80],
                [3.58, 0.56, 0.66],
                [3.58, 0.40, 0.68],
            ],
        ),
        // Greenhouse: rear window, side windows, windscreen.
        hull(
            Material::Glass,
            &[
                [-0.60, 0.97, 0.74],
                [2.10, 0.95, 0.78],
                [0.15, 1.40, 0.59],
                [1.25, 1.40, 0.61],
            ],
        ),
        hull(
            PAINT,
            &[
                [0.05, 1.38, 0.60],
                [1.35, 1.37, 0.63],
                [0.20, 1.44, 0.52],
                [0.70, 1.45, 0.52],
                [1.15, 1.44, 0.54],
            ],
        ),
        // Seats and dashboard behind the glass.
        hull(
            Material::Rubber,
            &[
                [0.00, 0.92, 0.66],
                [1.75, 0.92, 0.66],
                [0.10, 1.20, 0.58],
                [1.15, 1.20, 0.58],
            ],
        ),
        // Bumpers.
        block(
            Material::Rubber,
            [-1.10, -0.98],
            [-0.74, 0.74],
            [0.24, 0.42],
        ),
        block(Material::Rubber, [3.42, 3.60], [-0.66, 0.66], [0.22, 0.40]),
        block(PLATE, [-1.10, -1.06], [-0.26, 0.26], [0.60, 0.71]),
        block(PLATE, [3.58, 3.60], [-0.26, 0.26], [0.42, 0.53]),
    ];
    parts.extend(pillars([[0.62, 0.98], [0.66, 1.39]], [0.80, 0.62], 0.09));
    parts.extend(pillars([[-0.52, 0.98], [0.14, 1.39]], [0.75, 0.60], 0.16));
    parts.extend(pair(TAIL_LAMP, [-1.09, -0.96], [0.44, 0.78], [0.70, 0.86]));
    parts.extend(pair(HEADLAMP, [3.30, 3.53], [0.40, 0.73], [0.56, 0.70]));
    parts.extend(mirrors(1.75, 0.98, 0.82, 0.90));
    parts.extend(wheels(VehicleModel::Sedan, 0.32, 0.21));
    parts
}

fn suv() -> Vec<ConvexPart> {
    let mut parts = vec![
        hull(
            PAINT,
            &[
                [-0.98, 0.48, 0.82],
                [-0.96, 1.08, 0.84],
                [-0.86, 0.28, 0.88],
                [-0.30, 0.75, 0.93],
                [-0.60, 1.14, 0.86],
                [2.10, 1.12, 0.88],
                [2.80, 0.75, 0.93],
                [3.30, 0.98, 0.80],
                [3.42, 0.28, 0.84],
                [3.58, 0.78, 0.74],
                [3.58, 0.48, 0.76],
            ],
        ),
        hull(
            Material::Glass,
            &[
                [-0.94, 1.10, 0.78],
                [2.12, 1.10, 0.82],
                [-0.72, 1.62, 0.66],
                [1.40, 1.63, 0.68],
            ],
        ),
        hull(
            PAINT,
            &[
                [-0.82, 1.60, 0.67],
                [1.45, 1.60, 0.70],
                [-0.60, 1.68, 0.58],
                [0.50, 1.70, 0.60],
                [1.20, 1.68, 0.60],
            ],
        ),
        hull(
            Material::Rubber,
            &[
                [-0.50, 1.00, 0.72],
                [1.85, 1.00, 0.72],
                [-0.40, 1.38, 0.64],
                [1.20, 1.38, 0.64],
            ],
        ),
        block(
            Material::Rubber,
            [-1.00, -0.88],
            [-0.80, 0.80],
            [0.30, 0.52],
        ),
        block(Material::Rubber, [3.40, 3.60], [-0.72, 0.72], [0.28, 0.48]),
        block(PLATE, [-1.00, -0.96], [-0.26, 0.26], [0.80, 0.91]),
        block(PLATE, [3.58, 3.60], [-0.26, 0.26], [0.50, 0.61]),
    ];
    parts.extend(pillars([[0.55, 1.12], [0.58, 1.61]], [0.84, 0.69], 0.10));
    parts.extend(pillars([[-0.90, 1.12], [-0.70, 1.61]], [0.79, 0.67], 0.22));
    parts.extend(pair(TAIL_LAMP, [-0.99, -0.84], [0.62, 0.86], [0.86, 1.14]));
    parts.extend(pair(HEADLAMP, [3.34, 3.55], [0.44, 0.78], [0.76, 0.91]));
    parts.extend(mirrors(1.75, 1.12, 0.86, 0.94));
    parts.extend(wheels(VehicleModel::Suv, 0.36, 0.24));
    parts
}

fn van() -> Vec<ConvexPart> {
    let mut parts = vec![
        // Cab and cargo space in one.
        hull(
            PAINT,
            &[
                [-1.13, 0.45, 0.95],
                [-1.13, 1.30, 0.98],
                [-1.08, 2.25, 0.88],
                [-0.95, 2.30, 0.80],
                [2.30, 2.28, 0.82],
                [2.45, 2.22, 0.88],
                [3.35, 1.25, 0.95],
                [3.35, 0.70, 0.98],
                [3.35, 0.32, 0.90],
                [-1.00, 0.32, 0.94],
            ],
        ),
        // Bonnet.
        hull(
            PAINT,
            &[
                [3.15, 1.24, 0.93],
                [3.20, 0.70, 0.98],
                [4.02, 1.02, 0.82],
                [4.18, 0.75, 0.80],
                [4.18, 0.42, 0.80],
                [3.95, 0.30, 0.88],
                [3.20, 0.30, 0.90],
            ],
        ),
        // Windscreen, a little proud of the coated hull.
        hull(
            Material::Glass,
            &[
                [3.31, 1.32, 0.88],
                [3.20, 1.32, 0.88],
                [2.57, 2.12, 0.80],
                [2.46, 2.10, 0.80],
            ],
        ),
        block(
            Material::Rubber,
            [-1.15, -1.00],
            [-0.92, 0.92],
            [0.36, 0.56],
        ),
        block(Material::Rubber, [4.00, 4.25], [-0.80, 0.80], [0.30, 0.58]),
        block(PLATE, [-1.15, -1.10], [-0.26, 0.26], [0.80, 0.91]),
        block(PLATE, [4.24, 4.25], [-0.26, 0.26], [0.40, 0.51]),
    ];
    parts.extend(pair(
        Material::Glass,
        [-1.15, -1.08],
        [0.12, 0.74],
        [1.45, 1.98],
    ));
    parts.extend(pair(TAIL_LAMP, [-1.15, -1.04], [0.82, 0.97], [0.95, 1.40]));
    parts.extend(pair(HEADLAMP, [3.90, 4.20], [0.48, 0.80], [0.80, 0.98]));
    parts.extend(side_windows(
        [[2.00, 1.35], [3.15, 1.35], [2.45, 1.98], [2.00, 1.98]],
        [0.985, 0.92],
    ));
    parts.extend(mirrors(2.95, 1.35, 0.94, 1.00));
    parts.extend(wheels(VehicleModel::Van, 0.35, 0.23));
    parts
}

fn truck() -> Vec<ConvexPart> {
    let mut parts = vec![
        // Cargo box.
        block(PAINT, [-1.96, 3.45], [-1.20, 1.20], [0.95, 3.00]),
        // Frame and underrun bar.
        block(Material::Metal, [-1.90, 4.60], [-0.45, 0.45], [0.55, 0.95]),
        block(Material::Metal, [-2.00, -1.88], [-1.10, 1.10], [0.45, 0.62]),
        // Cab.
        hull(
            PAINT,
            &[
                [3.62, 0.50, 1.08],
                [3.62, 2.40, 1.02],
                [4.90, 2.42, 0.98],
                [5.20, 1.35, 1.08],
                [5.38, 1.20, 1.06],
                [5.46, 0.90, 1.02],
                [5.46, 0.45, 1.02],
            ],
        ),
        hull(
            Material::Glass,
            &[
                [5.36, 1.32, 0.98],
                [5.22, 1.32, 0.98],
                [5.03, 2.20, 0.92],
                [4.88, 2.20, 0.92],
            ],
        ),
        block(Material::Rubber, [5.20, 5.50], [-1.08, 1.08], [0.40, 0.68]),
        block(PLATE, [-2.00, -1.95], [-0.26, 0.26], [0.66, 0.77]),
        block(PLATE, [5.49, 5.50], [-0.26, 0.26], [0.46, 0.57]),
    ];
    parts.extend(pair(TAIL_LAMP, [-1.99, -1.90], [0.75, 1.12], [0.66, 0.84]));
    parts.extend(pair(HEADLAMP, [5.38, 5.49], [0.62, 0.98], [0.72, 0.90]));
    parts.extend(side_windows(
        [[4.05, 1.40], [5.05, 1.40], [4.90, 2.15], [4.05, 2.15]],
        [1.085, 1.04],
    ));
    parts.extend(mirrors(5.05, 1.60, 1.06, 1.20));
    parts.extend(wheels(VehicleModel::Truck, 0.45, 0.28));
    parts
}

/// A slanted pillar on each side, from `line[0]` to `line[1]` (x, z), at these half widths.
fn pillars(line: [[f64; 2]; 2], half_widths: [f64; 2], width_m: f64) -> [ConvexPart; 2] {
    [1.0, -1.0].map(|side| {
        let vertices = line
            .iter()
            .zip(half_widths)
            .flat_map(|(&[x, z], half)| {
                [
                    [x, half + 0.01],
                    [x + width_m, half + 0.01],
                    [x, half - 0.04],
                    [x + width_m, half - 0.04],
                ]
                .map(|[x, y]| Point3::new(x, side * y, z))
            })
            .collect();
        ConvexPart {
            vertices,
            material: PAINT,
        }
    })
}

/// A thin side window on each side: its outline (x, z), half widths at its bottom and top.
fn side_windows(outline: [[f64; 2]; 4], half_widths: [f64; 2]) -> [ConvexPart; 2] {
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

fn mirrors(x: f64, z: f64, inner: f64, outer: f64) -> [ConvexPart; 2] {
    pair(PAINT, [x, x + 0.12], [inner, outer], [z, z + 0.13])
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODELS: [VehicleModel; 4] = [
        VehicleModel::Sedan,
        VehicleModel::Suv,
        VehicleModel::Van,
        VehicleModel::Truck,
    ];

    #[test]
    fn bodies_fill_their_dimensions_and_stay_inside() {
        for model in MODELS {
            let size = model.dimensions();
            let vertices = || model.body().parts.iter().flat_map(|part| &part.vertices);
            let max = |axis: usize| vertices().map(|v| v[axis]).fold(f64::MIN, f64::max);
            let min = |axis: usize| vertices().map(|v| v[axis]).fold(f64::MAX, f64::min);
            let front = size.length_m - size.rear_overhang_m;
            assert!((max(0) - front).abs() < 1e-9, "{model:?} front {}", max(0));
            assert!(
                (min(0) + size.rear_overhang_m).abs() < 1e-9,
                "{model:?} rear {}",
                min(0)
            );
            assert!(
                (max(1) - size.width_m / 2.0).abs() < 1e-9,
                "{model:?} width {}",
                max(1)
            );
            assert!((min(1) + size.width_m / 2.0).abs() < 1e-9, "{model:?}");
            assert!(
                (max(2) - size.height_m).abs() < 1e-9,
                "{model:?} top {}",
                max(2)
            );
            assert!(
                min(2) > -1e-9 && min(2) < 0.05,
                "{model:?} bottom {}",
                min(2)
            );
            assert!(
                model
                    .body()
                    .parts
                    .iter()
                    .all(|part| part.vertices.len() <= 30)
            );
        }
    }
}
