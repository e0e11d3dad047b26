//! The truth of covista: vehicles and scenery with their shapes, human drivers, the step of time,
//! scenario files and random scenes.
//!
//! *Architecture invariant:* only `sensors`, `drive` and the whole-system tests depend on this
//! crate, so that a stage which must perceive cannot even link the truth. It knows nothing of
//! sensors, networks, messages or controllers: a CAV is moved by the control input it is given.

mod body;
mod footprint;
mod model;
mod sample;
mod scene;
/// Builders of static bodies in the world frame, along a road.
pub mod scenery;

pub use body::{Body, ConvexPart, Material};
pub use footprint::Footprint;
pub use model::VehicleModel;
pub use sample::{SampledScene, sample_scene};
pub use scene::{Scene, SceneLook, SceneVehicle, VehicleId};
