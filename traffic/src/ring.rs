//! The three-lane loop: humans and CAVs on a road that repeats.

mod error;
mod lanes;
mod report;
mod settings;
mod start;
mod timing;
mod vehicle;

use std::sync::Arc;

use covista_world::{BicycleState, ControlInput, FrenetPose, STEP_S};
use nalgebra::Vector3;

pub use error::RingError;
pub use report::RingReport;
pub use settings::{RingSettings, SAFE_DISTANCE_M};
pub use timing::{RingTiming, time_ring};
pub use vehicle::RingVehicle;

use crate::{
    Footprint, LoopRoad, RoadMarkings, Scene, SceneLook, SceneVehicle, human::leader, idm::Ahead,
    simulation::within_limits,
};
use lanes::Lanes;
use report::Sums;
use vehicle::Mover;

/// A leader's front falls back behind one's own by less than this before that is noticed.
const BESIDE_M: f64 = 20.0;
const CLEAR_DAY: SceneLook = SceneLook {
    sun_direction: Vector3::new(0.6, 0.0, 0.8),
    direct_light: 0.5,
    paint_wear: 0.2,
    asphalt_albedo: 0.3,
    haze_per_m: 0.0,
    wetness: 0.0,
    damage: 0.0,
    texture_seed: 0,
};

/// Steps between two looks round of a human driver.
const DECISION_STEPS: u64 = 10;

/// The image of a vehicle nearest to somebody.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RingImage {
    /// Rear-axle pose in the world frame, and speed.
    pub state: BicycleState,
    /// The rear axle's position and heading along the endless road.
    pub frenet: FrenetPose,
}

/// Traffic on a loop of three lanes: the truth, and its step of 0.01 s.
///
/// The loop is an endless road that repeats ([`LoopRoad`]); a vehicle is where it has driven to,
/// and [`Ring::image_near`] is where somebody elsewhere sees it.
#[derive(Debug, Clone)]
pub struct Ring {
    settings: RingSettings,
    road: LoopRoad,
    vehicles: Vec<RingVehicle>,
    lanes: Lanes,
    inputs: Vec<ControlInput>,
    /// Pairs whose bodies overlap, and those that did before.
    contacts: Vec<(u32, u32)>,
    contacts_before: Vec<(u32, u32)>,
    sums: Sums,
}

impl Ring {
    /// Sets an episode up.
    ///
    /// # Errors
    /// When a setting makes no sense or the vehicles do not fit on the road.
    pub fn new(settings: RingSettings) -> Result<Self, RingError> {
        settings.check()?;
        let (limit_mps, way_m) = (settings.speed_limit_mps, settings.way_m());
        let road = LoopRoad::new(settings.period_m(), limit_mps, way_m)?;
        let vehicles = start::place_all(&settings, &road)?;
        let mut ring = Self {
            lanes: Lanes::new(&road, vehicles.len()),
            inputs: Vec::with_capacity(vehicles.len()),
            contacts: Vec::with_capacity(vehicles.len()),
            contacts_before: Vec::with_capacity(vehicles.len()),
            sums: Sums::default(),
            settings,
            road,
            vehicles,
        };
        ring.look();
        Ok(ring)
    }

    /// Sets another episode up on the same road.
    ///
    /// # Errors
    /// As [`Ring::new`].
    pub fn reset(&mut self, seed: u64) -> Result<(), RingError> {
        self.settings.seed = seed;
        self.vehicles = start::place_all(&self.settings, &self.road)?;
        self.contacts.clear();
        self.sums = Sums::default();
        self.look();
        Ok(())
    }

    /// What it was set up with.
    pub fn settings(&self) -> &RingSettings {
        &self.settings
    }

    /// The road.
    pub fn road(&self) -> &LoopRoad {
        &self.road
    }

    /// Time since the start in seconds.
    pub fn time_s(&self) -> f64 {
        self.sums.steps as f64 * STEP_S
    }

    /// All vehicles in the order of their ids: the CAVs first.
    pub fn vehicles(&self) -> &[RingVehicle] {
        &self.vehicles
    }

    /// Pairs of vehicles, by index, whose bodies overlap, as of the newest tenth of a second.
    pub fn contacts(&self) -> &[(u32, u32)] {
        &self.contacts
    }

    /// Where somebody at `near_s_m` of the endless road sees a vehicle of this ring.
    pub fn image_near(&self, vehicle: &RingVehicle, near_s_m: f64) -> RingImage {
        let road = self.road.road();
        let mut frenet = vehicle.frenet();
        let mut state = vehicle.state(road);
        let laps = self.road.laps_to(frenet.s_m, near_s_m);
        if laps.abs() > 0.5 {
            frenet.s_m += laps * self.road.period_m();
            state.pose = road.pose_from_frenet(frenet.s_m, frenet.d_m, frenet.psi_rad);
        }
        RingImage { state, frenet }
    }

    /// Moves everybody by 0.01 s: CAVs by `cav_inputs`, in the order of their ids, humans by their
    /// drivers. Inputs are clamped to the plant's limits; one that is not finite brakes as hard as
    /// it can.
    ///
    /// # Errors
    /// When not every CAV has an input, or one has come to the end of the unrolled road.
    pub fn step(&mut self, cav_inputs: &[ControlInput]) -> Result<(), RingError> {
        if cav_inputs.len() != self.settings.cavs {
            return Err(RingError::Inputs {
                given: cav_inputs.len(),
                cavs: self.settings.cavs,
            });
        }
        self.inputs.clear();
        self.inputs.extend_from_slice(cav_inputs);
        for index in 0..self.vehicles.len() {
            self.drive(index);
        }
        for (vehicle, input) in self.vehicles.iter_mut().zip(&self.inputs) {
            vehicle.advance(within_limits(*input), &self.road);
            self.sums.speed_mps += vehicle.speed_mps;
        }
        self.sums.steps += 1;
        if self.sums.steps.is_multiple_of(DECISION_STEPS) {
            self.look();
        }
        self.check_ends()
    }

    /// How far the vehicle of this index is behind the one it follows, between the bodies' centres
    /// along the road in metres; `None` while it follows nobody.
    pub fn headway_m(&self, index: usize) -> Option<f64> {
        let vehicle = self.vehicles.get(index)?;
        let leader = &self.vehicles[vehicle.leader? as usize];
        Some(self.gap_m(vehicle, leader) + vehicle.half_lengths_m(leader))
    }

    /// What the episode has come to so far.
    pub fn report(&self) -> RingReport {
        self.sums.report(self.vehicles.len(), self.road.period_m())
    }

    /// The truth as sensors at `near_s_m` of the endless road measure it: everybody at the image
    /// nearest to there, on a road without scenery.
    pub fn scene_near(&self, near_s_m: f64) -> Scene {
        let image = |vehicle: &RingVehicle| SceneVehicle {
            id: vehicle.id,
            model: vehicle.model,
            paint: vehicle.paint,
            scale: Vector3::repeat(1.0),
            state: self.image_near(vehicle, near_s_m).state,
        };
        Scene {
            time_s: self.time_s(),
            road: Arc::clone(self.road.road()),
            markings: RoadMarkings::default(),
            terrain: Arc::default(),
            vehicles: self.vehicles.iter().map(image).collect(),
            scenery: Arc::default(),
            look: CLEAR_DAY,
        }
    }

    /// The input of a human, behind the vehicle it follows as that moves; for everybody the
    /// headway is watched.
    fn drive(&mut self, index: usize) {
        let vehicle = &self.vehicles[index];
        let leader = vehicle.leader.map(|leader| &self.vehicles[leader as usize]);
        let ahead = leader.map(|leader| Ahead {
            gap_m: self.gap_m(vehicle, leader),
            speed_mps: leader.speed_mps,
        });
        if let Some((leader, ahead)) = leader.zip(ahead) {
            self.sums
                .headway(ahead.gap_m + vehicle.half_lengths_m(leader));
        }
        let vehicle = &mut self.vehicles[index];
        let (speed_mps, wheelbase_m) = (vehicle.speed_mps, vehicle.dimensions.wheelbase_m);
        if let Mover::Human(driver) = &mut vehicle.mover {
            driver.follow(speed_mps, ahead);
            let road = self.road.road();
            self.inputs.push(ControlInput {
                tan_delta: driver.steer(vehicle.place, speed_mps, road, wheelbase_m),
                accel_mps2: driver.accel_mps2,
            });
        }
    }

    /// Bumper to bumper distance to the leader, along the own line through the curves.
    fn gap_m(&self, vehicle: &RingVehicle, leader: &RingVehicle) -> f64 {
        let fronts_m = leader.front_m() - vehicle.front_m();
        // A leader's front was ahead when it was found, and is still nearly so.
        let ahead_m = if fronts_m < -BESIDE_M {
            fronts_m + self.road.period_m()
        } else if fronts_m > self.road.period_m() - BESIDE_M {
            fronts_m - self.road.period_m()
        } else {
            fronts_m
        };
        let turn_rad = leader.turned_rad - vehicle.turned_rad;
        ahead_m - vehicle.place.d_m * turn_rad - leader.dimensions.length_m
    }

    /// Everybody looks round; humans decide, one after the other, so that a later one sees an
    /// earlier one's signal.
    fn look(&mut self) {
        self.find_contacts();
        for index in 0..self.vehicles.len() {
            let seen = self.lanes.around(index);
            let own = *self.lanes.strip(index);
            let vehicle = &mut self.vehicles[index];
            let body = vehicle.across();
            let d_m = vehicle.place.d_m;
            let leader = match &mut vehicle.mover {
                Mover::Cav(_) => leader(&own, seen.strips(), body).map(|(of, _)| of),
                Mover::Human(driver) => {
                    let before = driver.lane_change();
                    let leader = driver.decide(&own, seen.strips(), d_m, self.road.road());
                    if before.is_none() && driver.lane_change().is_some() {
                        self.sums.human_lane_changes += 1;
                        self.lanes.claim(index, vehicle.strip(&self.road));
                    }
                    leader
                }
            };
            self.vehicles[index].leader = leader.map(|of| seen.index(of));
        }
    }

    /// Takes up where everybody is; counts the pairs of vehicles that have come to overlap.
    fn find_contacts(&mut self) {
        let road = &self.road;
        let strips = self.vehicles.iter().map(|vehicle| vehicle.strip(road));
        self.lanes.update(strips);
        let mut touching = std::mem::take(&mut self.contacts_before);
        touching.clear();
        self.lanes.near_pairs(|one, other| {
            if self.overlap(one, other) {
                touching.push((one, other));
            }
        });
        let is_new = |pair: &&(u32, u32)| !self.contacts.contains(pair);
        self.sums.collisions += touching.iter().filter(is_new).count() as u64;
        self.contacts_before = std::mem::replace(&mut self.contacts, touching);
    }

    fn overlap(&self, one: u32, other: u32) -> bool {
        let [one, other] = [one, other].map(|index| &self.vehicles[index as usize]);
        // In lap 1, where there is road whoever has driven how far.
        let near_s_m = self.road.period_m() + one.place.s_m;
        let [one, other] = [one, other].map(|vehicle| {
            let pose = self.image_near(vehicle, near_s_m).state.pose;
            Footprint::new(pose, vehicle.dimensions, 0.0)
        });
        one.overlaps(&other)
    }

    fn check_ends(&self) -> Result<(), RingError> {
        let end_m = self.road.end_m();
        let is_beyond = |vehicle: &&RingVehicle| vehicle.frenet().s_m > end_m;
        let cavs = &self.vehicles[..self.settings.cavs];
        match cavs.iter().find(is_beyond) {
            Some(vehicle) => Err(RingError::RoadEnds {
                id: vehicle.id,
                way_m: vehicle.frenet().s_m - self.road.period_m(),
            }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
