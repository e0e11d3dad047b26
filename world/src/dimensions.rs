use serde::{Deserialize, Serialize};

use crate::Se2Pose;

/// What a detector tells apart (KITTI's `Car`; `Van` and `Truck` taken together).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObjectClass {
    /// Sedans and SUVs.
    Car,
    /// Vans and trucks.
    Truck,
}

/// Outer dimensions of a vehicle, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleDimensions {
    /// Bumper to bumper.
    pub length_m: f64,
    /// Without mirrors.
    pub width_m: f64,
    /// Ground to roof.
    pub height_m: f64,
    /// Front to rear axle.
    pub wheelbase_m: f64,
    /// Rear axle to rear bumper.
    pub rear_overhang_m: f64,
}

impl VehicleDimensions {
    /// How far the body's centre lies ahead of the rear axle.
    pub fn center_ahead_of_axle_m(&self) -> f64 {
        self.length_m / 2.0 - self.rear_overhang_m
    }

    /// The pose of the body's centre, from the pose of the rear axle.
    pub fn center_pose(&self, rear_axle: Se2Pose) -> Se2Pose {
        rear_axle.compose(Se2Pose::new(self.center_ahead_of_axle_m(), 0.0, 0.0))
    }

    /// The pose of the rear axle, from the pose of the body's centre.
    pub fn axle_pose(&self, center: Se2Pose) -> Se2Pose {
        center.compose(Se2Pose::new(-self.center_ahead_of_axle_m(), 0.0, 0.0))
    }

    /// Corners of the body in the frame of the rear axle: front left, front right, rear right,
    /// rear left.
    pub fn corners_from_axle(&self) -> [nalgebra::Vector2<f64>; 4] {
        let (front, rear, half) = (
            self.length_m - self.rear_overhang_m,
            -self.rear_overhang_m,
            self.width_m / 2.0,
        );
        [
            nalgebra::Vector2::new(front, half),
            nalgebra::Vector2::new(front, -half),
            nalgebra::Vector2::new(rear, -half),
            nalgebra::Vector2::new(rear, half),
        ]
    }
}
