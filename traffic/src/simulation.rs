use std::{collections::BTreeMap, sync::Arc};

use covista_world::{
    BicycleState, ControlInput, FrenetPose, LaneIndex, Road, STEP_S, VehicleDimensions,
    bicycle_step,
};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{
    ACCEL_MAX_MPS2, BRAKING_MAX_MPS2, Body, Footprint, RoadMarkings, Scenario, ScenarioError,
    Scene, SceneLook, SceneVehicle, TAN_DELTA_MAX, VehicleId, VehicleModel,
    human::{Across, Habit, HumanDriver, Strip},
    idm::Idm,
    sample::{draw_model, draw_paint},
    scenario::{Start, VehicleKind},
    sight::Occluders,
};

/// Steps between two decisions of a human driver.
const DECISION_STEPS: u64 = 10;
const HUMAN_SIGHT_M: f64 = 100.0;
/// How far ahead in time a sideways movement is taken to go on.
const ENTERING_S: f64 = 1.0;

/// A vehicle of the simulation, with everything there is to know of it.
#[derive(Debug, Clone)]
pub struct TrafficVehicle {
    /// Its name.
    pub id: VehicleId,
    /// Who moves it.
    pub kind: VehicleKind,
    /// Its model.
    pub model: VehicleModel,
    /// Its colour.
    pub paint: [u8; 3],
    /// Rear-axle pose and speed.
    pub state: BicycleState,
    /// The rear axle's position and heading along the road.
    pub frenet: FrenetPose,
    /// Acceleration over the last step in m/s^2, as it came out.
    pub accel_mps2: f64,
    /// The speed it would like to drive.
    pub desired_speed_mps: f64,
    driver: Option<HumanDriver>,
}

impl TrafficVehicle {
    /// Its dimensions.
    pub fn dimensions(&self) -> VehicleDimensions {
        self.model.dimensions()
    }

    /// The ground it covers.
    pub fn footprint(&self) -> Footprint {
        Footprint::new(self.state.pose, self.dimensions(), 0.0)
    }

    /// The lane a human driver is changing to.
    pub fn human_lane_change(&self) -> Option<LaneIndex> {
        self.driver.as_ref().and_then(HumanDriver::lane_change)
    }

    /// The strip of road it covers, with what its sideways movement or signal tells others.
    fn strip(&self, road: &Road) -> Strip {
        let corners = self
            .footprint()
            .corners
            .map(|corner| road.to_frenet_near(corner, self.frenet.s_m));
        let [front_left, front_right, ..] = corners;
        let span = |value: fn(f64, f64) -> f64, of: fn(&covista_world::FrenetPoint) -> f64| {
            let [a, b, c, d] = corners.each_ref().map(of);
            value(value(a, b), value(c, d))
        };
        let sideways_m = self.state.speed_mps * self.frenet.psi_rad.sin() * ENTERING_S;
        let body = Across {
            right_m: span(f64::min, |point| point.d_m),
            left_m: span(f64::max, |point| point.d_m),
        };
        let mut across = body.moving(sideways_m);
        if let Some((driver, target)) = self.driver.as_ref().zip(self.human_lane_change()) {
            across = across.union(driver.swath(target, road));
        }
        Strip {
            rear_m: span(f64::min, |point| point.s_m),
            front_m: span(f64::max, |point| point.s_m),
            across,
            front_across: Across {
                right_m: front_left.d_m.min(front_right.d_m),
                left_m: front_left.d_m.max(front_right.d_m),
            },
            speed_mps: self.state.speed_mps,
        }
    }
}

/// The traffic on a road: the truth, and its step of 0.01 s.
#[derive(Debug, Clone)]
pub struct Traffic {
    road: Arc<Road>,
    scenery: Arc<Vec<Body>>,
    occluders: Occluders,
    look: SceneLook,
    vehicles: Vec<TrafficVehicle>,
    steps: u64,
}

impl Traffic {
    /// Sets a scenario up; `seed` draws positions, speeds, models, paints and drivers within the
    /// scenario's bounds.
    ///
    /// # Errors
    /// When two vehicles overlap at the start.
    pub fn new(scenario: &Scenario, seed: u64) -> Result<Self, ScenarioError> {
        let road = scenario.road()?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let scenery = scenario.scenery(&road, &mut rng);
        let look = scenario.look.to_look(rng.random());
        let vehicles: Vec<_> = scenario
            .starts()
            .enumerate()
            .map(|(index, start)| {
                // A stream each: one vehicle more leaves the others as they were.
                rng.set_stream(index as u64 + 1);
                rng.set_word_pos(0);
                place(&road, VehicleId(index as u32 + 1), &start, &mut rng)
            })
            .collect();
        let traffic = Self {
            road: Arc::new(road),
            occluders: Occluders::new(&scenery),
            scenery: Arc::new(scenery),
            look,
            vehicles,
            steps: 0,
        };
        match traffic.overlapping_pairs().first() {
            Some(&(one, other)) => Err(scenario.overlap(seed, one, other)),
            None => Ok(traffic),
        }
    }

    /// Time since the start in seconds.
    pub fn time_s(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    /// The road.
    pub fn road(&self) -> &Arc<Road> {
        &self.road
    }

    /// All vehicles, in the order of their ids.
    pub fn vehicles(&self) -> &[TrafficVehicle] {
        &self.vehicles
    }

    /// The vehicle with this id.
    pub fn vehicle(&self, id: VehicleId) -> Option<&TrafficVehicle> {
        self.vehicles.iter().find(|vehicle| vehicle.id == id)
    }

    /// The truth as the sensors measure it.
    pub fn scene(&self) -> Scene {
        Scene {
            time_s: self.time_s(),
            road: Arc::clone(&self.road),
            markings: RoadMarkings::default(),
            terrain: Arc::default(),
            vehicles: self
                .vehicles
                .iter()
                .map(|vehicle| SceneVehicle {
                    id: vehicle.id,
                    model: vehicle.model,
                    paint: vehicle.paint,
                    scale: Vector3::repeat(1.0),
                    state: vehicle.state,
                })
                .collect(),
            scenery: Arc::clone(&self.scenery),
            look: self.look,
        }
    }

    /// Moves everybody by 0.01 s: CAVs by their input, humans by their drivers; obstacles stand.
    ///
    /// Inputs are clamped to the plant's limits. A CAV without input rolls straight on; one whose
    /// input is not finite brakes as hard as it can.
    pub fn step(&mut self, cav_inputs: &BTreeMap<VehicleId, ControlInput>) {
        if self.steps.is_multiple_of(DECISION_STEPS) {
            self.decide_humans();
        }
        for vehicle in &mut self.vehicles {
            let wheelbase_m = vehicle.dimensions().wheelbase_m;
            let speed_mps = vehicle.state.speed_mps;
            let input = match (vehicle.kind, &mut vehicle.driver) {
                (VehicleKind::Obstacle, _) => continue,
                (_, Some(driver)) => ControlInput {
                    tan_delta: driver.steer(vehicle.frenet, speed_mps, &self.road, wheelbase_m),
                    accel_mps2: driver.accel_mps2,
                },
                (_, None) => cav_inputs.get(&vehicle.id).copied().unwrap_or_default(),
            };
            vehicle.state = bicycle_step(vehicle.state, within_limits(input), wheelbase_m);
            vehicle.accel_mps2 = (vehicle.state.speed_mps - speed_mps) / STEP_S;
            vehicle.frenet = self
                .road
                .to_frenet_pose_near(vehicle.state.pose, vehicle.frenet.s_m);
        }
        self.steps += 1;
    }

    /// Pairs of vehicles whose footprints overlap: collisions.
    pub fn overlapping_pairs(&self) -> Vec<(VehicleId, VehicleId)> {
        let prints: Vec<_> = self
            .vehicles
            .iter()
            .map(|vehicle| (vehicle.id, vehicle.footprint()))
            .collect();
        prints
            .iter()
            .enumerate()
            .flat_map(|(index, one)| prints[index + 1..].iter().map(move |other| (one, other)))
            .filter(|((_, one), (_, other))| one.overlaps(other))
            .map(|((one, _), (other, _))| (*one, *other))
            .collect()
    }

    /// Every human looks and decides, one after the other, so that a later one sees an earlier
    /// one's signal.
    fn decide_humans(&mut self) {
        let mut strips: Vec<_> = self
            .vehicles
            .iter()
            .map(|vehicle| vehicle.strip(&self.road))
            .collect();
        for index in 0..self.vehicles.len() {
            if self.vehicles[index].driver.is_none() {
                continue;
            }
            let seen: Vec<_> = (0..strips.len())
                .filter(|&other| other != index && self.sees(index, other))
                .map(|other| strips[other])
                .collect();
            let vehicle = &mut self.vehicles[index];
            if let Some(driver) = &mut vehicle.driver {
                driver.decide(&strips[index], &seen, vehicle.frenet.d_m, &self.road);
            }
            strips[index] = vehicle.strip(&self.road);
        }
    }

    /// Whether a human in one vehicle sees another: near enough, and its middle or a corner not
    /// behind scenery.
    fn sees(&self, from: usize, to: usize) -> bool {
        let (from, to) = (&self.vehicles[from], &self.vehicles[to]);
        let middle =
            |vehicle: &TrafficVehicle| vehicle.dimensions().center_pose(vehicle.state.pose);
        let eye = middle(from).position();
        let center = middle(to).position();
        (center - eye).norm() < HUMAN_SIGHT_M
            && to
                .footprint()
                .corners
                .into_iter()
                .chain([center])
                .any(|point| self.occluders.clear(eye, point))
    }
}

/// What the plant's actuators make of an input.
pub(crate) fn within_limits(input: ControlInput) -> ControlInput {
    if !(input.tan_delta.is_finite() && input.accel_mps2.is_finite()) {
        return ControlInput {
            tan_delta: 0.0,
            accel_mps2: -BRAKING_MAX_MPS2,
        };
    }
    ControlInput {
        tan_delta: input.tan_delta.clamp(-TAN_DELTA_MAX, TAN_DELTA_MAX),
        accel_mps2: input.accel_mps2.clamp(-BRAKING_MAX_MPS2, ACCEL_MAX_MPS2),
    }
}

fn place(road: &Road, id: VehicleId, start: &Start, rng: &mut ChaCha8Rng) -> TrafficVehicle {
    let drawn = draw_model(rng);
    let model = start.model.unwrap_or(match start.kind {
        VehicleKind::Cav => VehicleModel::Sedan,
        VehicleKind::Human | VehicleKind::Obstacle => drawn,
    });
    let paint = draw_paint(model, rng);
    let mut around = |middle: f64, spread: f64| middle + spread * rng.random_range(-1.0..=1.0_f64);
    let s_m = around(start.s_m, start.s_spread_m);
    let speed_mps = around(start.speed_mps, start.speed_spread_mps).max(0.0);
    let d_m = road.lane_center_m(start.lane);
    let driver = (start.kind == VehicleKind::Human).then(|| {
        let idm = Idm::draw(start.desired_speed_mps, rng);
        HumanDriver::new(
            idm,
            Habit::KEEPS_LANE,
            start.lane,
            model.dimensions().width_m,
        )
    });
    let pose = road.pose_from_frenet(s_m, d_m, 0.0);
    TrafficVehicle {
        id,
        kind: start.kind,
        model,
        paint,
        state: BicycleState { pose, speed_mps },
        frenet: road.to_frenet_pose_near(pose, s_m),
        accel_mps2: 0.0,
        desired_speed_mps: start.desired_speed_mps,
        driver,
    }
}
