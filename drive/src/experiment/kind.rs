use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::Behaviour;

/// An experiment of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Experiment {
    /// Velocity and comfort of all traffic, by the share of CAVs.
    CavRatio,
    /// Flow and comfort by density, at a CAV ratio of 0.6.
    Density,
    /// Unsafe actions by density.
    Safety,
    /// The least headway over time, at density 0.6.
    Headway,
    /// The reward of an episode over the training.
    EpisodeReward,
    /// How smooth trajectories are, beside those of control inputs as actions.
    ActionDesign,
    /// Standing vehicles behind a corner, with and without shared vision.
    ObstacleAtCorner,
    /// What truncating the Q-function to a neighbourhood costs, beside the bound of Theorem 2.
    Truncation,
}

impl Experiment {
    /// All of them, in the paper's order.
    pub const ALL: [Self; 8] = [
        Self::CavRatio,
        Self::Density,
        Self::Safety,
        Self::Headway,
        Self::EpisodeReward,
        Self::ActionDesign,
        Self::ObstacleAtCorner,
        Self::Truncation,
    ];

    /// Its name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::CavRatio => "cav-ratio",
            Self::Density => "density",
            Self::Safety => "safety",
            Self::Headway => "headway",
            Self::EpisodeReward => "episode-reward",
            Self::ActionDesign => "action-design",
            Self::ObstacleAtCorner => "obstacle-at-corner",
            Self::Truncation => "truncation",
        }
    }

    /// Whose CAVs are compared on the loop, in the order of the table.
    pub fn behaviours(self) -> &'static [Behaviour] {
        match self {
            Self::CavRatio => &[
                Behaviour::Ours,
                Behaviour::Unshared,
                Behaviour::MaddpgMapped,
                Behaviour::KeepLane,
                Behaviour::RandomSafe,
            ],
            Self::Density => &[Behaviour::Ours, Behaviour::Idm, Behaviour::Maddpg],
            Self::Safety | Self::Headway | Self::EpisodeReward => {
                &[Behaviour::Ours, Behaviour::Maddpg]
            }
            Self::ActionDesign => &[
                Behaviour::Ours,
                Behaviour::EndToEnd,
                Behaviour::EndToEndUnfiltered,
            ],
            Self::ObstacleAtCorner | Self::Truncation => &[],
        }
    }

    /// Those of them whose policies must be there.
    pub fn learned(self) -> Vec<Behaviour> {
        let is_needed = self != Self::EpisodeReward;
        let behaviours = self.behaviours().iter().copied();
        behaviours
            .filter(|of| is_needed && of.algorithm().is_some())
            .collect()
    }
}

impl FromStr for Experiment {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|known| known.name() == name);
        known.ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("there is no such experiment; take one of {names}")
        })
    }
}
