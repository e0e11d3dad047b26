use serde::{Deserialize, Serialize};

use crate::{Se2Pose, wrap_angle};

/// The sampling time Ts of the plant and of the controller (Appendix A).
pub const STEP_S: f64 = 0.01;

/// The control state x = [p_x, p_y, psi, v] of Appendix A, at the rear axle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BicycleState {
    /// Pose of the rear axle in the world.
    pub pose: Se2Pose,
    /// Speed v in m/s.
    pub speed_mps: f64,
}

/// The control input u = [tan(delta), a] of Appendix A.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ControlInput {
    /// Tangent of the steering angle.
    pub tan_delta: f64,
    /// Acceleration in m/s^2.
    pub accel_mps2: f64,
}

/// One explicit Euler step of the kinematic bicycle model (Appendix A, Eq. of `x_{t+1}`).
///
/// The speed stays at or above zero: a vehicle does not reverse.
pub fn bicycle_step(state: BicycleState, u: ControlInput, wheelbase_m: f64) -> BicycleState {
    let BicycleState { pose, speed_mps: v } = state;
    let (sin, cos) = pose.yaw_rad.sin_cos();
    BicycleState {
        pose: Se2Pose::new(
            pose.x_m + v * cos * STEP_S,
            pose.y_m + v * sin * STEP_S,
            wrap_angle(pose.yaw_rad + v * STEP_S / wheelbase_m * u.tan_delta),
        ),
        speed_mps: (v + u.accel_mps2 * STEP_S).max(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_steering_angle_drives_a_circle() {
        let wheelbase_m = 2.51;
        let radius_m = 50.0;
        let u = ControlInput {
            tan_delta: wheelbase_m / radius_m,
            accel_mps2: 0.0,
        };
        let mut state = BicycleState {
            pose: Se2Pose::new(radius_m, 0.0, std::f64::consts::FRAC_PI_2),
            speed_mps: 10.0,
        };
        for _ in 0..1000 {
            state = bicycle_step(state, u, wheelbase_m);
        }
        // Explicit Euler spirals outwards by about v^2 Ts / (2 R) a second.
        assert!((state.pose.position().norm() - radius_m).abs() < 0.2);
        assert!((state.pose.yaw_rad - wrap_angle(std::f64::consts::FRAC_PI_2 + 2.0)).abs() < 1e-9);
    }

    #[test]
    fn braking_ends_at_standstill() {
        let mut state = BicycleState {
            pose: Se2Pose::default(),
            speed_mps: 0.05,
        };
        for _ in 0..3 {
            state = bicycle_step(
                state,
                ControlInput {
                    tan_delta: 0.0,
                    accel_mps2: -8.0,
                },
                2.51,
            );
        }
        assert!(state.speed_mps.abs() < 1e-12);
    }
}
