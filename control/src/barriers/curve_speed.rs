use covista_world::{BarrierKind, ControlInput, STEP_S};

use super::{Barrier, Input, Row, target};
use crate::{RoadProfile, SafetySettings};

/// h = v_limit(s) - v, in m/s: v^2 <= a_lat_max / (|kappa| + k_min) for all road within braking
/// distance, so that some counter-curvature is left to steer back with.
#[derive(Debug, Clone, Copy)]
pub struct CurveSpeed<'a> {
    safety: &'a SafetySettings,
    speed_mps: f64,
    limit_next_mps: f64,
    h_mps: f64,
}

impl<'a> CurveSpeed<'a> {
    /// At road s `s_m`; `next_s_m` is from where to where the vehicle may be one step on.
    pub fn new(
        profile: &RoadProfile,
        s_m: f64,
        next_s_m: [f64; 2],
        speed_mps: f64,
        safety: &'a SafetySettings,
    ) -> Self {
        Self {
            safety,
            speed_mps,
            limit_next_mps: profile.least_speed_limit_mps(next_s_m),
            h_mps: profile.speed_limit_mps(s_m) - speed_mps,
        }
    }
}

impl Barrier for CurveSpeed<'_> {
    fn kind(&self) -> BarrierKind {
        BarrierKind::CurveSpeed
    }

    fn h(&self) -> f64 {
        self.h_mps
    }

    fn h_next(&self, u: ControlInput) -> f64 {
        let next_mps = (self.speed_mps + u.accel_mps2 * STEP_S).max(0.0);
        self.limit_next_mps - next_mps - self.safety.noise_speed_mps
    }

    fn target(&self) -> f64 {
        target(self.h_mps, self.safety.eta).max(0.0)
    }

    fn row(&self) -> Row {
        let next_mps = self.limit_next_mps - self.target() - self.safety.noise_speed_mps;
        let v = self.speed_mps;
        let upper = ((next_mps - v) / STEP_S).max(-v / STEP_S);
        let upper = if self.h_mps < -1e-9 {
            // A vehicle that starts too fast for the road brakes at least gently.
            upper.clamp(-self.safety.brake_mps2, -self.safety.gentle_brake_mps2)
        } else {
            upper
        };
        Row::at_most(self.kind(), Input::Accel, upper, self.h_mps)
    }
}
