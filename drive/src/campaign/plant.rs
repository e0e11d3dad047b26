use covista_control::SafetySettings;
use covista_world::{
    BicycleState, ControlInput, FrenetPose, Road, STEP_S, Se2Pose, VehicleDimensions, bicycle_step,
    wrap_angle,
};

use super::{
    lag::{Motion, lag_share, led},
    sedan::{Sedan, Sway},
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
        /// Whether the controller is told the state that the actuators lead to, instead of the
        /// state that is.
        is_told: bool,
    },
    /// Lateral velocity and yaw rate of a bicycle on linear tyres.
    Dynamic,
}

impl PlantModel {
    /// Its name in rows.
    pub fn name(self) -> String {
        match self {
            Self::Kinematic => "kinematic".to_owned(),
            Self::Lag {
                time_constant_s,
                is_told,
            } => {
                let told = if is_told { "-told" } else { "" };
                format!("lag-{time_constant_s:.1}-s{told}")
            }
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

/// Slower than this is standstill, but for rounding.
const STANDSTILL_MPS: f64 = 1e-9;

/// The plant and the states that the kinematic model has not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plant {
    pub model: PlantModel,
    /// Rear axle and speed along the heading.
    pub state: BicycleState,
    dimensions: VehicleDimensions,
    /// What the actuators do.
    actual: ControlInput,
    sway: Sway,
}

impl Plant {
    /// At `state`, or, where the controller is told what a lag leads to, so far behind that it is
    /// told `state`. Steering and tyres have settled on the road's curve.
    pub fn new(
        model: PlantModel,
        state: BicycleState,
        dimensions: VehicleDimensions,
        road: &Road,
    ) -> Self {
        let now = road.to_frenet_pose(state.pose);
        let curvature = now.curvature_per_m / (1.0 - now.curvature_per_m * now.d_m);
        let mut plant = Self {
            model,
            state,
            dimensions,
            actual: ControlInput {
                tan_delta: curvature * dimensions.wheelbase_m,
                accel_mps2: 0.0,
            },
            sway: Sedan::new(dimensions.wheelbase_m).settled(state.speed_mps, curvature),
        };
        let (_, told) = plant.told(now, road);
        if told != now {
            let behind_m = 2.0 * now.s_m - told.s_m;
            plant.state.pose = road.pose_from_frenet(behind_m, now.d_m, now.psi_rad);
        }
        plant
    }

    /// The own state as the controller is told it, in the plane and on the road; `now` is where
    /// the plant is.
    pub fn told(&self, now: FrenetPose, road: &Road) -> (BicycleState, FrenetPose) {
        match self.model {
            PlantModel::Lag {
                time_constant_s,
                is_told: true,
            } => {
                let motion = Motion {
                    speed_mps: self.state.speed_mps,
                    accel_mps2: self.actual.accel_mps2,
                    curvature_per_m: self.actual.tan_delta / self.dimensions.wheelbase_m,
                };
                led(time_constant_s, motion, now, road)
            }
            _ => (self.state, now),
        }
    }

    /// One step of Ts with `u` applied, disturbed by shares of the settings' bounds.
    pub fn step(&mut self, u: ControlInput, disturbance: Disturbance, bounds: &SafetySettings) {
        let before = self.state;
        let wheelbase_m = self.dimensions.wheelbase_m;
        match self.model {
            PlantModel::Kinematic => self.state = bicycle_step(before, u, wheelbase_m),
            PlantModel::Lag {
                time_constant_s, ..
            } => {
                let share = lag_share(time_constant_s);
                self.actual.tan_delta += share * (u.tan_delta - self.actual.tan_delta);
                self.actual.accel_mps2 += share * (u.accel_mps2 - self.actual.accel_mps2);
                self.state = bicycle_step(before, self.actual, wheelbase_m);
            }
            PlantModel::Dynamic => {
                (self.state, self.sway) = Sedan::new(wheelbase_m).step(before, self.sway, u);
            }
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
}

#[cfg(test)]
mod tests {
    use covista_world::RoadSegment;

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
        let straight = [RoadSegment::Straight { length_m: 2e3 }];
        let road = Road::new(Se2Pose::default(), &straight, 3.5).expect("a road");
        Plant::new(model, state, DIMENSIONS, &road)
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
                is_told: false,
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

    /// Over throttle, brakes and a stop that is not reached; the controller's model in between.
    #[test]
    fn what_a_lag_leads_to_moves_as_if_there_were_none() {
        let straight = [RoadSegment::Straight { length_m: 2e3 }];
        let road = Road::new(Se2Pose::default(), &straight, 3.5).expect("a road");
        let model = PlantModel::Lag {
            time_constant_s: 0.3,
            is_told: true,
        };
        let mut lag = at(model, 20.0);
        let mut ideal = at(PlantModel::Kinematic, 20.0);
        assert!(lag.state.pose.x_m < ideal.state.pose.x_m - 5.0);
        for step in 0..600 {
            let (told, _) = lag.told(road.to_frenet_pose(lag.state.pose), &road);
            let apart = told.pose.position() - ideal.state.pose.position();
            assert!(apart.norm() < 1e-6, "{step}: {apart}");
            assert!((told.speed_mps - ideal.state.speed_mps).abs() < 1e-9);
            assert!(lag.state.pose.x_m < told.pose.x_m);
            let brakes = step % 200 < 80;
            let u = ControlInput {
                tan_delta: 0.0,
                accel_mps2: if brakes { -8.0 } else { 3.0 },
            };
            for plant in [&mut lag, &mut ideal] {
                plant.step(u, Disturbance::default(), &SafetySettings::default());
            }
        }
    }

    #[test]
    fn a_lag_that_is_told_starts_where_it_is_told_to_be_on_a_curve_too() {
        let arc = [RoadSegment::Arc {
            length_m: 300.0,
            curvature_per_m: 0.01,
        }];
        let road = Road::new(Se2Pose::default(), &arc, 3.5).expect("a road");
        let state = BicycleState {
            pose: road.pose_from_frenet(50.0, 0.4, 0.0),
            speed_mps: 15.0,
        };
        let model = PlantModel::Lag {
            time_constant_s: 0.2,
            is_told: true,
        };
        let plant = Plant::new(model, state, DIMENSIONS, &road);
        let (told, there) = plant.told(road.to_frenet_pose(plant.state.pose), &road);
        assert!((told.pose.position() - state.pose.position()).norm() < 1e-3);
        assert!(there.psi_rad.abs() < 1e-3 && (there.d_m - 0.4).abs() < 1e-6);
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
