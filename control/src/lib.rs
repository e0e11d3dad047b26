//! Preference to control input: a verdict on each action, and for the action taken the control
//! input u = [tan(delta), a] nearest to its reference within the safe set.
//!
//! *Architecture invariant:* this crate is safety-critical and small. It knows the road, the ego
//! vehicle's own state and what the vehicle itself knows of others; it knows no truth, no network
//! and no policy, and does no I/O.
//!
//! ```text
//! minimise    || u - U a ||^2
//! subject to  h_k(x+) >= (1 - eta) h_k(x)   where h_k(x) >= 0
//!             h_k(x+) >= h_k(x)             where h_k(x) <  0,  for every barrier k
//!             u in U,  v + a Ts >= 0
//! ```
//!
//! The barriers are not affine in x: every one is turned into the exact interval that it leaves to
//! one component of u (module `barriers`), so the QP's rows carry no linearisation error. A gap is
//! the arc length of the lane itself from the circle round the rear axle that holds the ego
//! vehicle's front to the circle that holds the other vehicle at any heading.
//!
//! After a lane change has begun the rows towards followers are no longer hard: what they lack is
//! reported as [`ControlOutput::rear_slack_mps2`].
//!
//! The flow of one step is [`Controller::control`]: manoeuvre, reference, rows, filter.

mod arc;
mod barriers;
mod controller;
mod distance;
mod execution;
mod filter;
mod lanes;
mod manoeuvre;
mod memory;
mod monotone;
mod neighbour;
mod paper;
mod path;
mod profile;
mod qp;
mod reference;
mod rows;
mod settings;
mod sight;
mod situation;
#[cfg(test)]
mod tests;
mod validator;
mod verdict;

pub use barriers::affine::AffineBarrier;
pub use controller::{ControlOutput, Controller};
pub use distance::Closing;
pub use lanes::LaneSet;
pub use manoeuvre::Manoeuvre;
pub use memory::{Excuse, Excused};
pub use neighbour::{Measured, Neighbour};
pub use profile::RoadProfile;
pub use settings::{
    ControlSettings, Formulation, Mode, QpSettings, ReferenceSettings, SafetySettings,
    SettingsError, Solver,
};
pub use sight::{Clear, SightLine, clear_until_m};
pub use situation::{EgoState, Situation};
