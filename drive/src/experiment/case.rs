use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Behaviour;
use crate::{ControlSettings, RingEnvironmentSettings, RingPerception, TrainingConfig};

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
    /// A networked game whose global Q is computed and truncated.
    Truncation(TruncationCase),
}

/// An episode on the three-lane loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopCase {
    /// Who decides for the CAVs.
    pub behaviour: Behaviour,
    /// SHA-256 of the policy's file, where the behaviour is learnt.
    pub policy_sha256: Option<String>,
    /// SHA-256 of the networks by their ids, where percepts come from them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub networks: BTreeMap<String, String>,
    /// The traffic with its seed, the controller, the length of the episode.
    pub environment: RingEnvironmentSettings,
    /// Whether a learned behaviour explores as in the last episodes of its training.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub explores: bool,
    /// Whether headways are kept over time.
    pub keeps_headways: bool,
    /// Whether it is measured how smoothly the CAVs drive.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keeps_motion: bool,
}

/// Where the CAVs' percepts come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Percepts {
    /// Exact, of what is in line of sight.
    Truth,
    /// With the networks' errors, as drawn from the fitted model.
    Statistical,
    /// By the networks, on rendered pictures and sweeps.
    Network,
}

impl Percepts {
    /// The same for CAVs on the three-lane loop.
    pub(super) fn on_ring(self) -> RingPerception {
        match self {
            Self::Truth => RingPerception::Exact,
            Self::Statistical => RingPerception::Statistical,
            Self::Network => RingPerception::Network,
        }
    }
}

/// A run of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneCase {
    /// A built-in scenario.
    pub scenario: String,
    /// Where percepts come from.
    pub percepts: Percepts,
    /// SHA-256 of the networks by their ids, where percepts come from them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub networks: BTreeMap<String, String>,
    /// Whether CAVs share what they see.
    pub sharing: bool,
    /// Seed of everything random.
    pub seed: u64,
    /// Simulated seconds.
    pub duration_s: f64,
    /// Of the CAVs' controllers.
    pub control: ControlSettings,
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

/// A Markov game of vehicles on a ring, each coupled to the one behind and the one ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NetworkedGame {
    /// Dense traffic with drivers drawn from a seed.
    Traffic {
        /// Seed of the drivers.
        seed: u64,
    },
    /// A signal that is passed on as fast as the paper's assumption allows: the worst there is.
    Relay,
}

impl NetworkedGame {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Traffic { .. } => "traffic",
            Self::Relay => "relay",
        }
    }
}

/// The global Q of a game, truncated to every kappa.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruncationCase {
    /// The game.
    pub game: NetworkedGame,
    /// Vehicles on the ring.
    pub vehicles: usize,
    /// gamma.
    pub discount: f64,
}

impl Case {
    /// A name for a file, of its own among the cases of an experiment.
    pub fn name(&self) -> String {
        match self {
            Self::Loop(case) => {
                let ring = &case.environment.ring;
                let perception = case.environment.perception.suffix();
                let exploring = if case.explores { "-exploring" } else { "" };
                format!(
                    "{}{exploring}-cavs{:02}-rho{:.2}-seed{}{perception}",
                    case.behaviour.name(),
                    ring.cavs,
                    ring.density,
                    ring.seed
                )
            }
            Self::Scene(case) => {
                let sharing = if case.sharing { "on" } else { "off" };
                let perception = case.percepts.on_ring().suffix();
                format!("sharing-{sharing}-seed{}{perception}", case.seed)
            }
            Self::Training(case) => {
                let training = &case.config.training;
                let behaviour = Behaviour::of(training.algorithm);
                format!("{}-seed{}", behaviour.name(), training.seed)
            }
            Self::Truncation(case) => {
                let name = format!("{}-gamma{:.2}", case.game.name(), case.discount);
                match case.game {
                    NetworkedGame::Traffic { seed } => format!("{name}-seed{seed}"),
                    NetworkedGame::Relay => name,
                }
            }
        }
    }
}
