use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::{Action, LaneIndex, ObjectClass, Se2Pose, VehicleDimensions};

/// The identity of a V2V station (ETSI TS 102 894-2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct StationId(pub u32);

/// The kinematic state of an object in the world frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObjectState {
    /// Pose of the body's centre.
    pub center: Se2Pose,
    /// Velocity in m/s.
    pub velocity_mps: Vector2<f64>,
    /// Length in metres.
    pub length_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Height in metres.
    pub height_m: f64,
    /// Class.
    pub class: ObjectClass,
}

/// An object as one station reports it (ETSI TS 103 324, `PerceivedObject`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PerceivedObject {
    /// The sender's number for the object.
    pub object_id: u32,
    /// State at `measured_s`.
    pub state: ObjectState,
    /// Standard deviation of the position in metres.
    pub position_std_m: f64,
    /// Standard deviation of the velocity in m/s.
    pub velocity_std_mps: f64,
    /// Lane by the sender's fusion.
    pub lane: Option<LaneIndex>,
    /// Time of the sender's last own measurement of it, in seconds.
    pub measured_s: f64,
    /// Confidence that it exists, in [0, 1].
    pub confidence: f64,
}

/// What a CAV broadcasts: state, action, perceived objects (Section II of the paper; in the shape
/// of ETSI TS 103 324's message).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CollectivePerceptionMessage {
    /// Sender.
    pub station: StationId,
    /// Time of the sender's state, in seconds.
    pub time_s: f64,
    /// Pose of the sender's rear axle in the world.
    pub pose: Se2Pose,
    /// The sender's speed in m/s.
    pub speed_mps: f64,
    /// The sender's acceleration in m/s^2.
    pub accel_mps2: f64,
    /// The sender's dimensions.
    pub dimensions: VehicleDimensions,
    /// The sender's lane.
    pub lane: LaneIndex,
    /// The action that it executes or announces.
    pub action: Action,
    /// When it announced that action, in seconds.
    pub announced_s: f64,
    /// Vehicles it perceives itself.
    pub objects: Vec<PerceivedObject>,
}

/// Who saw an object, and when last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// The station whose sensors saw it.
    pub station: StationId,
    /// Time of the measurement in seconds.
    pub measured_s: f64,
}

/// An object as a CAV knows it over time, in the world frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The tracker's identity for the object; never used again for another.
    pub id: u32,
    /// The station, where the object is itself a CAV that was heard.
    pub station: Option<StationId>,
    /// State at `time_s`.
    pub state: ObjectState,
    /// Time of the state in seconds.
    pub time_s: f64,
    /// Standard deviation of the position in metres, at its newest measurement: what the object
    /// may have done since is for whoever reads the track to bound.
    pub position_std_m: f64,
    /// Standard deviation of the velocity in m/s, at its newest measurement.
    pub velocity_std_mps: f64,
    /// Confidence that it exists, in [0, 1].
    pub confidence: f64,
    /// Its lane index by vision, own or shared; `None` where it can't be known.
    pub lane: Option<LaneIndex>,
    /// The action that it announced, where it is a CAV.
    pub action: Option<Action>,
    /// When it announced that action, in seconds.
    pub announced_s: Option<f64>,
    /// The newest measurement of each station that saw it, by station.
    pub sightings: Vec<Sighting>,
}

impl Track {
    /// Time of the newest measurement by anybody, in seconds.
    pub fn measured_s(&self) -> f64 {
        self.sightings
            .iter()
            .fold(f64::NEG_INFINITY, |newest, sighting| {
                newest.max(sighting.measured_s)
            })
    }

    /// When `station`'s own sensors last saw it.
    pub fn seen_by(&self, station: StationId) -> Option<f64> {
        self.sightings
            .iter()
            .find(|sighting| sighting.station == station)
            .map(|sighting| sighting.measured_s)
    }
}
