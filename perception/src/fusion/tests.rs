use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use covista_world::{LaneIndex, MARK_COUNT, MarkPoint, ObjectClass, ROW_ANCHORS};
use nalgebra::Vector2;
use proptest::prelude::*;

use super::*;

const RADIUS_M: f64 = 80.0;

type MarkPoints = [Vec<MarkPoint>; MARK_COUNT];

/// A point as a network that is sure of itself sees it.
fn mark_point(position_m: Vector2<f64>) -> MarkPoint {
    MarkPoint {
        position_m,
        std_m: f64::hypot(0.05, position_m.x.abs().max(1.0) / 290.0),
    }
}

/// A point of a left-hand bend, `d_m` to the left of the middle lane's centre, where the own
/// vehicle is.
fn bend(along_m: f64, d_m: f64) -> Vector2<f64> {
    let (sin, cos) = (along_m / RADIUS_M).sin_cos();
    let radius = RADIUS_M - d_m;
    Vector2::new(radius * sin, RADIUS_M - radius * cos)
}

fn straight(along_m: f64, d_m: f64) -> Vector2<f64> {
    Vector2::new(along_m, d_m)
}

/// The marks from 7 m to 40 m ahead; `known` tells which.
fn marks(road: impl Fn(f64, f64) -> Vector2<f64>, known: [bool; MARK_COUNT]) -> MarkPoints {
    std::array::from_fn(|mark| {
        let points =
            (0..12).map(|step| road(7.0 + 3.0 * f64::from(step), 5.25 - 3.5 * mark as f64));
        points.filter(|_| known[mark]).map(mark_point).collect()
    })
}

fn vehicle(at: Vector2<f64>, yaw_rad: f64) -> Detection3d {
    Detection3d {
        center_m: Vector3::new(at.x, at.y, 0.8),
        size_m: Vector3::new(4.6, 1.85, 1.55),
        yaw_rad,
        class: ObjectClass::Car,
        score: 0.9,
    }
}

fn course(points: &MarkPoints, boxes: &[Detection3d]) -> LaneCourse {
    LaneCourse::fit(points, boxes).expect("a course")
}

#[test]
fn a_known_bend_is_found() {
    let course = course(&marks(bend, [true; MARK_COUNT]), &[]);
    assert!((course.lane_width_m() - 3.5).abs() < 0.02);
    for (along, lane) in [(-5.0, 1), (10.0, 0), (20.0, 2), (38.0, 1)] {
        let d_m = 3.5 * (1.0 - f64::from(lane));
        let found = course.locate(bend(along, d_m + 0.8));
        assert_eq!(Some(found.lane), LaneIndex::new(lane));
        assert!(found.probability > 0.95, "{along}: {found:?}");
        assert!((found.d_m - d_m - 0.8).abs() < 0.15, "{along}: {found:?}");
    }
    // Beyond the edge lines there is no lane.
    assert!(course.locate(bend(20.0, 7.0)).probability < 0.05);
    // Straight ahead the road's right lane is where the own one would be were it straight.
    assert!(course.locate(Vector2::new(30.0, 0.0)).probability < 0.5);
}

#[test]
fn a_lost_mark_does_not_lose_its_lanes() {
    for lost in 0..MARK_COUNT {
        let mut known = [true; MARK_COUNT];
        known[lost] = false;
        let course = course(&marks(bend, known), &[]);
        for lane in LaneIndex::all() {
            let d_m = 3.5 * (1.0 - f64::from(lane.get()));
            let found = course.locate(bend(25.0, d_m));
            assert_eq!(found.lane, lane);
            assert!(found.probability > 0.95, "{lost} {lane:?}: {found:?}");
        }
    }
}

#[test]
fn an_outlying_mark_is_outvoted() {
    let mut points = marks(straight, [true; MARK_COUNT]);
    for point in &mut points[3] {
        point.position_m.y += 3.0;
    }
    let found = course(&points, &[]).locate(Vector2::new(30.0, -3.5));
    assert_eq!(found.lane, LaneIndex::RIGHTMOST);
    assert!((found.d_m + 3.5).abs() < 0.3, "{found:?}");
}

#[test]
fn uncertainty_grows_away_from_what_is_seen() {
    let course = course(&marks(straight, [true; MARK_COUNT]), &[]);
    let std_m = |x: f64| course.locate(Vector2::new(x, 0.0)).d_std_m;
    assert!(std_m(20.0) < 0.1, "{}", std_m(20.0));
    for (nearer, farther) in [(30.0, 50.0), (50.0, 65.0), (0.0, -15.0), (-15.0, -40.0)] {
        assert!(std_m(nearer) < std_m(farther));
    }
    assert!(std_m(-50.0) > 2.0);
    assert!(course.locate(Vector2::new(-50.0, 0.0)).probability < 0.6);
}

#[test]
fn vehicles_behind_show_how_the_road_bends_there() {
    let points = marks(bend, [true; MARK_COUNT]);
    let behind = [-12.0, -22.0, -33.0, -44.0].map(|along| {
        let oncoming = if along < -30.0 { PI } else { 0.0 };
        vehicle(bend(along, 3.5), wrap_angle(along / RADIUS_M + oncoming))
    });
    // One stands across the road and says nothing.
    let across = vehicle(bend(-20.0, -12.0), 1.2);
    let with: Vec<_> = behind.iter().copied().chain([across]).collect();
    let [alone, shown] = [course(&points, &[]), course(&points, &with)];
    let place = bend(-44.0, 3.5);
    assert!(alone.locate(place).d_std_m > 3.0 * shown.locate(place).d_std_m);
    assert!((shown.locate(place).d_m - 3.5).abs() < 1.0);
    assert_eq!(shown.locate(place).lane, LaneIndex::LEFTMOST);
}

#[test]
fn too_few_marks_are_no_course() {
    assert_eq!(LaneCourse::fit(&MarkPoints::default(), &[]), None);
    let mut points = MarkPoints::default();
    points[1].extend([7.0, 8.0, 9.0].map(|x| mark_point(Vector2::new(x, 1.75))));
    let car = vehicle(Vector2::new(20.0, 0.0), 0.0);
    assert_eq!(LaneCourse::fit(&points, &[car]), None);
}

fn lane_marks(points: MarkPoints) -> LaneMarks {
    LaneMarks {
        pixels: [[None; ROW_ANCHORS.len()]; MARK_COUNT],
        points,
        curves: [None; MARK_COUNT],
    }
}

#[test]
fn without_marks_a_percept_has_no_lane() {
    let car = vehicle(Vector2::new(20.0, 0.0), 0.0);
    let fused = fuse(
        &lane_marks(MarkPoints::default()),
        &[car],
        &Calibration::kitti(),
    );
    assert_eq!(fused.course, None);
    assert_eq!(fused.percepts[0].lane, None);
    assert!(fused.percepts[0].lane_probability.abs() < 1e-12);
}

#[test]
fn a_percept_carries_kittis_angles() {
    let calibration = Calibration::kitti();
    let percept = |x: f64, y: f64, yaw_rad: f64| {
        let detection = Detection3d {
            center_m: Vector3::new(x, y, -0.95),
            ..vehicle(Vector2::zeros(), yaw_rad)
        };
        let marks = lane_marks(marks(straight, [true; MARK_COUNT]));
        fuse(&marks, &[detection], &calibration).percepts[0]
    };
    // Straight ahead and driving away: rotation_y and alpha are -pi/2.
    let ahead = percept(20.0, 0.0, 0.0);
    assert_eq!(ahead.lane, LaneIndex::new(1));
    assert!(ahead.lane_probability > 0.99);
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

proptest! {
    #[test]
    fn a_mirrored_road_has_mirrored_lanes(
        radius in 60.0..400.0_f64,
        along in -30.0..50.0_f64,
        across in -5.0..5.0_f64,
    ) {
        let road = |along: f64, d: f64| {
            let (sin, cos) = (along / radius).sin_cos();
            Vector2::new((radius - d) * sin, radius - (radius - d) * cos)
        };
        let mirror = |point: Vector2<f64>| Vector2::new(point.x, -point.y);
        let points = marks(road, [true; MARK_COUNT]);
        let mut mirrored = points.clone().map(|line| {
            let mirrored = line.iter().map(|point| mark_point(mirror(point.position_m)));
            mirrored.collect::<Vec<_>>()
        });
        mirrored.reverse();
        let place = road(along, across);
        let [here, there] = [
            course(&points, &[]).locate(place),
            course(&mirrored, &[]).locate(mirror(place)),
        ];
        prop_assert!((here.d_m + there.d_m).abs() < 1e-6);
        prop_assert!((here.d_std_m - there.d_std_m).abs() < 1e-6);
        prop_assert!((here.probability - there.probability).abs() < 1e-6);
        prop_assert!((0.0..=1.0 + 1e-9).contains(&here.probability));
    }

    #[test]
    fn no_boxes_and_points_make_it_panic(
        numbers in proptest::collection::vec(-1e6..1e6_f64, 0..40),
        yaw in -1e3..1e3_f64,
    ) {
        let mut points = MarkPoints::default();
        for (index, pair) in numbers.chunks_exact(2).enumerate() {
            points[index % MARK_COUNT].push(mark_point(Vector2::new(pair[0], pair[1])));
        }
        let boxes: Vec<_> = points[0].iter().map(|at| vehicle(at.position_m, yaw)).collect();
        if let Some(course) = LaneCourse::fit(&points, &boxes) {
            let found = course.locate(Vector2::new(3.0, 1.0));
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&found.probability));
        }
    }
}
