//! Speed of the ray caster on one thread. By hand, for it measures and does not judge:
//! `cargo test --release -p covista-sensors --test caster_speed -- --ignored --nocapture`

#![allow(clippy::expect_used, clippy::print_stdout)]

use std::sync::Arc;
use std::time::Instant;

use covista_sensors::{Lidar, RayScene, Sighting};
use covista_traffic::scenery::{Stretch, building, guard_rail, pole, tree, wall};
use covista_traffic::{Body, Scene, SceneVehicle, Terrain, VehicleId, VehicleModel, sample_scene};
use covista_world::{BicycleState, FrenetPoint, Road, RoadSegment, Se2Pose};
use nalgebra::{Point3, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const LANE_M: f64 = 3.5;

/// A straight road across the axes of the world, `length_m` long about the origin.
fn road(length_m: f64) -> Road {
    let (sin, cos) = 0.5_f64.sin_cos();
    let start = Se2Pose::new(-cos * length_m / 2.0, -sin * length_m / 2.0, 0.5);
    Road::new(start, &[RoadSegment::Straight { length_m }], LANE_M).expect("a road")
}

/// Walls, guard rails, poles, buildings and trees along both sides.
fn roadside(road: &Road) -> Vec<Body> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let length_m = road.length_m();
    let stretch = |from_m: f64, to_m: f64, d_m: f64| Stretch { from_m, to_m, d_m };
    let places = |spacing_m: f64| {
        (0..(length_m / spacing_m) as u32).map(move |place| (f64::from(place) + 0.5) * spacing_m)
    };
    let at = |s_m: f64, d_m: f64| road.from_frenet(FrenetPoint { s_m, d_m });
    let mut bodies = vec![
        guard_rail(road, stretch(0.0, length_m, -7.5)),
        guard_rail(road, stretch(0.0, length_m / 2.0, 7.5)),
        wall(road, stretch(length_m / 2.0, length_m, 8.0), 3.0, 0.3),
    ];
    for side in [-1.0, 1.0] {
        bodies.extend(places(30.0).map(|s_m| {
            pole(
                road,
                FrenetPoint {
                    s_m,
                    d_m: 9.0 * side,
                },
                8.0,
                0.12,
            )
        }));
        bodies.extend(places(12.0).map(|s_m| tree(at(s_m, 13.0 * side), 8.0, 2.5, &mut rng)));
        bodies.extend(places(40.0).map(|s_m| {
            let foot = at(s_m, 28.0 * side);
            building(
                Se2Pose::new(foot.x, foot.y, 0.4),
                [14.0, 10.0, 9.0],
                [180, 160, 140],
            )
        }));
    }
    bodies
}

/// The ego at the origin and `count` - 1 others on three lanes, `spacing_m` of road for each.
fn scene(count: u32, spacing_m: f64, full_roadside: bool) -> Scene {
    let mut scene = sample_scene(1, 0).scene;
    let road = road((f64::from(count) * spacing_m).max(300.0));
    let middle_m = road.length_m() / 2.0;
    scene.scenery = Arc::new(if full_roadside {
        roadside(&road)
    } else {
        Vec::new()
    });
    scene.terrain = Arc::default();
    scene.vehicles = (0..count)
        .map(|index| {
            let rank = f64::from(index.div_ceil(2)) * if index % 2 == 0 { 1.0 } else { -1.0 };
            let place = FrenetPoint {
                s_m: middle_m + rank * spacing_m,
                d_m: LANE_M * (f64::from(index % 3) - 1.0),
            };
            let foot = road.from_frenet(place);
            SceneVehicle {
                id: VehicleId(index),
                model: VehicleModel::ALL[index as usize % VehicleModel::ALL.len()],
                paint: [120, 120, 120],
                scale: Vector3::repeat(1.0),
                state: BicycleState {
                    pose: Se2Pose::new(foot.x, foot.y, 0.5),
                    speed_mps: 25.0,
                },
            }
        })
        .collect();
    scene.road = Arc::new(road);
    scene
}

/// A thousand vehicles side by side, the ego among them.
fn car_park() -> Scene {
    let mut scene = scene(1000, 10.0, false);
    let park = Se2Pose::new(0.0, 0.0, 0.5);
    for (index, vehicle) in (0_i32..).zip(&mut scene.vehicles) {
        let (row, column) = ((index / 40 + 12) % 25 - 12, (index % 40 + 20) % 40 - 20);
        let place = Vector2::new(7.5 * f64::from(row), 3.0 * f64::from(column));
        let place = park.transform(place);
        vehicle.state.pose = Se2Pose::new(place.x, place.y, 0.5);
        vehicle.state.speed_mps = 0.0;
    }
    scene
}

/// The directions of every column of a turn.
fn columns(lidar: &Lidar) -> Vec<Vec<Vector3<f32>>> {
    let azimuths = (0..lidar.columns)
        .map(|column| -std::f64::consts::TAU * f64::from(column) / f64::from(lidar.columns));
    let column = |azimuth: f64| {
        let beams = lidar.beams.iter().map(move |beam| {
            let (sin, cos) = beam.elevation_rad.sin_cos();
            Vector3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin).cast::<f32>()
        });
        beams.collect()
    };
    azimuths.map(column).collect()
}

/// The best of several runs in nanoseconds.
fn best_ns<T>(runs: u32, mut run: impl FnMut() -> T) -> (f64, T) {
    let mut timed = || {
        let start = Instant::now();
        let result = run();
        (start.elapsed().as_nanos() as f64, result)
    };
    (1..runs).fold(timed(), |best, _| {
        let next = timed();
        if next.0 < best.0 { next } else { best }
    })
}

fn measure(name: &str, scene: &Scene) {
    let (runs, skip) = (15, Some(VehicleId(0)));
    let (build_ns, rays) = best_ns(runs, || RayScene::rolling(scene, 0.05));
    let columns = columns(&Lidar::hdl64e());
    let pose = scene.placed(&scene.vehicles[0]);
    let origin = (pose * Point3::new(0.9, 0.0, 1.73)).cast::<f32>();
    let (single_ns, single) = best_ns(3, || {
        let rays_of = columns.iter().flatten().map(|direction| {
            let ground_m = rays.ground_hit(&origin, direction, 120.0);
            let reach_m = ground_m.unwrap_or(120.0);
            Sighting {
                ground_m,
                hit: rays.cast(&origin, direction, reach_m, skip),
            }
        });
        rays_of.collect::<Vec<_>>()
    });
    let (fan_ns, fans) = best_ns(runs, || {
        let fan = |column: &Vec<_>| rays.cast_fan(&origin, column, 120.0, skip, 0.0);
        columns.iter().map(fan).collect::<Vec<_>>()
    });
    assert!(
        fans.concat() == single,
        "a fan must see what single rays see"
    );
    let count = single.len() as f64;
    let hits = single
        .iter()
        .filter(|sighting| sighting.hit.is_some())
        .count();
    println!(
        "{name:32} {:5.1} ns/ray, {:5.1} Mrays/s in fans; {:5.1} ns/ray single; \
         build {:6.2} ms; {:4.1} % on objects",
        fan_ns / count,
        1e3 * count / fan_ns,
        single_ns / count,
        build_ns / 1e6,
        100.0 * hits as f64 / count,
    );
}

#[test]
#[ignore = "measures"]
fn rays_a_second() {
    for count in [10, 30, 100, 300, 1000] {
        measure(
            &format!("{count} vehicles along a road"),
            &scene(count, 10.0, true),
        );
    }
    measure("1000 vehicles, no roadside", &scene(1000, 10.0, false));
    measure("1000 parked within 103 m", &car_park());
    let mut hills = scene(30, 10.0, true);
    hills.terrain = Arc::new(Terrain::sampled(Vector2::zeros(), 200.0, 4.0, |p| {
        0.4 * (p.x / 20.0).sin() + 0.3 * (p.y / 15.0).cos()
    }));
    measure("30 vehicles on hilly ground", &hills);
}
