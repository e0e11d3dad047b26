//! Boxes and lane marks to percepts: which lane each vehicle is in, and where it stands.

use covista_world::{
    Calibration, Detection3d, LaneIndex, LaneMarks, MarkCurve, Percept, wrap_angle,
};
use nalgebra::{Point3, Vector2, Vector3};

/// How far past the farthest point at which a mark was seen its curve is trusted, as a part of
/// the seen length, and at most.
const BEYOND: f64 = 0.25;
const BEYOND_MOST_M: f64 = 10.0;
/// How far before the nearest point at which a mark was seen its curve is trusted: from where the
/// camera's bottom row meets the ground to just behind the own vehicle.
const BEFORE_M: f64 = 17.5;
/// No curve is trusted farther behind.
const BEHIND_M: f64 = -10.0;

/// A percept for each detection of the LIDAR frame, in their order.
pub fn fuse(
    marks: &LaneMarks,
    detections: &[Detection3d],
    calibration: &Calibration,
) -> Vec<Percept> {
    detections
        .iter()
        .map(|detection| percept(marks, detection, calibration))
        .collect()
}

fn percept(marks: &LaneMarks, detection: &Detection3d, calibration: &Calibration) -> Percept {
    let vehicle_from_lidar = calibration.vehicle_from_lidar;
    let camera_from_vehicle = calibration.vehicle_from_camera.inverse();
    let (sin, cos) = detection.yaw_rad.sin_cos();
    let heading = vehicle_from_lidar * Vector3::new(cos, sin, 0.0);
    let center = vehicle_from_lidar * Point3::from(detection.center_m);
    let camera_heading = camera_from_vehicle * heading;
    let camera_center = camera_from_vehicle * center;
    let rotation_y_rad = (-camera_heading.z).atan2(camera_heading.x);
    Percept {
        detection: Detection3d {
            center_m: center.coords,
            yaw_rad: wrap_angle(heading.y.atan2(heading.x)),
            ..*detection
        },
        lane: lane_at(marks, center.coords.xy()),
        distance_m: detection.center_m.xy().norm(),
        observation_angle_rad: wrap_angle(rotation_y_rad - camera_center.x.atan2(camera_center.z)),
        rotation_y_rad: wrap_angle(rotation_y_rad),
    }
}

/// The lane of the own vehicle, at its rear axle.
pub fn ego_lane(marks: &LaneMarks) -> Option<LaneIndex> {
    lane_at(marks, Vector2::zeros())
}

/// The lane whose two marks a ground point of the vehicle frame lies between; `None` where they
/// aren't both known.
pub fn lane_at(marks: &LaneMarks, point_m: Vector2<f64>) -> Option<LaneIndex> {
    let mark_y = |mark: u8| {
        let curve = marks.curves[usize::from(mark)].filter(|curve| reaches(curve, point_m.x))?;
        Some(curve.y_at(point_m.x))
    };
    LaneIndex::all().find(|lane| {
        let [left, right] = [lane.get(), lane.get() + 1].map(mark_y);
        left.is_some_and(|left| point_m.y <= left) && right.is_some_and(|right| point_m.y > right)
    })
}

/// Whether a mark's curve can be trusted at `x_m`.
fn reaches(curve: &MarkCurve, x_m: f64) -> bool {
    let [nearest, farthest] = curve.x_range_m;
    let beyond = (BEYOND * (farthest - nearest)).min(BEYOND_MOST_M);
    ((nearest - BEFORE_M).max(BEHIND_M)..=farthest + beyond).contains(&x_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_world::{MARK_COUNT, ObjectClass, ROW_ANCHORS};
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

    /// The marks of a left-hand bend seen from the middle lane; `known` tells which.
    fn marks(known: [bool; MARK_COUNT]) -> LaneMarks {
        LaneMarks {
            pixels: [[None; ROW_ANCHORS.len()]; MARK_COUNT],
            curves: std::array::from_fn(|mark| {
                known[mark].then(|| MarkCurve {
                    coefficients: [5.25 - 3.5 * mark as f64, 0.0, 1.0 / 160.0],
                    x_range_m: [7.2, 40.0],
                })
            }),
        }
    }

    fn lane(known: [bool; MARK_COUNT], x: f64, y: f64) -> Option<u8> {
        lane_at(&marks(known), Vector2::new(x, y)).map(LaneIndex::get)
    }

    #[test]
    fn a_vehicle_is_in_the_lane_whose_marks_it_lies_between() {
        let all = [true; MARK_COUNT];
        let bend = 32.0 * 32.0 / 160.0;
        for (y, expected) in [
            (5.3, None),
            (5.2, Some(0)),
            (1.8, Some(0)),
            (0.0, Some(1)),
            (-1.8, Some(2)),
            (-5.3, None),
        ] {
            assert_eq!(lane(all, 32.0, y + bend), expected, "{y}");
        }
        // The road's left lane ahead is where the own lane would be were the road straight.
        assert_eq!(lane(all, 32.0, 0.0), None);
        assert_eq!(lane(all, 32.0, 3.0), Some(2));
    }

    #[test]
    fn no_lane_without_both_of_its_marks() {
        let second_missing = [true, false, true, true];
        assert_eq!(lane(second_missing, 10.0, 4.0), None);
        assert_eq!(lane(second_missing, 10.0, 0.0), None);
        assert_eq!(lane(second_missing, 10.0, -3.0), Some(2));
    }

    #[test]
    fn no_lane_where_the_marks_were_not_seen() {
        let all = [true; MARK_COUNT];
        let at = |x: f64| lane(all, x, x * x / 160.0);
        assert_eq!(at(47.0), Some(1));
        assert_eq!(at(50.0), None);
        assert_eq!(at(-9.0), Some(1));
        assert_eq!(at(-11.0), None);
        let mut far_only = marks(all);
        for curve in far_only.curves.iter_mut().flatten() {
            curve.x_range_m[0] = 20.0;
        }
        assert_eq!(ego_lane(&far_only), None);
        assert_eq!(ego_lane(&marks(all)), LaneIndex::new(1));
        assert_eq!(ego_lane(&marks([false; 4])), None);
    }

    #[test]
    fn a_percept_carries_kittis_angles() {
        let calibration = Calibration::kitti();
        let percept = |x: f64, y: f64, yaw_rad: f64| {
            let detection = Detection3d {
                center_m: Vector3::new(x, y, -0.95),
                size_m: Vector3::new(4.6, 1.85, 1.55),
                yaw_rad,
                class: ObjectClass::Car,
                score: 0.9,
            };
            fuse(&marks([true; 4]), &[detection], &calibration)[0]
        };
        // Straight ahead and driving away: rotation_y and alpha are -pi/2.
        let ahead = percept(20.0, 0.0, 0.0);
        assert!((ahead.rotation_y_rad + FRAC_PI_2).abs() < 1e-12);
        assert!((ahead.observation_angle_rad + FRAC_PI_2).abs() < 1e-12);
        assert!((ahead.distance_m - 20.0).abs() < 1e-12);
        let center = ahead.detection.center_m - Vector3::new(20.9, 0.0, 0.78);
        assert!(center.norm() < 1e-9);
        // 45 degrees to the left of the camera: alpha is turned by the bearing.
        let left = percept(10.27, 10.0, 0.0);
        assert!((left.observation_angle_rad + FRAC_PI_2 - FRAC_PI_4).abs() < 1e-12);
        // Facing us: heading -x is camera -z, so rotation_y is pi/2.
        let facing = percept(20.0, 0.0, PI);
        assert!((facing.rotation_y_rad - FRAC_PI_2).abs() < 1e-9);
        assert!((facing.detection.yaw_rad.abs() - PI).abs() < 1e-9);
    }
}
