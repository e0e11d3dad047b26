//! The tracker as a vehicle uses it: frames in, messages in, tracks out.
#![cfg(test)]

mod frames;
mod messages;

use covista_sharing::{OwnState, Tracker, TrackerSettings};
use covista_world::{
    Action, Detection3d, LaneIndex, ObjectClass, Percept, Se2Pose, StationId, Track,
    VehicleDimensions,
};
use nalgebra::{Vector2, Vector3};

const SEDAN: VehicleDimensions = VehicleDimensions {
    length_m: 4.6,
    width_m: 1.9,
    height_m: 1.5,
    wheelbase_m: 2.7,
    rear_overhang_m: 0.9,
};
const FRAME_S: f64 = 0.5;

fn tracker(station: u32) -> Tracker {
    Tracker::new(StationId(station), SEDAN, TrackerSettings::default())
}

/// The percept of a body whose centre has `center` in the world, seen from `pose`.
fn percept(pose: Se2Pose, center: Vector2<f64>, lane: Option<LaneIndex>) -> Percept {
    let local = pose.inverse_transform(center);
    Percept {
        detection: Detection3d {
            center_m: Vector3::new(local.x, local.y, 0.75),
            size_m: Vector3::new(4.6, 1.9, 1.5),
            yaw_rad: -pose.yaw_rad,
            class: ObjectClass::Car,
            score: 0.7,
        },
        lane,
        lane_probability: 1.0,
        distance_m: local.norm(),
        observation_angle_rad: 0.0,
        rotation_y_rad: 0.0,
    }
}

fn own(pose: Se2Pose, speed_mps: f64) -> OwnState {
    OwnState {
        pose,
        speed_mps,
        accel_mps2: 0.0,
        lane: LaneIndex::LEFTMOST,
        action: Action::KeepLane,
        announced_s: 0.0,
    }
}

fn at(x_m: f64, y_m: f64) -> Se2Pose {
    Se2Pose::new(x_m, y_m, 0.0)
}

/// A tracker at `pose` that saw bodies standing at `centers` in `frames` frames from time 0.
fn observer(station: u32, pose: Se2Pose, centers: &[Vector2<f64>], frames: u32) -> Tracker {
    let mut tracker = tracker(station);
    for i in 0..frames {
        let percepts: Vec<_> = centers
            .iter()
            .map(|&center| percept(pose, center, None))
            .collect();
        tracker.observe(FRAME_S * f64::from(i), pose, 0.0, &percepts);
    }
    tracker
}

fn nearest(tracks: &[Track], place: Vector2<f64>) -> &Track {
    let distance = |track: &Track| (track.state.center.position() - place).norm();
    tracks
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .expect("a track")
}
