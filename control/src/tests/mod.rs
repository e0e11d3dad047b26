//! The controller in closed loop with the plant.

mod announcements;
mod barriers;
mod edges;
mod equality;
mod excursion;
mod filter;
mod formulations;
mod grid;
mod lateral;
mod limits;
mod longitudinal;
mod manoeuvres;
mod memory;
mod modes;
mod numbers;
mod oracle;
mod own_barriers;
mod rows;
mod running;
mod sampling;

use covista_world::{
    Action, BicycleState, ControlInput, LaneIndex, ObjectClass, ObjectState, Road, RoadSegment,
    STEP_S, Se2Pose, Sighting, StationId, Track, VehicleDimensions, bicycle_step,
};

use std::sync::Arc;

use crate::manoeuvre::Course;
use crate::memory::Memory;
use crate::rows::Rows;
use crate::{
    ControlOutput, ControlSettings, Controller, EgoState, Formulation, Mode, Neighbour,
    RoadProfile, SafetySettings, SightLine, Situation,
};

pub const SEDAN: VehicleDimensions = VehicleDimensions {
    length_m: 4.6,
    width_m: 1.85,
    height_m: 1.5,
    wheelbase_m: 2.51,
    rear_overhang_m: 0.95,
};

/// The rows of a course, without memory.
pub fn rows(situation: &Situation<'_>, course: &Course, safety: &SafetySettings) -> Rows {
    let mut rows = Rows::default();
    rows.collect(situation, course, &Memory::default(), safety);
    rows
}

/// A small deterministic generator.
pub struct Dice(pub u64);

impl Dice {
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        low + (high - low) * (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

pub fn straight() -> Road {
    let segment = RoadSegment::Straight { length_m: 3000.0 };
    Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road")
}

/// The corner of the obstacle-at-corner scene: a left arc of radius 80 m.
pub fn corner() -> Road {
    let curvature = 1.0 / 80.0;
    let segments = [
        RoadSegment::Straight { length_m: 150.0 },
        RoadSegment::Clothoid {
            length_m: 40.0,
            from_per_m: 0.0,
            to_per_m: curvature,
        },
        RoadSegment::Arc {
            length_m: 90.0,
            curvature_per_m: curvature,
        },
        RoadSegment::Clothoid {
            length_m: 40.0,
            from_per_m: curvature,
            to_per_m: 0.0,
        },
        RoadSegment::Straight { length_m: 600.0 },
    ];
    Road::new(Se2Pose::new(10.0, 5.0, 0.4), &segments, 3.5).expect("a road")
}

/// An input by its two components.
pub fn input(tan_delta: f64, accel_mps2: f64) -> ControlInput {
    ControlInput {
        tan_delta,
        accel_mps2,
    }
}

/// The default settings in another mode.
pub fn in_mode(mode: Mode) -> ControlSettings {
    ControlSettings {
        mode,
        ..ControlSettings::default()
    }
}

/// The default settings with another formulation of the QP.
pub fn formulated(formulation: Formulation) -> ControlSettings {
    let mut settings = ControlSettings::default();
    settings.qp.formulation = formulation;
    settings
}

pub fn lane(index: u8) -> LaneIndex {
    LaneIndex::new(index).expect("a lane")
}

/// A vehicle in the simulation, driven by somebody else.
#[derive(Debug, Clone, Copy)]
pub struct Other {
    pub id: u32,
    pub station: Option<StationId>,
    /// Road s of its centre.
    pub s_m: f64,
    pub d_m: f64,
    pub speed_mps: f64,
    pub action: Option<Action>,
    pub announced_s: Option<f64>,
    /// When it was heard last, where that is not now; sensors see it in any case.
    pub heard_s: Option<f64>,
}

impl Other {
    pub fn new(id: u32, s_m: f64, d_m: f64, speed_mps: f64) -> Self {
        Self {
            id,
            station: None,
            s_m,
            d_m,
            speed_mps,
            action: None,
            announced_s: None,
            heard_s: None,
        }
    }

    /// A CAV that announces `action` since `announced_s`.
    pub fn cav(self, station: u32, action: Action, announced_s: f64) -> Self {
        Self {
            station: Some(StationId(station)),
            action: Some(action),
            announced_s: action.is_lane_change().then_some(announced_s),
            ..self
        }
    }

    pub fn step(&mut self, accel_mps2: f64) {
        self.s_m += self.speed_mps * STEP_S;
        self.speed_mps = (self.speed_mps + accel_mps2 * STEP_S).max(0.0);
    }

    pub fn track(&self, road: &Road, time_s: f64) -> Track {
        let center = road.pose_from_frenet(self.s_m, self.d_m, 0.0);
        let station = self.station.unwrap_or(StationId(1));
        Track {
            id: self.id,
            station: self.station,
            state: ObjectState {
                center,
                velocity_mps: center.forward() * self.speed_mps,
                length_m: SEDAN.length_m,
                width_m: SEDAN.width_m,
                height_m: SEDAN.height_m,
                class: ObjectClass::Car,
            },
            time_s,
            position_std_m: 0.0,
            velocity_std_mps: 0.0,
            confidence: 1.0,
            lane: road.lane_at(self.d_m),
            action: self.action,
            announced_s: self.announced_s,
            sightings: vec![
                Sighting {
                    station,
                    measured_s: self.heard_s.unwrap_or(time_s),
                },
                Sighting {
                    station: STATION,
                    measured_s: time_s,
                },
            ],
        }
    }
}

/// The ego vehicle with its controller on a road.
pub struct Drive {
    pub station: StationId,
    pub road: Arc<Road>,
    pub profile: RoadProfile,
    pub controller: Controller,
    pub state: BicycleState,
    pub others: Vec<Other>,
    pub clear_s_m: f64,
    pub desired_mps: f64,
    pub time_s: f64,
}

pub const STATION: StationId = StationId(7);

impl Drive {
    /// In the centre of a lane, with the body's centre at road s `s_m`.
    pub fn new(road: Road, in_lane: u8, s_m: f64, speed_mps: f64) -> Self {
        Self::with(ControlSettings::default(), road, in_lane, s_m, speed_mps)
    }

    pub fn with(
        settings: ControlSettings,
        road: Road,
        in_lane: u8,
        s_m: f64,
        speed_mps: f64,
    ) -> Self {
        let road = Arc::new(road);
        let d_m = road.lane_center_m(lane(in_lane));
        let center = road.pose_from_frenet(s_m, d_m, 0.0);
        Self {
            station: STATION,
            controller: Controller::new(settings, lane(in_lane)).expect("valid settings"),
            state: BicycleState {
                pose: SEDAN.axle_pose(center),
                speed_mps,
            },
            profile: RoadProfile::new(road.clone(), &settings),
            road,
            others: Vec::new(),
            clear_s_m: 1e4,
            desired_mps: speed_mps.max(5.0),
            time_s: 0.0,
        }
    }

    pub fn safety(&self) -> SafetySettings {
        self.controller.settings().safety
    }

    pub fn with_situation<T>(
        &mut self,
        act: impl FnOnce(&mut Controller, &Situation<'_>) -> T,
    ) -> T {
        let settings = self.safety();
        let tracks = self.others.iter();
        let neighbours: Vec<_> = tracks
            .map(|other| {
                let track = other.track(&self.road, self.time_s);
                Neighbour::from_track(&track, &self.road, self.time_s, &settings).expect("finite")
            })
            .collect();
        let situation = Situation {
            profile: &self.profile,
            ego: EgoState::new(self.station, self.state, SEDAN, &self.road),
            neighbours: &neighbours,
            sight: &SightLine::new([self.clear_s_m; 3], self.time_s),
            time_s: self.time_s,
            desired_speed_mps: self.desired_mps,
        };
        act(&mut self.controller, &situation)
    }

    pub fn control(&mut self) -> ControlOutput {
        self.with_situation(|controller, situation| controller.control(situation))
    }

    pub fn filter(&mut self, u_nominal: ControlInput) -> ControlOutput {
        self.with_situation(|controller, situation| controller.filter(situation, u_nominal))
    }

    /// Drives `seconds` with the controller's own reference; the others keep their speed.
    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as usize {
            let output = self.control();
            self.apply(output.u);
            for other in &mut self.others {
                other.step(0.0);
            }
        }
    }

    pub fn verdict(&mut self, action: Action) -> covista_world::ActionVerdict {
        self.with_situation(|controller, situation| controller.verdict(situation, action))
    }

    pub fn apply(&mut self, u: ControlInput) {
        self.state = bicycle_step(self.state, u, SEDAN.wheelbase_m);
        self.time_s += STEP_S;
    }

    pub fn ego(&self) -> EgoState {
        EgoState::new(self.station, self.state, SEDAN, &self.road)
    }

    pub fn lateral_accel_mps2(&self, u: ControlInput) -> f64 {
        self.state.speed_mps.powi(2) * u.tan_delta / SEDAN.wheelbase_m
    }
}
