use covista_world::{BicycleState, ControlInput, STEP_S, wrap_angle};

/// A sedan on linear tyres.
///
/// ```text
/// m (vy' + v r) = F_f cos(delta) + F_r,   I_z r' = a F_f cos(delta) - b F_r
/// F_f = -C_f (atan2(vy + a r, v) - delta),   F_r = -C_r atan2(vy - b r, v)
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sedan {
    pub mass_kg: f64,
    pub yaw_inertia_kgm2: f64,
    /// Centre of mass to the front axle, in metres.
    pub to_front_m: f64,
    /// Centre of mass to the rear axle, in metres.
    pub to_rear_m: f64,
    /// Of both front tyres, in N/rad.
    pub front_stiffness: f64,
    /// Of both rear tyres, in N/rad.
    pub rear_stiffness: f64,
}

/// What the kinematic bicycle has not.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sway {
    /// Of the centre of mass, in m/s.
    pub lateral_mps: f64,
    pub yaw_rate_radps: f64,
}

/// Below this speed the tyres roll without slip; up to [`DYNAMIC_MPS`] the models are blended.
const KINEMATIC_MPS: f64 = 3.0;
const DYNAMIC_MPS: f64 = 5.0;
/// Steps of the tyres' fast dynamics in one of the controller's.
const SUBSTEPS: usize = 10;

impl Sedan {
    /// A mid-size sedan with this wheelbase, a little more of its weight on the front axle.
    pub fn new(wheelbase_m: f64) -> Self {
        Self {
            mass_kg: 1500.0,
            yaw_inertia_kgm2: 2500.0,
            to_front_m: 0.45 * wheelbase_m,
            to_rear_m: 0.55 * wheelbase_m,
            front_stiffness: 120e3,
            rear_stiffness: 130e3,
        }
    }

    /// In a steady turn.
    pub fn settled(&self, speed_mps: f64, curvature_per_m: f64) -> Sway {
        let yaw_rate_radps = speed_mps * curvature_per_m;
        let rear_share = self.to_front_m / (self.to_front_m + self.to_rear_m);
        let rear_force = rear_share * self.mass_kg * speed_mps * yaw_rate_radps;
        let slip_rad = rear_force / self.rear_stiffness * (1.0 - rolling(speed_mps));
        Sway {
            lateral_mps: self.to_rear_m * yaw_rate_radps - speed_mps * slip_rad.tan(),
            yaw_rate_radps,
        }
    }

    /// One step of Ts with `u` applied; the state is that of the rear axle.
    pub fn step(
        &self,
        mut state: BicycleState,
        mut sway: Sway,
        u: ControlInput,
    ) -> (BicycleState, Sway) {
        let v = state.speed_mps;
        let rolling = rolling(v);
        let delta = u.tan_delta.atan();
        let dt = STEP_S / SUBSTEPS as f64;
        let rolled_r = v * u.tan_delta / (self.to_front_m + self.to_rear_m);
        let rolled_vy = rolled_r * self.to_rear_m;
        for _ in 0..SUBSTEPS {
            let (vy, r) = (sway.lateral_mps, sway.yaw_rate_radps);
            (sway.lateral_mps, sway.yaw_rate_radps) = (rolled_vy, rolled_r);
            if rolling < 1.0 {
                let front =
                    self.front_stiffness * (delta - ((vy + self.to_front_m * r) / v).atan());
                let rear = -self.rear_stiffness * ((vy - self.to_rear_m * r) / v).atan();
                let front = front * delta.cos();
                let vy_next = vy + dt * ((front + rear) / self.mass_kg - v * r);
                let moment = self.to_front_m * front - self.to_rear_m * rear;
                let r_next = r + dt * moment / self.yaw_inertia_kgm2;
                sway.lateral_mps = rolling * rolled_vy + (1.0 - rolling) * vy_next;
                sway.yaw_rate_radps = rolling * rolled_r + (1.0 - rolling) * r_next;
            }
            // The rear axle moves sideways by what the tyres slip.
            let axle_mps = sway.lateral_mps - self.to_rear_m * sway.yaw_rate_radps;
            let pose = &mut state.pose;
            let (sin, cos) = pose.yaw_rad.sin_cos();
            pose.x_m += dt * (v * cos - axle_mps * sin);
            pose.y_m += dt * (v * sin + axle_mps * cos);
            pose.yaw_rad = wrap_angle(pose.yaw_rad + dt * sway.yaw_rate_radps);
        }
        state.speed_mps = (v + u.accel_mps2 * STEP_S).max(0.0);
        (state, sway)
    }

    /// Understeer gradient K in rad s^2/m: at steady state `delta = L kappa + K v^2 kappa`.
    #[cfg(test)]
    pub fn understeer(&self) -> f64 {
        let wheelbase_m = self.to_front_m + self.to_rear_m;
        self.mass_kg / wheelbase_m
            * (self.to_rear_m / self.front_stiffness - self.to_front_m / self.rear_stiffness)
    }
}

/// Share of the model that rolls without slip.
fn rolling(speed_mps: f64) -> f64 {
    ((DYNAMIC_MPS - speed_mps) / (DYNAMIC_MPS - KINEMATIC_MPS)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHEELBASE_M: f64 = 2.51;

    #[test]
    fn it_settles_at_the_understeer_formula() {
        let sedan = Sedan::new(WHEELBASE_M);
        for (v, delta) in [(10.0, 0.03), (20.0, 0.015), (30.0, 0.008)] {
            let mut state = BicycleState {
                pose: Default::default(),
                speed_mps: v,
            };
            let u = ControlInput {
                tan_delta: f64::tan(delta),
                accel_mps2: 0.0,
            };
            let mut sway = Sway::default();
            for _ in 0..1000 {
                (state, sway) = sedan.step(state, sway, u);
            }
            let curvature = sway.yaw_rate_radps / v;
            let k = sedan.understeer();
            let expected = delta / (WHEELBASE_M + k * v * v);
            assert!(k > 0.0);
            assert!(
                (curvature / expected - 1.0).abs() < 0.01,
                "{curvature} {expected}"
            );
            let settled = sedan.settled(v, curvature);
            let apart_mps = (settled.lateral_mps - sway.lateral_mps).abs();
            assert!(apart_mps < 0.01, "{settled:?} {sway:?}");
        }
    }
}
