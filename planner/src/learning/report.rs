use serde::{Deserialize, Serialize};

/// What an episode of one environment came to.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EpisodeReport {
    /// Behaviour steps.
    pub steps: u64,
    /// Rewards, summed over the steps, mean over the agents: the paper's global reward.
    pub reward: f64,
    /// Actions executed that were not safe.
    pub unsafe_actions: u64,
    /// Emergency stops.
    pub emergency_stops: u64,
    /// Lane changes among the actions.
    pub lane_changes: u64,
    /// Agents that were terminated.
    pub terminated: u64,
}

/// What the updates of a round of episodes came to.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct UpdateReport {
    /// Updates in all.
    pub updates: u64,
    /// Mean squared error of the critics.
    pub critic_loss: f64,
    /// Mean value of the actors' choices by their critics.
    pub value: f64,
}

/// What a round of episodes came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoundReport {
    /// Of each environment.
    pub episodes: Vec<EpisodeReport>,
    /// Of all learners together; zero in an evaluation.
    pub updates: UpdateReport,
}
