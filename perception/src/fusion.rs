//! Boxes and lane marks to percepts: which lane each vehicle is in, and where it stands.

mod course;
mod fit;

use covista_world::{Calibration, Detection3d, LaneMarks, Percept, wrap_angle};
use nalgebra::{Point3, Vector3};

pub use course::{LaneCourse, LanePosition};

/// A vehicle is given a lane that it is in more likely than not.
const LEAST_PROBABILITY: f64 = 0.5;

/// What fusion tells of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused {
    /// Where the lanes run; `None` where too little of their marks is seen.
    pub course: Option<LaneCourse>,
    /// A percept for each detection, in their order.
    pub percepts: Vec<Percept>,
}

/// Fuses lane marks on the ground with detections in the LIDAR frame.
pub fn fuse(marks: &LaneMarks, detections: &[Detection3d], calibration: &Calibration) -> Fused {
    let boxes: Vec<Detection3d> = detections
        .iter()
        .map(|detection| in_vehicle_frame(detection, calibration))
        .collect();
    let course = LaneCourse::fit(&marks.points, &boxes);
    let percepts = detections
        .iter()
        .zip(boxes)
        .map(|(detection, in_vehicle)| percept(detection, in_vehicle, course.as_ref(), calibration))
        .collect();
    Fused { course, percepts }
}

fn in_vehicle_frame(detection: &Detection3d, calibration: &Calibration) -> Detection3d {
    let heading = calibration.vehicle_from_lidar * heading(detection);
    Detection3d {
        center_m: (calibration.vehicle_from_lidar * Point3::from(detection.center_m)).coords,
        yaw_rad: wrap_angle(heading.y.atan2(heading.x)),
        ..*detection
    }
}

fn heading(detection: &Detection3d) -> Vector3<f64> {
    let (sin, cos) = detection.yaw_rad.sin_cos();
    Vector3::new(cos, sin, 0.0)
}

fn percept(
    in_lidar: &Detection3d,
    in_vehicle: Detection3d,
    course: Option<&LaneCourse>,
    calibration: &Calibration,
) -> Percept {
    let camera_from_lidar = calibration.camera_from_lidar();
    let camera_heading = camera_from_lidar * heading(in_lidar);
    let camera_center = camera_from_lidar * Point3::from(in_lidar.center_m);
    let rotation_y_rad = (-camera_heading.z).atan2(camera_heading.x);
    let position = course.map(|course| course.locate(in_vehicle.center_m.xy()));
    let lane_probability = position.map_or(0.0, |position| position.probability);
    Percept {
        detection: in_vehicle,
        lane: position
            .filter(|_| lane_probability > LEAST_PROBABILITY)
            .map(|position| position.lane),
        lane_probability,
        distance_m: in_lidar.center_m.xy().norm(),
        observation_angle_rad: wrap_angle(rotation_y_rad - camera_center.x.atan2(camera_center.z)),
        rotation_y_rad: wrap_angle(rotation_y_rad),
    }
}

#[cfg(test)]
mod tests;
