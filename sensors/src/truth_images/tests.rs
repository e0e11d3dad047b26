use std::sync::Arc;

use covista_traffic::{Terrain, VehicleId, VehicleModel, sample_scene};
use covista_world::{Calibration, Se2Pose};
use nalgebra::{Point3, Vector2};

use super::*;
use crate::kitti::KittiLabel;
use crate::testing::{EGO, empty_road, vehicle};
use crate::{LabelledCloud, RayScene, truth_boxes};

const OTHER: VehicleId = VehicleId(9);

/// KITTI's camera, turned and lifted.
fn tilted() -> Calibration {
    let text = include_str!("../../../assets/calibration/kitti.toml");
    let turned = "yaw_deg = 4.0\npitch_deg = -6.0\nroll_deg = 5.0\n[lidar]";
    Calibration::parse(&text.replace("[lidar]", turned), "tilted").expect("a calibration")
}

fn slope(rise: f64, bank: f64) -> Arc<Terrain> {
    let height_m = |p: Vector2<f64>| rise * p.x + bank * p.y;
    Arc::new(Terrain::sampled(Vector2::zeros(), 400.0, 5.0, height_m))
}

fn hills() -> Arc<Terrain> {
    let height_m = |p: Vector2<f64>| 1.2 * (p.x / 14.0).sin() + 0.5 * (p.y / 6.0).cos();
    Arc::new(Terrain::sampled(Vector2::zeros(), 300.0, 1.0, height_m))
}

fn images<T>(
    scene: &Scene,
    calibration: &Calibration,
    check: impl FnOnce(&Viewpoint, &TruthImages) -> T,
) -> T {
    let rays = RayScene::new(scene);
    let view = Viewpoint::new(scene, &rays, EGO, calibration).expect("the ego");
    check(&view, &take_truth_images(&view))
}

/// Least and greatest u and v.
fn bounds(pixels: impl Iterator<Item = [f64; 2]>) -> [f64; 4] {
    let start = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    pixels.fold(start, |[left, top, right, bottom], [u, v]| {
        [left.min(u), top.min(v), right.max(u), bottom.max(v)]
    })
}

fn overlap_over_union(a: [f64; 4], b: [f64; 4]) -> f64 {
    let area = |r: [f64; 4]| (r[2] - r[0]).max(0.0) * (r[3] - r[1]).max(0.0);
    let both = [
        a[0].max(b[0]),
        a[1].max(b[1]),
        a[2].min(b[2]),
        a[3].min(b[3]),
    ];
    area(both) / (area(a) + area(b) - area(both))
}

#[test]
fn a_vehicle_fills_the_box_of_its_label_on_any_ground_and_camera() {
    let cameras = [Calibration::kitti(), tilted()];
    for (terrain, camera) in [(Arc::default(), 0), (hills(), 0), (slope(-0.05, 0.05), 1)] {
        for (index, model) in VehicleModel::ALL.into_iter().enumerate() {
            let mut scene = empty_road();
            scene.terrain = Arc::clone(&terrain);
            let pose = Se2Pose::new(14.0, -2.0, 0.3 + 0.5 * index as f64);
            scene.vehicles.push(vehicle(OTHER, model, pose));
            images(&scene, &cameras[camera], |view, images| {
                let [truth] = &truth_boxes(view, &LabelledCloud::default())[..] else {
                    panic!("one box")
                };
                let label = KittiLabel::new(truth, view.calibration);
                let number = instance_number(&scene, ObjectRef::Vehicle(OTHER));
                assert_eq!(number, 2);
                let covered = (0..images.instance.len()).filter(|&i| images.instance[i] == number);
                let width = images.width_px as usize;
                let mask = bounds(covered.map(|i| [(i % width) as f64, (i / width) as f64]));
                let share = overlap_over_union(label.bbox_px, mask);
                assert!(share > 0.95, "{model:?} {share} {label} {mask:?}");
            });
        }
    }
}

#[test]
fn depth_is_that_of_the_ground_the_pixel_sees() {
    for (terrain, calibration) in [
        (Arc::default(), Calibration::kitti()),
        (slope(0.06, -0.04), tilted()),
        (hills(), Calibration::kitti()),
        (hills(), tilted()),
    ] {
        let mut scene = empty_road();
        scene.terrain = terrain;
        images(&scene, &calibration, |view, images| {
            let (mut seen, mut sky) = (0, 0);
            let camera = &calibration.intrinsics;
            for index in (0..images.depth_m.len()).step_by(97) {
                let (u, v) = (index % 1242, index / 1242);
                let ray = camera.ray(u as f64, v as f64);
                let along = view.world_from_camera() * ray;
                let eye = Point3::from(view.world_from_camera().translation.vector);
                let met = scene.terrain.meet(&eye, &along.normalize(), 3000.0);
                let depth_m = f64::from(images.depth_m[index]);
                let Some(distance_m) = met else {
                    sky += 1;
                    assert!(
                        depth_m.is_infinite() || depth_m > 500.0,
                        "{u} {v} {depth_m}"
                    );
                    continue;
                };
                let truth_m = distance_m / ray.norm();
                if truth_m < 60.0 {
                    seen += 1;
                    let off = (depth_m - truth_m).abs() / truth_m;
                    assert!(off < 0.03, "{u} {v}: {depth_m} {truth_m}");
                }
            }
            assert!(seen > 500 && sky > 300, "{seen} {sky}");
        });
    }
}

#[test]
fn depth_of_solids_is_that_of_rays_against_them() {
    let sample = sample_scene(3, 4);
    let (rays, calibration) = (RayScene::new(&sample.scene), Calibration::kitti());
    let view = Viewpoint::new(&sample.scene, &rays, sample.ego, &calibration).expect("the ego");
    let images = take_truth_images(&view);
    let eye = Point3::from(view.world_from_camera().translation.vector);
    let (mut solid, mut agree) = (0, 0);
    for index in (0..images.depth_m.len()).step_by(31) {
        let ray = calibration
            .intrinsics
            .ray((index % 1242) as f64, (index / 1242) as f64);
        let direction = (view.world_from_camera() * ray).normalize().cast::<f32>();
        let reach_m = rays
            .ground_hit(&eye.cast(), &direction, 3000.0)
            .unwrap_or(3000.0);
        let hit = rays.cast(&eye.cast(), &direction, reach_m, Some(sample.ego));
        let Some(hit) = hit.filter(|hit| hit.material != covista_traffic::Material::Foliage) else {
            continue;
        };
        solid += 1;
        let depth_m = f64::from(hit.distance_m) / ray.norm();
        let same = images.instance[index] == instance_number(&sample.scene, hit.object);
        agree +=
            usize::from(same && (f64::from(images.depth_m[index]) / depth_m - 1.0).abs() < 1e-3);
    }
    assert!(
        solid > 1000 && agree * 1000 >= solid * 998,
        "{agree} of {solid}"
    );
}

#[test]
fn any_number_of_threads_sees_the_same() {
    let sample = sample_scene(3, 1);
    let (rays, calibration) = (RayScene::new(&sample.scene), Calibration::kitti());
    let view = Viewpoint::new(&sample.scene, &rays, sample.ego, &calibration).expect("the ego");
    let on_threads = |count| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
        pool.expect("a pool").install(|| take_truth_images(&view))
    };
    assert!(on_threads(1) == on_threads(2));
}
