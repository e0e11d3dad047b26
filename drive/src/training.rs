use std::path::{Path, PathBuf};

use covista_planner::learning::{LearningError, Trainer, TrainingSettings};
use serde::{Deserialize, Serialize};

use crate::{Networks, RingEnvironment, RingEnvironmentError, RingEnvironmentSettings};

/// What `covista train` does: which traffic, and who learns how.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingConfig {
    /// Loops that are driven side by side.
    pub environments: usize,
    /// Each of them.
    pub environment: RingEnvironmentSettings,
    /// The learners.
    pub training: TrainingSettings,
}

impl Default for TrainingConfig {
    fn default() -> Self {
        Self {
            environments: 1,
            environment: RingEnvironmentSettings::default(),
            training: TrainingSettings::default(),
        }
    }
}

/// Why a training can't begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// The configuration cannot be read.
    #[error("cannot read {path}: {source}; check the path given to --config")]
    Read {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: std::io::Error,
    },
    /// It is no TOML of these settings.
    #[error("{path}: {reason}; see docs/learning.md for the settings there are")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What is wrong, in one line.
        reason: String,
    },
    /// There is no loop to drive on.
    #[error("environments is 0; set it to 1 or more")]
    NoEnvironments,
    /// A loop.
    #[error(transparent)]
    Environment(#[from] RingEnvironmentError),
    /// A learner.
    #[error(transparent)]
    Learning(#[from] LearningError),
}

impl TrainingConfig {
    /// From a TOML file; what it leaves out keeps its default.
    ///
    /// # Errors
    /// When the file cannot be read or has an unknown field.
    pub fn load(path: &Path) -> Result<Self, TrainingError> {
        let text = std::fs::read_to_string(path).map_err(|source| TrainingError::Read {
            path: path.to_owned(),
            source,
        })?;
        toml::from_str(&text).map_err(|error| {
            let line = error.span().map_or(1, |span| {
                1 + text[..span.start.min(text.len())].matches('\n').count()
            });
            let message = error.message().lines().collect::<Vec<_>>().join(" ");
            TrainingError::Syntax {
                path: path.to_owned(),
                reason: format!("line {line}: {message}"),
            }
        })
    }

    /// New learners on these loops, with `networks` where perception asks for them.
    ///
    /// # Errors
    /// When a setting makes no sense, or networks are needed and not given.
    pub fn start(
        &self,
        networks: Option<&Networks>,
    ) -> Result<Trainer<RingEnvironment>, TrainingError> {
        Ok(Trainer::new(self.loops(networks)?, self.training)?)
    }

    /// Learners that go on where a checkpoint ends, with its settings, on these loops.
    ///
    /// # Errors
    /// As [`TrainingConfig::start`], or when the checkpoint is damaged or of other sizes.
    pub fn resume(
        &self,
        checkpoint: &Path,
        networks: Option<&Networks>,
    ) -> Result<Trainer<RingEnvironment>, TrainingError> {
        Ok(Trainer::resume(self.loops(networks)?, checkpoint)?)
    }

    fn loops(&self, networks: Option<&Networks>) -> Result<Vec<RingEnvironment>, TrainingError> {
        if self.environments == 0 {
            return Err(TrainingError::NoEnvironments);
        }
        let ring = || Ok(RingEnvironment::with_networks(self.environment, networks)?);
        (0..self.environments).map(|_| ring()).collect()
    }
}
