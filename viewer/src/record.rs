use covista_world::{
    Action, Calibration, CameraImage, FilterOutcome, LaneIndex, MARK_COUNT, ObjectState,
    PointCloud, Road, Se2Pose, StationId, Track, VehicleDimensions,
};
use nalgebra::Point3;

use crate::palette::Rgb;

/// What does not change over a run.
#[derive(Debug, Clone)]
pub struct SceneRecord {
    /// Name of the scenario, such as `obstacle-at-corner`.
    pub scenario: String,
    /// Which run of it, such as `sharing on`.
    pub run: String,
    /// What is to be seen, in Markdown; a legend of the colours is added below it.
    pub description: String,
    /// The road.
    pub road: Road,
    /// Walls, barriers, poles and buildings.
    pub scenery: Vec<SceneryPart>,
    /// All vehicles of the run.
    pub vehicles: Vec<VehicleInfo>,
    /// The CAV whose sensors and knowledge are shown.
    pub focus: StationId,
    /// Mounting of its sensors.
    pub calibration: Calibration,
}

/// A convex piece of scenery.
#[derive(Debug, Clone)]
pub struct SceneryPart {
    /// Points in the world frame in metres whose convex hull it is.
    pub vertices_m: Vec<Point3<f64>>,
    /// Red, green, blue.
    pub color: Rgb,
}

/// What drives a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum VehicleKind {
    /// A connected automated vehicle.
    Cav,
    /// A human driver.
    Human,
    /// Nobody: it stands still.
    Obstacle,
}

/// A vehicle of the run.
#[derive(Debug, Clone)]
pub struct VehicleInfo {
    /// Its number, which is also the station id of a CAV.
    pub id: u32,
    /// How it is called in the pictures, such as `CAV 3`; unique in the run.
    pub label: String,
    /// What drives it.
    pub kind: VehicleKind,
    /// Its dimensions.
    pub dimensions: VehicleDimensions,
}

/// One instant of the run.
#[derive(Debug, Clone, Default)]
pub struct StepRecord {
    /// Time since the run began, in seconds.
    pub time_s: f64,
    /// The truth about the vehicles; those that are left out stay as they were.
    pub vehicles: Vec<VehicleStep>,
    /// Pairs of CAVs between which messages arrive.
    pub links: Vec<[StationId; 2]>,
    /// What the focus CAV measured and knows, where this instant has a perception frame.
    pub focus: Option<FocusFrame>,
}

/// The truth about one vehicle.
#[derive(Debug, Clone)]
pub struct VehicleStep {
    /// Its number.
    pub id: u32,
    /// Pose of the rear axle in the world.
    pub pose: Se2Pose,
    /// Speed in m/s.
    pub speed_mps: f64,
    /// Acceleration in m/s^2.
    pub accel_mps2: f64,
    /// Its lane, on the road.
    pub lane: Option<LaneIndex>,
    /// The action that a CAV executes.
    pub action: Option<Action>,
    /// What became of a CAV's nominal input.
    pub outcome: Option<FilterOutcome>,
    /// The smallest barrier value h of a CAV in metres.
    pub h_m: Option<f64>,
    /// Bumper-to-bumper gap to the vehicle ahead in its lane, in metres.
    pub headway_m: Option<f64>,
}

/// What the focus CAV measured and knows at one time.
#[derive(Debug, Clone, Default)]
pub struct FocusFrame {
    /// Pose of its rear axle in the world at the time stamp.
    pub pose: Se2Pose,
    /// The camera's image.
    pub image: Option<CameraImage>,
    /// The LIDAR's sweep.
    pub cloud: Option<PointCloud>,
    /// The marks that the lane network found, each by its pixels (u, v) in the image.
    pub marks: Option<[Vec<[f64; 2]>; MARK_COUNT]>,
    /// The boxes of this instant, its own and those it received.
    pub boxes: Vec<SeenBox>,
    /// Its tracks.
    pub tracks: Vec<Track>,
}

/// A vehicle as somebody's detector sees it.
#[derive(Debug, Clone, Copy)]
pub struct SeenBox {
    /// Where it is, in the world frame.
    pub state: ObjectState,
    /// Whose sensors saw it: the focus CAV's own or those of another station.
    pub seen_by: StationId,
}
