use covista_control::{ControlSettings, SettingsError};
use covista_perception::PerceiveError;
use covista_planner::{
    InvalidObservation, Reward,
    learning::{GLOBAL_FEATURES, InvalidFeatures, NEIGHBOUR_FEATURES, OWN_FEATURES, Shape},
};
use covista_sensors::ErrorModelError;
use covista_traffic::{RingError, RingSettings};
use serde::{Deserialize, Serialize};

use super::RingPerception;

/// Who drives on the ring, what they know and what they are rewarded for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RingEnvironmentSettings {
    /// The traffic.
    pub ring: RingSettings,
    /// The controller of every CAV.
    pub control: ControlSettings,
    /// How they come to know of the others.
    #[serde(skip_serializing_if = "RingPerception::is_exact")]
    pub perception: RingPerception,
    /// Whether CAVs tell each other what they are about and whom they see.
    pub sharing: bool,
    /// How far their messages reach in metres, along the road.
    pub communication_m: f64,
    /// Most neighbours that are kept, K.
    pub neighbours: usize,
    /// Behaviour steps of an episode, 0.5 s each.
    pub steps: u64,
    /// The reward.
    pub reward: Reward,
    /// Whether a CAV that touches another vehicle, or steers off the road, ends the episode.
    pub ends_at_collision: bool,
    /// Whether the monitor looks on: [`crate::RingEnvironment::safety`].
    pub watched: bool,
}

impl RingEnvironmentSettings {
    /// The sizes of what is learnt from.
    pub fn shape(&self) -> Shape {
        Shape {
            agents: self.ring.cavs,
            own: OWN_FEATURES,
            neighbours: self.neighbours,
            neighbour: NEIGHBOUR_FEATURES,
            global: GLOBAL_FEATURES,
        }
    }
}

impl Default for RingEnvironmentSettings {
    fn default() -> Self {
        Self {
            ring: RingSettings {
                cavs: 18,
                ..RingSettings::default()
            },
            control: ControlSettings::default(),
            perception: RingPerception::default(),
            sharing: true,
            communication_m: 150.0,
            neighbours: 6,
            steps: 200,
            reward: Reward::default(),
            ends_at_collision: true,
            watched: true,
        }
    }
}

/// Why the closed loop on the ring can't be set up or go on.
#[derive(Debug, thiserror::Error)]
pub enum RingEnvironmentError {
    /// There is nobody to learn.
    #[error("a ring without CAVs has nobody to decide; set ring.cavs to 1 or more")]
    NoCavs,
    /// An episode of no length.
    #[error("an episode of 0 steps is none; set steps to 1 or more")]
    NoSteps,
    /// No range at all.
    #[error("communication_m = {0} is no distance; set it to 0 m or more")]
    Communication(f64),
    /// The traffic.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// The controller.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The errors of perception.
    #[error(transparent)]
    Errors(#[from] ErrorModelError),
    /// Networks are asked for, and there are none.
    #[error(
        "perception = \"network\" needs the networks, which were not opened here; give them, or set perception to \"exact\" or \"statistical\""
    )]
    NoNetworks,
    /// A network.
    #[error(transparent)]
    Perceive(#[from] PerceiveError),
    /// What a CAV knows.
    #[error(transparent)]
    Observation(#[from] InvalidObservation),
    /// Its features.
    #[error(transparent)]
    Features(#[from] InvalidFeatures),
}
