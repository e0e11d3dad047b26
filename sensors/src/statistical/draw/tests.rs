use std::collections::BTreeMap;

use covista_traffic::VehicleModel;
use covista_world::Calibration;

use super::*;
use crate::testing::{EGO, block, empty_road, vehicle};
use crate::{RayScene, Viewpoint};

fn model() -> ErrorModel {
    ErrorModel::parse(include_str!("tests.toml"), "tests.toml").expect("an error model")
}

fn seen(id: u32, x_m: f64, y_m: f64, visibility: f64) -> SeenVehicle {
    SeenVehicle {
        id: VehicleId(id),
        truth: Detection3d {
            center_m: Vector3::new(x_m, y_m, -0.9),
            size_m: Vector3::new(4.5, 1.8, 1.5),
            yaw_rad: 0.0,
            class: ObjectClass::Car,
            score: 1.0,
        },
        lane: LaneIndex::new(1),
        visibility,
    }
}

fn observer(seed: u64, time_s: f64) -> Observer<'static> {
    Observer {
        seed,
        ego: VehicleId(0),
        time_s,
        lidar: Se2Pose::default(),
        road: None,
    }
}

/// The draws of one vehicle in many runs.
fn runs(vehicle: SeenVehicle, count: u64) -> Vec<Option<DrawnBox>> {
    let model = model();
    let run = |seed| {
        let drawn = model.draw(&[vehicle], &observer(seed, 2.0));
        drawn.into_iter().find(|drawn| drawn.of == Some(vehicle.id))
    };
    (0..count).map(run).collect()
}

/// Four standard deviations of a share of `count`.
fn tolerance(share: f64, count: f64) -> f64 {
    4.0 * (share * (1.0 - share) / count).sqrt()
}

#[test]
fn shares_and_quantiles_of_the_draws_are_those_of_the_row() {
    let runs = runs(seen(4, 20.0, 0.0, 0.8), 8000);
    let found: Vec<DrawnBox> = runs.iter().flatten().copied().collect();
    let count = found.len() as f64;
    assert!((count / 8000.0 - 0.9).abs() < tolerance(0.9, 8000.0));
    let share = |of: &dyn Fn(&DrawnBox) -> bool| {
        found.iter().filter(|drawn| of(drawn)).count() as f64 / count
    };
    let row = &model().vehicles[1];
    for (name, share, expected) in [
        ("flipped", share(&|d| d.detection.yaw_rad.abs() > 1.6), 0.2),
        (
            "other",
            share(&|d| d.detection.class == ObjectClass::Truck),
            0.1,
        ),
        ("lane", share(&|d| d.lane == LaneIndex::new(1)), 0.7),
        ("no lane", share(&|d| d.lane.is_none()), 0.2),
        ("left", share(&|d| d.lane == LaneIndex::new(0)), 0.05),
        // The LIDAR is behind the vehicle: the error along it is that of x.
        (
            "along",
            share(&|d| d.detection.center_m.x < 20.0 + row.along_m.0[3]),
            0.25,
        ),
        (
            "tail",
            share(&|d| d.detection.center_m.x > 20.0 + row.along_m.0[6]),
            0.05,
        ),
        (
            "length",
            share(&|d| d.detection.size_m.x < 4.5 + row.length_m.0[5]),
            0.75,
        ),
        (
            "score",
            share(&|d| d.detection.score < row.score.0[2]),
            0.05,
        ),
    ] {
        assert!(
            (share - expected).abs() < tolerance(expected, count),
            "{name}: {share} instead of {expected}"
        );
    }
}

#[test]
fn a_vehicle_behind_errs_away_from_the_sensor_too() {
    let runs = runs(seen(4, -20.0, 0.0, 0.8), 2000);
    let errors = runs.iter().flatten().map(|d| d.detection.center_m.x + 20.0);
    let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), error| (sum + error, count + 1.0));
    assert!((sum / count + 0.1).abs() < 0.03, "{}", sum / count);
}

#[test]
fn what_hides_or_is_far_is_found_less() {
    let share = |vehicle| runs(vehicle, 2000).iter().flatten().count() as f64 / 2000.0;
    for (vehicle, recall) in [
        (seen(4, 20.0, 0.0, 0.3), 0.4),
        (seen(4, 55.0, 0.0, 0.9), 0.5),
        // Beyond all rows the nearest one holds.
        (seen(4, 90.0, 0.0, 0.9), 0.5),
    ] {
        assert!((share(vehicle) - recall).abs() < tolerance(recall, 2000.0));
    }
    assert!(
        runs(seen(4, 20.0, 0.0, 0.0), 100)
            .iter()
            .all(Option::is_none)
    );
}

#[test]
fn a_vehicle_that_is_missed_stays_missed_for_a_while() {
    let (model, vehicle) = (model(), seen(4, 20.0, 0.0, 0.3));
    let is_found = |seed, time_s| {
        let drawn = model.draw(&[vehicle], &observer(seed, time_s));
        drawn.iter().any(|drawn| drawn.of.is_some())
    };
    let missed: Vec<u64> = (0..8000).filter(|&seed| !is_found(seed, 1.0)).collect();
    let again = missed.iter().filter(|&&seed| !is_found(seed, 1.4)).count();
    let lasts = (-0.4_f64 / 0.8).exp();
    let expected = lasts + (1.0 - lasts) * 0.6;
    let share = again as f64 / missed.len() as f64;
    assert!((share - expected).abs() < tolerance(expected, missed.len() as f64));
}

#[test]
fn neither_order_nor_company_changes_a_draw() {
    let model = model();
    let vehicles: Vec<_> = (1..9)
        .map(|id| seen(id, 7.0 * f64::from(id) - 30.0, 3.0, 0.9))
        .collect();
    let by_id = |vehicles: &[SeenVehicle]| -> BTreeMap<_, _> {
        let drawn = model.draw(vehicles, &observer(5, 0.8));
        let of_vehicles = drawn
            .into_iter()
            .filter_map(|drawn| Some((drawn.of?, drawn)));
        of_vehicles
            .map(|(id, drawn)| (id, (drawn.detection, drawn.lane)))
            .collect()
    };
    let all = by_id(&vehicles);
    let backwards: Vec<_> = vehicles.iter().rev().copied().collect();
    assert_eq!(by_id(&backwards), all);
    for (id, drawn) in by_id(&vehicles[2..5]) {
        assert_eq!(all[&id], drawn);
    }
}

#[test]
fn vehicles_of_a_frame_err_together_in_lane_as_often_as_said() {
    let model = model();
    let pair = [seen(1, 15.0, 0.0, 0.9), seen(2, 30.0, 0.0, 0.9)];
    let mut counts = [0.0; 4];
    for seed in 0..20_000 {
        let drawn = model.draw(&pair, &observer(seed, 0.0));
        let lanes = [1, 2].map(|id| {
            let mut drawn = drawn.iter();
            drawn.find_map(|d| (d.of == Some(VehicleId(id))).then_some(d.lane))
        });
        if let [Some(a), Some(b)] = lanes {
            let right = [a, b].map(|lane| f64::from(lane == LaneIndex::new(1)));
            counts[0] += 1.0;
            counts[1] += right[0];
            counts[2] += right[1];
            counts[3] += right[0] * right[1];
        }
    }
    let [count, first, second, both] = counts;
    let covariance = both / count - first / count * (second / count);
    let correlation = covariance / (0.7 * 0.3);
    // Both take the frame's draw in two fifths of the frames.
    assert!((correlation - 0.4).abs() < 0.04, "{correlation}");
}

#[test]
fn false_boxes_are_as_many_as_said_and_stand_still() {
    let model = model();
    let of = |seed, time_s, x_m| {
        let from = Observer {
            lidar: Se2Pose::new(x_m, 40.0, 0.3),
            ..observer(seed, time_s)
        };
        let places: Vec<Vector2<f64>> = model
            .draw(&[], &from)
            .iter()
            .map(|drawn| from.lidar.transform(drawn.detection.center_m.xy()))
            .collect();
        let drawn = model.draw(&[], &from);
        let beside = drawn.iter().filter(|d| d.detection.center_m.y.abs() > 6.0);
        (places, beside.count())
    };
    let (mut all, mut beside, mut kept) = (0.0, 0.0, 0.0);
    for seed in 0..1000 {
        let (places, aside) = of(seed, 1.0, 0.0);
        let later = of(seed, 1.4, 2.0).0;
        all += places.len() as f64;
        beside += aside as f64;
        let is_kept = |place: &&Vector2<f64>| later.iter().any(|p| (p - *place).norm() < 1e-6);
        kept += places.iter().filter(is_kept).count() as f64;
    }
    // A Poisson number each; within 3.5 m of the LIDAR there are none.
    assert!(
        (beside / 1000.0 - 2.0).abs() < 4.0 * (2.0 / 1000.0_f64).sqrt(),
        "{beside}"
    );
    assert!(((all - beside) / 1000.0 - 0.49).abs() < 0.1, "{all}");
    // Some leave the range meanwhile.
    let lasts = (-0.4_f64 / 0.6).exp();
    assert!((kept / all - lasts).abs() < 0.06, "{}", kept / all);
    let taken = seen(9, 0.0, 9.0, 1.0);
    for seed in 0..200 {
        let drawn = model.draw(&[taken], &observer(seed, 0.0));
        let mut false_boxes = drawn.iter().filter(|drawn| drawn.of.is_none());
        let apart = |d: &DrawnBox| (d.detection.center_m - taken.truth.center_m).xy().norm();
        assert!(false_boxes.all(|drawn| apart(drawn) > APART_M));
    }
}

#[test]
fn nothing_is_found_behind_a_wall() {
    let model = model();
    let mut scene = empty_road();
    let pose = Se2Pose::new(25.0, 0.0, 0.0);
    scene
        .vehicles
        .push(vehicle(VehicleId(4), VehicleModel::Suv, pose));
    let count = |scene: &covista_traffic::Scene| {
        let (rays, calibration) = (RayScene::new(scene), Calibration::kitti());
        let view = Viewpoint::new(scene, &rays, EGO, &calibration).expect("the ego");
        let ahead = |drawn: &DrawnBox| drawn.detection.center_m.x > 14.0;
        let drawn = (0..100)
            .flat_map(|seed| model.perceive(&view, seed))
            .filter(ahead);
        let drawn: Vec<_> = drawn.collect();
        let vehicles = drawn.iter().filter(|drawn| drawn.of.is_some()).count();
        [vehicles, drawn.len() - vehicles]
    };
    let [vehicles, false_boxes] = count(&scene);
    assert!(
        vehicles > 80 && false_boxes > 40,
        "{vehicles} {false_boxes}"
    );
    scene.scenery = vec![block([10.0, -60.0, 0.0], [10.5, 60.0, 4.0])].into();
    assert_eq!(count(&scene), [0, 0]);
}
