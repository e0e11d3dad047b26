use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// The angle that is equal to `angle_rad` modulo 2 pi and lies in (-pi, pi].
pub fn wrap_angle(angle_rad: f64) -> f64 {
    // Within a turn, as nearly all are, it needs no remainder.
    let wrapped = if (0.0..TAU).contains(&angle_rad) {
        angle_rad
    } else if -TAU < angle_rad && angle_rad < 0.0 {
        angle_rad + TAU
    } else {
        angle_rad.rem_euclid(TAU)
    };
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

/// A position and a heading in the plane, in metres and radians.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Se2Pose {
    /// x in metres.
    pub x_m: f64,
    /// y in metres.
    pub y_m: f64,
    /// Heading in radians, counter-clockwise from x.
    pub yaw_rad: f64,
}

impl Se2Pose {
    /// A pose from its parts.
    pub fn new(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        Self { x_m, y_m, yaw_rad }
    }

    /// The position as a vector.
    pub fn position(&self) -> Vector2<f64> {
        Vector2::new(self.x_m, self.y_m)
    }

    /// Unit vector along the heading.
    pub fn forward(&self) -> Vector2<f64> {
        let (sin, cos) = self.yaw_rad.sin_cos();
        Vector2::new(cos, sin)
    }

    /// Maps a point from this pose's frame to the frame the pose is given in.
    pub fn transform(&self, local: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.yaw_rad.sin_cos();
        Vector2::new(
            self.x_m + cos * local.x - sin * local.y,
            self.y_m + sin * local.x + cos * local.y,
        )
    }

    /// Maps a point from the frame the pose is given in to this pose's frame.
    pub fn inverse_transform(&self, outer: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let delta = outer - self.position();
        Vector2::new(
            cos * delta.x + sin * delta.y,
            -sin * delta.x + cos * delta.y,
        )
    }

    /// The pose `local`, given in this pose's frame, in the frame this pose is given in.
    pub fn compose(&self, local: Se2Pose) -> Se2Pose {
        let position = self.transform(local.position());
        Se2Pose::new(
            position.x,
            position.y,
            wrap_angle(self.yaw_rad + local.yaw_rad),
        )
    }

    /// The pose on the ground (z = 0) as a transform in space.
    pub fn to_isometry(&self) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(self.x_m, self.y_m, 0.0),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw_rad),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_are_inverse() {
        let pose = Se2Pose::new(3.0, -2.0, 0.7);
        let point = Vector2::new(1.5, 4.0);
        let back = pose.inverse_transform(pose.transform(point));
        assert!((back - point).norm() < 1e-12);
    }

    #[test]
    fn wraps_into_the_half_open_interval() {
        assert!((wrap_angle(3.0 * PI) - PI).abs() < 1e-12);
        assert!((wrap_angle(-PI) - PI).abs() < 1e-12);
        assert!((wrap_angle(-0.5) + 0.5).abs() < 1e-12);
    }
}
