use covista_traffic::SceneKind;
use covista_world::{LaneIndex, MARK_COUNT, ROW_ANCHORS};
use nalgebra::Vector3;
use serde::Serialize;

use crate::{CameraSettings, MarkTruth, Rig, TruthBox, Viewpoint};

/// The settings that a scene was drawn with, and the truth that KITTI's and TuSimple's files have
/// no place for.
#[derive(Serialize)]
pub(super) struct SceneDescription {
    kind: &'static str,
    lidar_motion: String,
    lidar_specimen: u64,
    camera: CameraSettings,
    sun_direction: Vector3<f64>,
    direct_light: f64,
    paint_wear: f64,
    asphalt_albedo: f64,
    haze_per_m: f64,
    wetness: f64,
    damage: f64,
    /// Bodies that stand still and are no vehicle.
    scenery: usize,
    ego_speed_mps: f64,
    ego_lane: Option<LaneIndex>,
    vehicles: Vec<VehicleDescription>,
    /// The marks on the ground in the vehicle frame, in metres.
    marks_m: [Vec<[f64; 2]>; MARK_COUNT],
    /// The rows of the picture at which TuSimple's labels stand.
    row_anchors: [u32; ROW_ANCHORS.len()],
}

/// A vehicle other than the own one.
#[derive(Serialize)]
struct VehicleDescription {
    id: u32,
    /// Its number in point labels.
    instance: usize,
    model: String,
    lane: Option<LaneIndex>,
    speed_mps: f64,
    /// Centre of the box in the LIDAR frame.
    center_m: Vector3<f64>,
    /// Length, width, height.
    size_m: Vector3<f64>,
    yaw_rad: f64,
    /// Where the frame has a sweep.
    #[serde(skip_serializing_if = "Option::is_none")]
    lidar_points: Option<usize>,
    /// Share of the body in line of sight of the LIDAR.
    visibility: f64,
}

impl SceneDescription {
    pub(super) fn new(
        view: &Viewpoint,
        kind: SceneKind,
        rig: &Rig,
        truth: &[TruthBox],
        marks: &MarkTruth,
        is_swept: bool,
    ) -> Self {
        let look = &view.scene.look;
        let road = &view.scene.road;
        let lane = |vehicle: &covista_traffic::SceneVehicle| {
            road.lane_at(road.to_frenet(vehicle.state.pose.position()).d_m)
        };
        let vehicles = truth.iter().filter_map(|truth| {
            let mut vehicles = view.scene.vehicles.iter();
            let index = vehicles.position(|vehicle| vehicle.id == truth.id)?;
            let vehicle = &view.scene.vehicles[index];
            Some(VehicleDescription {
                id: truth.id.0,
                instance: index + 1,
                model: format!("{:?}", truth.model).to_lowercase(),
                lane: truth.lane,
                speed_mps: vehicle.state.speed_mps,
                center_m: truth.center_m,
                size_m: truth.size_m,
                yaw_rad: truth.yaw_rad,
                lidar_points: is_swept.then_some(truth.lidar_points),
                visibility: truth.visibility,
            })
        });
        Self {
            lidar_motion: format!("{:?}", rig.lidar_motion).to_lowercase(),
            lidar_specimen: rig.lidar_specimen,
            camera: rig.camera,
            kind: match kind {
                SceneKind::Freeway => "freeway",
                SceneKind::Street => "street",
            },
            sun_direction: look.sun_direction,
            direct_light: look.direct_light,
            paint_wear: look.paint_wear,
            asphalt_albedo: look.asphalt_albedo,
            haze_per_m: look.haze_per_m,
            wetness: look.wetness,
            damage: look.damage,
            scenery: view.scene.scenery.len(),
            ego_speed_mps: view.ego.state.speed_mps,
            ego_lane: lane(view.ego),
            vehicles: vehicles.collect(),
            marks_m: std::array::from_fn(|mark| {
                let points = marks.points_m[mark].iter();
                points.map(|point| [point.x, point.y]).collect()
            }),
            row_anchors: ROW_ANCHORS.map(|anchor| anchor.0),
        }
    }
}
