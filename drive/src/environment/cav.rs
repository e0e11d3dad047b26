use covista_control::{
    ControlSettings, Controller, EgoState, Manoeuvre, Neighbour, RoadProfile, SettingsError,
    SightLine, Situation,
};
use covista_planner::learning::{ActionSet, InputShares, Options};
use covista_traffic::RingVehicle;
use covista_world::{
    Action, ActionVerdict, BicycleState, ControlInput, FilterOutcome, FrenetPose, LANE_COUNT,
    LaneIndex, Road, StationId, VehicleDimensions,
};

use super::STEERING_S;
use crate::ControlMode;

/// One CAV of a ring: what it knows, and its controller.
pub(super) struct RingCav {
    pub station: StationId,
    pub dimensions: VehicleDimensions,
    pub desired_speed_mps: f64,
    pub state: BicycleState,
    pub frenet: FrenetPose,
    pub sight: SightLine,
    /// Whom it knows of, as of now.
    pub neighbours: Vec<Neighbour>,
    /// What it tells the others to be about, and since when in seconds.
    pub announced: (Action, f64),
    /// Its legal and its safe actions at the newest behaviour step.
    pub options: Options,
    pub outcome: FilterOutcome,
    pub input: ControlInput,
    /// Whether a lane change began in the newest step.
    pub has_begun: bool,
    /// The control input that it chose itself, where it steers.
    chosen: Option<InputShares>,
    controller: Controller,
}

impl RingCav {
    pub fn new(
        vehicle: &RingVehicle,
        road: &Road,
        settings: ControlSettings,
    ) -> Result<Self, SettingsError> {
        let frenet = vehicle.frenet();
        Ok(Self {
            station: StationId(vehicle.id.0),
            dimensions: vehicle.dimensions(),
            desired_speed_mps: vehicle.desired_speed_mps,
            state: vehicle.state(road),
            frenet,
            sight: SightLine::new([f64::NEG_INFINITY; LANE_COUNT as usize], 0.0),
            neighbours: Vec::new(),
            announced: (Action::KeepLane, 0.0),
            options: Options {
                legal: ActionSet::EMPTY,
                safe: ActionSet::EMPTY,
            },
            outcome: FilterOutcome::Nominal,
            input: ControlInput::default(),
            has_begun: false,
            chosen: None,
            controller: Controller::new(settings, nearest_lane(road, frenet.d_m))?,
        })
    }

    pub fn manoeuvre(&self) -> Manoeuvre {
        self.controller.manoeuvre()
    }

    /// Whether it changes lanes, or takes that back.
    pub fn is_changing(&self) -> bool {
        matches!(
            self.manoeuvre(),
            Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. }
        )
    }

    /// What it was about in a behaviour step for which it chose `action`: who moves across changes
    /// lanes, whatever it chose.
    pub fn driven(&self, action: Action) -> Action {
        if self.is_changing() && action == Action::KeepLane {
            return self.manoeuvre().action();
        }
        action
    }

    /// Takes up where it has come to.
    pub fn moves(&mut self, vehicle: &RingVehicle, road: &Road) {
        (self.state, self.frenet) = (vehicle.state(road), vehicle.frenet());
    }

    /// Looks up the actions that mean something now, and those of them that are safe (Alg. 1).
    pub fn consider(&mut self, time_s: f64, profile: &RoadProfile) {
        let legal: ActionSet = match self.manoeuvre() {
            Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. } => {
                [Action::KeepLane, self.manoeuvre().action()]
                    .into_iter()
                    .collect()
            }
            Manoeuvre::KeepLane { .. } | Manoeuvre::Announced { .. } => {
                let lane = nearest_lane(profile.road(), self.frenet.d_m);
                let left = lane.left().map(|_| Action::ChangeLeft);
                let right = lane.right().map(|_| Action::ChangeRight);
                [Some(Action::KeepLane), left, right]
                    .into_iter()
                    .flatten()
                    .collect()
            }
        };
        let situation = self.situation(time_s, profile);
        let safe = legal.iter().filter(|&action| {
            self.controller.safe_verdict(&situation, action) == ActionVerdict::Safe
        });
        self.options = Options {
            legal,
            safe: safe.collect(),
        };
    }

    pub fn set_action(&mut self, action: Action, time_s: f64) {
        self.controller.set_action(action, time_s);
        self.announce(time_s);
    }

    /// Takes the control input of the coming decision instead of a behaviour: there is nothing else
    /// to choose from.
    pub fn steer(&mut self, chosen: InputShares, road: &Road) -> Result<(), SettingsError> {
        self.chosen = Some(chosen);
        let only = ActionSet::EMPTY.with(Action::KeepLane);
        self.options = Options {
            legal: only,
            safe: only,
        };
        // Without the filter it is held in no lane, and keeps the one that it is in.
        let (lane, settings) = (
            nearest_lane(road, self.frenet.d_m),
            *self.controller.settings(),
        );
        if settings.mode == ControlMode::Off && lane != self.manoeuvre().lane() {
            self.controller = Controller::new(settings, lane)?;
        }
        Ok(())
    }

    /// What steering amounts to now: who reaches over the line of a lane changes lanes. Which side
    /// it is makes no difference to comfort.
    pub fn steered(&self, road: &Road) -> Action {
        let (right_m, left_m) = road.lane_bounds_m(nearest_lane(road, self.frenet.d_m));
        let half_m = self.dimensions.width_m / 2.0;
        if self.frenet.d_m + half_m > left_m || self.frenet.d_m - half_m < right_m {
            Action::ChangeLeft
        } else {
            Action::KeepLane
        }
    }

    /// Whether the rear axle's middle has left the road.
    pub fn is_beside_the_road(&self, road: &Road) -> bool {
        road.lane_at(self.frenet.d_m).is_none()
    }

    /// The input that is meant by these shares at the present speed: of tan(delta) that of U, of
    /// acceleration and braking those of the reference, up to the desired speed.
    fn input_of(&self, [steering, accel]: InputShares) -> ControlInput {
        let settings = self.controller.settings();
        let v = self.state.speed_mps;
        let grip = settings.safety.lateral_accel_max_mps2 * self.dimensions.wheelbase_m;
        let limit = settings
            .safety
            .tan_delta_max
            .min(grip / v.powi(2).max(1e-9));
        let accel = f64::from(accel);
        let accel_mps2 = if accel > 0.0 {
            accel * settings.reference.accel_mps2
        } else {
            accel * settings.reference.brake_max_mps2
        };
        ControlInput {
            tan_delta: f64::from(steering) * limit,
            accel_mps2: accel_mps2.min((self.desired_speed_mps - v) / STEERING_S),
        }
    }

    pub fn control(&mut self, time_s: f64, profile: &RoadProfile) -> ControlInput {
        let chosen = self.chosen.map(|shares| self.input_of(shares));
        let situation = Situation {
            profile,
            ego: self.ego(),
            neighbours: &self.neighbours,
            sight: &self.sight,
            time_s,
            desired_speed_mps: self.desired_speed_mps,
        };
        let was_changing = self.is_changing();
        let output = match chosen {
            Some(input) => self.controller.filter(&situation, input),
            None => self.controller.control(&situation),
        };
        self.has_begun = self.is_changing() && !was_changing;
        (self.outcome, self.input) = (output.outcome, output.u);
        self.announce(time_s);
        output.u
    }

    fn announce(&mut self, time_s: f64) {
        let action = self.controller.manoeuvre().action();
        if action != self.announced.0 {
            self.announced = (action, time_s);
        }
    }

    fn ego(&self) -> EgoState {
        EgoState {
            station: self.station,
            state: self.state,
            dimensions: self.dimensions,
            frenet: self.frenet,
        }
    }

    fn situation<'a>(&'a self, time_s: f64, profile: &'a RoadProfile) -> Situation<'a> {
        Situation {
            profile,
            ego: self.ego(),
            neighbours: &self.neighbours,
            sight: &self.sight,
            time_s,
            desired_speed_mps: self.desired_speed_mps,
        }
    }
}

/// The lane that holds the offset `d_m`; beside the road, the nearest one.
pub(super) fn nearest_lane(road: &Road, d_m: f64) -> LaneIndex {
    road.lane_at(d_m).unwrap_or(if d_m > 0.0 {
        LaneIndex::LEFTMOST
    } else {
        LaneIndex::RIGHTMOST
    })
}
