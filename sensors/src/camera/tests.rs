use std::sync::Arc;

use covista_traffic::{MarkStyle, Scene, Terrain, VehicleId, VehicleModel, sample_scene};
use covista_world::{Calibration, ROW_ANCHORS, Road, RoadSegment, Se2Pose};
use nalgebra::Vector2;

use super::*;
use crate::testing::{EGO, empty_road, vehicle};
use crate::{RayScene, true_marks};

fn with_view<T>(scene: &Scene, ego: VehicleId, look: impl FnOnce(&Viewpoint) -> T) -> T {
    let (rays, calibration) = (RayScene::new(scene), Calibration::kitti());
    look(&Viewpoint::new(scene, &rays, ego, &calibration).expect("the ego"))
}

fn radiance(scene: &Scene, ego: VehicleId, row: f64) -> Vec<Rgb> {
    with_view(scene, ego, |view| {
        let picture = Picture::new(view).radiance();
        picture.pixels[row as usize * 1242..][..1242].to_vec()
    })
}

/// The brightness that paint adds to each pixel of one row.
fn paint_alone(scene: &Scene, calibration: &Calibration) -> impl Fn(u32) -> Vec<f32> {
    let painted = |style: MarkStyle| {
        let mut scene = scene.clone();
        scene.markings.styles = [style; 4];
        let rays = RayScene::new(&scene);
        let view = Viewpoint::new(&scene, &rays, EGO, calibration).expect("the ego");
        Picture::new(&view).radiance()
    };
    let (with, without) = (painted(MarkStyle::Solid), painted(MarkStyle::None));
    move |row| {
        let start = row as usize * with.width;
        let pixels = with.pixels[start..start + with.width].iter();
        let bare = &without.pixels[start..start + with.width];
        pixels.zip(bare).map(|(a, b)| (a - b).sum().abs()).collect()
    }
}

/// How many labels lie in the middle of the paint; fails where one is more than a pixel off.
fn labels_on_paint(scene: &Scene, calibration: &Calibration) -> usize {
    let mut scene = scene.clone();
    scene.look.paint_wear = 0.0;
    scene.look.haze_per_m = 0.0;
    scene.markings.styles = [MarkStyle::Solid; 4];
    let rays = RayScene::new(&scene);
    let view = Viewpoint::new(&scene, &rays, EGO, calibration).expect("the ego");
    let (marks, row_of_paint) = (true_marks(&view), paint_alone(&scene, calibration));
    let mut compared = 0;
    for (mark, pixels) in marks.pixels.iter().enumerate() {
        for (index, anchor) in ROW_ANCHORS.iter().enumerate() {
            let Some(u) = pixels[index].map(f64::from) else {
                continue;
            };
            let paint = row_of_paint(anchor.0);
            let nearby = |reach: f64| {
                let first = (u - reach).ceil().max(0.0) as usize;
                first..((u + reach) as usize + 1).min(paint.len())
            };
            let strongest = |paint: &[f32]| nearby(1.0).map(|i| paint[i]).fold(0.0, f32::max);
            let peak = strongest(&paint);
            if peak < 0.02 {
                // On a crest the paint may end within the pixel, above its middle.
                let beside = strongest(&row_of_paint(anchor.0 + 1));
                assert!(beside > 0.02, "{mark} {anchor:?}: no paint at {u}");
                continue;
            }
            let covered = |i: &usize| paint[*i] > 0.3 * peak;
            let middle = nearby(1.0).find(covered).expect("the peak");
            let first = (0..=middle)
                .rev()
                .take_while(covered)
                .last()
                .unwrap_or(middle);
            let last = (middle..paint.len())
                .take_while(covered)
                .last()
                .unwrap_or(middle);
            // Paint along the row has no middle in it, nor has paint that the image's edge cuts off.
            let below = pixels.get(index + 1).copied().flatten().map(f64::from);
            let steep = below.is_some_and(|below| (below - u).abs() < 50.0);
            if steep && first > 0 && last + 1 < paint.len() {
                let weight: f64 = (first..=last).map(|i| f64::from(paint[i])).sum();
                let moment = |i: usize| f64::from(paint[i]) * i as f64;
                let center = (first..=last).map(moment).sum::<f64>() / weight;
                assert!((center - u).abs() < 1.0, "{mark} {anchor:?}: {center} {u}");
                compared += 1;
            }
        }
    }
    compared
}

fn tilted() -> Calibration {
    let text = include_str!("../../../assets/calibration/kitti.toml");
    let turned = "yaw_deg = 4.0\npitch_deg = -6.0\nroll_deg = 5.0\n[lidar]";
    Calibration::parse(&text.replace("[lidar]", turned), "tilted").expect("a calibration")
}

#[test]
fn marks_are_painted_where_the_labels_are() {
    let ground = |height_m: fn(Vector2<f64>) -> f64| {
        Arc::new(Terrain::sampled(Vector2::zeros(), 200.0, 2.0, height_m))
    };
    let bend = RoadSegment::Arc {
        length_m: 250.0,
        curvature_per_m: -1.0 / 150.0,
    };
    let start = Se2Pose::new(-20.0, 0.0, 0.1);
    let bend = Arc::new(Road::new(start, &[bend], 3.5).expect("a road"));
    let straight = empty_road().road;
    let hills = ground(|p| 0.8 * (p.x / 16.0).sin() + 0.2 * (p.y / 5.0).cos());
    let bank = ground(|p| 0.04 * p.x + 0.06 * p.y);
    let level = Arc::new(Terrain::FLAT);
    for (road, terrain, calibration, least) in [
        (&straight, &level, Calibration::kitti(), 50),
        (&bend, &level, Calibration::kitti(), 30),
        (&straight, &hills, Calibration::kitti(), 25),
        (&bend, &bank, Calibration::kitti(), 30),
        (&straight, &level, tilted(), 40),
        (&bend, &hills, tilted(), 20),
    ] {
        let mut scene = empty_road();
        scene.road = Arc::clone(road);
        scene.terrain = Arc::clone(terrain);
        let compared = labels_on_paint(&scene, &calibration);
        assert!(compared > least, "{compared}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let sample = sample_scene(3, 1);
    let on_threads = |count, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
        pool.expect("a pool").install(|| {
            with_view(&sample.scene, sample.ego, |view| {
                take_picture(view, &CameraSettings::default(), seed)
            })
        })
    };
    let picture = on_threads(1, 8);
    assert_eq!(picture.rgb.len(), 3 * 1242 * 375);
    assert!(picture == on_threads(2, 8));
    assert!(picture != on_threads(2, 9));
}

#[test]
fn no_light_gives_a_colour_that_is_no_number() {
    for (index, (height, haze)) in [(0.0, 0.0), (-0.2, 0.01), (1.0, 0.0)].iter().enumerate() {
        let mut sample = sample_scene(4, index as u64);
        sample.scene.look.sun_direction = Vector3::new(0.3, 0.1, *height);
        sample.scene.look.haze_per_m = *haze;
        for row in [0, 150, 172, 173, 200, 374] {
            let line = radiance(&sample.scene, sample.ego, f64::from(row));
            let sane = |color: &Rgb| color.iter().all(|x| x.is_finite() && *x >= 0.0);
            assert!(line.iter().all(sane), "{index} {row}");
        }
    }
}

#[test]
fn a_vehicle_ahead_throws_its_shadow_away_from_the_sun() {
    let mut scene = empty_road();
    scene.look.sun_direction = Vector3::new(0.0, -1.0, 1.0).normalize();
    let bare = radiance(&scene, EGO, 230.0);
    // The row sees the ground 20.8 m ahead of the camera.
    let pose = Se2Pose::new(20.7, 0.0, 0.0);
    scene
        .vehicles
        .push(vehicle(VehicleId(1), VehicleModel::Van, pose));
    let line = radiance(&scene, EGO, 230.0);
    let column = |left_m: f64| (609.56 - left_m * 721.54 / 20.83) as usize;
    let kept = |left_m: f64| line[column(left_m)].x / bare[column(left_m)].x;
    assert!(kept(2.2) < 0.6, "{}", kept(2.2));
    assert!((kept(-2.2) - 1.0).abs() < 1e-6 && (kept(5.0) - 1.0).abs() < 1e-6);
}
