//! The truth of covista: vehicles and scenery with their shapes, human drivers, the step of time,
//! scenario files and random scenes.
//!
//! *Architecture invariant:* only `sensors`, `drive` and the whole-system tests depend on this
//! crate, so that a stage which must perceive cannot even link the truth. It knows nothing of
//! sensors, networks, messages or controllers: a CAV is moved by the control input it is given.

mod body;
mod footprint;
mod human;
mod idm;
mod loop_road;
mod markings;
mod model;
mod ring;
mod sample;
mod scenario;
mod scenario_error;
mod scene;
/// Builders of static bodies in the world frame, along a road.
pub mod scenery;
mod sight;
mod simulation;
mod terrain;

pub use body::{Body, ConvexPart, Material};
pub use footprint::Footprint;
pub use idm::{Ahead, Idm};
pub use loop_road::{Bend, LoopRoad};
pub use markings::{MarkStyle, PaintColor, RoadMarkings};
pub use model::VehicleModel;
pub use ring::{
    Ring, RingError, RingImage, RingReport, RingSettings, RingTiming, RingVehicle, SAFE_DISTANCE_M,
    time_ring,
};
pub use sample::{SampledScene, SceneKind, sample_scene};
pub use scenario::{
    BarrierEntry, BuildingEntry, DrivenEntry, LookEntry, ObstacleEntry, PolesEntry,
    RoadsideBarrier, Scenario, TreeEntry, VehicleKind, WallEntry,
};
pub use scenario_error::ScenarioError;
pub use scene::{Scene, SceneLook, SceneVehicle, VehicleId};
pub use simulation::{Traffic, TrafficVehicle};
pub use terrain::Terrain;

/// The hardest braking of any vehicle, in m/s^2 (b_e and b_l of the safe set).
pub const BRAKING_MAX_MPS2: f64 = 8.0;
/// The strongest acceleration of any vehicle, in m/s^2.
pub const ACCEL_MAX_MPS2: f64 = 3.0;
/// The largest tangent of a steering angle.
pub const TAN_DELTA_MAX: f64 = 0.6;
