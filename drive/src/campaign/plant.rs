use covista_control::SafetySettings;
use covista_world::{
    BicycleState, ControlInput, STEP_S, Se2Pose, VehicleDimensions, bicycle_step, wrap_angle,
};

/// What moves when the controller's input is applied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlantModel {
    /// The controller's own: an explicit Euler step of the kinematic bicycle.
    Kinematic,
    /// Acceleration and steering follow the input with a first-order lag.
    Lag {
        /// Time constant of both actuators in seconds.
        time_constant_s: f64,
    },
    /// Lateral velocity and yaw rate of a bicycle on linear tyres.
    Dynamic,
}

impl PlantModel {
    /// Its name in rows.
    pub fn name(self) -> String {
        match self {
            Self::Kinematic => "kinematic".to_owned(),
            Self::Lag { time_constant_s } => format!("lag-{time_constant_s:.1}-s"),
            Self::Dynamic => "dynamic-bicycle".to_owned(),
        }
    }
}

/// Disturbance of one step, in shares of its bounds, each in [-1, 1].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Disturbance {
    /// Position along the heading, of W_p.
    pub position: f64,
    /// Speed, of W_v.
    pub speed: f64,
    /// Direction of travel against heading, of `noise_slip_rad`, positive to the left.
    pub slip: f64,
    /// Driven curvature, of `noise_curvature_per_m`, positive to the left.
    pub curvature: f64,
}

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

/// Below this speed the tyres roll without slip; up to [`DYNAMIC_MPS`] the models are blended.
const KINEMATIC_MPS: f64 = 3.0;
const DYNAMIC_MPS: f64 = 5.0;
/// Slower than this is standstill, but for rounding.
const STANDSTILL_MPS: f64 = 1e-9;
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

    /// Understeer gradient K in rad s^2/m: at steady state `delta = L kappa + K v^2 kappa`.
    #[cfg(test)]
    pub fn understeer(&self) -> f64 {
        let wheelbase_m = self.to_front_m + self.to_rear_m;
        self.mass_kg / wheelbase_m
            * (self.to_rear_m / self.front_stiffness - self.to_front_m / self.rear_stiffness)
    }
}

/// The plant and the states that the kinematic model has not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plant {
    pub model: PlantModel,
    /// Rear axle and speed along the heading.
    pub state: BicycleState,
    dimensions: VehicleDimensions,
    /// What the actuators do.
    actual: ControlInput,
    /// Lateral velocity of the centre of mass in m/s.
    lateral_mps: f64,
    yaw_rate_radps: f64,
}

impl Plant {
    pub fn new(model: PlantModel, state: BicycleState, dimensions: VehicleDimensions) -> Self {
        Self {
            model,
            state,
            dimensions,
            actual: ControlInput::default(),
            lateral_mps: 0.0,
            yaw_rate_radps: 0.0,
        }
    }

    /// One step of Ts with `u` applied, disturbed by shares of the settings' bounds.
    pub fn step(&mut self, u: ControlInput, disturbance: Disturbance, bounds: &SafetySettings) {
        let before = self.state;
        let wheelbase_m = self.dimensions.wheelbase_m;
        match self.model {
            PlantModel::Kinematic => self.state = bicycle_step(before, u, wheelbase_m),
            PlantModel::Lag { time_constant_s } => {
                let share = 1.0 - (-STEP_S / time_constant_s).exp();
                self.actual.tan_delta += share * (u.tan_delta - self.actual.tan_delta);
                self.actual.accel_mps2 += share * (u.accel_mps2 - self.actual.accel_mps2);
                self.state = bicycle_step(before, self.actual, wheelbase_m);
            }
            PlantModel::Dynamic => self.dynamic_step(u),
        }
        self.disturb(before, disturbance, bounds);
    }

    /// Moves the state by the noise of one step. There is none at standstill, and brakes that bring
    /// the vehicle to a stop hold it.
    fn disturb(&mut self, before: BicycleState, of: Disturbance, bounds: &SafetySettings) {
        let v = before.speed_mps;
        if v <= STANDSTILL_MPS {
            return;
        }
        let pose = &mut self.state.pose;
        let driven = Se2Pose::new(pose.x_m - before.pose.x_m, pose.y_m - before.pose.y_m, 0.0);
        let share_m = bounds.noise_position_share * before.speed_mps * STEP_S;
        let along_m = of.position * bounds.noise_position_m.min(share_m);
        let (sin, cos) = (of.slip * bounds.noise_slip_rad).sin_cos();
        let (x, y) = (
            driven.x_m + along_m * before.pose.yaw_rad.cos(),
            driven.y_m + along_m * before.pose.yaw_rad.sin(),
        );
        pose.x_m = before.pose.x_m + cos * x - sin * y;
        pose.y_m = before.pose.y_m + sin * x + cos * y;
        let turned = of.curvature * bounds.noise_curvature_per_m * v * STEP_S;
        pose.yaw_rad = wrap_angle(pose.yaw_rad + turned);
        if self.state.speed_mps > STANDSTILL_MPS {
            let faster_mps = of.speed * bounds.noise_speed_mps;
            self.state.speed_mps = (self.state.speed_mps + faster_mps).max(0.0);
        }
    }

    fn dynamic_step(&mut self, u: ControlInput) {
        let sedan = Sedan::new(self.dimensions.wheelbase_m);
        let v = self.state.speed_mps;
        let rolling = ((DYNAMIC_MPS - v) / (DYNAMIC_MPS - KINEMATIC_MPS)).clamp(0.0, 1.0);
        let delta = u.tan_delta.atan();
        let dt = STEP_S / SUBSTEPS as f64;
        for _ in 0..SUBSTEPS {
            let (vy, r) = (self.lateral_mps, self.yaw_rate_radps);
            let rolled_r = v * u.tan_delta / self.dimensions.wheelbase_m;
            let rolled_vy = rolled_r * sedan.to_rear_m;
            if rolling < 1.0 {
                let front =
                    sedan.front_stiffness * (delta - ((vy + sedan.to_front_m * r) / v).atan());
                let rear = -sedan.rear_stiffness * ((vy - sedan.to_rear_m * r) / v).atan();
                let front = front * delta.cos();
                let vy_next = vy + dt * ((front + rear) / sedan.mass_kg - v * r);
                let moment = sedan.to_front_m * front - sedan.to_rear_m * rear;
                let r_next = r + dt * moment / sedan.yaw_inertia_kgm2;
                self.lateral_mps = rolling * rolled_vy + (1.0 - rolling) * vy_next;
                self.yaw_rate_radps = rolling * rolled_r + (1.0 - rolling) * r_next;
            } else {
                (self.lateral_mps, self.yaw_rate_radps) = (rolled_vy, rolled_r);
            }
            // The rear axle moves sideways by what the tyres slip.
            let axle_mps = self.lateral_mps - sedan.to_rear_m * self.yaw_rate_radps;
            let pose = &mut self.state.pose;
            let (sin, cos) = pose.yaw_rad.sin_cos();
            pose.x_m += dt * (v * cos - axle_mps * sin);
            pose.y_m += dt * (v * sin + axle_mps * cos);
            pose.yaw_rad = wrap_angle(pose.yaw_rad + dt * self.yaw_rate_radps);
        }
        self.state.speed_mps = (v + u.accel_mps2 * STEP_S).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMENSIONS: VehicleDimensions = VehicleDimensions {
        length_m: 4.6,
        width_m: 1.85,
        height_m: 1.5,
        wheelbase_m: 2.51,
        rear_overhang_m: 0.95,
    };

    fn at(model: PlantModel, speed_mps: f64) -> Plant {
        let state = BicycleState {
            pose: Se2Pose::default(),
            speed_mps,
        };
        Plant::new(model, state, DIMENSIONS)
    }

    #[test]
    fn the_dynamic_bicycle_settles_at_the_understeer_formula() {
        for (v, delta) in [(10.0, 0.03), (20.0, 0.015), (30.0, 0.008)] {
            let mut plant = at(PlantModel::Dynamic, v);
            let u = ControlInput {
                tan_delta: f64::tan(delta),
                accel_mps2: 0.0,
            };
            for _ in 0..1000 {
                plant.step(u, Disturbance::default(), &SafetySettings::default());
            }
            let curvature = plant.yaw_rate_radps / v;
            let k = Sedan::new(DIMENSIONS.wheelbase_m).understeer();
            let expected = delta / (DIMENSIONS.wheelbase_m + k * v * v);
            assert!(k > 0.0);
            assert!(
                (curvature / expected - 1.0).abs() < 0.01,
                "{curvature} {expected}"
            );
        }
    }

    #[test]
    fn without_slip_the_dynamic_bicycle_is_the_kinematic_one() {
        let (mut one, mut other) = (at(PlantModel::Dynamic, 2.5), at(PlantModel::Kinematic, 2.5));
        let u = ControlInput {
            tan_delta: 0.2,
            accel_mps2: 0.0,
        };
        for _ in 0..300 {
            one.step(u, Disturbance::default(), &SafetySettings::default());
            other.step(u, Disturbance::default(), &SafetySettings::default());
        }
        let apart = one.state.pose.position() - other.state.pose.position();
        assert!(apart.norm() < 0.03, "{apart}");
        assert!((one.state.pose.yaw_rad - other.state.pose.yaw_rad).abs() < 1e-9);
    }

    #[test]
    fn a_lag_costs_its_time_constant_of_way() {
        let mut lag = at(
            PlantModel::Lag {
                time_constant_s: 0.3,
            },
            20.0,
        );
        let mut ideal = at(PlantModel::Kinematic, 20.0);
        let brake = ControlInput {
            tan_delta: 0.0,
            accel_mps2: -8.0,
        };
        for _ in 0..400 {
            lag.step(brake, Disturbance::default(), &SafetySettings::default());
            ideal.step(brake, Disturbance::default(), &SafetySettings::default());
        }
        let later_m = lag.state.pose.x_m - ideal.state.pose.x_m;
        assert!((later_m - 0.3 * 20.0).abs() < 0.5, "{later_m}");
    }

    #[test]
    fn the_disturbance_is_what_the_settings_bound() {
        let bounds = SafetySettings::default();
        let mut plant = at(PlantModel::Kinematic, 20.0);
        let full = Disturbance {
            position: 1.0,
            speed: 1.0,
            slip: 1.0,
            curvature: 1.0,
        };
        plant.step(ControlInput::default(), full, &bounds);
        let BicycleState { pose, speed_mps } = plant.state;
        let way_m = 0.2 + bounds.noise_position_m;
        assert!((pose.position().norm() - way_m).abs() < 1e-12);
        assert!((pose.y_m.atan2(pose.x_m) - bounds.noise_slip_rad).abs() < 1e-12);
        assert!((pose.yaw_rad - bounds.noise_curvature_per_m * 0.2).abs() < 1e-12);
        assert!((speed_mps - 20.0 - bounds.noise_speed_mps).abs() < 1e-12);
    }
}
