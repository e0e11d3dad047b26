use std::path::PathBuf;

use super::EnvironmentError;

/// Why the learner cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum LearningError {
    /// A setting makes no sense.
    #[error("hyperparameter {name} is {value}, it must be {must}")]
    Hyperparameter {
        /// Which.
        name: &'static str,
        /// As given.
        value: String,
        /// What is allowed.
        must: &'static str,
    },
    /// Environments that cannot learn together or at all.
    #[error("{0}")]
    Environments(String),
    /// A reward or feature is no finite number.
    #[error(
        "agent {agent} got {what} that is not finite; nothing was learnt from it, check the environment"
    )]
    NotFinite {
        /// Whose.
        agent: usize,
        /// What it was.
        what: &'static str,
    },
    /// The loss of a network is no finite number.
    #[error(
        "the {network}'s loss of learner {learner} is not finite after {updates} updates; its weights are those before this update: save them to look at, and lower the learning rate"
    )]
    Diverged {
        /// Which learner.
        learner: usize,
        /// `critic` or `actor`.
        network: &'static str,
        /// Updates done.
        updates: u64,
    },
    /// The environment failed.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A checkpoint cannot be read or written.
    #[error("checkpoint {}: {problem}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it and what to do.
        problem: String,
    },
}
