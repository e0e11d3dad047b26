//! The safe actor-critic (Alg. 2 of the paper) and its baselines.
//!
//! A critic is trained towards
//!
//! ```text
//! y = r + gamma sum_a Phi(pi')(a | s') Q'(s', a, a'^N)
//! ```
//!
//! and the actor up the gradient of J = sum_a Phi(pi)(a | s) Q(s, a, a^N).
//!
//! *The relaxation.* Alg. 2 writes the gradient by the action, but the action is one of three. Here
//! the critic is extended from the corners of the simplex of distributions to all of it, linearly:
//! Q(s, p) = sum_a p_a Q(s, a). Its gradient by p_a is Q(s, a), exact, of no variance, and the
//! critic is only ever asked about actions that can be executed, as it was trained. A straight-through
//! or Gumbel estimate would ask it in between and add noise; three actions cost next to nothing,
//! because the own action enters the critic after the LSTM: one pass values all of them.
//!
//! *The mapping.* Phi(pi) is pi renormalised over the safe set C_A, and the emergency stop where it
//! is empty. It is what is executed, what y bootstraps from (as written, Alg. 2 would bootstrap from
//! pi', which may be unsafe), and what the actor's gradient goes through.
//!
//! *Neighbours' actions.* The critic sees them at s and, in y, those really taken at s'. The actor
//! never does: otherwise CAVs would wait for each other.
//!
//! *The end-to-end variant* takes the control input for the action. Its actor is deterministic, two
//! numbers in [-1, 1]; its critic is the truncated one, reads them where the other has one of three
//! actions, and gives the actor its slope by them. There is nothing to map: the filter takes any input.

mod action_set;
mod arena;
mod batch;
mod benchmark;
mod checkpoint;
mod environment;
mod error;
mod exploration;
mod features;
mod hyperparameters;
mod input_shares;
mod kept_action;
mod learned_policy;
mod learner;
mod network;
mod nn;
mod plan;
mod policy_distribution;
mod replay;
mod report;
mod seat;
mod situations;
mod trainer;
mod training_settings;

#[cfg(test)]
mod tests;

pub use action_set::{ACTIONS, ActionSet, CHOICES, action_index};
pub use benchmark::{TimedLearner, UpdateCost, UpdateSizes, update_cost};
pub use checkpoint::{CheckpointHeader, Counts};
pub use environment::{Environment, EnvironmentError, Options, Outcome, Shape};
pub use error::LearningError;
pub use exploration::Exploration;
pub use features::{
    CapCount, FeatureEncoder, GLOBAL_FEATURES, InvalidFeatures, NEIGHBOUR_FEATURES, OWN_FEATURES,
};
pub use hyperparameters::Hyperparameters;
pub use input_shares::InputShares;
pub use learned_policy::LearnedPolicy;
pub use learner::Losses;
pub use nn::AdamSettings;
pub use policy_distribution::{any_of, mapped_best};
pub use report::{EpisodeReport, RoundReport, UpdateReport};
pub use situations::{Situation, SituationMut, Situations};
pub use trainer::{Trainer, mixed};
pub use training_settings::{Algorithm, Objective, Sharing, TrainingSettings};
