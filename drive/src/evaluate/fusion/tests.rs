use covista_world::ObjectClass;
use nalgebra::Vector3;

use super::*;

fn body(x: f64, y: f64, yaw_rad: f64, score: f64) -> Detection3d {
    Detection3d {
        center_m: Vector3::new(x, y, -0.9),
        size_m: Vector3::new(4.0, 2.0, 1.6),
        yaw_rad,
        class: ObjectClass::Car,
        score,
    }
}

fn vehicle(x: f64, y: f64, lane: u8, lidar_points: usize) -> TrueVehicle {
    TrueVehicle {
        body: body(x, y, 0.0, 1.0),
        lane: LaneIndex::new(lane),
        lidar_points,
        angles: None,
    }
}

#[test]
fn the_surest_box_takes_the_vehicle_that_it_overlaps_most() {
    let vehicles = [vehicle(10.0, 0.0, 1, 50), vehicle(13.0, 0.0, 1, 50)];
    let boxes = [
        body(11.0, 0.0, 0.0, 0.5),
        body(10.2, 0.0, 0.0, 0.9),
        body(40.0, 0.0, 0.0, 0.9),
    ];
    let found = owners(&boxes, &vehicles.iter().collect::<Vec<_>>());
    // The first overlaps the second vehicle by 2 m of 6: enough, as the first vehicle is taken.
    assert_eq!(found, [Some(1), Some(0), None]);
}

/// A frame of a straight road seen from the middle lane, of which the lane network sees nothing.
fn frame() -> Frame {
    let calibration = Calibration::kitti();
    let camera = calibration.intrinsics;
    let true_marks: MarkPixels = std::array::from_fn(|mark| {
        covista_world::ROW_ANCHORS.map(|row| {
            let below_px = f64::from(row.0) - camera.cy_px;
            let d_m = 5.25 - 3.5 * mark as f64;
            let u_px = camera.cx_px - d_m * below_px / 1.65;
            (below_px > 10.0 && (0.0..1242.0).contains(&u_px)).then_some(u_px as f32)
        })
    });
    Frame {
        calibration,
        points: PointCloud::default(),
        found_marks: [[None; covista_world::ROW_ANCHORS.len()]; 4].into(),
        true_marks,
        found_boxes: vec![body(20.1, 0.1, 0.0, 0.9), body(25.0, -3.5, 0.0, 0.4)],
        truth: SceneTruth {
            seed: 7,
            split: "test".to_owned(),
            vehicles: vec![
                vehicle(20.0, 0.0, 1, 50),
                vehicle(-15.0, 3.5, 0, 5),
                vehicle(30.0, -7.0, 3, 9),
                vehicle(35.0, 0.0, 1, 4),
            ],
        },
    }
}

fn near(evaluation: &FusionEvaluation, marks: Origin, boxes: Origin) -> LaneIndexFigures {
    let rows = &evaluation.lane_indices;
    let row = rows.iter().find(|row| {
        (row.marks, row.boxes) == (marks, boxes) && (row.road, row.view) == ("marked", "all")
    });
    row.expect("a row").clone()
}

#[test]
fn every_visible_vehicle_is_counted_once() {
    let (mut verdicts, mut deviations) = (Vec::new(), Vec::new());
    frame().judge(&mut verdicts, &mut deviations);
    let figures = FusionEvaluation::new(Some((7, "test".to_owned())), &verdicts, &deviations);
    let is = |share: Option<f64>, expected: f64| {
        assert!(
            (share.expect("a share") - expected).abs() < 1e-9,
            "{share:?}"
        );
    };
    // With exact inputs both are right; the vehicle with four returns is not asked for, and the one
    // beyond the edge line gets no lane.
    let exact = near(&figures, Origin::Exact, Origin::Exact);
    assert_eq!(
        (exact.vehicles, exact.elsewhere, exact.false_boxes),
        (2, 1, 0)
    );
    is(exact.lane_index_accuracy, 100.0);
    is(exact.elsewhere_given_lane, 0.0);
    // The detector finds one of two, and one box too many, in the right lane.
    let boxes = near(&figures, Origin::Exact, Origin::Network);
    assert_eq!(
        (boxes.vehicles, boxes.elsewhere, boxes.false_boxes),
        (2, 0, 1)
    );
    is(boxes.lane_index_accuracy, 50.0);
    is(boxes.undetected, 50.0);
    is(boxes.lane_index_accuracy_detected, 100.0);
    is(boxes.false_boxes_given_lane, 100.0);
    // Without marks nothing is decided.
    let marks = near(&figures, Origin::Network, Origin::Exact);
    is(marks.undecided, 100.0);
    is(marks.wrong, 0.0);

    let by = |view: &str, range_m: [f64; 2]| {
        let mut rows = figures.lane_indices.iter();
        let row = rows.find(|row| {
            (row.marks, row.boxes, row.road) == (Origin::Exact, Origin::Exact, "straight")
                && row.view == view
                && (row.from_m - range_m[0]).abs() + (row.to_m - range_m[1]).abs() < 1e-9
        });
        row.map(|row| row.vehicles)
    };
    assert_eq!(by("camera", [20.0, 30.0]), Some(1));
    assert_eq!(by("outside", [10.0, 20.0]), Some(1));
    assert_eq!(by("all", [40.0, 50.0]), None);
    assert_eq!(figures.geometry[0].vehicles, 0);
}

#[test]
fn the_road_is_bent_where_a_vehicle_points_away() {
    let mut frame = frame();
    let road = |frame: &Frame, yaw_deg: f64| {
        frame
            .place(&body(20.0, 0.0, f64::to_radians(yaw_deg), 1.0))
            .road
    };
    for (yaw_deg, expected) in [
        (2.0, Road::Straight),
        (-179.0, Road::Straight),
        (4.0, Road::Bent),
        (-175.0, Road::Bent),
    ] {
        assert_eq!(road(&frame, yaw_deg), expected, "{yaw_deg}");
    }
    frame.true_marks[2] = [None; covista_world::ROW_ANCHORS.len()];
    assert_eq!(road(&frame, 4.0), Road::Unmarked);
}

#[test]
fn a_vehicle_seen_from_the_wrong_end_is_reversed_and_no_angle_error() {
    let deviation = |true_distance_m, rotation_deg: f64| Deviation {
        true_distance_m,
        distance_m: -0.2,
        observation_angle_rad: rotation_deg.to_radians(),
        rotation_y_rad: rotation_deg.to_radians(),
    };
    let seen = [
        deviation(5.0, 2.0),
        deviation(45.0, -178.0),
        deviation(8.0, -4.0),
        deviation(9.0, 3.0),
    ];
    let figures = FusionEvaluation::new(None, &[], &seen);
    let near = &figures.geometry[0];
    assert_eq!(near.vehicles, 4);
    let is = |value: Option<f64>, expected: f64| {
        assert!(
            (value.expect("a value") - expected).abs() < 1e-9,
            "{value:?}"
        );
    };
    is(near.reversed, 25.0);
    is(near.median_rotation_y_deg, 3.0);
    is(near.p95_observation_angle_deg, 4.0);
    is(near.median_distance_m, 0.2);
    is(figures.geometry[5].reversed, 100.0);
    assert_eq!(figures.geometry[5].median_rotation_y_deg, None);
}
