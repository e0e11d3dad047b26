use covista_control::{Measured, Neighbour, RoadProfile, SafetySettings, SightLine};
use covista_planner::{self as planner, InvalidObservation, Observation, OwnMotion};
use covista_traffic::{Ring, RingVehicle};
use covista_world::{Action, BicycleState, LaneIndex, ObjectState, Sighting, StationId, Track};

use super::view::{Shape, free_lanes, is_seen};

/// Whoever is farther away than this along the road is of no concern to a CAV.
const NEAR_M: f64 = 150.0;

/// What the CAVs of a ring know of the others: exact as of the newest frame, and the same for
/// everybody who knows of a vehicle at all, but for the lap in which they see it.
#[derive(Default)]
pub(super) struct Knowledge {
    /// Every vehicle where it has driven to, as of the newest frame.
    tracks: Vec<Track>,
    measured: Vec<Measured>,
    /// The same for the controllers, as of now.
    now: Vec<Option<Neighbour>>,
    /// The same for the planner, as of the newest frame.
    observed: Vec<planner::Neighbour>,
    /// Who of the CAVs sees which vehicle, and who of them hears whom, row by row.
    sees: Vec<bool>,
    hears: Vec<bool>,
    bodies: Vec<Shape>,
    near: Vec<usize>,
    shapes: Vec<Shape>,
}

/// A vehicle that a CAV knows of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    /// Its index.
    pub vehicle: usize,
    /// How much farther along the endless road than it has driven the CAV meets it.
    pub farther_m: f64,
    /// Whether it tells the CAV itself.
    pub tells: bool,
}

/// Who hears whom.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hearing {
    pub sharing: bool,
    pub range_m: f64,
}

impl Knowledge {
    /// A frame: everybody looks. `announced` is what each CAV tells to be about and since when.
    pub fn frame(&mut self, ring: &Ring, announced: &[(Action, f64)], hearing: Hearing) {
        let road = ring.road().road();
        let (vehicles, time_s) = (ring.vehicles(), ring.time_s());
        self.tracks.clear();
        self.bodies.clear();
        for (index, vehicle) in vehicles.iter().enumerate() {
            let word = announced.get(index).copied();
            self.tracks
                .push(track(vehicle, vehicle.state(road), time_s, word));
            self.bodies.push(Shape::of(vehicle));
        }
        self.measured.clear();
        let measured = self.tracks.iter().map(|track| Measured::new(track, road));
        self.measured.extend(measured);
        let count = announced.len();
        let apart_m = |one: &RingVehicle, other: &RingVehicle| {
            let away_m = other.frenet().s_m - one.frenet().s_m;
            away_m + ring.road().laps_to(away_m, 0.0) * ring.road().period_m()
        };
        self.hears.clear();
        self.hears.extend((0..count * count).map(|pair| {
            let (one, other) = (pair / count, pair % count);
            one != other
                && hearing.sharing
                && apart_m(&vehicles[one], &vehicles[other]).abs() < hearing.range_m
        }));
        self.sees.clear();
        self.sees.resize(count * vehicles.len(), false);
    }

    /// How far CAV `index` sees each lane ahead; notes whom it sees.
    pub fn look(
        &mut self,
        index: usize,
        ring: &Ring,
        profile: &RoadProfile,
        safety: &SafetySettings,
    ) -> SightLine {
        let (vehicles, period_m) = (ring.vehicles(), ring.road().period_m());
        let own = &vehicles[index];
        let eye = [
            own.frenet().s_m + own.dimensions().center_ahead_of_axle_m(),
            own.frenet().d_m,
        ];
        self.near.clear();
        self.shapes.clear();
        for (other, body) in self.bodies.iter().enumerate() {
            let s_m = vehicles[other].frenet().s_m;
            let body = body.farther(ring.road().laps_to(s_m, eye[0]) * period_m);
            if other != index && (body.corners[0][0] - eye[0]).abs() < safety.sight_range_m {
                self.near.push(other);
                self.shapes.push(body);
            }
        }
        let row = index * vehicles.len();
        for (body, &other) in self.near.iter().enumerate() {
            self.sees[row + other] = is_seen(eye, &self.shapes, body);
        }
        let free = free_lanes(profile.road(), eye, &self.shapes, safety);
        SightLine::new(free.map(|lane| eye[0] + lane.clear_m), ring.time_s())
            .with_open(free.map(|lane| eye[0] + lane.open_m))
            .with_blocked(free.map(|lane| lane.is_blocked))
    }

    /// Whether CAV `index` sees vehicle `other`.
    pub fn sees(&self, index: usize, other: usize) -> bool {
        self.sees[index * self.bodies.len() + other]
    }

    /// Whom CAV `index` knows of: whom it sees, whom it hears and whom those see.
    pub fn known(&self, index: usize, ring: &Ring, known: &mut Vec<Known>) {
        let (vehicles, period_m) = (ring.vehicles(), ring.road().period_m());
        let count = self.sees.len() / vehicles.len();
        let hears = |other: usize| other < count && self.hears[index * count + other];
        let s_m = vehicles[index].frenet().s_m;
        known.clear();
        known.extend((0..vehicles.len()).filter_map(|other| {
            let is_known = hears(other)
                || self.sees(index, other)
                || (0..count).any(|by| hears(by) && self.sees(by, other));
            let there_m = vehicles[other].frenet().s_m;
            let farther_m = ring.road().laps_to(there_m, s_m) * period_m;
            let is_near = (there_m + farther_m - s_m).abs() < NEAR_M;
            (is_known && is_near && other != index).then_some(Known {
                vehicle: other,
                farther_m,
                tells: hears(other),
            })
        }));
    }

    /// Carries everything on to `time_s`.
    pub fn carry_on(&mut self, profile: &RoadProfile, time_s: f64, safety: &SafetySettings) {
        let road = profile.road();
        self.now.clear();
        let carried = |measured: &Measured| measured.at(time_s, road, safety);
        self.now.extend(self.measured.iter().map(carried));
    }

    /// Those of `known` for a controller.
    pub fn neighbours(&self, known: &[Known], neighbours: &mut Vec<Neighbour>) {
        neighbours.clear();
        neighbours.extend(known.iter().filter_map(|known| {
            let neighbour = self.now[known.vehicle]?.farther(known.farther_m);
            Some(if known.tells {
                neighbour
            } else {
                neighbour.untold()
            })
        }));
    }

    /// Places every vehicle for the planner.
    ///
    /// # Errors
    /// When a number is not finite.
    pub fn observe(&mut self, ring: &Ring) -> Result<(), InvalidObservation> {
        let Some(any) = ring.vehicles().first() else {
            return Ok(());
        };
        let road = ring.road().road();
        let own = OwnMotion {
            state: any.state(road),
            dimensions: any.dimensions(),
            lane: LaneIndex::RIGHTMOST,
            desired_speed_mps: any.desired_speed_mps,
            manoeuvre: planner::Manoeuvre::KeepingLane,
        };
        self.observed = Observation::new(road, &own, &self.tracks)?.neighbours;
        Ok(())
    }

    /// Those of `known` for the planner.
    pub fn observed(&self, known: &[Known]) -> Vec<planner::Neighbour> {
        let seen = |known: &Known| {
            let observed = self.observed[known.vehicle];
            let told = known.tells;
            planner::Neighbour {
                s_m: observed.s_m + known.farther_m,
                station: observed.station.filter(|_| told),
                action: observed.action.filter(|_| told),
                entering: observed.entering.filter(|_| told),
                ..observed
            }
        };
        known.iter().map(seen).collect()
    }

    /// Those of `known` as tracks in the world, as CAV `index` has them at a frame.
    pub fn tracks(&self, ring: &Ring, index: usize, known: &[Known]) -> Vec<Track> {
        let near_m = ring.vehicles()[index].frenet().s_m;
        let (time_s, own) = (self.tracks[index].time_s, ring.vehicles()[index].id);
        let track_of = |known: &Known| {
            let there = &self.tracks[known.vehicle];
            let mut here = there.clone();
            if known.farther_m != 0.0 {
                let vehicle = &ring.vehicles()[known.vehicle];
                let state = ring.image_near(vehicle, near_m).state;
                here = track(vehicle, state, time_s, there.action.zip(there.announced_s));
            }
            if !known.tells {
                (here.station, here.action, here.announced_s) = (None, None, None);
                here.sightings = vec![Sighting {
                    station: StationId(own.0),
                    measured_s: time_s,
                }];
            }
            here
        };
        known.iter().map(track_of).collect()
    }
}

/// A vehicle as it is; with its `word` about itself, where it is a CAV.
fn track(
    vehicle: &RingVehicle,
    state: BicycleState,
    time_s: f64,
    word: Option<(Action, f64)>,
) -> Track {
    let dimensions = vehicle.dimensions();
    let center = dimensions.center_pose(state.pose);
    let station = StationId(vehicle.id.0);
    Track {
        id: vehicle.id.0,
        station: word.map(|_| station),
        state: ObjectState {
            center,
            velocity_mps: center.forward() * state.speed_mps,
            length_m: dimensions.length_m,
            width_m: dimensions.width_m,
            height_m: dimensions.height_m,
            class: vehicle.model.class(),
        },
        time_s,
        position_std_m: 0.0,
        velocity_std_mps: 0.0,
        confidence: 1.0,
        lane: None,
        action: word.map(|(action, _)| action),
        announced_s: word.map(|(_, since_s)| since_s),
        sightings: vec![Sighting {
            station,
            measured_s: time_s,
        }],
    }
}
