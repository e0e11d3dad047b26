use covista_world::{
    BicycleState, ControlInput, FrenetPose, LaneIndex, Road, STEP_S, VehicleDimensions,
    bicycle_step,
};

use crate::{
    LoopRoad, VehicleId, VehicleKind, VehicleModel,
    human::{Across, HumanDriver, Strip},
};

/// How far ahead in time a CAV's sideways movement is taken to go on.
const ENTERING_S: f64 = 1.0;

/// A vehicle of a ring, with everything there is to know of it.
#[derive(Debug, Clone)]
pub struct RingVehicle {
    /// Its name: 1 to `cavs` are the CAVs.
    pub id: VehicleId,
    /// Its model.
    pub model: VehicleModel,
    /// Its colour.
    pub paint: [u8; 3],
    /// Speed in m/s.
    pub speed_mps: f64,
    /// Acceleration over the last step in m/s^2, as it came out.
    pub accel_mps2: f64,
    /// The speed it would like to drive.
    pub desired_speed_mps: f64,
    pub(super) dimensions: VehicleDimensions,
    /// Where its lap began.
    pub(super) lap_from_m: f64,
    /// The rear axle in its lap: `s_m` lies in [0, period).
    pub(super) place: FrenetPose,
    /// The road's angle there since the beginning of the lap.
    pub(super) turned_rad: f64,
    pub(super) mover: Mover,
    /// Whom it follows: an index into the vehicles.
    pub(super) leader: Option<u32>,
}

/// Who moves a vehicle.
#[derive(Debug, Clone)]
pub(super) enum Mover {
    /// The input from outside, on the plant of Appendix A in the world frame.
    Cav(BicycleState),
    /// A driver, along the road.
    Human(HumanDriver),
}

impl RingVehicle {
    /// CAV or human.
    pub fn kind(&self) -> VehicleKind {
        match self.mover {
            Mover::Cav(_) => VehicleKind::Cav,
            Mover::Human(_) => VehicleKind::Human,
        }
    }

    /// Its dimensions.
    pub fn dimensions(&self) -> VehicleDimensions {
        self.dimensions
    }

    /// The rear axle's position and heading along the endless road.
    pub fn frenet(&self) -> FrenetPose {
        FrenetPose {
            s_m: self.lap_from_m + self.place.s_m,
            ..self.place
        }
    }

    /// The lane a human driver is changing to.
    pub fn human_lane_change(&self) -> Option<LaneIndex> {
        match &self.mover {
            Mover::Human(driver) => driver.lane_change(),
            Mover::Cav(_) => None,
        }
    }

    /// Rear-axle pose and speed in the world frame.
    pub fn state(&self, road: &Road) -> BicycleState {
        let FrenetPose {
            s_m, d_m, psi_rad, ..
        } = self.frenet();
        match self.mover {
            Mover::Cav(state) => state,
            Mover::Human(_) => BicycleState {
                pose: road.pose_from_frenet(s_m, d_m, psi_rad),
                speed_mps: self.speed_mps,
            },
        }
    }

    /// What lies between the centres of the two where they touch.
    pub(super) fn half_lengths_m(&self, leader: &Self) -> f64 {
        (self.dimensions.length_m + leader.dimensions.length_m) / 2.0
    }

    /// How far the front bumper lies ahead of the rear axle.
    pub(super) fn front_ahead_m(&self) -> f64 {
        self.dimensions.length_m - self.dimensions.rear_overhang_m
    }

    /// The front bumper in the lap of the rear axle.
    pub(super) fn front_m(&self) -> f64 {
        self.place.s_m + self.front_ahead_m()
    }

    /// What the body covers across the road.
    pub(super) fn across(&self) -> Across {
        self.front_across()
            .union(self.bumper_across(-self.dimensions.rear_overhang_m))
    }

    fn front_across(&self) -> Across {
        self.bumper_across(self.front_ahead_m())
    }

    /// What a bumper covers that lies so far ahead of the rear axle.
    fn bumper_across(&self, ahead_m: f64) -> Across {
        let middle_m = self.place.d_m + self.place.psi_rad * ahead_m;
        Across::around(middle_m, self.dimensions.width_m / 2.0)
    }

    /// The strip of road it covers in its lap, with what a human's signal or a CAV's sideways
    /// movement tells others; the front is brought into [0, period).
    pub(super) fn strip(&self, road: &LoopRoad) -> Strip {
        let body = self.across();
        let across = match &self.mover {
            Mover::Human(driver) => driver
                .lane_change()
                .map_or(body, |target| body.union(driver.swath(target, road.road()))),
            Mover::Cav(_) => body.moving(self.speed_mps * self.place.psi_rad * ENTERING_S),
        };
        let mut front_m = self.front_m();
        if front_m >= road.period_m() {
            front_m -= road.period_m();
        }
        Strip {
            rear_m: front_m - self.dimensions.length_m,
            front_m,
            across,
            front_across: self.front_across(),
            speed_mps: self.speed_mps,
        }
    }

    /// One step: a CAV by the bicycle model in the plane, a human by the same model along the road.
    pub(super) fn advance(&mut self, input: ControlInput, road: &LoopRoad) {
        let before_mps = self.speed_mps;
        let wheelbase_m = self.dimensions.wheelbase_m;
        match &mut self.mover {
            Mover::Cav(state) => {
                *state = bicycle_step(*state, input, wheelbase_m);
                self.speed_mps = state.speed_mps;
                let stretch = 1.0 - self.place.curvature_per_m * self.place.d_m;
                let along_m = before_mps * STEP_S * self.place.psi_rad.cos() / stretch;
                let hint_m = self.lap_from_m + self.place.s_m + along_m;
                self.place = road.road().to_frenet_pose_near(state.pose, hint_m);
                self.place.s_m -= self.lap_from_m;
            }
            Mover::Human(_) => {
                let (sin, cos) = self.place.psi_rad.sin_cos();
                let way_m = before_mps * STEP_S;
                let kappa = self.place.curvature_per_m;
                let along_m = way_m * cos / (1.0 - kappa * self.place.d_m);
                self.place.s_m += along_m;
                self.place.d_m += way_m * sin;
                self.place.psi_rad += way_m / wheelbase_m * input.tan_delta - kappa * along_m;
                self.speed_mps = (before_mps + input.accel_mps2 * STEP_S).max(0.0);
            }
        }
        self.accel_mps2 = (self.speed_mps - before_mps) / STEP_S;
        if self.place.s_m >= road.period_m() {
            self.place.s_m -= road.period_m();
            self.lap_from_m += road.period_m();
        } else if self.place.s_m < 0.0 {
            self.place.s_m += road.period_m();
            self.lap_from_m -= road.period_m();
        }
        let bend = road.bend(self.place.s_m);
        self.place.curvature_per_m = bend.curvature_per_m;
        self.turned_rad = bend.turned_rad;
    }
}
