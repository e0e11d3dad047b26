mod car;
mod cars;
mod large;
mod shapes;
mod solid;

use std::sync::OnceLock;

use covista_world::{ObjectClass, VehicleDimensions};
use serde::{Deserialize, Serialize};

use crate::Body;

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
    /// A compact car with a tailgate.
    Hatchback,
    /// A short car with four seats.
    CityCar,
    /// A very short car with two seats.
    TwoSeater,
    /// An estate car.
    Wagon,
    /// A tall family car.
    Minivan,
    /// A car with a covered load bed.
    Pickup,
    /// A small bus for goods or people.
    Transporter,
    /// A city bus.
    Bus,
}

impl VehicleModel {
    /// All models, in the order of their discriminants.
    pub const ALL: [Self; 12] = [
        Self::Sedan,
        Self::Suv,
        Self::Van,
        Self::Truck,
        Self::Hatchback,
        Self::CityCar,
        Self::TwoSeater,
        Self::Wagon,
        Self::Minivan,
        Self::Pickup,
        Self::Transporter,
        Self::Bus,
    ];

    /// Outer dimensions.
    pub fn dimensions(self) -> VehicleDimensions {
        let [length_m, width_m, height_m, wheelbase_m, rear_overhang_m] = match self {
            Self::Sedan => [4.7, 1.82, 1.45, 2.51, 1.10],
            Self::Suv => [4.6, 1.90, 1.70, 2.66, 1.00],
            Self::Van => [5.4, 2.00, 2.30, 3.30, 1.15],
            Self::Truck => [7.5, 2.40, 3.00, 4.20, 2.00],
            Self::Hatchback => [3.95, 1.66, 1.47, 2.50, 0.68],
            Self::CityCar => [3.40, 1.60, 1.46, 2.35, 0.46],
            Self::TwoSeater => [2.60, 1.54, 1.54, 1.82, 0.34],
            Self::Wagon => [4.60, 1.76, 1.48, 2.68, 1.02],
            Self::Minivan => [4.40, 1.78, 1.62, 2.70, 0.82],
            Self::Pickup => [5.40, 1.92, 1.82, 3.30, 1.18],
            Self::Transporter => [4.89, 1.90, 1.96, 3.00, 0.98],
            Self::Bus => [11.50, 2.55, 3.05, 5.90, 2.95],
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
            Self::Sedan
            | Self::Suv
            | Self::Hatchback
            | Self::CityCar
            | Self::TwoSeater
            | Self::Wagon
            | Self::Minivan
            | Self::Pickup => ObjectClass::Car,
            Self::Van | Self::Truck | Self::Transporter | Self::Bus => ObjectClass::Truck,
        }
    }

    /// Its shape in the vehicle frame; the coated parts are grey until a paint replaces them.
    pub fn body(self) -> &'static Body {
        static BODIES: [OnceLock<Body>; VehicleModel::ALL.len()] =
            [const { OnceLock::new() }; VehicleModel::ALL.len()];
        BODIES[self as usize].get_or_init(|| {
            let size = self.dimensions();
            Body {
                parts: match self {
                    Self::Sedan => cars::SEDAN.parts(size),
                    Self::Suv => cars::SUV.parts(size),
                    Self::Van => large::van(size),
                    Self::Truck => large::truck(size),
                    Self::Hatchback => cars::HATCHBACK.parts(size),
                    Self::CityCar => cars::CITY_CAR.parts(size),
                    Self::TwoSeater => cars::TWO_SEATER.parts(size),
                    Self::Wagon => cars::WAGON.parts(size),
                    Self::Minivan => cars::MINIVAN.parts(size),
                    Self::Pickup => cars::PICKUP.parts(size),
                    Self::Transporter => cars::TRANSPORTER.parts(size),
                    Self::Bus => cars::BUS.parts(size),
                },
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    use crate::{ConvexPart, Material};

    /// Every face of the hull counted by its outward normal.
    fn faces(part: &ConvexPart) -> usize {
        let vertices = &part.vertices;
        let mut normals: Vec<nalgebra::Vector3<f64>> = Vec::new();
        for (i, a) in vertices.iter().enumerate() {
            for (j, b) in vertices.iter().enumerate() {
                for c in vertices[i.max(j) + 1..].iter().filter(|_| i != j) {
                    let across = (b - a).cross(&(c - a));
                    if across.norm() < 1e-8 {
                        continue;
                    }
                    let normal = across.normalize();
                    let supports = vertices.iter().all(|v| normal.dot(&(v - a)) < 1e-6);
                    if supports && normals.iter().all(|known| (known - normal).norm() > 1e-4) {
                        normals.push(normal);
                    }
                }
            }
        }
        normals.len()
    }

    #[test]
    fn bodies_fill_their_dimensions_and_stand_on_the_ground() {
        for model in VehicleModel::ALL {
            let size = model.dimensions();
            let vertices = || model.body().parts.iter().flat_map(|part| &part.vertices);
            let max = |axis: usize| vertices().map(|v| v[axis]).fold(f64::MIN, f64::max);
            let min = |axis: usize| vertices().map(|v| v[axis]).fold(f64::MAX, f64::min);
            let expected = [
                (max(0), size.length_m - size.rear_overhang_m),
                (min(0), -size.rear_overhang_m),
                (max(1), size.width_m / 2.0),
                (min(1), -size.width_m / 2.0),
                (max(2), size.height_m),
                (min(2), 0.0),
            ];
            for (found, expected) in expected {
                assert!(
                    (found - expected).abs() < 1e-9,
                    "{model:?}: {found} for {expected}"
                );
            }
        }
    }

    #[test]
    fn every_part_is_a_hull_and_a_body_has_few_faces() {
        for model in VehicleModel::ALL {
            let parts = &model.body().parts;
            for (index, part) in parts.iter().enumerate() {
                let corners = part.vertices.len();
                assert!(
                    (4..=30).contains(&corners),
                    "{model:?} {index}: {corners} corners"
                );
                // Euler: no more faces than twice the corners less four, and four at least.
                let faces = faces(part);
                assert!(
                    (4..=2 * corners - 4).contains(&faces),
                    "{model:?} {index}: {faces}"
                );
            }
            let faces: usize = parts.iter().map(faces).sum();
            assert!(faces <= 330, "{model:?}: {faces} faces");
        }
    }

    #[test]
    fn left_is_the_mirror_image_of_right() {
        for model in VehicleModel::ALL {
            let vertices: Vec<_> = model
                .body()
                .parts
                .iter()
                .flat_map(|part| part.vertices.iter().map(|v| (part.material, *v)))
                .collect();
            for (material, v) in &vertices {
                let mirrored = Point3::new(v.x, -v.y, v.z);
                assert!(
                    vertices
                        .iter()
                        .any(|(other, w)| other == material && (w - mirrored).norm() < 1e-6),
                    "{model:?}: {v} of {material:?}"
                );
            }
        }
    }

    #[test]
    fn light_passes_under_the_body_and_between_the_wheels() {
        for model in VehicleModel::ALL {
            let size = model.dimensions();
            let lowest = model
                .body()
                .parts
                .iter()
                .filter(|part| part.material != Material::Rubber)
                .flat_map(|part| &part.vertices)
                .map(|v| v.z)
                .fold(f64::MAX, f64::min);
            assert!((0.13..0.60).contains(&lowest), "{model:?}: {lowest}");
            let wheels: Vec<_> = model
                .body()
                .parts
                .iter()
                .filter(|part| part.vertices.iter().any(|v| v.z.abs() < 1e-9))
                .map(|part| {
                    part.vertices
                        .iter()
                        .map(|v| v.coords)
                        .sum::<nalgebra::Vector3<f64>>()
                        / part.vertices.len() as f64
                })
                .collect();
            assert_eq!(wheels.len(), 4, "{model:?}");
            assert!(
                wheels
                    .iter()
                    .all(|w| w.x.abs() < 1e-6 || (w.x - size.wheelbase_m).abs() < 1e-6)
            );
        }
    }
}
