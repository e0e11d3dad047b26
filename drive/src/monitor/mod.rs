//! The closed loop, watched on the truth: barriers, gaps, motion, and what each CAV knows.
//!
//! Nothing here allocates from step to step once every vehicle has been seen.

mod attribution;
mod barriers;
mod cav_state;
mod closing;
mod distributions;
mod followers;
mod knowledge;
mod motion;
mod report;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use covista_control::{Manoeuvre, SafetySettings, SightLine};
use covista_traffic::VehicleId;
use covista_world::{BicycleState, ControlInput, Road};

use crate::{
    cause::Cause,
    truth::{Lanes, TrueVehicle},
};
use attribution::{KnownAhead, Meeting, Pair};
use barriers::Gaps;
pub use barriers::TrueBarriers;
use cav_state::CavState;
pub use distributions::{Distributions, Histogram};
pub use knowledge::PlacedTrack;
use knowledge::{Knowledge, Other};
use motion::{Motion, STUCK_MPS};

/// h below this counts as violated: round-off.
const TOLERANCE_M: f64 = 1e-6;
/// An assumption that broke this long ago still explains a violation: the longest time that
/// braking to standstill takes, and a perception frame.
const MEMORY_S: f64 = 3.0;

/// What the monitor may ask about one CAV besides the truth.
#[derive(Clone, Copy)]
pub struct CavView<'a> {
    /// The CAV.
    pub id: VehicleId,
    /// What it knows, to tell which assumption broke.
    pub tracks: &'a [PlacedTrack],
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

/// Watches the closed loop on the truth: gaps, barriers, collisions, standstill.
#[derive(Debug, Clone)]
pub struct Monitor {
    settings: SafetySettings,
    started: bool,
    vehicles: BTreeMap<VehicleId, Motion>,
    cavs: BTreeMap<VehicleId, CavState>,
    pairs: BTreeMap<(VehicleId, VehicleId), Pair>,
    collisions: BTreeSet<(VehicleId, VehicleId)>,
    violations: BTreeMap<Cause, usize>,
    rear_losses: BTreeMap<Cause, usize>,
    steps_violated: [usize; Cause::COUNT],
    cav_steps: usize,
    unsafe_actions: usize,
    collision_set_left: usize,
    distributions: Distributions,
}

/// The truth at one step.
#[derive(Clone, Copy)]
struct Instant<'a> {
    time_s: f64,
    first: bool,
    road: &'a Road,
    truth: &'a [TrueVehicle],
}

impl Monitor {
    /// A monitor of the promise that `settings` make.
    pub fn new(settings: SafetySettings) -> Self {
        Self {
            settings,
            started: false,
            vehicles: BTreeMap::new(),
            cavs: BTreeMap::new(),
            pairs: BTreeMap::new(),
            collisions: BTreeSet::new(),
            violations: BTreeMap::new(),
            rear_losses: BTreeMap::new(),
            steps_violated: [0; Cause::COUNT],
            cav_steps: 0,
            unsafe_actions: 0,
            collision_set_left: 0,
            distributions: Distributions::new(),
        }
    }

    /// Notes that `viewer` has line of sight to `seen` at `time_s`, or has none.
    pub fn sight(&mut self, viewer: VehicleId, seen: VehicleId, visible: bool, time_s: f64) {
        let memory_s = self.settings.sight_memory_s;
        let pair = self.pairs.entry((viewer, seen)).or_default();
        pair.in_sight.note(visible, time_s, memory_s);
    }

    /// One step of the truth, 0.01 s after the one before.
    pub fn observe(
        &mut self,
        time_s: f64,
        road: &Road,
        truth: &[TrueVehicle],
        cavs: &[CavView<'_>],
        overlapping: impl IntoIterator<Item = (VehicleId, VehicleId)>,
    ) {
        let first = self.begin(time_s, truth, overlapping);
        for view in cavs {
            self.watch(time_s, first, road, truth, view);
        }
    }

    /// Takes up the motion of all vehicles at one step, before each CAV is watched; tells whether
    /// this is the first step of all.
    pub(crate) fn begin(
        &mut self,
        time_s: f64,
        truth: &[TrueVehicle],
        overlapping: impl IntoIterator<Item = (VehicleId, VehicleId)>,
    ) -> bool {
        self.collisions.extend(overlapping);
        for vehicle in truth {
            let motion = self.vehicles.entry(vehicle.id).or_default();
            motion.step(time_s, vehicle, &self.settings);
        }
        !std::mem::replace(&mut self.started, true)
    }

    /// Watches one CAV at a step, among the vehicles round it: itself and, on a ring, the others'
    /// images nearest to it.
    pub(crate) fn watch(
        &mut self,
        time_s: f64,
        first: bool,
        road: &Road,
        truth: &[TrueVehicle],
        view: &CavView<'_>,
    ) {
        let now = Instant {
            time_s,
            first,
            road,
            truth,
        };
        if let Some(ego) = truth.iter().find(|vehicle| vehicle.id == view.id) {
            self.observe_cav(&now, ego, view);
        }
    }

    fn observe_cav(&mut self, now: &Instant<'_>, ego: &TrueVehicle, view: &CavView<'_>) {
        let settings = self.settings;
        let changing = matches!(
            view.manoeuvre,
            Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. }
        );
        let gaps = Gaps::new(ego, now.road, &settings, changing);
        let lanes = ego.lanes(now.road, 0.0);
        let mut cav = self.cavs.get(&ego.id).copied().unwrap_or_default();
        let claimed = lanes.with(view.manoeuvre.lane());
        let claimed = match view.manoeuvre {
            Manoeuvre::Announced { .. } => claimed,
            running => claimed.with(running.destination()),
        };
        let claimed_before = cav.claimed.replace(claimed).unwrap_or(claimed);
        cav.plant.step(now.time_s, view, &settings);
        if let Some(jerk) = cav.jerk.step(ego.speed_mps) {
            self.distributions.note_jerk(jerk);
        }
        cav.watch_sight(view.sight, &gaps, claimed);
        self.judge_lane_change(now, &mut cav, view, &gaps);

        cav.barriers = None;
        let mut ttc_s = f64::INFINITY;
        for other in now.truth.iter().filter(|other| other.id != ego.id) {
            let others = other.lanes(now.road, settings.lane_entry_m);
            let shared = lanes.shared_with(others);
            let encounter = Encounter {
                view,
                gaps: &gaps,
                other,
                others,
                shared,
                claimed,
                claimed_before,
            };
            self.watch_follower(now, &cav, &encounter);
            let Some((barriers, closing_s)) = self.meet(now, &cav, &encounter) else {
                continue;
            };
            ttc_s = ttc_s.min(closing_s.unwrap_or(f64::INFINITY));
            let least_m = cav.min_headway_m.get_or_insert(barriers.headway_m);
            *least_m = least_m.min(barriers.headway_m);
            if cav.barriers.is_none_or(|worst| barriers.h_m < worst.h_m) {
                cav.barriers = Some(barriers);
            }
        }
        if ttc_s < f64::INFINITY {
            self.distributions.note_ttc(ttc_s);
        }
        self.cav_steps += 1;
        if let Some(cause) = cav.barriers.and_then(|worst| worst.cause) {
            self.steps_violated[cause as usize] += 1;
        }
        self.cavs.insert(ego.id, cav);
    }

    /// The barriers towards another vehicle, where it is ahead in a lane of the CAV, and the time
    /// to collision with it.
    fn meet(
        &mut self,
        now: &Instant<'_>,
        cav: &CavState,
        encounter: &Encounter<'_>,
    ) -> Option<(TrueBarriers, Option<f64>)> {
        let &Encounter {
            view,
            gaps,
            other,
            others,
            shared,
            claimed,
            claimed_before,
        } = encounter;
        let (ego, time_s) = (gaps.ego, now.time_s);
        let knowledge = Knowledge {
            time_s,
            road: now.road,
            truth: now.truth,
            tracks: view.tracks,
            sight: view.sight,
            settings: gaps.settings,
        };
        let track = knowledge.track_of(other);
        let ahead = gaps.ahead(other, shared);
        let claimed_ahead = gaps.ahead(other, others.shared_with(claimed));
        let own = (ego.lanes(now.road, 0.0)).with(view.manoeuvre.destination());
        let known = track.map(|track| {
            let known = knowledge.known(track);
            let lanes = known.lanes.shared_with(claimed);
            let is_ahead = known.middle_s_m > ego.middle_s_m();
            KnownAhead {
                ahead_in: if is_ahead { lanes } else { Lanes::default() },
                is_in_own: is_ahead && !lanes.shared_with(own).is_empty(),
                measured_s: known.measured_s,
                h_m: gaps.set_h_m(&known.best, lanes),
                worst_h_m: gaps.set_h_m(&known.worst, lanes),
            }
        });
        let from_other = self.pairs.get(&(other.id, ego.id));
        let unknowing_other = from_other.and_then(|pair| pair.broken_lately(time_s));
        let pair = self.pairs.entry((ego.id, other.id)).or_default();
        pair.note_lanes(others, time_s);
        let is_ahead = ego.is_behind(other);
        let broken = knowledge.broken(&Other {
            vehicle: other,
            ahead: is_ahead,
            shared,
            track,
            entered_s: pair.entered_s,
            in_sight_since_s: pair.in_sight.since_s(time_s, gaps.settings.sight_memory_s),
            away_m: if is_ahead {
                other.s_range_m[0] - ego.s_range_m[1]
            } else {
                ego.s_range_m[0] - other.s_range_m[1]
            },
        });
        // A CAV that comes in unsafely did so for what it did not know.
        let comes_in_unknowing = unknowing_other.filter(|_| pair.comes_in(ahead.as_ref()));
        if let Some(broken) = broken.map(|cause| (cause, time_s)).or(comes_in_unknowing) {
            pair.broken = Some(broken);
        }
        let begins = pair.step(
            &Meeting {
                time_s,
                first: now.first,
                settings: gaps.settings,
                ego,
                other,
                manoeuvre: view.manoeuvre,
                shared: others.shared_with(claimed),
                own_lanes_before: claimed_before,
                known,
                stands: other.speed_mps < STUCK_MPS
                    || track
                        .is_some_and(|placed| placed.track.state.velocity_mps.norm() < STUCK_MPS),
                sight_broke_off: cav.sight_broke_off(others.shared_with(claimed)),
                sight_reaches_past: cav.sight_reaches_past(other, others.shared_with(claimed)),
                leader_braking: (self.vehicles.get(&other.id))
                    .map(|motion| motion.braked_too_hard)
                    .unwrap_or_default(),
                process_noise: cav.plant.strayed,
            },
            claimed_ahead.as_ref(),
            ahead.as_ref(),
        );
        self.collision_set_left += usize::from(pair.leaves_collision_set(ahead.as_ref()));
        if let Some(cause) = begins {
            *self.violations.entry(cause).or_default() += 1;
        }
        let ahead = ahead?;
        let barriers = TrueBarriers {
            h_m: ahead.h_m,
            h0_m: ahead.h0_m,
            headway_m: ahead.headway_m,
            cause: pair.episode(),
        };
        Some((barriers, ahead.ttc_s))
    }
}

/// A CAV and another vehicle at one step.
struct Encounter<'a> {
    view: &'a CavView<'a>,
    gaps: &'a Gaps<'a>,
    other: &'a TrueVehicle,
    /// Lanes of the other.
    others: Lanes,
    /// Lanes that both occupy.
    shared: Lanes,
    /// Lanes that the CAV is in, enters or leaves.
    claimed: Lanes,
    /// The same at the step before.
    claimed_before: Lanes,
}
