//! The experiments of the paper's Section V: lists of cases, what driving each of them gives, and
//! what they come to together, beside what the paper found.

mod behaviour;
mod case;
mod claims;
mod error;
mod figures;
mod human_ring;
mod kind;
mod means;
mod paper;
mod plan;
mod policies;
mod results;
mod ring_case;
mod scene_case;
mod seeds;
mod spread;
mod summaries;
mod training_case;
mod truncation_case;

pub use behaviour::Behaviour;
pub use case::{Case, LoopCase, NetworkedGame, Percepts, SceneCase, TrainingCase, TruncationCase};
pub use error::ExperimentError;
pub use figures::{Figures, Headways, LearningCurve, LoopFigures, SceneFigures, TruncationFigures};
pub use kind::Experiment;
pub use means::Means;
pub use plan::{ExperimentOptions, Plan};
pub use policies::{Policies, policy_file};
pub use results::{Claim, Diagram, Key, Line, Quantity, Results, Row};
pub use seeds::Seeds;
pub use spread::{Spread, rank_correlation};
pub use training_case::{read_training, train, training_of};
