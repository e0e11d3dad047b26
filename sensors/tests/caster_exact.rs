//! The ray caster against answers of others: parry's meshes, shifted scenes, itself ray by ray.

#![allow(clippy::expect_used)]

use std::sync::Arc;

use covista_sensors::{ObjectRef, RayScene, Sighting};
use covista_traffic::{Body, ConvexPart, Material, Scene, Terrain, sample_scene};
use nalgebra::{Point3, Vector2, Vector3};
use parry3d::math::Vector;
use parry3d::query::{Ray, RayCast};
use parry3d::shape::TriMesh;
use proptest::prelude::*;

const RANGE_M: f32 = 120.0;
const EXACT_M: f32 = 1e-3;

/// A scene of nothing but these bodies, on level ground far below them.
fn scene_of(bodies: Vec<Body>) -> Scene {
    let mut scene = sample_scene(1, 0).scene;
    scene.vehicles.clear();
    scene.terrain = Arc::default();
    scene.scenery = Arc::new(bodies);
    scene
}

fn body(vertices: &[Point3<f64>]) -> Body {
    Body {
        parts: vec![ConvexPart {
            vertices: vertices.to_vec(),
            material: Material::Concrete,
        }],
    }
}

fn mesh(vertices: &[Point3<f64>]) -> TriMesh {
    let points: Vec<_> = vertices
        .iter()
        .map(|p| Vector::new(p.x as f32, p.y as f32, p.z as f32))
        .collect();
    let (points, triangles) = parry3d::transformation::convex_hull(&points);
    TriMesh::new(points, triangles).expect("a mesh")
}

/// The nearest of the meshes along a ray, by parry.
fn nearest(meshes: &[TriMesh], origin: &Point3<f32>, direction: &Vector3<f32>) -> Option<f32> {
    let vector = |v: &Vector3<f32>| Vector::new(v.x, v.y, v.z);
    let ray = Ray::new(vector(&origin.coords), vector(direction));
    let hits = meshes
        .iter()
        .filter_map(|mesh| mesh.cast_local_ray(&ray, RANGE_M, false));
    hits.reduce(f32::min)
}

/// Whether the ray passes within a millimetre of an outline, so that rounding decides.
fn grazes(meshes: &[TriMesh], origin: &Point3<f32>, direction: &Vector3<f32>) -> bool {
    let right = direction
        .cross(&Vector3::ith(direction.iamin(), 1.0))
        .normalize();
    let up = direction.cross(&right);
    let around = [right, -right, up, -up];
    let beside: Vec<_> = around
        .iter()
        .map(|way| nearest(meshes, &(origin + way * EXACT_M), direction))
        .map(|hit| hit.unwrap_or(10.0 * RANGE_M))
        .collect();
    let (least, most) = beside
        .iter()
        .fold((f32::MAX, 0.0_f32), |(a, b), &m| (a.min(m), b.max(m)));
    most - least > 10.0 * EXACT_M
}

/// Corners of a random solid about a place some hundred metres from the world's origin.
fn solid() -> impl Strategy<Value = Vec<Point3<f64>>> {
    let corner = [-2.0..2.0_f64, -2.0..2.0, -2.0..2.0];
    let center = [-30.0..30.0_f64, -30.0..30.0, 2.0..10.0];
    (center, prop::collection::vec(corner, 6..14)).prop_map(|(center, corners)| {
        let place = Vector3::from(center) + Vector3::new(350.0, -420.0, 0.0);
        corners
            .into_iter()
            .map(|corner| Point3::from(place + Vector3::from(corner)))
            .collect()
    })
}

proptest! {
    #[test]
    fn solids_are_hit_where_parry_hits_their_meshes(
        solids in prop::collection::vec(solid(), 1..20),
        eye in [-45.0..45.0_f64, -45.0..45.0, -5.0..25.0],
        aims in prop::collection::vec([-2.5..2.5_f64, -2.5..2.5, -2.5..2.5], 20),
    ) {
        let rays = RayScene::new(&scene_of(solids.iter().map(|s| body(s)).collect()));
        let meshes: Vec<_> = solids.iter().map(|s| mesh(s)).collect();
        let origin = Point3::from(Vector3::from(eye) + Vector3::new(350.0, -420.0, 0.0));
        for (index, aim) in aims.into_iter().enumerate() {
            let target = solids[index % solids.len()][0] + Vector3::from(aim);
            let direction = (target - origin).normalize().cast::<f32>();
            let origin = origin.cast::<f32>();
            // Both begin outside of all solids: ours looks out of those that hold the eye.
            let inside = nearest(&meshes, &origin, &direction).is_some_and(|first_m| {
                first_m < 4.0
            });
            if inside || grazes(&meshes, &origin, &direction) {
                continue;
            }
            let ours = rays.cast(&origin, &direction, RANGE_M, None).map(|hit| hit.distance_m);
            let theirs = nearest(&meshes, &origin, &direction);
            match (ours, theirs) {
                (Some(ours), Some(theirs)) => {
                    prop_assert!((ours - theirs).abs() < EXACT_M, "{} {}", ours, theirs);
                }
                (ours, theirs) => prop_assert_eq!(ours, theirs),
            }
        }
    }
}

/// The beams of a column of a LIDAR that is tilted a little.
fn column(azimuth: f32, beams: u32) -> Vec<Vector3<f32>> {
    let tilt = nalgebra::Rotation3::from_euler_angles(0.02, -0.03, 0.0);
    let beam = |beam: u32| {
        let elevation = (2.0 - 26.3 * beam as f32 / beams as f32).to_radians();
        let (sin, cos) = elevation.sin_cos();
        tilt * Vector3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin)
    };
    (0..beams).map(beam).collect()
}

fn one_by_one(
    rays: &RayScene,
    origin: &Point3<f32>,
    fan: &[Vector3<f32>],
    dt_s: f32,
) -> Vec<Sighting> {
    let sighting = |direction| {
        let ground_m = rays.ground_hit(origin, direction, RANGE_M);
        let reach_m = ground_m.unwrap_or(RANGE_M);
        let hit = rays.cast_at(origin, direction, reach_m, None, dt_s);
        Sighting { ground_m, hit }
    };
    fan.iter().map(sighting).collect()
}

fn rolling_scene(index: u64) -> (Scene, Point3<f32>) {
    let sampled = sample_scene(9, index);
    let mut scene = sampled.scene;
    let own = scene
        .vehicles
        .iter()
        .position(|v| v.id == sampled.ego)
        .expect("the ego");
    let own = scene.vehicles.remove(own);
    let eye = scene.placed(&own) * Point3::new(0.9, 0.0, 1.73);
    scene.terrain = Arc::new(Terrain::sampled(eye.xy().coords, 150.0, 4.0, |p| {
        let gap: Vector2<f64> = p - eye.xy().coords;
        0.4 * (gap.x / 12.0).sin() - 0.3 * (gap.y / 9.0).sin()
    }));
    (scene, eye.cast())
}

#[test]
fn a_fan_sees_what_its_rays_see_bit_by_bit() {
    let mut hits = 0;
    for index in 0..6 {
        let (scene, origin) = rolling_scene(index);
        let rays = RayScene::rolling(&scene, 0.05);
        for turn in 0..200_u8 {
            let share = f32::from(turn) / 200.0;
            let dt_s = 0.1 * (share - 0.5);
            let narrow = column(std::f32::consts::TAU * share, 64);
            // Beams set off to the side, as in a VLP-32C, in no order, and too few for a packet.
            let offset =
                |beam: u8| column(std::f32::consts::TAU * share + 0.02 * f32::from(beam), 11);
            let scattered: Vec<_> = (0..4).flat_map(offset).collect();
            let wide: Vec<_> = (0..8_u8).flat_map(|i| column(f32::from(i), 3)).collect();
            for fan in [&narrow, &scattered, &wide] {
                let seen = rays.cast_fan(&origin, fan, RANGE_M, None, dt_s);
                assert_eq!(seen, one_by_one(&rays, &origin, fan, dt_s));
                hits += seen
                    .iter()
                    .filter(|sighting| sighting.hit.is_some())
                    .count();
            }
        }
        assert!(rays.cast_fan(&origin, &[], RANGE_M, None, 0.0).is_empty());
    }
    assert!(hits > 10_000, "{hits}");
}

#[test]
fn a_moving_vehicle_is_hit_where_it_is_then() {
    let (mut hits, mut others) = (0, 0);
    for index in 0..6 {
        let (scene, origin) = rolling_scene(index);
        let (dt_s, mut then) = (0.04, scene.clone());
        then.terrain = Arc::default();
        let rolling = RayScene::rolling(&then, 0.05);
        for vehicle in &mut then.vehicles {
            let state = &mut vehicle.state;
            let way_m = state.speed_mps * f64::from(dt_s);
            state.pose.x_m += way_m * state.pose.yaw_rad.cos();
            state.pose.y_m += way_m * state.pose.yaw_rad.sin();
        }
        let shifted = RayScene::new(&then);
        for direction in (0..800_u16).flat_map(|turn| column(f32::from(turn) / 127.0, 16)) {
            let moving = rolling.cast_at(&origin, &direction, RANGE_M, None, dt_s);
            let still = shifted.cast(&origin, &direction, RANGE_M, None);
            match (moving, still) {
                (Some(a), Some(b)) if a.object == b.object => {
                    hits += u32::from(matches!(a.object, ObjectRef::Vehicle(_)));
                    others += u32::from((a.distance_m - b.distance_m).abs() > EXACT_M);
                }
                (a, b) => others += u32::from(a != b),
            }
        }
    }
    // Rays along an outline may see either side of it.
    assert!(hits > 1000 && others * 500 < hits, "{hits} {others}");
}

#[test]
fn a_frozen_scene_stands_still_and_odd_rays_meet_nothing() {
    let (scene, origin) = rolling_scene(0);
    let rays = RayScene::new(&scene);
    for direction in column(0.3, 64) {
        let cast = |dt_s| rays.cast_at(&origin, &direction, RANGE_M, None, dt_s);
        assert_eq!(cast(1.0), cast(0.0));
    }
    let nan = f32::NAN;
    for rays in [rays, RayScene::rolling(&scene, f64::NAN)] {
        for way in [
            Vector3::zeros(),
            Vector3::repeat(nan),
            Vector3::new(0.0, nan, 1.0),
        ] {
            assert_eq!(rays.cast_at(&origin, &way, RANGE_M, None, nan), None);
            assert_eq!(rays.ground_hit(&origin, &way, RANGE_M), None);
            let fan = rays.cast_fan(&origin, &[way; 3], RANGE_M, None, 0.0);
            assert!(fan.iter().all(|sighting| sighting.hit.is_none()));
        }
    }
}

#[test]
fn a_sloped_ground_is_a_plane() {
    let mut scene = scene_of(Vec::new());
    scene.terrain = Arc::new(Terrain::sampled(Vector2::zeros(), 200.0, 4.0, |p| {
        0.06 * p.x
    }));
    let rays = RayScene::new(&scene);
    let origin = Point3::new(10.0_f32, -3.0, 2.33);
    for direction in (0..40_u8).flat_map(|turn| column(f32::from(turn) * 0.16, 32)) {
        let closing = 0.06 * direction.x - direction.z;
        let expected_m = 1.73 / closing;
        let found = rays.ground_hit(&origin, &direction, RANGE_M);
        if closing > 0.0 && expected_m < RANGE_M - 0.1 {
            assert!((found.expect("ground") - expected_m).abs() < EXACT_M);
        } else if closing < 0.0 || expected_m > RANGE_M + 0.1 {
            assert_eq!(found, None);
        }
    }
}
