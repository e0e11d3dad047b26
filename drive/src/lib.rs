//! The closed loop, top to bottom: `traffic -> sensors -> perception -> sharing -> planner ->
//! control -> traffic`.
//!
//! [`run`] drives one scenario once; it reads like the list in ARCHITECTURE.md. The [`Monitor`]
//! watches it on the truth, and a [`RunSummary`] says what came out.
//!
//! *Architecture invariant:* this crate joins the stages and adds nothing to them. What a CAV's
//! tracker, policy and controller are given comes from its own sensors and from messages, never
//! from the truth; the truth goes to the monitor, the trace and the recording only. It knows
//! neither rerun nor the command line.

mod bench_frames;
mod campaign;
mod cause;
mod cav;
mod control_file;
mod environment;
mod evaluate;
mod excuse;
mod experiment;
mod free_lanes;
mod monitor;
mod networked;
mod networks;
mod recorded;
mod run;
mod senses;
mod snapshot;
mod summary;
mod tally;
mod trace;
mod training;
mod truth;

pub use bench_frames::{recorded_bench_frames, rendered_frames};
pub use campaign::{
    Broken, COVERS, CampaignError, CampaignSpec, CoverCase, EpisodeId, Family, Nominals,
    PlantCover, PlantModel, Stage, StepTiming, Tally, cover_plants, look_at_episode, run_campaign,
    time_control,
};
pub use cause::Cause;
pub use control_file::{ControlFileError, load_control_settings};
pub use covista_control::{ControlSettings, Mode as ControlMode, Solver};
pub use covista_planner::learning::{
    Algorithm, EpisodeReport, Hyperparameters, LearningError, Objective, RoundReport, Sharing,
    TimedLearner, Trainer, TrainingSettings, UpdateCost, UpdateSizes, update_cost,
};
pub use covista_sharing::{ChannelSettings, PoseNoise};
pub use covista_traffic::{
    Material, RingError, RingReport, RingSettings, RingTiming, Scenario, Traffic, VehicleKind,
    time_ring,
};
pub use environment::{
    RingEnvironment, RingEnvironmentError, RingEnvironmentSettings, RingMotion, RingPerception,
    RingSafety, RingTally, time_closed_loop,
};
pub use evaluate::{
    Bar, ClassEvaluation, CooperativeEvaluation, CooperativeRuns, DataOrigin, DetectorEvaluation,
    ErrorFigures, ErrorFrame, ErrorFrames, EvaluateError, Evaluated, FitError, FoundBox,
    FusionEvaluation, FusionFigures, GeometryErrors, Hardness, KnownVehicles, LaneEvaluation,
    LaneIndexFigures, OperatingPoint, Origin, Progress, RecallBar, Reliability, SharingCondition,
    evaluate_cooperative, evaluate_detector, evaluate_fusion, evaluate_lanes, figures_by_distance,
    fit_errors, perceive_dataset, perceive_scenario,
};
pub use experiment::{
    Behaviour, Case, Claim, Diagram, Experiment, ExperimentError, ExperimentOptions, Figures,
    Headways, Key, LearningCurve, Line, LoopCase, LoopFigures, Means, NetworkedGame, Percepts,
    Plan, Policies, Quantity, Results, Row, SceneCase, SceneFigures, Seeds, Spread, TrainingCase,
    TruncationCase, TruncationFigures, policy_file, rank_correlation, read_training, train,
    training_of,
};
pub use monitor::{CavView, Distributions, Histogram, Monitor, PlacedTrack, TrueBarriers};
pub use networked::{InvalidDiscount, TruncationErrors};
pub use networks::Networks;
pub use recorded::{FittedPicture, Lacking, RecordedError, calibration_of};
pub use run::{RunConfig, RunError, run};
pub use senses::Senses;
pub use snapshot::{CavSnapshot, FocusSnapshot, Observe, RecordError, Snapshot};
pub use summary::{CavSummary, RunSummary, StageWallTimes};
pub use trace::{TRACE_HEADER, TraceRow};
pub use training::{TrainingConfig, TrainingError};
pub use truth::{Lanes, TrueVehicle, closing_distance_m};
