use covista_control::{Neighbour, RoadProfile, SafetySettings, SightLine};
use covista_perception::PerceiveError;
use covista_planner::{self as planner, InvalidObservation, Observation, OwnMotion};
use covista_traffic::Ring;
use covista_world::{LaneIndex, Road, Se2Pose, Track};
use serde::{Deserialize, Serialize};

use super::{cav::RingCav, sights::Sights, view::Shape};

/// How CAVs on the ring come to know of the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RingPerception {
    /// Exactly, as of the newest frame: whom they see, whom they hear, and whom those see.
    #[default]
    Exact,
    /// By tracks of percepts and messages, with the networks' errors as drawn from the fitted
    /// model.
    Statistical,
    /// By tracks of percepts and messages, with both networks on the rendered picture and sweep of
    /// each CAV; needs [`Networks`](crate::Networks).
    Network,
}

impl RingPerception {
    /// What tells its runs from others in names of files.
    pub(crate) fn suffix(self) -> &'static str {
        match self {
            Self::Exact => "",
            Self::Statistical => "-statistical",
            Self::Network => "-network",
        }
    }

    /// Whether it is without errors.
    pub fn is_exact(&self) -> bool {
        *self == Self::Exact
    }
}

/// An instant at which everybody looks and tells.
pub(super) struct Frame<'a> {
    pub ring: &'a Ring,
    pub cavs: &'a [RingCav],
    pub sights: &'a Sights,
    pub profile: &'a RoadProfile,
    pub safety: &'a SafetySettings,
    pub sharing: bool,
    pub communication_m: f64,
}

impl Frame<'_> {
    /// Whether CAV `one` hears CAV `other`.
    pub fn hears(&self, one: usize, other: usize) -> bool {
        let (vehicles, road) = (self.ring.vehicles(), self.ring.road());
        let away_m = vehicles[other].frenet().s_m - vehicles[one].frenet().s_m;
        let apart_m = away_m + road.laps_to(away_m, 0.0) * road.period_m();
        one != other && self.sharing && apart_m.abs() < self.communication_m
    }
}

/// What the CAVs of a ring know of the others.
pub(super) trait Knowledge: Send {
    /// Takes a frame up.
    ///
    /// # Errors
    /// When a network fails.
    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), PerceiveError>;

    /// How far CAV `index` at `pose` sees each lane free by its sweep; nowhere, without one. `None`
    /// where free sight is not measured, but exact.
    fn sight(
        &self,
        _index: usize,
        _pose: Se2Pose,
        _road: &Road,
        _time_s: f64,
        _safety: &SafetySettings,
    ) -> Option<SightLine> {
        None
    }

    /// Whether CAV `index` knows of `body`, at the image nearest to it, in `lane`.
    fn knows(&self, index: usize, lane: LaneIndex, body: &Shape) -> bool;

    /// Brings everything to `time_s`.
    fn carry_on(&mut self, profile: &RoadProfile, time_s: f64, safety: &SafetySettings);

    /// For the controller of CAV `index`, as of now.
    fn neighbours(&self, index: usize, neighbours: &mut Vec<Neighbour>);

    /// Places everything for the planner, as of the newest frame.
    ///
    /// # Errors
    /// When a number is not finite.
    fn observe(&mut self, ring: &Ring) -> Result<(), InvalidObservation>;

    /// For the planner of CAV `index`.
    fn observed(&self, index: usize) -> Vec<planner::Neighbour>;

    /// As tracks in the world, as CAV `index` has them at the newest frame.
    fn tracks(&self, ring: &Ring, index: usize) -> Vec<Track>;
}

/// `tracks` as the planner has them on the road of the ring.
pub(super) fn on_road(
    ring: &Ring,
    tracks: &[Track],
) -> Result<Vec<planner::Neighbour>, InvalidObservation> {
    let Some(any) = ring.vehicles().first() else {
        return Ok(Vec::new());
    };
    let road = ring.road().road();
    let own = OwnMotion {
        state: any.state(road),
        dimensions: any.dimensions(),
        lane: LaneIndex::RIGHTMOST,
        desired_speed_mps: any.desired_speed_mps,
        manoeuvre: planner::Manoeuvre::KeepingLane,
    };
    Ok(Observation::new(road, &own, tracks)?.neighbours)
}
