use covista_world::{Action, LANE_COUNT, LaneIndex, StationId};
use serde::{Deserialize, Serialize};

use super::SituationMut;
use crate::{Manoeuvre, Neighbour, Observation};

/// Features of a vehicle's own state.
pub const OWN_FEATURES: usize = 13;
/// Features of one neighbour.
pub const NEIGHBOUR_FEATURES: usize = 17;
/// Features of a CAV in the global state of a centralised critic.
pub const GLOBAL_FEATURES: usize = OWN_FEATURES + 2;

/// What counts as one, so that features lie about in [-1, 1]; what lies outside is clamped.
const RANGE_M: f64 = 150.0;
const NEAR_M: f64 = 10.0;
const ACROSS_M: f64 = 10.0;
const SPEED_MPS: f64 = 20.0;
const RELATIVE_SPEED_MPS: f64 = 15.0;
const LENGTH_M: f64 = 20.0;
const HEADING_RAD: f64 = 0.3;
const CURVATURE_PER_M: f64 = 0.02;
const AGE_S: f64 = 5.0;

/// Why a situation cannot be encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum InvalidFeatures {
    /// An own number is not finite.
    #[error("the observation's own state has a number that is not finite; check who made it")]
    OwnState,
    /// A neighbour's number is not finite.
    #[error("neighbour {0} has a number that is not finite; check the tracker that made it")]
    Neighbour(u32),
}

/// How often the cap on neighbours left some out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CapCount {
    /// Situations encoded.
    pub situations: u64,
    /// Those with more than K neighbours.
    pub capped: u64,
    /// Neighbours left out in all.
    pub left_out: u64,
}

/// Turns what a CAV knows into a fixed number of features, with at most K neighbours.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureEncoder {
    /// The length of the road where it is a loop: distances are taken the shorter way round.
    pub loop_length_m: Option<f64>,
    /// How often K was too small.
    pub cap: CapCount,
    nearest: Vec<(f64, usize)>,
}

impl FeatureEncoder {
    /// For a road that is a loop of this length, or none.
    pub fn new(loop_length_m: Option<f64>) -> Self {
        Self {
            loop_length_m,
            cap: CapCount::default(),
            nearest: Vec::new(),
        }
    }

    /// Writes own state and nearest neighbours of `observation` into `row`; `agent_of` tells which
    /// agent a station is. Legal and safe actions stay as they are. The global part, where the row
    /// has one, gets the own state and the place on the loop.
    ///
    /// # Errors
    /// When a number is not finite; nothing is written then.
    pub fn encode(
        &mut self,
        observation: &Observation,
        agent_of: impl Fn(StationId) -> Option<u32>,
        row: &mut SituationMut<'_>,
    ) -> Result<(), InvalidFeatures> {
        check(observation)?;
        let loop_length_m = self.loop_length_m;
        self.nearest.clear();
        self.nearest.extend(
            observation
                .neighbours
                .iter()
                .enumerate()
                .map(|(index, other)| {
                    let (along_m, across_m) = offset_m(observation, other, loop_length_m);
                    (along_m.hypot(across_m), index)
                }),
        );
        self.nearest
            .sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let known = self.nearest.len().min(row.agents.len());
        let left_out = self.nearest.len() - known;
        self.cap.situations += 1;
        self.cap.capped += u64::from(left_out > 0);
        self.cap.left_out += left_out as u64;

        let own = own_features(observation);
        row.own.copy_from_slice(&own);
        if let Some(global) = row.global.first_chunk_mut::<GLOBAL_FEATURES>() {
            global[..OWN_FEATURES].copy_from_slice(&own);
            let round = std::f64::consts::TAU / self.loop_length_m.unwrap_or(10.0 * RANGE_M);
            global[OWN_FEATURES] = (observation.s_m * round).sin() as f32;
            global[OWN_FEATURES + 1] = (observation.s_m * round).cos() as f32;
        }
        *row.known = known;
        for (slot, &(_, index)) in self.nearest[..known].iter().enumerate() {
            let other = &observation.neighbours[index];
            row.agents[slot] = other.station.and_then(&agent_of);
            row.neighbours[slot * NEIGHBOUR_FEATURES..][..NEIGHBOUR_FEATURES]
                .copy_from_slice(&self.neighbour_features(observation, other));
        }
        Ok(())
    }

    fn neighbour_features(
        &self,
        observation: &Observation,
        other: &Neighbour,
    ) -> [f32; NEIGHBOUR_FEATURES] {
        let (along_m, across_m) = offset_m(observation, other, self.loop_length_m);
        let between_m = (other.length_m + observation.length_m) / 2.0;
        let gap_m = (along_m.abs() - between_m).max(0.0);
        let lanes_off = |lane: Option<LaneIndex>| {
            lane.map(|lane| i16::from(lane.get()) - i16::from(observation.lane.get()))
        };
        let (lane, entering) = (lanes_off(other.lane), lanes_off(other.entering));
        let is = |holds: bool| f64::from(u8::from(holds));
        clamped([
            along_m / RANGE_M,
            along_m.signum() / (1.0 + gap_m / NEAR_M),
            across_m / ACROSS_M,
            (other.speed_mps - observation.speed_mps) / RELATIVE_SPEED_MPS,
            other.speed_std_mps / RELATIVE_SPEED_MPS,
            other.length_m / LENGTH_M,
            other.age_s / AGE_S,
            is(lane == Some(-2)),
            is(lane == Some(-1)),
            is(lane == Some(0)),
            is(lane == Some(1)),
            is(lane == Some(2)),
            is(other.station.is_some()),
            is(other.action == Some(Action::ChangeLeft)),
            is(other.action == Some(Action::ChangeRight)),
            is(other.action == Some(Action::EmergencyStop)),
            is(entering == Some(0)),
        ])
    }
}

/// From the own centre to the other's, along the road and to the left; round a loop the shorter way.
fn offset_m(
    observation: &Observation,
    other: &Neighbour,
    loop_length_m: Option<f64>,
) -> (f64, f64) {
    let along_m = other.s_m - observation.s_m;
    let turns_m = loop_length_m.map_or(0.0, |length_m| length_m * (along_m / length_m).round());
    (along_m - turns_m, other.d_m - observation.d_m)
}

fn own_features(observation: &Observation) -> [f32; OWN_FEATURES] {
    let (phase, progress) = match observation.manoeuvre {
        Manoeuvre::KeepingLane => (0.0, 0.0),
        Manoeuvre::ChangingLane { from, to, progress } => {
            (if to < from { 1.0 } else { -1.0 }, progress)
        }
    };
    let is_in = |lane: u8| f64::from(u8::from(observation.lane.get() == lane));
    let lanes: [f64; LANE_COUNT as usize] = std::array::from_fn(|lane| is_in(lane as u8));
    clamped([
        observation.speed_mps / SPEED_MPS,
        observation.desired_speed_mps / SPEED_MPS - 1.0,
        (observation.speed_mps - observation.desired_speed_mps) / RELATIVE_SPEED_MPS,
        observation.d_m / ACROSS_M,
        observation.psi_rad / HEADING_RAD,
        observation.curvature_per_m / CURVATURE_PER_M,
        observation.length_m / LENGTH_M,
        lanes[0],
        lanes[1],
        lanes[2],
        phase,
        progress,
        phase * progress,
    ])
}

fn clamped<const N: usize>(features: [f64; N]) -> [f32; N] {
    features.map(|feature| feature.clamp(-1.0, 1.0) as f32)
}

fn check(observation: &Observation) -> Result<(), InvalidFeatures> {
    let progress = match observation.manoeuvre {
        Manoeuvre::KeepingLane => 0.0,
        Manoeuvre::ChangingLane { progress, .. } => progress,
    };
    let own = [
        observation.s_m,
        observation.d_m,
        observation.psi_rad,
        observation.speed_mps,
        observation.length_m,
        observation.desired_speed_mps,
        observation.curvature_per_m,
        progress,
    ];
    if !own.iter().all(|number| number.is_finite()) {
        return Err(InvalidFeatures::OwnState);
    }
    let is_finite = |other: &&Neighbour| {
        [
            other.s_m,
            other.d_m,
            other.speed_mps,
            other.length_m,
            other.age_s,
        ]
        .iter()
        .all(|number| number.is_finite())
            && !other.speed_std_mps.is_nan()
    };
    match observation
        .neighbours
        .iter()
        .find(|other| !is_finite(other))
    {
        Some(other) => Err(InvalidFeatures::Neighbour(other.id)),
        None => Ok(()),
    }
}
