use covista_control::{
    ControlOutput, ControlSettings, Controller, EgoState, Manoeuvre, Neighbour, RoadProfile,
    SightLine, Situation,
};
use covista_planner::{
    self as planner, FreeLane, MappedAction, Observation, OwnMotion, Policy, safe_action_mapping,
};
use covista_sharing::{OwnState, Tracker, TrackerSettings};
use covista_traffic::{TrafficVehicle, VehicleId};
use covista_world::{
    Action, BicycleState, Calibration, CollectivePerceptionMessage, LANE_COUNT, LaneIndex, Road,
    Se2Pose, StationId, Track, VehicleDimensions,
};

use crate::{free_lanes::seen_free, run::RunError, senses::Sensed};

/// One connected vehicle's stack, from percepts to control input.
///
/// Its own pose and speed are taken as known (satellite navigation and odometry); everything about
/// other vehicles comes from its sensors and from messages.
pub(crate) struct Cav {
    pub id: VehicleId,
    pub station: StationId,
    pub initial_lane: LaneIndex,
    pub tracker: Tracker,
    /// The action that the policy valued highest at the last behaviour step.
    pub preferred: Action,
    /// The same after the safe action mapping.
    pub mapped: Action,
    pub last_output: Option<ControlOutput>,
    /// When each lane change began, in seconds.
    pub lane_changes_s: Vec<f64>,
    dimensions: VehicleDimensions,
    desired_speed_mps: f64,
    settings: ControlSettings,
    policy: FreeLane,
    controller: Controller,
    sight: Option<SightLine>,
    announced: (Action, f64),
}

/// The vehicle's own state, as its odometry gives it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Odometry {
    pub state: BicycleState,
    pub accel_mps2: f64,
}

impl From<&TrafficVehicle> for Odometry {
    fn from(vehicle: &TrafficVehicle) -> Self {
        Self {
            state: vehicle.state,
            accel_mps2: vehicle.accel_mps2,
        }
    }
}

impl Cav {
    pub fn new(
        vehicle: &TrafficVehicle,
        road: &Road,
        settings: ControlSettings,
        tracker: TrackerSettings,
    ) -> Result<Self, RunError> {
        let station = StationId(vehicle.id.0);
        let dimensions = vehicle.dimensions();
        let lane = lane_of(road, dimensions, vehicle.state.pose);
        Ok(Self {
            id: vehicle.id,
            station,
            initial_lane: lane,
            tracker: Tracker::new(station, dimensions, tracker),
            preferred: Action::KeepLane,
            mapped: Action::KeepLane,
            last_output: None,
            lane_changes_s: Vec::new(),
            dimensions,
            desired_speed_mps: vehicle.desired_speed_mps,
            settings,
            policy: FreeLane::default(),
            controller: Controller::new(settings, lane)?,
            sight: None,
            announced: (Action::KeepLane, 0.0),
        })
    }

    /// Takes up a perception frame.
    pub fn perceive(
        &mut self,
        time_s: f64,
        road: &Road,
        calibration: &Calibration,
        own: &Odometry,
        sensed: &Sensed,
    ) {
        let pose = own.state.pose;
        self.tracker
            .observe(time_s, pose, own.state.speed_mps, &sensed.percepts);
        let neighbours = self.neighbours(time_s, road);
        let safety = &self.settings.safety;
        let free_space = &sensed.free_space;
        let seen = seen_free(
            free_space,
            pose,
            calibration,
            &neighbours,
            road,
            time_s,
            safety,
        );
        match &mut self.sight {
            Some(sight) => sight.update(&seen, time_s, safety),
            None => self.sight = Some(seen),
        }
    }

    /// What it knows at `time_s`.
    pub fn tracks(&self, time_s: f64) -> Vec<Track> {
        self.tracker.tracks(time_s)
    }

    fn neighbours(&self, time_s: f64, road: &Road) -> Vec<Neighbour> {
        self.tracks(time_s)
            .iter()
            .filter_map(|track| Neighbour::from_track(track, road, time_s, &self.settings.safety))
            .collect()
    }

    /// What it broadcasts.
    pub fn message(
        &mut self,
        time_s: f64,
        road: &Road,
        own: &Odometry,
    ) -> CollectivePerceptionMessage {
        self.tracker.message(time_s, &self.own_state(road, own))
    }

    /// What it tells of itself.
    pub fn own_state(&self, road: &Road, own: &Odometry) -> OwnState {
        let (action, announced_s) = self.announced;
        OwnState {
            pose: own.state.pose,
            speed_mps: own.state.speed_mps,
            accel_mps2: own.accel_mps2,
            lane: lane_of(road, self.dimensions, own.state.pose),
            action,
            announced_s,
        }
    }

    /// A behaviour step: the policy's order of the actions, through the safe action mapping
    /// (Alg. 1) into the controller.
    pub fn decide(
        &mut self,
        time_s: f64,
        profile: &RoadProfile,
        own: &Odometry,
    ) -> Result<(), RunError> {
        let road = profile.road();
        let tracks = self.tracks(time_s);
        let observation = Observation::new(
            road,
            &OwnMotion {
                state: own.state,
                dimensions: self.dimensions,
                lane: lane_of(road, self.dimensions, own.state.pose),
                desired_speed_mps: self.desired_speed_mps,
                manoeuvre: self.phase(road, own),
            },
            &tracks,
        )?;
        let values = self.policy.values(&observation);
        self.preferred = values.in_order()[0];
        let neighbours = self.neighbours(time_s, road);
        let Some(sight) = self.sight else {
            return Ok(());
        };
        let situation = self.situation(time_s, profile, own, &neighbours, &sight);
        let MappedAction { action, .. } =
            safe_action_mapping(values, |action| self.controller.verdict(&situation, action));
        self.mapped = action;
        self.controller.set_action(action, time_s);
        self.announce(time_s);
        Ok(())
    }

    /// A control step: reference, QP, validation.
    pub fn control(&mut self, time_s: f64, profile: &RoadProfile, own: &Odometry) -> ControlOutput {
        let neighbours = self.neighbours(time_s, profile.road());
        let sight = self
            .sight
            .unwrap_or_else(|| SightLine::new([f64::NEG_INFINITY; LANE_COUNT as usize], time_s));
        let was_changing = self.is_changing();
        let situation = self.situation(time_s, profile, own, &neighbours, &sight);
        let output = self.controller.control(&situation);
        self.announce(time_s);
        if self.is_changing() && !was_changing {
            self.lane_changes_s.push(time_s);
        }
        self.last_output = Some(output);
        output
    }

    /// Keeps what is broadcast in step with the manoeuvre.
    fn announce(&mut self, time_s: f64) {
        let action = self.controller.manoeuvre().action();
        if action != self.announced.0 {
            self.announced = (action, time_s);
        }
    }

    /// What the controller is about.
    pub fn manoeuvre(&self) -> Manoeuvre {
        self.controller.manoeuvre()
    }

    /// How far it takes each lane ahead to be free.
    pub fn sight(&self) -> Option<&SightLine> {
        self.sight.as_ref()
    }

    /// Front to rear axle.
    pub fn wheelbase_m(&self) -> f64 {
        self.dimensions.wheelbase_m
    }

    fn is_changing(&self) -> bool {
        matches!(
            self.controller.manoeuvre(),
            Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. }
        )
    }

    fn situation<'a>(
        &self,
        time_s: f64,
        profile: &'a RoadProfile,
        own: &Odometry,
        neighbours: &'a [Neighbour],
        sight: &'a SightLine,
    ) -> Situation<'a> {
        Situation {
            profile,
            ego: EgoState::new(self.station, own.state, self.dimensions, profile.road()),
            neighbours,
            sight,
            time_s,
            desired_speed_mps: self.desired_speed_mps,
        }
    }

    /// The running manoeuvre in the planner's words.
    fn phase(&self, road: &Road, own: &Odometry) -> planner::Manoeuvre {
        let (from, to) = match self.controller.manoeuvre() {
            Manoeuvre::ChangeLane { from, to, .. } => (from, to),
            Manoeuvre::Abort { from, back } => (from, back),
            Manoeuvre::KeepLane { .. } | Manoeuvre::Announced { .. } => {
                return planner::Manoeuvre::KeepingLane;
            }
        };
        let d_m = road
            .to_frenet(self.dimensions.center_pose(own.state.pose).position())
            .d_m;
        let (start, end) = (road.lane_center_m(from), road.lane_center_m(to));
        planner::Manoeuvre::ChangingLane {
            from,
            to,
            progress: ((d_m - start) / (end - start)).clamp(0.0, 1.0),
        }
    }
}

/// The lane of the body's centre; beside the road, the nearest one.
fn lane_of(road: &Road, dimensions: VehicleDimensions, rear_axle: Se2Pose) -> LaneIndex {
    let d_m = road
        .to_frenet(dimensions.center_pose(rear_axle).position())
        .d_m;
    road.lane_at(d_m).unwrap_or(if d_m > 0.0 {
        LaneIndex::LEFTMOST
    } else {
        LaneIndex::RIGHTMOST
    })
}
