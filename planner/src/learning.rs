//! The safe actor-critic (Alg. 2 of the paper) and its baselines.

mod action_set;
mod environment;
mod features;
mod nn;
mod situations;

pub use action_set::{ACTIONS, ActionSet, CHOICES, action_index};
pub use environment::{Environment, EnvironmentError, Options, Outcome, Shape};
pub use features::{
    CapCount, FeatureEncoder, GLOBAL_FEATURES, InvalidFeatures, NEIGHBOUR_FEATURES, OWN_FEATURES,
};
pub use situations::{Situation, SituationMut, Situations};
