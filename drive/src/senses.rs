use std::time::Instant;

use covista_perception::{FramePercepts, PerceiveError, Perceiver};
use covista_sensors::{CameraSettings, Lidar, RayScene, Viewpoint, take_picture, truth_detections};
use covista_traffic::{Scene, VehicleId};
use covista_world::{
    Calibration, Detection3d, FreeSpace, LaneMarks, Percept, Se2Pose, SensorFrame, wrap_angle,
};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Where a CAV's percepts come from.
pub enum Senses {
    /// Rendered images and point clouds through both networks; one perceiver a thread.
    Network(Vec<Perceiver>),
    /// Exact boxes, lanes and free space of what is in line of sight.
    Truth,
}

/// What one CAV perceives at one time.
pub struct Sensed {
    /// Its vehicles.
    pub percepts: Vec<Percept>,
    /// How far the way is seen free.
    pub free_space: FreeSpace,
    /// Measurement and lane marks, where networks run.
    pub frame: Option<(SensorFrame, LaneMarks)>,
}

/// Wall time of measuring and of perceiving, in seconds.
#[derive(Debug, Clone, Copy, Default)]
pub struct SenseTimes {
    /// Ray casting.
    pub sensors_s: f64,
    /// Networks and fusion.
    pub perception_s: f64,
}

impl Senses {
    /// What each of `cavs` perceives of `scene`, in their order.
    ///
    /// The noise of a measurement depends on `seed`, time and vehicle alone.
    ///
    /// # Errors
    /// When a frame is refused or a network fails.
    pub fn perceive(
        &mut self,
        scene: &Scene,
        rays: &RayScene,
        calibration: &Calibration,
        cavs: &[VehicleId],
        seed: u64,
    ) -> Result<(Vec<Sensed>, SenseTimes), PerceiveError> {
        let views: Vec<_> = cavs
            .iter()
            .filter_map(|&cav| Viewpoint::new(scene, rays, cav, calibration))
            .collect();
        let start = Instant::now();
        let perceivers = match self {
            Self::Truth => {
                let sensed = views.iter().map(exact).collect();
                let times = SenseTimes {
                    sensors_s: start.elapsed().as_secs_f64(),
                    ..SenseTimes::default()
                };
                return Ok((sensed, times));
            }
            Self::Network(perceivers) => perceivers,
        };
        let lidar = Lidar::hdl64e();
        let frames: Vec<SensorFrame> = views
            .iter()
            .map(|view| {
                let seed = frame_seed(seed, view.ego.id, scene.time_s);
                SensorFrame {
                    time_s: scene.time_s,
                    image: take_picture(view, &CameraSettings::default(), seed),
                    points: lidar.sweep(view, seed),
                }
            })
            .collect();
        let sensors_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let share = frames.len().div_ceil(perceivers.len().max(1)).max(1);
        let percepts: Vec<Vec<FramePercepts>> = perceivers
            .par_iter_mut()
            .zip(frames.par_chunks(share))
            .map(|(perceiver, frames)| {
                frames
                    .iter()
                    .map(|frame| perceiver.perceive(frame, calibration))
                    .collect::<Result<_, _>>()
            })
            .collect::<Result<_, _>>()?;
        let sensed = percepts
            .into_iter()
            .flatten()
            .zip(frames)
            .map(|(percepts, frame)| Sensed {
                percepts: percepts.percepts,
                free_space: percepts.free_space,
                frame: Some((frame, percepts.marks)),
            })
            .collect();
        let times = SenseTimes {
            sensors_s,
            perception_s: start.elapsed().as_secs_f64(),
        };
        Ok((sensed, times))
    }
}

fn frame_seed(seed: u64, cav: VehicleId, time_s: f64) -> u64 {
    let tick = (time_s / covista_world::STEP_S).round() as u64;
    seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (u64::from(cav.0) << 40) ^ tick
}

fn exact(view: &Viewpoint<'_>) -> Sensed {
    let road = &view.scene.road;
    let own = view.ego.state.pose;
    let vehicle_from_lidar = &view.calibration.vehicle_from_lidar;
    let percepts = truth_detections(view)
        .into_iter()
        .map(|in_lidar| {
            let center = vehicle_from_lidar * Point3::from(in_lidar.center_m);
            let world = own.transform(center.coords.xy());
            let from_sensor = in_lidar.center_m;
            let bearing_rad = from_sensor.y.atan2(from_sensor.x);
            let rotation_y_rad = wrap_angle(-in_lidar.yaw_rad - std::f64::consts::FRAC_PI_2);
            let lane = road.lane_at(road.to_frenet(world).d_m);
            Percept {
                detection: Detection3d {
                    center_m: center.coords,
                    ..in_lidar
                },
                lane,
                lane_probability: f64::from(u8::from(lane.is_some())),
                distance_m: from_sensor.xy().norm(),
                observation_angle_rad: wrap_angle(rotation_y_rad + bearing_rad),
                rotation_y_rad,
            }
        })
        .collect();
    Sensed {
        percepts,
        free_space: exact_free_space(view, own),
        frame: None,
    }
}

/// Free range by horizontal rays one metre above the ground.
fn exact_free_space(view: &Viewpoint<'_>, own: Se2Pose) -> FreeSpace {
    const BINS: usize = 720;
    const HEIGHT_M: f64 = 1.0;
    const FARTHEST_M: f32 = 100.0;
    let origin_m = view.calibration.vehicle_from_lidar.translation.vector.xy();
    let world = own.transform(origin_m);
    let origin = Point3::new(world.x, world.y, HEIGHT_M).cast::<f32>();
    let ranges_m = (0..BINS)
        .map(|bin| {
            let azimuth = (bin as f64 + 0.5) / BINS as f64 * std::f64::consts::TAU + own.yaw_rad;
            let direction = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0).cast::<f32>();
            view.rays
                .cast(&origin, &direction, FARTHEST_M, Some(view.ego.id))
                .map_or(FARTHEST_M, |hit| hit.distance_m)
        })
        .collect();
    FreeSpace { origin_m, ranges_m }
}
