use std::{collections::BTreeSet, error::Error};

use covista_sharing::OwnState;
use covista_traffic::{Traffic, VehicleId};
use covista_world::{
    Calibration, CollectivePerceptionMessage, LaneMarks, Percept, SensorFrame, StationId, Track,
};

use crate::trace::TraceRow;

/// Whatever keeps an observer from recording a snapshot.
pub type RecordError = Box<dyn Error + Send + Sync>;

/// Takes up the snapshots of a run.
pub type Observe<'a> = dyn FnMut(&Snapshot<'_>) -> Result<(), RecordError> + 'a;

/// The closed loop at one instant, every 0.1 s, for whoever records it.
pub struct Snapshot<'a> {
    /// Time in seconds.
    pub time_s: f64,
    /// The truth.
    pub traffic: &'a Traffic,
    /// The truth, one row a vehicle.
    pub rows: Vec<TraceRow>,
    /// Pairs of CAVs between which messages pass.
    pub links: &'a [(StationId, StationId)],
    /// Each CAV's own state and percepts.
    pub cavs: Vec<CavSnapshot<'a>>,
    /// Who of the CAVs has line of sight to whom, from its LIDAR's place.
    pub in_sight: &'a BTreeSet<(VehicleId, VehicleId)>,
    /// The CAV whose sensors are shown, at its perception frames.
    pub focus: Option<FocusSnapshot<'a>>,
}

/// What one CAV tells of itself and perceives.
pub struct CavSnapshot<'a> {
    /// The vehicle.
    pub id: VehicleId,
    /// What it tells of itself.
    pub own: OwnState,
    /// At perception frames, what it perceives, in its vehicle frame.
    pub percepts: Option<&'a [Percept]>,
}

/// What one CAV measured and knows.
pub struct FocusSnapshot<'a> {
    /// The CAV.
    pub station: StationId,
    /// Mounting of its sensors.
    pub calibration: &'a Calibration,
    /// What it measured, where networks run.
    pub frame: Option<&'a (SensorFrame, LaneMarks)>,
    /// What it perceives in this frame, in its vehicle frame.
    pub percepts: &'a [Percept],
    /// What it knows.
    pub tracks: Vec<Track>,
    /// The messages that reached it last.
    pub heard: Vec<&'a CollectivePerceptionMessage>,
}
