//! The step's record, as a rerun recording and as plots.
//!
//! `drive` fills a [`SceneRecord`] once and a [`StepRecord`] as often as it likes; [`Recording`]
//! writes them as an .rrd file with its blueprint, [`plot_trajectories`] and [`plot_speeds`] draw
//! the runs side by side, [`plot_frontier`] accuracy against speed, [`plot_curves`] quantities with their spread, [`open_viewer`] shows recordings.
//!
//! *Architecture invariant:* the viewer draws what it is given and nothing comes back: no stage
//! reads anything from it, and it knows neither the simulator nor a stage, only the vocabulary.

mod error;
mod frames;
mod hull;
mod layout;
mod learning;
mod objects;
mod open;
mod palette;
mod perception;
mod plots;
mod projection;
mod record;
mod recording;
mod rrd;
mod scene;
mod series;

pub use error::ViewerError;
pub use frames::FrameRecording;
pub use learning::record_learning_curve;
pub use open::open_viewer;
pub use plots::{
    Curve, CurvePanel, FrontierPanel, FrontierPoint, FrontierSeries, RunSeries, VehicleSample,
    VehicleSeries, plot_curves, plot_frontier, plot_speeds, plot_trajectories,
};
pub use record::{
    FocusFrame, SceneRecord, SceneryPart, SeenBox, StepRecord, VehicleInfo, VehicleKind,
    VehicleStep,
};
pub use recording::Recording;
