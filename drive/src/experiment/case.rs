use serde::{Deserialize, Serialize};

use super::Behaviour;
use crate::{RingEnvironmentSettings, TrainingConfig};

/// One run of an experiment, with everything that its outcome depends on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Case {
    /// An episode on the three-lane loop.
    Loop(LoopCase),
    /// A run of a scenario, as `covista demo` makes it.
    Scene(SceneCase),
    /// A training, for its learning curve.
    Training(TrainingCase),
}

/// An episode on the three-lane loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopCase {
    /// Who decides for the CAVs.
    pub behaviour: Behaviour,
    /// SHA-256 of the policy's file, where the behaviour is learnt.
    pub policy_sha256: Option<String>,
    /// The traffic with its seed, the controller, the length of the episode.
    pub environment: RingEnvironmentSettings,
    /// Whether headways are kept over time.
    pub keeps_headways: bool,
    /// Whether it is measured how smoothly the CAVs drive.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keeps_motion: bool,
}

/// Where percepts come from in a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Percepts {
    /// Exact, of what is in line of sight.
    Truth,
    /// With the networks' errors, as drawn from the fitted model.
    Statistical,
}

/// A run of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneCase {
    /// A built-in scenario.
    pub scenario: String,
    /// Where percepts come from.
    pub percepts: Percepts,
    /// Whether CAVs share what they see.
    pub sharing: bool,
    /// Seed of everything random.
    pub seed: u64,
    /// Simulated seconds.
    pub duration_s: f64,
}

/// A training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainingCase {
    /// What is trained, where and how, with its seed.
    pub config: TrainingConfig,
    /// Decisions of each learner; the round in which they are reached is finished.
    pub decisions: u64,
}

impl TrainingCase {
    /// Whether both differ only in who learns, with which filter and seed, and in who looks on.
    pub(super) fn is_comparable(&self, other: &Self) -> bool {
        let mut like = self.clone();
        let (to, from) = (&mut like.config, &other.config);
        to.training.algorithm = from.training.algorithm;
        to.training.seed = from.training.seed;
        to.environment.ring.seed = from.environment.ring.seed;
        to.environment.control.mode = from.environment.control.mode;
        to.environment.watched = from.environment.watched;
        like == *other
    }
}

impl Case {
    /// A name for a file, of its own among the cases of an experiment.
    pub fn name(&self) -> String {
        match self {
            Self::Loop(case) => {
                let ring = &case.environment.ring;
                format!(
                    "{}-cavs{:02}-rho{:.2}-seed{}",
                    case.behaviour.name(),
                    ring.cavs,
                    ring.density,
                    ring.seed
                )
            }
            Self::Scene(case) => {
                let sharing = if case.sharing { "on" } else { "off" };
                format!("sharing-{sharing}-seed{}", case.seed)
            }
            Self::Training(case) => {
                let training = &case.config.training;
                let behaviour = Behaviour::of(training.algorithm);
                format!("{}-seed{}", behaviour.name(), training.seed)
            }
        }
    }
}
