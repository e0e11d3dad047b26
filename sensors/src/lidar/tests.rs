use covista_traffic::{Body, Material, Scene, VehicleId, VehicleModel};
use covista_world::{Calibration, Se2Pose};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::RayScene;
use crate::testing::{EGO, block, empty_road, vehicle};

const OTHER: VehicleId = VehicleId(4);

fn swept(lidar: &Lidar, scene: &Scene, seed: u64) -> LabelledCloud {
    let rays = RayScene::rolling(scene, lidar.half_turn_s());
    let calibration = Calibration::kitti();
    let view = Viewpoint::new(scene, &rays, EGO, &calibration).expect("the ego");
    lidar.sweep_labelled(&view, seed)
}

fn hdl64e() -> Lidar {
    Lidar::builtin("hdl-64e").expect("a table")
}

/// The LIDAR stands at x = 0.9 m, the wall's face 20 m ahead of it.
fn before_a_wall() -> Scene {
    let mut scene = empty_road();
    scene.scenery = vec![block([20.9, -30.0, 0.0], [21.9, 30.0, 4.0])].into();
    scene
}

/// Points on the first body of the scenery.
fn on_body(swept: &LabelledCloud) -> Vec<[f32; 4]> {
    let wanted = PointLabel::Object(ObjectRef::Scenery(0));
    let labelled = swept.cloud.points.iter().zip(&swept.objects);
    labelled
        .filter_map(|(point, label)| (*label == wanted).then_some(*point))
        .collect()
}

fn with_material(mut body: Body, material: Material) -> Body {
    for part in &mut body.parts {
        part.material = material;
    }
    body
}

#[test]
fn the_built_in_devices_have_their_beams() {
    let range_deg = |name: &str| {
        let lidar = Lidar::builtin(name).expect("a table");
        assert!(lidar.half_turn_s().abs() < f64::EPSILON);
        let beams = &lidar.beams;
        assert!(
            beams
                .windows(2)
                .all(|pair| pair[1].elevation_rad < pair[0].elevation_rad)
        );
        let sides = beams.iter().map(|beam| beam.azimuth_rad.to_degrees());
        let widest = sides.fold(0.0, |widest: f64, side| widest.max(side.abs()));
        let [first, last] =
            [&beams[0], &beams[beams.len() - 1]].map(|beam| beam.elevation_rad.to_degrees());
        [beams.len() as f64, first, last, widest]
    };
    let close = |name: &str, expected: [f64; 4]| {
        for (found, expected) in range_deg(name).iter().zip(expected) {
            assert!(
                (found - expected).abs() < 1e-9,
                "{name}: {found} {expected}"
            );
        }
    };
    close("hdl-64e", [64.0, 1.94, -24.84, 0.0]);
    close("vlp-32c", [32.0, 15.0, -25.0, 4.2]);
    close("os1-64", [64.0, 22.5, -22.5, 4.23]);
    assert_eq!(Lidar::hdl64e(), hdl64e());
}

#[test]
fn a_wall_is_measured_at_its_distance_with_two_centimetres_of_noise() {
    let found = on_body(&swept(&hdl64e(), &before_a_wall(), 1));
    let errors: Vec<f64> = found
        .iter()
        .filter(|[_, y, z, _]| y.abs() < 5.0 && *z > -1.2)
        .map(|&[x, y, z, _]| {
            // From the bank's own height to the face along the pulse.
            let height = Vector3::z() * 0.203;
            let range = (Vector3::new(x, y, z).cast::<f64>() - height).norm();
            range - 20.0 * range / f64::from(x)
        })
        .collect();
    let count = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / count;
    let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
    // 28 degrees at 0.167 degrees, some 17 beams between +1.9 and -4.0 degrees.
    assert!((2500.0..3100.0).contains(&count), "{count}");
    assert!(mean.abs() < 2e-3, "{mean}");
    assert!((deviation - 0.02).abs() < 2e-3, "{deviation}");
}

#[test]
fn paint_shines_and_the_ground_lies_at_the_mounting_height() {
    let lidar = Lidar {
        reflectance_std: 0.0,
        ..hdl64e()
    };
    let cloud = swept(&lidar, &empty_road(), 2).cloud;
    let near = || {
        let points = cloud.points.iter();
        points.filter(|[x, y, _, _]| x.abs() < 12.0 && y.abs() < 8.0)
    };
    assert!(near().all(|[_, _, z, _]| (z + 1.73).abs() < 0.06));
    let mean = |low: f32, high: f32| {
        let picked: Vec<f32> = near()
            .filter(|[_, y, _, _]| (low..high).contains(y))
            .map(|point| point[3])
            .collect();
        assert!(picked.len() > 100);
        picked.iter().sum::<f32>() / picked.len() as f32
    };
    // The left edge line is at 5.25 m, the middle lane is bare asphalt.
    assert!(mean(5.20, 5.30) > 0.6, "{}", mean(5.20, 5.30));
    let asphalt = mean(-1.5, 1.5);
    assert!((0.2..0.35).contains(&asphalt), "{asphalt}");
}

#[test]
fn the_number_of_threads_changes_nothing_but_the_seed_and_the_specimen_do() {
    let (scene, lidar) = (before_a_wall(), hdl64e());
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a pool").install(|| swept(&lidar, &scene, 3))
    };
    let one = with_threads(1);
    assert!(one.cloud.points.len() > 50_000);
    assert_eq!(one.cloud.points.len(), one.objects.len());
    assert_eq!(one, with_threads(3));
    assert_ne!(one, swept(&lidar, &scene, 4));
    let specimen = Lidar {
        specimen: 1,
        ..lidar
    };
    assert_ne!(one, swept(&specimen, &scene, 3));
}

/// A LIDAR without noise, and a scene in which the ego drives at 30 m/s.
fn rolling(motion: Motion, mut scene: Scene) -> (Lidar, Scene) {
    scene.vehicles[0].state.speed_mps = 30.0;
    let lidar = Lidar {
        motion,
        range_std_m: 0.0,
        range_bias_std_m: 0.0,
        ..hdl64e()
    };
    (lidar, scene)
}

#[test]
fn a_wall_passed_at_speed_is_seen_displaced() {
    let (lidar, scene) = rolling(Motion::Rolling, before_a_wall());
    let points = on_body(&swept(&lidar, &scene, 1));
    assert!(points.len() > 5000);
    for [x, y, ..] in points {
        // Counter-clockwise: left of the axis is measured after the scene's time.
        let dt_s = f64::from(y.atan2(x)) / std::f64::consts::TAU / lidar.rotation_hz;
        assert!(
            (f64::from(x) - (20.0 - 30.0 * dt_s)).abs() < 1e-3,
            "{x} {y}"
        );
    }
    let (lidar, scene) = rolling(Motion::Undone, before_a_wall());
    let points = on_body(&swept(&lidar, &scene, 1));
    assert!(points.iter().all(|[x, ..]| (x - 20.0).abs() < 1e-3));
}

#[test]
fn a_vehicle_that_moves_alike_stays_put_and_an_oncoming_one_is_sheared() {
    let rear = |speed_mps: f64| {
        let (lidar, mut scene) = rolling(Motion::Rolling, empty_road());
        let mut truck = vehicle(OTHER, VehicleModel::Truck, Se2Pose::new(20.0, 0.5, 0.0));
        truck.state.speed_mps = speed_mps;
        scene.vehicles.push(truck);
        let swept = swept(&lidar, &scene, 1);
        let on_truck = PointLabel::Object(ObjectRef::Vehicle(OTHER));
        let labelled = swept.cloud.points.iter().zip(&swept.objects);
        let near = labelled.filter(|(point, label)| {
            **label == on_truck && point[2] > -0.3 && point[2] < 0.5 && point[0] < 18.0
        });
        near.map(|(&[x, y, ..], _)| (x, y)).collect::<Vec<_>>()
    };
    // The cargo box ends 1.96 m behind the rear axle.
    let standing = 20.0 - 1.96 - 0.9;
    let alike = rear(30.0);
    assert!(alike.len() > 200);
    assert!(alike.iter().all(|(x, _)| (x - standing).abs() < 2e-3));
    for (x, y) in rear(-10.0) {
        let dt_s = y.atan2(x) / std::f32::consts::TAU / 9.66;
        assert!((x - (standing - 40.0 * dt_s)).abs() < 2e-3, "{x} {y}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn labels_agree_with_the_boxes_and_reflectances_are_shares(
        x_m in 8.0..30.0_f64,
        y_m in 3.5..9.0_f64,
        yaw_rad in -3.0..3.0_f64,
        seed in 0..1000_u64,
    ) {
        let mut scene = before_a_wall();
        scene.vehicles.push(vehicle(OTHER, VehicleModel::Suv, Se2Pose::new(x_m, -y_m, yaw_rad)));
        let lidar = hdl64e();
        let swept = swept(&lidar, &scene, seed);
        let pose = scene.placed(&scene.vehicles[1]);
        let calibration = Calibration::kitti();
        let size = scene.vehicles[1].dimensions();
        for (&[x, y, z, reflectance], label) in swept.cloud.points.iter().zip(&swept.objects) {
            prop_assert!((0.0..=1.0).contains(&reflectance));
            let steps = reflectance / 0.01;
            prop_assert!((steps - steps.round()).abs() < 1e-3);
            let point = calibration.vehicle_from_lidar
                * nalgebra::Point3::new(x, y, z).cast::<f64>();
            match label {
                PointLabel::Ground => prop_assert!(point.z.abs() < 0.1, "{point}"),
                PointLabel::Object(ObjectRef::Scenery(_)) => {
                    prop_assert!((20.8..22.0).contains(&point.x), "{point}");
                }
                PointLabel::Object(ObjectRef::Vehicle(id)) => {
                    prop_assert_eq!(*id, OTHER);
                    let local = pose.inverse_transform_point(&point);
                    // A pulse through a window may come back from deep in the cabin.
                    prop_assert!(
                        (local.x - size.center_ahead_of_axle_m()).abs() < size.length_m / 2.0 + 0.1,
                        "{local}"
                    );
                    prop_assert!(local.y.abs() < size.width_m / 2.0 + 0.1, "{local}");
                }
            }
        }
    }
}

/// Points on a wall of this material, its face 20 m or so ahead.
fn seen(material: Material, ahead_m: f64) -> Vec<[f32; 4]> {
    let mut scene = empty_road();
    let near = ahead_m + 0.9;
    let wall = block([near, -3.0, 0.0], [near + 1.0, 3.0, 3.0]);
    scene.scenery = vec![with_material(wall, material)].into();
    on_body(&swept(&hdl64e(), &scene, 5))
}

#[test]
fn materials_come_back_as_they_do() {
    let white = seen(Material::CarPaint([240; 3]), 20.0);
    let black = seen(Material::CarPaint([10; 3]), 20.0);
    let zeros = |points: &[[f32; 4]]| {
        let dim = points.iter().filter(|point| point[3] < 5e-3);
        dim.count() as f64 / points.len() as f64
    };
    assert!(zeros(&white) < 0.1, "{}", zeros(&white));
    assert!(zeros(&black) > 0.4, "{}", zeros(&black));
    // Black paint is lost beyond 30 to 50 m, white is not.
    assert!(seen(Material::CarPaint([10; 3]), 60.0).len() < 20);
    assert!(seen(Material::CarPaint([240; 3]), 60.0).len() > 150);
    let plate = seen(Material::Reflector([255; 3]), 60.0);
    assert!(plate.iter().all(|point| point[3] > 0.9));
    let glass = seen(Material::Glass, 20.0).len() as f64;
    let share = glass / white.len() as f64;
    assert!((0.1..0.6).contains(&share), "{share}");
    let leaves = seen(Material::Foliage, 20.0);
    let depth = leaves
        .iter()
        .fold(0.0, |depth: f32, point| depth.max(point[0]));
    assert!((20.8..21.7).contains(&depth), "{depth}");
    let passed = 1.0 - leaves.len() as f64 / white.len() as f64;
    assert!((0.15..0.35).contains(&passed), "{passed}");
}

#[test]
fn a_wet_road_loses_its_grazing_returns() {
    let farthest = |wetness: f64| {
        let mut scene = empty_road();
        scene.look.wetness = wetness;
        let swept = swept(&hdl64e(), &scene, 1);
        let points = swept.cloud.points.iter();
        let lane = points.filter(|[_, y, ..]| y.abs() < 1.5);
        lane.fold(0.0, |far: f32, point| far.max(point[0]))
    };
    assert!((50.0..90.0).contains(&farthest(0.0)), "{}", farthest(0.0));
    assert!((10.0..35.0).contains(&farthest(1.0)), "{}", farthest(1.0));
}
