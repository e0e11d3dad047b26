//! The networks on recorded frames with labels, and what CAVs know in closed loops.

mod cooperative;
mod detector;
mod errors;
mod fusion;
mod lanes;

use std::path::{Path, PathBuf};

use covista_perception::PerceiveError;
use covista_sensors::kitti::KittiError;

pub use cooperative::{
    CooperativeEvaluation, CooperativeRuns, KnownVehicles, SharingCondition, evaluate_cooperative,
};
pub(crate) use detector::in_picture;
pub use detector::{
    Bar, ClassEvaluation, DetectorEvaluation, Hardness, OperatingPoint, RecallBar,
    evaluate_detector,
};
pub use errors::{
    DataOrigin, ErrorFigures, ErrorFrame, ErrorFrames, FitError, FoundBox, figures_by_distance,
    fit_errors, perceive_dataset, perceive_scenario,
};
pub use fusion::{
    FusionEvaluation, FusionFigures, GeometryErrors, LaneIndexFigures, Origin, Reliability,
    evaluate_fusion,
};
pub use lanes::{LaneEvaluation, evaluate_lanes};

use crate::{
    recorded::{Lacking, RecordedError},
    run::RunError,
};

/// Told after each frame: frames done and frames in all.
pub type Progress<'a> = &'a dyn Fn(usize, usize);

/// The figures of a network, and what they were taken on.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluated<T> {
    /// Frames evaluated.
    pub frames: usize,
    /// Frames that could not be, by the file they lack.
    pub lacking: Vec<Lacking>,
    /// The figures.
    pub figures: T,
}

impl<T> Evaluated<T> {
    fn new(frames: usize, lacking: Vec<Lacking>, figures: T) -> Result<Self, EvaluateError> {
        if frames == 0 {
            return Err(EvaluateError::none_with_files(&lacking));
        }
        Ok(Self {
            frames,
            lacking,
            figures,
        })
    }
}

fn said(lacking: &[Lacking]) -> String {
    let each = lacking
        .iter()
        .map(|Lacking { file, frames }| format!("{frames} without {file}"));
    each.collect::<Vec<_>>().join(", ")
}

/// Why frames can't be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// No frame has all that is needed.
    #[error("there is no frame with all the files that are needed: {0}")]
    NoLabelledFrame(String),
    /// No label shows a mark, as on streets without paint.
    #[error(
        "none of the {0} frames with labels has a labelled mark: there is nothing to measure the lane network on"
    )]
    NothingToScore(usize),
    /// Frames of the scenario's sensors fall between the loop's snapshots.
    #[error(
        "perception_period_s is {0}: to be measured in the closed loop it must be a multiple of 0.1 s"
    )]
    PerceptionPeriod(f64),
    /// A closed loop can't be run.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A file can't be read.
    #[error("{path}: {reason}")]
    File {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A point cloud, label or calibration is unusable.
    #[error(transparent)]
    Kitti(#[from] KittiError),
    /// A picture is unusable.
    #[error(transparent)]
    Recorded(#[from] RecordedError),
    /// A frame is refused or a network fails.
    #[error(transparent)]
    Perception(#[from] PerceiveError),
}

impl EvaluateError {
    /// No frame has the files that are needed; those lack which.
    pub(crate) fn none_with_files(lacking: &[Lacking]) -> Self {
        Self::NoLabelledFrame(said(lacking))
    }

    fn file(path: &Path, reason: impl ToString) -> Self {
        Self::File {
            path: path.display().to_string(),
            reason: reason.to_string(),
        }
    }
}

/// A file of a frame that was chosen because it has it.
pub(crate) fn file_of(file: &Option<PathBuf>) -> Result<&Path, EvaluateError> {
    file.as_deref()
        .ok_or_else(|| EvaluateError::NoLabelledFrame("its files are gone".to_owned()))
}
