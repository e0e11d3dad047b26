//! What a connected vehicle knows, turned into a preference over keep lane, change left and
//! change right.
//!
//! A [`Policy`] gives each action of the paper's set a value; [`safe_action_mapping`] takes the
//! best action that is safe (Alg. 1 of the paper). [`FreeLane`] is the first policy.
//!
//! *Architecture invariant:* a policy reads an [`Observation`] and nothing else: the road, the
//! vehicle's own state and its own tracks, in road coordinates. It knows neither the scenario nor
//! the truth, and it orders actions only; whether one is safe is for the verdicts passed in.

mod action_values;
mod free_lane;
pub mod learning;
mod observation;
mod policy;
mod reward;
mod safe_action_mapping;

pub use action_values::ActionValues;
pub use free_lane::{FreeLane, FreeLaneSettings};
pub use observation::{InvalidObservation, Manoeuvre, Neighbour, Observation, OwnMotion};
pub use policy::Policy;
pub use reward::{COMFORT_THRESHOLD_MPS2, Reward, comfort};
pub use safe_action_mapping::{MappedAction, safe_action_mapping};
