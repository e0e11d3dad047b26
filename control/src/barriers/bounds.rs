use covista_world::{ControlInput, STEP_S};

use crate::SafetySettings;

/// U at one state, and v + a Ts >= 0: |tan(delta)| <= `tan_delta`, `accel_min` <= a <= `accel_max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Largest |tan(delta)|.
    pub tan_delta: f64,
    /// Smallest acceleration.
    pub accel_min_mps2: f64,
    /// Largest acceleration.
    pub accel_max_mps2: f64,
}

impl Bounds {
    /// At speed v.
    pub fn new(speed_mps: f64, wheelbase_m: f64, safety: &SafetySettings) -> Self {
        Self {
            tan_delta: tan_delta_limit(speed_mps, wheelbase_m, safety),
            accel_min_mps2: (-safety.brake_mps2).max(-speed_mps / STEP_S),
            accel_max_mps2: safety.accel_max_mps2,
        }
    }

    /// The input of U nearest to `u`.
    pub fn clamp(&self, u: ControlInput) -> ControlInput {
        ControlInput {
            tan_delta: u.tan_delta.max(-self.tan_delta).min(self.tan_delta),
            accel_mps2: u
                .accel_mps2
                .min(self.accel_max_mps2)
                .max(self.accel_min_mps2),
        }
    }
}

/// |tan(delta)| in U at this speed: the steering's stop and the lateral acceleration.
pub fn tan_delta_limit(speed_mps: f64, wheelbase_m: f64, safety: &SafetySettings) -> f64 {
    let grip = safety.lateral_accel_max_mps2 * wheelbase_m / speed_mps.powi(2).max(1e-9);
    safety.tan_delta_max.min(grip)
}
