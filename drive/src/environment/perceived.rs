use std::{borrow::Cow, sync::Arc};

use covista_control::{Measured, Neighbour, RoadProfile, SafetySettings};
use covista_planner::{self as planner, InvalidObservation};
use covista_sensors::{DrawnBox, ErrorModel, Observer, SeenVehicle};
use covista_sharing::{OwnState, Tracker, TrackerSettings};
use covista_traffic::{Ring, VehicleId};
use covista_world::{
    Calibration, CollectivePerceptionMessage, Detection3d, LaneIndex, Percept, Se2Pose, Track,
    wrap_angle,
};
use nalgebra::{Vector2, Vector3};

use super::{
    cav::{RingCav, nearest_lane},
    perception::{Frame, Knowledge, on_road},
    sights::Seen,
    view::{Shape, is_open},
};
use crate::senses::percept;

/// Tracks farther from a CAV than this are of no concern to it.
const NEAR_M: f64 = 150.0;
/// How far a body may be from a track that stands for it, in metres along the road and across.
const SAME_BODY_M: f64 = 1.0;

/// What the CAVs of a ring have found out: each has a tracker, which takes up what it sees with the
/// networks' errors and what it is told.
///
/// A CAV knows nothing of laps: whatever it sees or is told of is placed at the image nearest to
/// it, and there it stays as the CAV drives on.
pub(super) struct Perceived {
    errors: Arc<ErrorModel>,
    calibration: Calibration,
    minds: Vec<Mind>,
    // Storage of one frame, used again in the next.
    centers: Vec<Se2Pose>,
    seen: Vec<SeenVehicle>,
    percepts: Vec<Percept>,
    messages: Vec<CollectivePerceptionMessage>,
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
    pub fn new(errors: Arc<ErrorModel>, cavs: &[RingCav]) -> Self {
        let mind = |cav: &RingCav| Mind {
            tracker: Tracker::new(cav.station, cav.dimensions, TrackerSettings::default()),
            tracks: Vec::new(),
            measured: Vec::new(),
            observed: Vec::new(),
            neighbours: Vec::new(),
        };
        Self {
            errors,
            calibration: Calibration::kitti(),
            minds: cavs.iter().map(mind).collect(),
            centers: Vec::new(),
            seen: Vec::new(),
            percepts: Vec::new(),
            messages: Vec::new(),
        }
    }

    /// CAV `index` looks, and its tracker takes up what the networks would have found.
    fn look(&mut self, index: usize, frame: &Frame<'_>) {
        let (ring, own) = (frame.ring, &frame.cavs[index]);
        let (road, time_s) = (ring.road().road(), ring.time_s());
        let mount = self.calibration.vehicle_from_lidar.translation.vector;
        let lidar = own.state.pose.compose(Se2Pose::new(mount.x, mount.y, 0.0));
        let [least_x, least_y, most_x, most_y] = self.errors.range_m;
        let seen = frame.sights.seen(index).map(|seen| {
            let center = self.centers[seen.vehicle];
            let lap_m = seen.laps * ring.road().lap_m();
            let center = Se2Pose::new(center.x_m + lap_m.x, center.y_m + lap_m.y, center.yaw_rad);
            as_seen(&seen, ring, center, lidar, mount.z)
        });
        self.seen.clear();
        self.seen.extend(seen.filter(|seen| {
            let place = seen.truth.center_m;
            (least_x..=most_x).contains(&place.x) && (least_y..=most_y).contains(&place.y)
        }));
        let observer = Observer {
            seed: ring.settings().seed,
            ego: VehicleId(own.station.0),
            time_s,
            lidar,
            road: Some(road),
        };
        let (eye, bodies) = frame.sights.about(index);
        let is_in_sight = |drawn: &DrawnBox| {
            let place = lidar.transform(drawn.detection.center_m.xy());
            let point = road.to_frenet_near(place, eye[0]);
            drawn.of.is_some() || is_open(eye, bodies, [point.s_m, point.d_m])
        };
        let drawn = self.errors.draw(&self.seen, &observer).into_iter();
        let found = drawn
            .filter(is_in_sight)
            .map(|drawn| percept(&self.calibration, drawn.detection, drawn.lane));
        self.percepts.clear();
        self.percepts.extend(found);
        self.minds[index].tracker.observe(
            time_s,
            own.state.pose,
            own.state.speed_mps,
            &self.percepts,
        );
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
    fn frame(&mut self, frame: &Frame<'_>) {
        let (road, time_s) = (frame.profile.road(), frame.ring.time_s());
        let center = |vehicle: &covista_traffic::RingVehicle| {
            let pose = vehicle.state(road).pose;
            vehicle.dimensions().center_pose(pose)
        };
        self.centers.clear();
        self.centers
            .extend(frame.ring.vehicles().iter().map(center));
        for index in 0..self.minds.len() {
            self.look(index, frame);
        }
        if frame.sharing {
            self.tell(frame);
        }
        for (mind, cav) in self.minds.iter_mut().zip(frame.cavs) {
            mind.place(cav, frame);
        }
        self.carry_on(frame.profile, time_s, frame.safety);
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

/// A vehicle with its body's centre at `center` in the world, as the error model takes it.
fn as_seen(
    seen: &Seen<'_>,
    ring: &Ring,
    center: Se2Pose,
    lidar: Se2Pose,
    lidar_height_m: f64,
) -> SeenVehicle {
    let vehicle = &ring.vehicles()[seen.vehicle];
    let size = vehicle.dimensions();
    let place = lidar.inverse_transform(center.position());
    SeenVehicle {
        id: vehicle.id,
        truth: Detection3d {
            center_m: place.push(size.height_m / 2.0 - lidar_height_m),
            size_m: Vector3::new(size.length_m, size.width_m, size.height_m),
            yaw_rad: wrap_angle(center.yaw_rad - lidar.yaw_rad),
            class: vehicle.model.class(),
            score: 1.0,
        },
        lane: ring.road().road().lane_at(seen.body.middle()[1]),
        visibility: seen.visibility,
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
