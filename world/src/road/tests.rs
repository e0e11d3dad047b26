use proptest::prelude::*;

use super::*;

fn corner() -> Road {
    let segments = [
        RoadSegment::Straight { length_m: 120.0 },
        RoadSegment::Clothoid {
            length_m: 40.0,
            from_per_m: 0.0,
            to_per_m: 1.0 / 60.0,
        },
        RoadSegment::Arc {
            length_m: 70.0,
            curvature_per_m: 1.0 / 60.0,
        },
        RoadSegment::Clothoid {
            length_m: 40.0,
            from_per_m: 1.0 / 60.0,
            to_per_m: 0.0,
        },
        RoadSegment::Straight { length_m: 100.0 },
    ];
    Road::new(Se2Pose::new(5.0, -3.0, 0.3), &segments, 3.5).expect("a road")
}

#[test]
fn an_arc_is_a_circle() {
    let arc = RoadSegment::Arc {
        length_m: 100.0,
        curvature_per_m: 0.01,
    };
    let road = Road::new(Se2Pose::default(), &[arc], 3.5).expect("a road");
    let (pose, curvature) = road.reference(99.0);
    assert!((pose.x_m - 100.0 * (0.99_f64).sin()).abs() < 1e-10);
    assert!((pose.y_m - 100.0 * (1.0 - (0.99_f64).cos())).abs() < 1e-10);
    assert!((pose.yaw_rad - 0.99).abs() < 1e-12);
    assert!((curvature - 0.01).abs() < 1e-15);
}

#[test]
fn a_clothoid_turns_by_half_its_length_times_its_curvature() {
    let road = corner();
    assert!((road.reference(160.0).0.yaw_rad - 0.3 - 0.5 * 40.0 / 60.0).abs() < 1e-10);
    assert!((road.max_abs_curvature(0.0, 140.0) - 0.5 / 60.0).abs() < 1e-12);
    assert!((road.max_abs_curvature(0.0, 400.0) - 1.0 / 60.0).abs() < 1e-12);
}

#[test]
fn a_full_turn_is_not_wrapped() {
    let arc = RoadSegment::Arc {
        length_m: 1000.0,
        curvature_per_m: -0.01,
    };
    let road = Road::new(Se2Pose::default(), &[arc], 3.5).expect("a road");
    assert!((road.turn_rad(10.0, 810.0) + 8.0).abs() < 1e-9);
    assert!((road.turn_rad(810.0, 10.0) - 8.0).abs() < 1e-9);
    assert!((road.turn_rad(-50.0, 1200.0) + 10.0).abs() < 1e-9);
    assert!(road.max_abs_curvature(1010.0, 1020.0).abs() < 1e-15);
}

proptest! {
    #[test]
    fn the_sharpest_of_a_stretch_is_that_of_its_points(from in -20.0..380.0_f64, length in 0.0..200.0_f64) {
        let road = corner();
        let sampled = (0..=2000)
            .map(|i| road.reference(from + length * f64::from(i) / 2000.0).1.abs())
            .fold(0.0, f64::max);
        let exact = road.max_abs_curvature(from, from + length);
        prop_assert!(exact >= sampled - 1e-12 && exact <= sampled + 1e-4, "{exact} {sampled}");
    }
}

#[test]
fn lanes_are_counted_from_the_left() {
    let road = corner();
    assert_eq!(road.lane_at(3.5), Some(LaneIndex::LEFTMOST));
    assert_eq!(road.lane_at(-3.5), Some(LaneIndex::RIGHTMOST));
    assert_eq!(road.lane_at(0.0), LaneIndex::new(1));
    assert_eq!(road.lane_at(5.3), None);
    assert_eq!(road.lane_at(-5.3), None);
    assert!((road.mark_offset_m(0) - 5.25).abs() < 1e-12);
    assert!((road.lane_center_m(LaneIndex::LEFTMOST) - 3.5).abs() < 1e-12);
}

#[test]
fn unusable_roads_are_refused() {
    let tight = RoadSegment::Arc {
        length_m: 10.0,
        curvature_per_m: 0.2,
    };
    let nan = RoadSegment::Straight { length_m: f64::NAN };
    let start = Se2Pose::default();
    assert_eq!(Road::new(start, &[], 3.5), Err(RoadError::Empty));
    assert_eq!(Road::new(start, &[nan], 3.5), Err(RoadError::BadSegment(0)));
    assert!(matches!(
        Road::new(start, &[tight], 3.5),
        Err(RoadError::TooTight { index: 0, .. })
    ));
}

proptest! {
    #[test]
    fn frenet_there_and_back(s_m in -30.0..420.0_f64, d_m in -12.0..12.0_f64) {
        let road = corner();
        let point = road.from_frenet(FrenetPoint { s_m, d_m });
        let back = road.to_frenet(point);
        prop_assert!((back.s_m - s_m).abs() < 1e-7, "{back:?}");
        prop_assert!((back.d_m - d_m).abs() < 1e-7, "{back:?}");
    }
}
