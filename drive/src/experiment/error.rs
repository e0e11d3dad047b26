use std::path::PathBuf;

use covista_planner::learning::{EnvironmentError, LearningError};
use covista_traffic::{RingError, ScenarioError};

use crate::{RingEnvironmentError, RunError, TrainingError, networked::InvalidDiscount};

/// Why an experiment cannot be run or put together.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A policy cannot be read.
    #[error(
        "cannot read the policy {path}: {source}; name the folder it is in with --policies, or train it with --retrain"
    )]
    Policy {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: std::io::Error,
    },
    /// A policy of another kind or size than its name or the loop asks for.
    #[error("the policy {path} {problem}; train it anew with --retrain")]
    Unfit {
        /// The file.
        path: PathBuf,
        /// What it is and what it should be.
        problem: String,
    },
    /// A behaviour is asked for whose policy was not loaded.
    #[error("the policy of {0} is not loaded; load it before the cases are driven")]
    NotLoaded(&'static str),
    /// Percepts are asked for whose error model was not loaded.
    #[error("statistical percepts need an error model; give one")]
    NoErrorModel,
    /// Percepts are asked for whose networks were not opened.
    #[error(
        "percepts of networks need the networks; open them, and name their hashes, before the cases are driven"
    )]
    NoNetworks,
    /// A file of `covista train` that cannot be used.
    #[error("{path}: {problem}; give a folder that `covista train` has written")]
    Training {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// Learning curves that cannot be compared.
    #[error("{0}")]
    Trainings(String),
    /// An episode too short to show anything.
    #[error("an episode of 0 steps shows nothing; give --episode 1 or more")]
    NoSteps,
    /// A loop cannot be set up.
    #[error(transparent)]
    Environment(#[from] RingEnvironmentError),
    /// A loop cannot go on.
    #[error(transparent)]
    Step(#[from] EnvironmentError),
    /// A loop of human drivers cannot be set up or go on.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// A policy is damaged, or a training cannot go on.
    #[error(transparent)]
    Learning(#[from] LearningError),
    /// A training cannot be set up.
    #[error(transparent)]
    Config(#[from] TrainingError),
    /// A game has no values.
    #[error(transparent)]
    Discount(#[from] InvalidDiscount),
    /// A scenario cannot be built.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A scenario cannot be driven.
    #[error(transparent)]
    Run(#[from] RunError),
}
