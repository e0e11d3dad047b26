mod cars;
mod large;
mod shapes;

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
}

impl VehicleModel {
    /// All models, in the order of their discriminants.
    pub const ALL: [Self; 4] = [Self::Sedan, Self::Suv, Self::Van, Self::Truck];

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
        static BODIES: [OnceLock<Body>; VehicleModel::ALL.len()] =
            [const { OnceLock::new() }; VehicleModel::ALL.len()];
        BODIES[self as usize].get_or_init(|| Body {
            parts: match self {
                Self::Sedan => cars::sedan(),
                Self::Suv => cars::suv(),
                Self::Van => large::van(),
                Self::Truck => large::truck(),
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_fill_their_dimensions_and_stay_inside() {
        for model in VehicleModel::ALL {
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
