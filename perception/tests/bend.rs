//! Fusion on the shape of road it is made for: marks of a bend, projected into the camera with
//! the network's kind of error, must put vehicles into their lanes.

#![allow(clippy::expect_used)]

use covista_perception::{
    fusion::LaneCourse, ground::Ground, lanes::decode::MarkPixels, lanes::ground,
};
use covista_world::{
    Calibration, FrenetPoint, LaneIndex, LaneMarks, ROW_ANCHORS, Road, RoadSegment, Se2Pose,
};
use nalgebra::Point3;

/// A straight, a clothoid, an arc of 80 m to the left, and the way out.
fn road() -> Road {
    let curvature_per_m = 1.0 / 80.0;
    let segments = [
        RoadSegment::Straight { length_m: 150.0 },
        RoadSegment::Clothoid {
            length_m: 40.0,
            from_per_m: 0.0,
            to_per_m: curvature_per_m,
        },
        RoadSegment::Arc {
            length_m: 90.0,
            curvature_per_m,
        },
        RoadSegment::Clothoid {
            length_m: 40.0,
            from_per_m: curvature_per_m,
            to_per_m: 0.0,
        },
        RoadSegment::Straight { length_m: 150.0 },
    ];
    Road::new(Se2Pose::default(), &segments, 3.5).expect("a road")
}

/// Marks as the camera of a vehicle at `ego` sees them up to `sight_m` along the road, with an
/// error of `error_px(row)`.
fn marks(
    road: &Road,
    ego: (f64, Se2Pose),
    sight_m: f64,
    error_px: impl Fn(usize) -> f64,
) -> LaneMarks {
    let calibration = Calibration::kitti();
    let camera_from_vehicle = calibration.vehicle_from_camera.inverse();
    let found: MarkPixels = std::array::from_fn(|mark| {
        let d_m = road.mark_offset_m(mark);
        let line: Vec<[f64; 2]> = (0..)
            .map(|step| ego.0 + f64::from(step) * 0.25)
            .take_while(|s_m| *s_m < ego.0 + sight_m)
            .filter_map(|s_m| {
                let local = ego
                    .1
                    .inverse_transform(road.from_frenet(FrenetPoint { s_m, d_m }));
                let camera = camera_from_vehicle * Point3::new(local.x, local.y, 0.0);
                calibration.intrinsics.project(&camera)
            })
            .collect();
        std::array::from_fn(|row| {
            let v = f64::from(ROW_ANCHORS[row].0);
            let pair = line
                .windows(2)
                .find(|pair| pair[1][1] <= v && v < pair[0][1])?;
            let part = (v - pair[0][1]) / (pair[1][1] - pair[0][1]);
            let u = pair[0][0] + part * (pair[1][0] - pair[0][0]) + error_px(row + 7 * mark);
            (0.0..1242.0).contains(&u).then_some(u as f32)
        })
    });
    ground::to_lane_marks(&found.into(), &Ground::FLAT, &calibration)
}

#[test]
fn vehicles_in_a_bend_are_put_into_their_lanes() {
    let road = road();
    let (mut right, mut wrong, mut unknown_near) = (0, 0, 0);
    for lane in LaneIndex::all() {
        for s_m in (100..330).step_by(7).map(f64::from) {
            let ego = road.pose_from_frenet(s_m, road.lane_center_m(lane), 0.02);
            let marks = marks(&road, (s_m, ego), 60.0, |row| {
                let wave = (12.9898 * (row as f64 + s_m)).sin();
                if row % 13 == 5 {
                    80.0 * wave
                } else {
                    5.0 * wave
                }
            });
            let course = LaneCourse::fit(&marks.points, &[]).expect("a course");
            for other in LaneIndex::all() {
                for ahead_m in (-8..50).step_by(4).map(f64::from) {
                    let position = road.from_frenet(FrenetPoint {
                        s_m: s_m + ahead_m,
                        d_m: road.lane_center_m(other),
                    });
                    let found = course.locate(ego.inverse_transform(position));
                    match Some(found.lane).filter(|_| found.probability > 0.5) {
                        Some(found) if found == other => right += 1,
                        Some(_) => wrong += 1,
                        None => unknown_near += u32::from((-4.0..=36.0).contains(&ahead_m)),
                    }
                }
            }
        }
    }
    assert_eq!(wrong, 0);
    assert!(right > 3700, "{right} right");
    assert!(unknown_near < 150, "{unknown_near} unknown within 36 m");
}
