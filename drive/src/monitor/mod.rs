use std::collections::{BTreeMap, BTreeSet};

use covista_control::{Manoeuvre, SafetySettings, SightLine};
use covista_traffic::{VehicleId, VehicleKind};
use covista_world::{BicycleState, ControlInput, LaneIndex, Road, STEP_S, Track};

use crate::{
    cause::Cause,
    truth::{TrueVehicle, closing_distance_m},
};

/// Slower than this for [`STUCK_S`] on end counts as stuck.
const STUCK_MPS: f64 = 0.5;
const STUCK_S: f64 = 5.0;
/// h below this counts as violated: what the monitor's quadrature of the arc length may err by.
const TOLERANCE_M: f64 = 0.05;
/// From light on a vehicle to its confirmed track: two frames, the filter's and the step's delay.
const PERCEPTION_DELAY_S: f64 = 1.5;
/// Knowledge older than this breaks the promise's assumption on age.
const OLDEST_KNOWLEDGE_S: f64 = 1.0;
/// An assumption that broke this long ago still explains a violation: the longest time that
/// braking to standstill takes, and a perception frame.
const MEMORY_S: f64 = 3.0;
/// A track within this distance of the truth is a track of that vehicle.
const SAME_OBJECT_M: f64 = 4.0;

/// The true barriers of one CAV at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueBarriers {
    /// Distance barrier h in metres.
    pub h_m: f64,
    /// Collision barrier h_0 in metres.
    pub h0_m: f64,
    /// Distance between reference points in metres.
    pub headway_m: f64,
    /// Why h is negative, while it is.
    pub cause: Option<Cause>,
}

/// What the monitor may ask about one CAV besides the truth.
#[derive(Clone, Copy)]
pub struct CavView<'a> {
    /// The CAV.
    pub id: VehicleId,
    /// What it knows, to tell which assumption broke.
    pub tracks: &'a [Track],
    /// How far it takes each lane ahead to be free; `None` where it has looked at none yet.
    pub sight: Option<&'a SightLine>,
    /// What its controller is about.
    pub manoeuvre: Manoeuvre,
    /// Its true rear axle and speed.
    pub state: BicycleState,
    /// Front to rear axle.
    pub wheelbase_m: f64,
    /// The input applied from this step to the next; `None` leaves its motion unjudged.
    pub input: Option<ControlInput>,
}

#[derive(Debug, Default)]
struct PairState {
    in_sight_since_s: Option<f64>,
    /// The newest time at which an assumption on the CAV's knowledge of the other did not hold.
    broken: Option<(Cause, f64)>,
    /// Whether h_0 >= 0 at the last step.
    inside: bool,
    /// Lanes that the other vehicle occupied at the last step.
    occupied: BTreeSet<LaneIndex>,
    episode: Option<Cause>,
}

/// A CAV and a vehicle ahead of it, in lanes that both occupy.
struct Encounter<'a> {
    ego: &'a TrueVehicle,
    other: &'a TrueVehicle,
    view: &'a CavView<'a>,
    /// The lanes that both occupy.
    shared: &'a BTreeSet<LaneIndex>,
    /// The lanes that the CAV occupied at the last step.
    previous: &'a BTreeSet<LaneIndex>,
    h0_m: f64,
}

/// Watches the closed loop on the truth: gaps, barriers, collisions, standstill.
pub struct Monitor {
    settings: SafetySettings,
    pairs: BTreeMap<(VehicleId, VehicleId), PairState>,
    own_lanes: BTreeMap<VehicleId, BTreeSet<LaneIndex>>,
    slow_since_s: BTreeMap<VehicleId, f64>,
    stuck: BTreeSet<VehicleId>,
    collisions: BTreeSet<(VehicleId, VehicleId)>,
    causes: BTreeMap<Cause, usize>,
    current: BTreeMap<VehicleId, TrueBarriers>,
    min_headway_m: BTreeMap<VehicleId, f64>,
    changing: BTreeSet<VehicleId>,
    unsafe_actions: usize,
    collision_set_left: usize,
}

impl Monitor {
    /// A monitor of the promise that `settings` make.
    pub fn new(settings: SafetySettings) -> Self {
        Self {
            settings,
            pairs: BTreeMap::new(),
            own_lanes: BTreeMap::new(),
            slow_since_s: BTreeMap::new(),
            stuck: BTreeSet::new(),
            collisions: BTreeSet::new(),
            causes: BTreeMap::new(),
            current: BTreeMap::new(),
            min_headway_m: BTreeMap::new(),
            changing: BTreeSet::new(),
            unsafe_actions: 0,
            collision_set_left: 0,
        }
    }

    /// Notes that `viewer` has line of sight to `seen` from `time_s` on, or has lost it.
    pub fn sight(&mut self, viewer: VehicleId, seen: VehicleId, visible: bool, time_s: f64) {
        let pair = self.pairs.entry((viewer, seen)).or_default();
        pair.in_sight_since_s = match (visible, pair.in_sight_since_s) {
            (true, None) => Some(time_s),
            (true, since) => since,
            (false, _) => None,
        };
    }

    /// One step of the truth.
    pub fn observe(
        &mut self,
        time_s: f64,
        road: &Road,
        truth: &[TrueVehicle],
        cavs: &[CavView<'_>],
        overlapping: impl IntoIterator<Item = (VehicleId, VehicleId)>,
    ) {
        self.collisions.extend(overlapping);
        for vehicle in truth {
            self.note_speed(vehicle, time_s);
        }
        for view in cavs {
            if let Some(ego) = truth.iter().find(|vehicle| vehicle.id == view.id) {
                self.observe_cav(time_s, road, truth, ego, view);
            }
        }
    }

    fn note_speed(&mut self, vehicle: &TrueVehicle, time_s: f64) {
        if vehicle.kind == VehicleKind::Obstacle || vehicle.speed_mps >= STUCK_MPS {
            self.slow_since_s.remove(&vehicle.id);
            return;
        }
        let since = *self.slow_since_s.entry(vehicle.id).or_insert(time_s);
        if time_s - since >= STUCK_S {
            self.stuck.insert(vehicle.id);
        }
    }

    fn observe_cav(
        &mut self,
        time_s: f64,
        road: &Road,
        truth: &[TrueVehicle],
        ego: &TrueVehicle,
        view: &CavView<'_>,
    ) {
        self.judge_lane_change(road, truth, ego, view);
        let lanes = ego.lanes(road);
        let previous = self
            .own_lanes
            .insert(ego.id, lanes.clone())
            .unwrap_or_else(|| lanes.clone());
        let mut worst: Option<TrueBarriers> = None;
        for other in truth.iter().filter(|other| other.id != ego.id) {
            let occupied = other.lanes(road);
            let shared: BTreeSet<LaneIndex> = lanes.intersection(&occupied).copied().collect();
            let barriers = if shared.is_empty() {
                None
            } else {
                self.barriers(ego, other, road)
            };
            let violated = barriers.is_some_and(|barriers| barriers.h_m < -TOLERANCE_M);
            let h0_m = barriers.map_or(f64::INFINITY, |barriers| barriers.h0_m);
            let inside = h0_m >= -TOLERANCE_M;
            let known = self.pairs.get(&(ego.id, other.id));
            let cause = match known.and_then(|pair| pair.episode) {
                _ if !violated => None,
                // Going round a standing vehicle excuses the distance, never the collision level.
                Some(cause) if cause != Cause::Leaving || inside => Some(cause),
                _ => {
                    let cause = self.cause(
                        time_s,
                        &Encounter {
                            ego,
                            other,
                            view,
                            shared: &shared,
                            previous: &previous,
                            h0_m,
                        },
                    );
                    *self.causes.entry(cause).or_default() += 1;
                    Some(cause)
                }
            };
            let in_sight_s = known
                .and_then(|pair| pair.in_sight_since_s)
                .map_or(0.0, |since_s| time_s - since_s);
            let broken = barriers
                .filter(|_| in_sight_s > PERCEPTION_DELAY_S)
                .and_then(|_| self.broken_knowledge(time_s, other, view.tracks));
            let pair = self.pairs.entry((ego.id, other.id)).or_default();
            self.collision_set_left += usize::from(pair.inside && !inside);
            pair.inside = inside;
            pair.episode = cause;
            pair.occupied = occupied;
            if let Some(broken) = broken {
                pair.broken = Some((broken, time_s));
            }
            if let Some(barriers) = barriers {
                let least = self
                    .min_headway_m
                    .entry(ego.id)
                    .or_insert(barriers.headway_m);
                *least = least.min(barriers.headway_m);
                if worst.is_none_or(|worst| barriers.h_m < worst.h_m) {
                    worst = Some(TrueBarriers { cause, ..barriers });
                }
            }
        }
        match worst {
            Some(barriers) => self.current.insert(ego.id, barriers),
            None => self.current.remove(&ego.id),
        };
    }

    /// Counts a lane change that begins inside the collision set of the truth, towards a vehicle
    /// ahead or behind in the lane that it enters.
    fn judge_lane_change(
        &mut self,
        road: &Road,
        truth: &[TrueVehicle],
        ego: &TrueVehicle,
        view: &CavView<'_>,
    ) {
        let Manoeuvre::ChangeLane { to, .. } = view.manoeuvre else {
            self.changing.remove(&ego.id);
            return;
        };
        if !self.changing.insert(ego.id) {
            return;
        }
        let others = truth
            .iter()
            .filter(|other| other.id != ego.id && other.occupies(to, road));
        let collides = others.into_iter().any(|other| {
            let ahead = self.barriers(ego, other, road);
            let h0_m = ahead.map(|barriers| barriers.h0_m);
            let behind_m = || self.rear_collision_barrier_m(ego, other, road);
            h0_m.or_else(behind_m).is_some_and(|h0_m| h0_m < 0.0)
        });
        self.unsafe_actions += usize::from(collides);
    }

    /// The collision barrier towards a vehicle behind, in the shape of RSS: it may accelerate for its
    /// reaction time and then brakes with b_min (docs/safety.md).
    fn rear_collision_barrier_m(
        &self,
        ego: &TrueVehicle,
        behind: &TrueVehicle,
        road: &Road,
    ) -> Option<f64> {
        let settings = &self.settings;
        let rho = match behind.kind {
            VehicleKind::Cav => settings.reaction_cav_s,
            VehicleKind::Human | VehicleKind::Obstacle => settings.reaction_human_s,
        };
        let (v, accel) = (behind.speed_mps, settings.follower_accel_mps2);
        let reacted_m = v * rho + accel * rho * rho / 2.0;
        let stopping_m = (v + rho * accel).powi(2) / (2.0 * settings.follower_brake_mps2);
        let own_m = ego.speed_mps.powi(2) / (2.0 * settings.brake_mps2);
        let needed_m = (reacted_m + stopping_m - own_m).max(0.0);
        Some(behind.gap_to_m(ego, road)? - settings.collision_margin_m - needed_m)
    }

    fn barriers(
        &self,
        ego: &TrueVehicle,
        ahead: &TrueVehicle,
        road: &Road,
    ) -> Option<TrueBarriers> {
        let gap_m = ego.gap_to_m(ahead, road)?;
        let closing_m = closing_distance_m(
            ego.speed_mps,
            ahead.speed_mps,
            self.settings.brake_mps2,
            self.settings.leader_brake_mps2,
        );
        let half_lengths_m = (ego.dimensions.length_m + ahead.dimensions.length_m) / 2.0;
        Some(TrueBarriers {
            h_m: gap_m - (self.settings.headway_safe_m - half_lengths_m) - closing_m,
            h0_m: gap_m - self.settings.collision_margin_m - closing_m,
            headway_m: gap_m + half_lengths_m,
            cause: None,
        })
    }

    /// Why the ego vehicle is outside the safe set towards the other.
    fn cause(&self, time_s: f64, encounter: &Encounter<'_>) -> Cause {
        let &Encounter {
            ego,
            other,
            view,
            shared,
            previous,
            h0_m,
        } = encounter;
        let pair = self.pairs.get(&(ego.id, other.id));
        let entered = pair.is_some_and(|pair| {
            shared
                .iter()
                .any(|lane| !pair.occupied.contains(lane) && previous.contains(lane))
        });
        let in_sight_since_s = pair.and_then(|pair| pair.in_sight_since_s);
        let leaves = matches!(view.manoeuvre, Manoeuvre::ChangeLane { from, .. } if shared.contains(&from))
            && ego.speed_mps < self.settings.leaving_speed_mps
            && other.speed_mps < STUCK_MPS
            && h0_m >= 0.0;
        let known = nearest_track(other, view.tracks).is_some();
        let fresh = in_sight_since_s.is_none_or(|since_s| time_s - since_s < PERCEPTION_DELAY_S);
        if pair.is_none_or(|pair| pair.occupied.is_empty()) && time_s < STEP_S / 2.0 {
            Cause::Start
        } else if entered && other.kind == VehicleKind::Human {
            Cause::CutIn
        } else if leaves {
            Cause::Leaving
        } else if fresh && !known {
            Cause::Revealed
        } else {
            let broken = self.broken_knowledge(time_s, other, view.tracks);
            let earlier = pair
                .and_then(|pair| pair.broken)
                .filter(|(_, broke_s)| time_s - broke_s < MEMORY_S)
                .map(|(cause, _)| cause);
            broken.or(earlier).unwrap_or(Cause::Unattributed)
        }
    }

    /// Which assumption about a CAV's knowledge of `other` does not hold.
    fn broken_knowledge(
        &self,
        time_s: f64,
        other: &TrueVehicle,
        tracks: &[Track],
    ) -> Option<Cause> {
        let Some(track) = nearest_track(other, tracks) else {
            return Some(Cause::MissedObject);
        };
        let error_m = (track.state.center.position() - other.center).norm();
        let speed_error_mps = (track.state.velocity_mps - other.velocity).norm();
        let sigmas = self.settings.error_sigmas;
        let position_bound_m = sigmas * track.position_std_m;
        let speed_bound_mps = sigmas * track.velocity_std_mps;
        // The track is carried on with constant velocity; the truth may have braked meanwhile.
        let age_s = (time_s - track.measured_s()).max(0.0);
        let braked_mps = self.settings.leader_brake_mps2 * age_s;
        let braked_m = 0.5 * braked_mps * age_s;
        if age_s > OLDEST_KNOWLEDGE_S {
            Some(Cause::MessageAge)
        } else if error_m > position_bound_m + braked_m
            || speed_error_mps > speed_bound_mps + braked_mps
        {
            Some(Cause::PerceptionError)
        } else {
            None
        }
    }

    /// The true barriers of `cav` against the worst vehicle ahead in its lanes, if there is one.
    pub fn barriers_of(&self, cav: VehicleId) -> Option<&TrueBarriers> {
        self.current.get(&cav)
    }

    /// Smallest headway of `cav` so far, in metres.
    pub fn min_headway_m(&self, cav: VehicleId) -> Option<f64> {
        self.min_headway_m.get(&cav).copied()
    }

    /// CAVs and humans that were stuck at some time.
    pub fn stuck(&self) -> usize {
        self.stuck.len()
    }

    /// Times that h_0 of a CAV became negative.
    pub fn collision_set_left(&self) -> usize {
        self.collision_set_left
    }

    /// Lane changes that began inside the collision set of the truth.
    pub fn unsafe_actions(&self) -> usize {
        self.unsafe_actions
    }

    /// Pairs of bodies that overlapped at some time.
    pub fn collisions(&self) -> usize {
        self.collisions.len()
    }

    /// Violations by cause.
    pub fn violations(&self) -> &BTreeMap<Cause, usize> {
        &self.causes
    }
}

/// The track that stands for `vehicle`.
fn nearest_track<'a>(vehicle: &TrueVehicle, tracks: &'a [Track]) -> Option<&'a Track> {
    let error_m = |track: &Track| (track.state.center.position() - vehicle.center).norm();
    tracks
        .iter()
        .min_by(|a, b| error_m(a).total_cmp(&error_m(b)))
        .filter(|track| error_m(track) <= SAME_OBJECT_M)
}

#[cfg(test)]
mod tests;
