//! Percepts over time and vehicles: what a connected vehicle knows.
//!
//! A [`Tracker`] gives the objects that a vehicle's own sensors find an identity and a velocity
//! over frames. The same tracker takes the messages of other vehicles, where sharing is on, and
//! keeps for each object who saw it and how old that is ([`covista_world::Track::sightings`]).
//! A [`Channel`] carries the messages, in process, to the vehicles within range: at once, or late
//! and from senders that are wrong about where they are ([`ChannelSettings`]).
//!
//! *Architecture invariant:* this crate knows no truth. It sees percepts, poses and messages, and
//! nothing tells it how many objects there are. A vehicle broadcasts only what its own sensors
//! measured, as it was measured, so that no information comes back to it as if it were new.

mod association;
mod boundary;
mod channel;
mod estimate;
mod filter;
mod known_object;
mod own_path;
mod pose_noise;
mod settings;
mod tracker;

pub use boundary::ReceptionCounts;
pub use channel::{Channel, ChannelSettings, Delivery, encoded_len};
pub use pose_noise::PoseNoise;
pub use settings::TrackerSettings;
pub use tracker::{OwnState, Tracker};
