//! One frame in, percepts out.
//!
//! The camera's image goes through a UFLD row-anchor network to [`lanes`], the LIDAR's sweep
//! through PointPillars to boxes ([`pointpillars`]) and to the range that is confirmed free
//! ([`free_space`]); [`fusion`] puts the boxes into lanes on the [`ground`] that the sweep shows. [`Perceiver`] does it all for one
//! frame. The networks are ONNX files, each described by a [`ModelCard`], and run in
//! [`OnnxRuntime`], which is found on the machine or fetched once.
//!
//! *Architecture invariant:* this crate knows one [`covista_world::SensorFrame`] and the sensors'
//! calibration, nothing else: no truth, no map, no earlier frame, no other vehicle.

mod benchmark;
mod card;
pub mod free_space;
pub mod fusion;
pub mod ground;
pub mod lanes;
pub mod metrics;
mod models;
mod perceiver;
pub mod pointpillars;
mod runtime;

pub use benchmark::{
    BenchFrame, BenchInput, BenchNetwork, BenchTimes, Precision, Sorted, time_perceiver,
};
pub use card::{
    AnchorSpec, CardError, Cost, Dimension, ModelCard, Network, PointPillarsSpec, TensorSpec,
    UfldSpec,
};
pub use lanes::finder::LaneFinder;
pub use models::{
    DETECTOR_MODEL, LANE_MODEL, ModelError, find_model, list_models, open_model, verify_model,
};
pub use perceiver::{FramePercepts, PerceiveError, Perceiver, StageTimes};
pub use pointpillars::detector::Detector;
pub use runtime::{
    ONNX_RUNTIME_VERSION, OnnxRuntime, Provider, ProviderChoice, RuntimeError, SessionSettings,
    UnknownProvider,
};
