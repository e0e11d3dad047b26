use std::time::Instant;

use covista_perception::{FramePercepts, PerceiveError};
use covista_sensors::{
    CameraSettings, ErrorModel, Lidar, RayScene, Viewpoint, take_picture, truth_detections,
};
use covista_traffic::{Scene, VehicleId};
use covista_world::{
    Calibration, Detection3d, FreeSpace, LaneIndex, LaneMarks, Percept, Se2Pose, SensorFrame,
    wrap_angle,
};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::Networks;

/// Where a CAV's percepts come from.
pub enum Senses {
    /// Rendered images and point clouds through both networks.
    Network(Networks),
    /// Boxes and lanes of what is in line of sight with the networks' errors, as drawn from a
    /// fitted model; exact free space.
    Statistical(Box<ErrorModel>),
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
        let networks = match self {
            Self::Network(networks) => &*networks,
            Self::Statistical(model) => {
                let model = &*model;
                return Ok(without_networks(&views, |view| drawn(view, model, seed)));
            }
            Self::Truth => return Ok(without_networks(&views, exact)),
        };
        let lidar = Lidar::hdl64e();
        let frames: Vec<SensorFrame> = views
            .iter()
            .map(|view| measure(view, &lidar, seed))
            .collect();
        let sensors_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let percepts: Vec<FramePercepts> = frames
            .par_iter()
            .map(|frame| networks.perceive(frame, calibration))
            .collect::<Result<_, _>>()?;
        let sensed = percepts
            .into_iter()
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

/// What camera and LIDAR measure from `view`; the noise depends on `seed`, time and vehicle alone.
pub(crate) fn measure(view: &Viewpoint<'_>, lidar: &Lidar, seed: u64) -> SensorFrame {
    let time_s = view.scene.time_s;
    let seed = frame_seed(seed, view.ego.id, time_s);
    SensorFrame {
        time_s,
        image: take_picture(view, &CameraSettings::default(), seed),
        points: lidar.sweep(view, seed),
    }
}

fn frame_seed(seed: u64, cav: VehicleId, time_s: f64) -> u64 {
    let tick = (time_s / covista_world::STEP_S).round() as u64;
    seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (u64::from(cav.0) << 40) ^ tick
}

/// What each view perceives by `sense`, with free space by rays.
fn without_networks(
    views: &[Viewpoint<'_>],
    sense: impl Fn(&Viewpoint<'_>) -> Vec<Percept>,
) -> (Vec<Sensed>, SenseTimes) {
    let start = Instant::now();
    let sensed = views.iter().map(|view| Sensed {
        percepts: sense(view),
        free_space: exact_free_space(view, view.ego.state.pose),
        frame: None,
    });
    let sensed = sensed.collect();
    let times = SenseTimes {
        sensors_s: start.elapsed().as_secs_f64(),
        ..SenseTimes::default()
    };
    (sensed, times)
}

fn drawn(view: &Viewpoint<'_>, model: &ErrorModel, seed: u64) -> Vec<Percept> {
    let drawn = model.perceive(view, seed).into_iter();
    drawn
        .map(|drawn| percept(view.calibration, drawn.detection, drawn.lane))
        .collect()
}

fn exact(view: &Viewpoint<'_>) -> Vec<Percept> {
    let road = &view.scene.road;
    let own = view.ego.state.pose;
    truth_detections(view)
        .into_iter()
        .map(|in_lidar| {
            let exact = percept(view.calibration, in_lidar, None);
            let world = own.transform(exact.detection.center_m.xy());
            let lane = road.lane_at(road.to_frenet(world).d_m);
            Percept {
                lane,
                lane_probability: certain(lane),
                ..exact
            }
        })
        .collect()
}

/// A box of the LIDAR frame, which stands upright on the vehicle, as fusion tells of it.
pub(crate) fn percept(
    calibration: &Calibration,
    in_lidar: Detection3d,
    lane: Option<LaneIndex>,
) -> Percept {
    let from_sensor = in_lidar.center_m;
    let center = calibration.vehicle_from_lidar * Point3::from(from_sensor);
    let bearing_rad = from_sensor.y.atan2(from_sensor.x);
    let rotation_y_rad = wrap_angle(-in_lidar.yaw_rad - std::f64::consts::FRAC_PI_2);
    Percept {
        detection: Detection3d {
            center_m: center.coords,
            ..in_lidar
        },
        lane,
        lane_probability: certain(lane),
        distance_m: from_sensor.xy().norm(),
        observation_angle_rad: wrap_angle(rotation_y_rad + bearing_rad),
        rotation_y_rad,
    }
}

/// The probability of a lane that is given without one.
fn certain(lane: Option<LaneIndex>) -> f64 {
    f64::from(u8::from(lane.is_some()))
}

/// Free range by horizontal rays one metre above the ground.
fn exact_free_space(view: &Viewpoint<'_>, own: Se2Pose) -> FreeSpace {
    const BINS: usize = 720;
    const FAN: usize = 24;
    const HEIGHT_M: f64 = 1.0;
    const FARTHEST_M: f32 = 100.0;
    let origin_m = view.calibration.vehicle_from_lidar.translation.vector.xy();
    let world = own.transform(origin_m);
    let origin = Point3::new(world.x, world.y, HEIGHT_M).cast::<f32>();
    let directions: Vec<Vector3<f32>> = (0..BINS)
        .map(|bin| {
            let azimuth = (bin as f64 + 0.5) / BINS as f64 * std::f64::consts::TAU + own.yaw_rad;
            Vector3::new(azimuth.cos(), azimuth.sin(), 0.0).cast::<f32>()
        })
        .collect();
    let (rays, skip) = (view.rays, Some(view.ego.id));
    let sightings = directions
        .chunks(FAN)
        .flat_map(|fan| rays.cast_fan(&origin, fan, FARTHEST_M, skip, 0.0));
    let ranges_m = sightings
        .map(|sighting| sighting.hit.map_or(FARTHEST_M, |hit| hit.distance_m))
        .collect();
    FreeSpace { origin_m, ranges_m }
}
