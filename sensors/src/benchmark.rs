//! How fast the sensors are: the measurements behind `covista bench sensors`.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use covista_traffic::scenery::{Stretch, building, guard_rail, jersey_barrier, pole, tree, wall};
use covista_traffic::{
    Body, RoadMarkings, Scene, SceneLook, SceneVehicle, Terrain, VehicleId, VehicleModel,
};
use covista_world::{
    BicycleState, Calibration, FrenetPoint, LANE_COUNT, LaneIndex, Road, RoadError, RoadSegment,
    Se2Pose,
};
use nalgebra::{Point3, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{CameraSettings, Lidar, RayScene, Viewpoint, take_picture};

/// From one vehicle of a lane to the next.
const SPACING_M: f64 = 20.0;
const EGO: VehicleId = VehicleId(0);
const REPETITIONS: u64 = 9;

/// The ground of a [`busy_road`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ground {
    /// The plane z = 0.
    Flat,
    /// Waves of 2 m, 120 m long.
    Hilly,
}

/// What the sensors take in one scene: medians of nine repetitions after one to warm up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorTimings {
    /// Convex parts of vehicles and scenery.
    pub parts: usize,
    /// Memory of the scene made ready for rays, in bytes.
    pub scene_bytes: usize,
    /// Making the scene ready for rays, on one core.
    pub prepare: Duration,
    /// Rays of one sweep, those that hit nothing included.
    pub rays: usize,
    /// Casting them on one core: first surface and ground, no physics.
    pub cast_core: Duration,
    /// The same on all cores.
    pub cast: Duration,
    /// A sweep: cast, returns and noise, on all cores.
    pub sweep: Duration,
    /// A picture with all effects on one core.
    pub picture_core: Duration,
    /// The same on all cores.
    pub picture: Duration,
}

/// A straight three-lane road with vehicles every 20 m of each lane, and with walls, barriers,
/// rails, poles, buildings and trees along all of it. The ego drives amid them.
///
/// # Errors
/// When the road can't be built.
pub fn busy_road(vehicles: usize, ground: Ground) -> Result<Scene, RoadError> {
    let rows = vehicles.div_ceil(usize::from(LANE_COUNT)).max(1);
    let length_m = rows as f64 * SPACING_M + 400.0;
    let straight = RoadSegment::Straight { length_m };
    let road = Road::new(Se2Pose::new(-length_m / 2.0, 0.0, 0.0), &[straight], 3.5)?;
    let scenery = roadside(&road);
    let mut vehicles: Vec<_> = (0..vehicles)
        .map(|number| row_vehicle(&road, number, rows))
        .collect();
    // The one in the middle carries the sensors and is the first by name.
    let middle = vehicles.len() / 2;
    if !vehicles.is_empty() {
        vehicles.swap(0, middle);
    }
    for (number, vehicle) in (0..).zip(&mut vehicles) {
        vehicle.id = VehicleId(number);
    }
    Ok(Scene {
        time_s: 0.0,
        road: Arc::new(road),
        markings: RoadMarkings::default(),
        terrain: Arc::new(terrain(ground)),
        vehicles,
        scenery: Arc::new(scenery),
        look: SceneLook {
            sun_direction: Vector3::new(0.4, 0.5, 0.77).normalize(),
            direct_light: 0.8,
            paint_wear: 0.3,
            asphalt_albedo: 0.25,
            haze_per_m: 0.001,
            wetness: 0.3,
            damage: 0.5,
            texture_seed: 1,
        },
    })
}

fn row_vehicle(road: &Road, number: usize, rows: usize) -> SceneVehicle {
    const MODELS: [VehicleModel; 7] = [
        VehicleModel::Sedan,
        VehicleModel::Suv,
        VehicleModel::Van,
        VehicleModel::Sedan,
        VehicleModel::Truck,
        VehicleModel::Suv,
        VehicleModel::Sedan,
    ];
    let (row, lane) = (
        number / usize::from(LANE_COUNT),
        number % usize::from(LANE_COUNT),
    );
    let lane = LaneIndex::new(lane as u8).unwrap_or(LaneIndex::LEFTMOST);
    let from_middle_m = (row as f64 - rows as f64 / 2.0) * SPACING_M;
    let stagger_m = f64::from(lane.get()) * SPACING_M / 3.0;
    let s_m = road.length_m() / 2.0 + from_middle_m + stagger_m;
    SceneVehicle {
        id: EGO,
        model: MODELS[number % MODELS.len()],
        paint: [180, 180, 185],
        scale: Vector3::repeat(1.0),
        state: BicycleState {
            pose: road.pose_from_frenet(s_m, road.lane_center_m(lane), 0.0),
            speed_mps: 15.0,
        },
    }
}

fn roadside(road: &Road) -> Vec<Body> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let edge_m = road.mark_offset_m(0);
    let mut bodies = Vec::new();
    let mut from_m = 0.0;
    while from_m < road.length_m() {
        for side in [1.0, -1.0] {
            let stretch = |length_m: f64, setback_m: f64| Stretch {
                from_m,
                to_m: from_m + length_m,
                d_m: side * (edge_m + setback_m),
            };
            bodies.push(jersey_barrier(road, stretch(40.0, 1.5)));
            bodies.push(guard_rail(road, stretch(60.0, 3.0)));
            bodies.push(wall(road, stretch(30.0, 6.0), 3.0, 0.3));
            for post in 0..3 {
                let s_m = from_m + 20.0 * f64::from(post);
                let foot = FrenetPoint {
                    s_m,
                    d_m: side * (edge_m + 4.5),
                };
                bodies.push(pole(road, foot, 6.0, 0.1));
                let foot = FrenetPoint {
                    s_m: s_m + 8.0,
                    d_m: side * (edge_m + 9.0),
                };
                bodies.push(tree(road.from_frenet(foot), 7.0, 2.0, &mut rng));
            }
            let center = road.pose_from_frenet(from_m + 45.0, side * (edge_m + 20.0), 0.0);
            bodies.push(building(center, [20.0, 10.0, 8.0], [190, 170, 150]));
        }
        from_m += 60.0;
    }
    bodies
}

fn terrain(ground: Ground) -> Terrain {
    let wave = |x_m: f64| (std::f64::consts::TAU * x_m / 120.0).sin();
    match ground {
        Ground::Flat => Terrain::FLAT,
        Ground::Hilly => Terrain::sampled(Vector2::zeros(), 160.0, 4.0, |p| 2.0 * wave(p.x)),
    }
}

/// Times both sensors of the ego of a [`busy_road`]; `None` where there is no vehicle.
pub fn time_sensors(scene: &Scene, lidar: &Lidar) -> Option<SensorTimings> {
    let (rays, calibration) = (RayScene::new(scene), Calibration::kitti());
    let view = Viewpoint::new(scene, &rays, EGO, &calibration)?;
    let one_core = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .ok()?;
    // Everything on, compression and the own bonnet, too.
    let settings = CameraSettings {
        motion_blur_s: 0.01,
        jpeg_quality: Some(85),
        ..CameraSettings::default()
    };
    let fans = fans(lidar, &view);
    let origin = Point3::from(view.world_from_lidar().translation.vector).cast::<f32>();
    let cast = |fan: &Vec<Vector3<f32>>| {
        black_box(rays.cast_fan(&origin, fan, lidar.range_m as f32, Some(EGO), 0.0));
    };
    let picture = |seed| drop(black_box(take_picture(&view, &settings, seed)));
    Some(SensorTimings {
        parts: rays.solids().count(),
        scene_bytes: rays.memory_bytes(),
        prepare: one_core.install(|| median(&|_| drop(black_box(RayScene::new(scene))))),
        rays: fans.iter().map(Vec::len).sum(),
        cast_core: one_core.install(|| median(&|_| fans.iter().for_each(cast))),
        cast: median(&|_| fans.par_iter().for_each(cast)),
        sweep: median(&|seed| drop(black_box(lidar.sweep(&view, seed)))),
        picture_core: one_core.install(|| median(&picture)),
        picture: median(&picture),
    })
}

fn median(work: &(dyn Fn(u64) + Sync)) -> Duration {
    work(0);
    let timed = |seed| {
        let began = Instant::now();
        work(seed);
        began.elapsed()
    };
    let mut times: Vec<Duration> = (0..REPETITIONS).map(timed).collect();
    times.sort();
    times[times.len() / 2]
}

/// The directions of each column's rays in the world frame.
fn fans(lidar: &Lidar, view: &Viewpoint) -> Vec<Vec<Vector3<f32>>> {
    let rotation = view.world_from_lidar().rotation;
    (0..lidar.columns)
        .map(|column| {
            let azimuth = -std::f64::consts::TAU * f64::from(column) / f64::from(lidar.columns);
            let beams = lidar.beams.iter().map(|beam| {
                let (sin, cos) = beam.elevation_rad.sin_cos();
                (rotation * Vector3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin)).cast()
            });
            beams.collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_busy_road_has_its_vehicles_apart_and_the_ego_amid_them() {
        for count in [1, 10, 1000] {
            let scene = busy_road(count, Ground::Flat).expect("a scene");
            assert_eq!(scene.vehicles.len(), count);
            let ego_x_m = scene.vehicles[0].state.pose.x_m;
            let ahead = scene.vehicles.iter().filter(|v| v.state.pose.x_m > ego_x_m);
            assert!((ahead.count() as f64 - count as f64 / 2.0).abs() <= 3.0);
        }
        assert!(
            busy_road(0, Ground::Flat)
                .expect("a scene")
                .vehicles
                .is_empty()
        );
    }
}
