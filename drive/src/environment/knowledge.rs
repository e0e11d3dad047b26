use covista_control::{Measured, Neighbour, RoadProfile, SafetySettings};
use covista_perception::PerceiveError;
use covista_planner::{self as planner, InvalidObservation};
use covista_traffic::{Ring, RingVehicle};
use covista_world::{Action, BicycleState, LaneIndex, ObjectState, Sighting, StationId, Track};

use super::{
    perception::{Frame, Knowledge, on_road},
    view::Shape,
};

/// Whoever is farther away than this along the road is of no concern to a CAV.
const NEAR_M: f64 = 150.0;

/// Exact knowledge: as of the newest frame, and the same for everybody who knows of a vehicle at
/// all, but for the lap in which they see it.
#[derive(Default)]
pub(super) struct Exact {
    /// Every vehicle where it has driven to, as of the newest frame.
    tracks: Vec<Track>,
    measured: Vec<Measured>,
    /// The same for the controllers, as of now.
    now: Vec<Option<Neighbour>>,
    /// The same for the planner, as of the newest frame.
    observed: Vec<planner::Neighbour>,
    /// Whom each CAV knows of, as of the newest frame.
    known: Vec<Vec<Known>>,
    /// Whether a CAV hears another, row by row.
    hears: Vec<bool>,
}

/// A vehicle that a CAV knows of.
#[derive(Debug, Clone, Copy)]
struct Known {
    /// Its index.
    vehicle: usize,
    /// How much farther along the endless road than it has driven the CAV meets it.
    farther_m: f64,
    /// Whether it tells the CAV itself.
    tells: bool,
}

impl Exact {
    /// Whom CAV `index` knows of: whom it sees, whom it hears and whom those see.
    fn know(&mut self, index: usize, frame: &Frame<'_>) {
        let (ring, sights) = (frame.ring, frame.sights);
        let (vehicles, period_m) = (ring.vehicles(), ring.road().period_m());
        let count = frame.cavs.len();
        let hears = |other: usize| other < count && self.hears[index * count + other];
        let s_m = vehicles[index].frenet().s_m;
        self.known[index].clear();
        self.known[index].extend((0..vehicles.len()).filter_map(|other| {
            let is_known = hears(other)
                || sights.sees(index, other)
                || (0..count).any(|by| hears(by) && sights.sees(by, other));
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
}

impl Knowledge for Exact {
    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), PerceiveError> {
        let (ring, count) = (frame.ring, frame.cavs.len());
        let (road, time_s) = (ring.road().road(), ring.time_s());
        self.tracks.clear();
        for (index, vehicle) in ring.vehicles().iter().enumerate() {
            let word = frame.cavs.get(index).map(|cav| cav.announced);
            self.tracks
                .push(track(vehicle, vehicle.state(road), time_s, word));
        }
        self.measured.clear();
        let measured = self.tracks.iter().map(|track| Measured::new(track, road));
        self.measured.extend(measured);
        let pairs = 0..count * count;
        self.hears.clear();
        self.hears
            .extend(pairs.map(|pair| frame.hears(pair / count, pair % count)));
        self.known.resize_with(count, Vec::new);
        for index in 0..count {
            self.know(index, frame);
        }
        Ok(())
    }

    fn knows(&self, _index: usize, _lane: LaneIndex, _body: &Shape) -> bool {
        // Whatever ends the free sight of a lane is seen.
        true
    }

    fn carry_on(&mut self, profile: &RoadProfile, time_s: f64, safety: &SafetySettings) {
        let road = profile.road();
        self.now.clear();
        let carried = |measured: &Measured| measured.at(time_s, road, safety);
        self.now.extend(self.measured.iter().map(carried));
    }

    fn neighbours(&self, index: usize, neighbours: &mut Vec<Neighbour>) {
        neighbours.clear();
        neighbours.extend(self.known[index].iter().filter_map(|known| {
            let neighbour = self.now[known.vehicle]?.farther(known.farther_m);
            Some(if known.tells {
                neighbour
            } else {
                neighbour.untold()
            })
        }));
    }

    fn observe(&mut self, ring: &Ring) -> Result<(), InvalidObservation> {
        self.observed = on_road(ring, &self.tracks)?;
        Ok(())
    }

    fn observed(&self, index: usize) -> Vec<planner::Neighbour> {
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
        self.known[index].iter().map(seen).collect()
    }

    fn tracks(&self, ring: &Ring, index: usize) -> Vec<Track> {
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
        self.known[index].iter().map(track_of).collect()
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
