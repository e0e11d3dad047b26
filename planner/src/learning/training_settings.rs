use serde::{Deserialize, Serialize};

use super::Hyperparameters;

/// What learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Algorithm {
    /// Alg. 2: truncated critic, safe action mapping.
    SafeActorCritic,
    /// The baseline: a critic of the global state and the joint action, any legal action.
    Maddpg,
    /// The same with the safe action mapping.
    MaddpgMapped,
    /// The baseline without behaviours: the action is the control input itself, the critic is
    /// truncated as in Alg. 2.
    EndToEnd,
}

impl Algorithm {
    /// Whether only safe actions are executed.
    pub fn is_mapped(self) -> bool {
        self != Self::Maddpg
    }

    pub(super) fn is_central(self) -> bool {
        matches!(self, Self::Maddpg | Self::MaddpgMapped)
    }

    /// Whether its actions are control inputs ([`super::InputShares`]).
    pub fn steers(self) -> bool {
        self == Self::EndToEnd
    }
}

/// Who learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sharing {
    /// Each agent has networks and a buffer of its own, as in Alg. 2.
    Independent,
    /// All agents use and train the same networks.
    Shared,
}

/// What an agent learns to make large.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Objective {
    /// Its own reward r^i, as Alg. 2 is written.
    Own,
    /// The mean reward of itself and of the CAVs among its neighbours. The paper's objective is the
    /// mean over all, G; its gradient by a policy is that of all Q^j, of which by Theorem 2 those of
    /// the neighbourhood are the ones that the policy's actions reach.
    Neighbourhood,
}

/// What to train and how.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingSettings {
    /// What learns.
    pub algorithm: Algorithm,
    /// Who learns.
    pub sharing: Sharing,
    /// What it learns for.
    pub objective: Objective,
    /// How it learns.
    pub hyperparameters: Hyperparameters,
    /// Of all random numbers.
    pub seed: u64,
}

impl Default for TrainingSettings {
    fn default() -> Self {
        Self {
            algorithm: Algorithm::SafeActorCritic,
            sharing: Sharing::Independent,
            objective: Objective::Own,
            hyperparameters: Hyperparameters::default(),
            seed: 0,
        }
    }
}
