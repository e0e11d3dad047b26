use covista_control::{RoadProfile, SafetySettings};
use covista_traffic::{Ring, RingVehicle};
use serde::{Deserialize, Serialize};

use super::{cav::RingCav, perception::Knowledge, sights::Sights};
use crate::{
    cause::Cause,
    monitor::{CavView, Monitor, PlacedTrack},
    truth::TrueVehicle,
};

/// Vehicles farther from a CAV than this along the road are not watched with it.
const NEAR_M: f64 = 120.0;

/// The monitor of a ring: every CAV is watched among the others' images nearest to it.
pub(super) struct Watch {
    monitor: Monitor,
    truth: Vec<TrueVehicle>,
    near: Vec<TrueVehicle>,
    /// What each CAV knows, as of the newest frame.
    tracks: Vec<Vec<PlacedTrack>>,
}

/// What the monitor found in an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RingSafety {
    /// Steps of 0.01 s, summed over CAVs.
    pub cav_steps: usize,
    /// Episodes of h < 0.
    pub violations: usize,
    /// Those that no broken assumption explains.
    pub violations_unattributed: usize,
    /// Steps of CAVs in them.
    pub violated_steps: usize,
    /// Lane changes that began where h_0 < 0 in truth.
    pub unsafe_lane_changes: usize,
    /// Times that h_0 of a CAV became negative.
    pub collision_set_left: usize,
    /// CAVs and humans that stood for five seconds.
    pub stuck: usize,
}

impl Watch {
    pub fn new(settings: SafetySettings) -> Self {
        Self {
            monitor: Monitor::new(settings),
            truth: Vec::new(),
            near: Vec::new(),
            tracks: Vec::new(),
        }
    }

    /// A frame: who sees whom, and what everybody knows.
    pub fn frame(&mut self, ring: &Ring, cavs: usize, sights: &Sights, knowledge: &dyn Knowledge) {
        self.tracks.clear();
        for index in 0..cavs {
            for (other, vehicle) in ring.vehicles().iter().enumerate() {
                if other != index {
                    let viewer = ring.vehicles()[index].id;
                    let visible = sights.sees(index, other);
                    self.monitor
                        .sight(viewer, vehicle.id, visible, ring.time_s());
                }
            }
            let tracks = knowledge.tracks(ring, index).into_iter();
            let placed = tracks.map(|track| PlacedTrack::new(track, ring.road().road()));
            self.tracks.push(placed.collect());
        }
    }

    /// A step, with the inputs that were just found for it.
    pub fn step(&mut self, ring: &Ring, cavs: &[RingCav], profile: &RoadProfile) {
        let (road, time_s) = (profile.road(), ring.time_s());
        self.truth.clear();
        self.truth.extend(ring.vehicles().iter().map(|vehicle| {
            let frenet = vehicle.frenet();
            truth(vehicle, ring, frenet.s_m)
        }));
        let vehicles = ring.vehicles();
        let overlapping = (ring.contacts().iter())
            .map(|&(one, other)| (vehicles[one as usize].id, vehicles[other as usize].id));
        let first = self.monitor.begin(time_s, &self.truth, overlapping);
        for (index, cav) in cavs.iter().enumerate() {
            let near_m = self.truth[index].frenet.s_m;
            self.near.clear();
            for (vehicle, there) in vehicles.iter().zip(&self.truth) {
                let laps = ring.road().laps_to(there.frenet.s_m, near_m);
                let s_m = there.frenet.s_m + laps * ring.road().period_m();
                if (s_m - near_m).abs() < NEAR_M {
                    let is_there = laps.abs() < 0.5;
                    let here = if is_there {
                        *there
                    } else {
                        truth(vehicle, ring, near_m)
                    };
                    self.near.push(here);
                }
            }
            let view = CavView {
                id: vehicles[index].id,
                tracks: self.tracks.get(index).map_or(&[], Vec::as_slice),
                sight: Some(&cav.sight),
                manoeuvre: cav.manoeuvre(),
                state: cav.state,
                wheelbase_m: cav.dimensions.wheelbase_m,
                input: Some(cav.input),
            };
            self.monitor.watch(time_s, first, road, &self.near, &view);
        }
    }

    pub fn safety(&self) -> RingSafety {
        let violations = self.monitor.violations();
        RingSafety {
            cav_steps: self.monitor.cav_steps(),
            violations: violations.values().sum(),
            violations_unattributed: violations.get(&Cause::Unattributed).copied().unwrap_or(0),
            violated_steps: self.monitor.steps_violated().map(|(_, steps)| steps).sum(),
            unsafe_lane_changes: self.monitor.unsafe_actions(),
            collision_set_left: self.monitor.collision_set_left(),
            stuck: self.monitor.stuck(),
        }
    }
}

/// A vehicle as somebody at `near_m` meets it.
fn truth(vehicle: &RingVehicle, ring: &Ring, near_m: f64) -> TrueVehicle {
    let image = ring.image_near(vehicle, near_m);
    TrueVehicle::new(
        vehicle.id,
        vehicle.kind(),
        vehicle.dimensions(),
        image.state,
        image.frenet.s_m,
        ring.road().road(),
    )
}
