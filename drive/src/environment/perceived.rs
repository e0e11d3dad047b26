mod drawn;
mod rendered;

use std::borrow::Cow;

use covista_control::{Measured, Neighbour, RoadProfile, SafetySettings, SightLine};
use covista_perception::PerceiveError;
use covista_planner::{self as planner, InvalidObservation};
use covista_sharing::{OwnState, Tracker, TrackerSettings};
use covista_traffic::Ring;
use covista_world::{
    Calibration, CollectivePerceptionMessage, LANE_COUNT, LaneIndex, Percept, Road, Se2Pose, Track,
};
use nalgebra::Vector2;

use super::{
    cav::{RingCav, nearest_lane},
    perception::{Frame, Knowledge, on_road},
    view::Shape,
};
use crate::free_lanes::seen_free;
pub(super) use drawn::Drawn;
pub(super) use rendered::Rendered;

/// Tracks farther from a CAV than this are of no concern to it.
const NEAR_M: f64 = 150.0;
/// How far a body may be from a track that stands for it, in metres along the road and across.
const SAME_BODY_M: f64 = 1.0;

/// What the CAVs of a ring have found out: each has a tracker, which takes up what it perceives and
/// what it is told.
///
/// A CAV knows nothing of laps: whatever it sees or is told of is placed at the image nearest to
/// it, and there it stays as the CAV drives on.
pub(super) struct Perceived {
    eyes: Eyes,
    calibration: Calibration,
    minds: Vec<Mind>,
    // Storage of one frame, used again in the next.
    /// Of each CAV.
    percepts: Vec<Vec<Percept>>,
    messages: Vec<CollectivePerceptionMessage>,
}

/// Where percepts come from.
#[derive(Clone)]
pub(super) enum Eyes {
    /// What the networks would have found, drawn.
    Statistical(Drawn),
    /// What they find.
    Network(Rendered),
}

/// What one CAV has found out.
struct Mind {
    tracker: Tracker,
    /// As of the newest frame.
    tracks: Vec<Track>,
    measured: Vec<Measured>,
    observed: Vec<planner::Neighbour>,
    /// As of now.
    neighbours: Vec<Neighbour>,
}

impl Perceived {
    /// Nobody knows anything yet.
    pub fn new(eyes: Eyes, cavs: &[RingCav]) -> Self {
        let mind = |cav: &RingCav| Mind {
            tracker: Tracker::new(cav.station, cav.dimensions, TrackerSettings::default()),
            tracks: Vec::new(),
            measured: Vec::new(),
            observed: Vec::new(),
            neighbours: Vec::new(),
        };
        Self {
            eyes,
            calibration: Calibration::kitti(),
            minds: cavs.iter().map(mind).collect(),
            percepts: vec![Vec::new(); cavs.len()],
            messages: Vec::new(),
        }
    }

    /// Everybody looks, and the trackers take up what is found.
    fn look(&mut self, frame: &Frame<'_>) -> Result<(), PerceiveError> {
        let (percepts, time_s) = (&mut self.percepts, frame.ring.time_s());
        match &mut self.eyes {
            Eyes::Statistical(drawn) => drawn.look(frame, &self.calibration, percepts),
            Eyes::Network(rendered) => rendered.look(frame, &self.calibration, percepts)?,
        }
        let found = frame.cavs.iter().zip(percepts);
        for (mind, (own, percepts)) in self.minds.iter_mut().zip(found) {
            let state = own.state;
            mind.tracker
                .observe(time_s, state.pose, state.speed_mps, percepts);
        }
        Ok(())
    }

    /// Everybody tells what they see and do, and takes up what they hear.
    fn tell(&mut self, frame: &Frame<'_>) {
        let time_s = frame.ring.time_s();
        self.messages.clear();
        for (index, (mind, cav)) in self.minds.iter_mut().zip(frame.cavs).enumerate() {
            let accel_mps2 = frame.ring.vehicles()[index].accel_mps2;
            let own = own_state(cav, accel_mps2, frame.profile);
            self.messages.push(mind.tracker.message(time_s, &own));
        }
        let lap_m = frame.ring.road().lap_m();
        for (index, (mind, cav)) in self.minds.iter_mut().zip(frame.cavs).enumerate() {
            let heard: Vec<_> = (0..self.messages.len())
                .filter(|&other| frame.hears(index, other))
                .map(|other| nearest(&self.messages[other], cav.state.pose.position(), lap_m))
                .collect();
            mind.tracker
                .receive(time_s, heard.iter().map(AsRef::as_ref));
        }
    }
}

impl Knowledge for Perceived {
    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), PerceiveError> {
        self.look(frame)?;
        if frame.sharing {
            self.tell(frame);
        }
        for (mind, cav) in self.minds.iter_mut().zip(frame.cavs) {
            mind.place(cav, frame);
        }
        self.carry_on(frame.profile, frame.ring.time_s(), frame.safety);
        Ok(())
    }

    fn sight(
        &self,
        index: usize,
        pose: Se2Pose,
        road: &Road,
        time_s: f64,
        safety: &SafetySettings,
    ) -> Option<SightLine> {
        let Eyes::Network(rendered) = &self.eyes else {
            return None;
        };
        let blind = SightLine::new([f64::NEG_INFINITY; LANE_COUNT as usize], time_s);
        let (known, calibration) = (&self.minds[index].neighbours, &self.calibration);
        let free = |space: &_| seen_free(space, pose, calibration, known, road, time_s, safety);
        Some(rendered.free_space(index).map_or(blind, free))
    }

    fn knows(&self, index: usize, lane: LaneIndex, body: &Shape) -> bool {
        let mut neighbours = self.minds[index].neighbours.iter();
        neighbours.any(|known| known.lanes.contains(lane) && stands_for(known, body))
    }

    fn carry_on(&mut self, profile: &RoadProfile, time_s: f64, safety: &SafetySettings) {
        for mind in &mut self.minds {
            let now = mind.measured.iter();
            mind.neighbours.clear();
            mind.neighbours
                .extend(now.filter_map(|known| known.at(time_s, profile.road(), safety)));
        }
    }

    fn neighbours(&self, index: usize, neighbours: &mut Vec<Neighbour>) {
        neighbours.clone_from(&self.minds[index].neighbours);
    }

    fn observe(&mut self, ring: &Ring) -> Result<(), InvalidObservation> {
        for mind in &mut self.minds {
            mind.observed = on_road(ring, &mind.tracks)?;
        }
        Ok(())
    }

    fn observed(&self, index: usize) -> Vec<planner::Neighbour> {
        self.minds[index].observed.clone()
    }

    fn tracks(&self, _ring: &Ring, index: usize) -> Vec<Track> {
        self.minds[index].tracks.clone()
    }
}

impl Mind {
    /// Places the tracks near the CAV on the road.
    fn place(&mut self, cav: &RingCav, frame: &Frame<'_>) {
        let own = cav.state.pose.position();
        self.tracks = self.tracker.tracks(frame.ring.time_s());
        self.tracks
            .retain(|track| (track.state.center.position() - own).norm() < NEAR_M);
        let road = frame.profile.road();
        let placed = self.tracks.iter().map(|track| Measured::new(track, road));
        self.measured.clear();
        self.measured.extend(placed);
    }
}

fn own_state(cav: &RingCav, accel_mps2: f64, profile: &RoadProfile) -> OwnState {
    let (action, announced_s) = cav.announced;
    OwnState {
        pose: cav.state.pose,
        speed_mps: cav.state.speed_mps,
        accel_mps2,
        lane: nearest_lane(profile.road(), cav.frenet.d_m),
        action,
        announced_s,
    }
}

/// A message as somebody at `own` has it: the sender and each of its objects at the image nearest
/// to there, a lap being `lap_m` in the plane.
fn nearest(
    message: &CollectivePerceptionMessage,
    own: Vector2<f64>,
    lap_m: Vector2<f64>,
) -> Cow<'_, CollectivePerceptionMessage> {
    let way_m = |pose: &Se2Pose| {
        let laps = (own - pose.position()).dot(&lap_m) / lap_m.norm_squared();
        laps.round() * lap_m
    };
    let moved = |pose: &Se2Pose| {
        let way_m = way_m(pose);
        Se2Pose::new(pose.x_m + way_m.x, pose.y_m + way_m.y, pose.yaw_rad)
    };
    let centers = message.objects.iter().map(|object| &object.state.center);
    if (centers.chain([&message.pose])).all(|pose| way_m(pose) == Vector2::zeros()) {
        return Cow::Borrowed(message);
    }
    let mut message = message.clone();
    message.pose = moved(&message.pose);
    for object in &mut message.objects {
        object.state.center = moved(&object.state.center);
    }
    Cow::Owned(message)
}

/// Whether what is known of a vehicle stands for the near side of `body`.
fn stands_for(known: &Neighbour, body: &Shape) -> bool {
    let [near_s_m, _] = body.s_range_m;
    let along = known.s_rear_m - SAME_BODY_M..=known.s_front_m + SAME_BODY_M;
    let [right_m, left_m] = body.d_range_m;
    along.contains(&near_s_m)
        && right_m < known.d_left_m + SAME_BODY_M
        && left_m > known.d_right_m - SAME_BODY_M
}

#[cfg(test)]
mod tests;
