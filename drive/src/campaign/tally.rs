use std::collections::BTreeMap;

use serde::Serialize;

use super::{
    exact::Levels,
    pair::{Scene, Seen},
    scenario::Family,
};
use crate::{Cause, Monitor};

/// What a campaign found, all of it on the truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tally {
    /// Controlled steps.
    pub campaign_steps: u64,
    /// Times that h fell below zero by more than round-off without an excuse: in the set's own
    /// definition while a lane was kept, and of the true bumpers, without any allowance, during a
    /// lane change.
    pub violations: u64,
    /// Times that the headway fell below P_safe without an excuse.
    pub headway_violations: u64,
    /// Times that h_0 fell below zero in the same way, where it was not so at once.
    pub collision_level_violations: u64,
    /// Steps of keeping a lane, without an excuse, in which no input met every row.
    pub infeasible: u64,
    /// The same while h < 0 towards a vehicle was excused, as far as braking was not enough.
    pub infeasible_excused: u64,
    /// Steps of a lane change or its abort in which no input met every row, those towards
    /// followers among them.
    pub infeasible_changing: u64,
    /// Excused cut-ins, reveals and starts: h < 0 at once.
    pub excused: u64,
    /// Cut-ins that were outside the set, but inside it before any measurement showed them.
    pub excused_known_late: u64,
    /// Times that the distance was given up below 5 m/s to drive round a standing vehicle.
    pub excused_leaving: u64,
    /// Steps during which anything was excused.
    pub excused_steps: u64,
    /// Times that the ego vehicle ran into a vehicle ahead, touched one beside it while outside of the
    /// lane that it kept or had yet to leave, or was run into by a follower that does as assumed.
    pub collisions: u64,
    /// Contacts that were the other's doing: from beside while the ego vehicle was within its lane,
    /// from behind by one that does not follow as assumed, or with one that came into the lane or
    /// into sight with h_0 < 0.
    pub touched: u64,
    /// Steps in which a corner of the body was outside its lane, or both lanes of a change.
    pub lane_excess_steps: u64,
    /// Farthest that a corner was outside, in metres; negative when none ever was.
    pub largest_lane_excess_m: f64,
    /// Steps faster than the curve allows.
    pub curve_speed_steps: u64,
    /// Steps with more lateral acceleration than the bound.
    pub lateral_accel_steps: u64,
    /// Steps in which a vehicle ahead was nearer or slower than the worst that the ego vehicle made of
    /// what it knew.
    pub beyond_estimate_steps: u64,
    /// Inputs that were not finite or outside U.
    pub bad_inputs: u64,
    /// Times that a follower was too near after a lane change began: nearer than P_safe, or, once
    /// it had time to react, than it takes to stop behind the ego vehicle's hardest braking.
    pub rear_gap_breaches: u64,
    /// Smallest gap to such a follower beyond that, in metres.
    pub smallest_rear_room_m: f64,
    /// Smallest h of the true bumpers without an excuse, in metres.
    pub smallest_h_m: f64,
    /// Smallest h_0 of the true bumpers without an excuse, in metres.
    pub smallest_h0_m: f64,
    /// Smallest h in the set's own definition without an excuse while keeping a lane, in metres.
    pub smallest_set_h_m: f64,
    /// Smallest distance of bodies' centres along the lane without an excuse, in metres.
    pub smallest_headway_m: f64,
    /// Lane changes that began.
    pub lane_changes: u64,
    /// What the monitor named, by cause.
    pub cause: BTreeMap<&'static str, u64>,
    /// The same for gaps lost to followers.
    pub rear_cause: BTreeMap<&'static str, u64>,
    /// Violations that the monitor saw and could not name.
    pub unattributed: u64,
    /// The first episode, by family and number, in which anything happened that the promise
    /// excludes.
    pub first_bad_episode: Option<EpisodeId>,
    /// What was found when and where, while one episode is looked at.
    #[serde(skip)]
    pub(super) lines: Option<Vec<String>>,
}

/// Which episode of a campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct EpisodeId {
    /// Its family.
    pub family: Family,
    /// Its number within the family.
    pub number: u64,
}

impl Default for Tally {
    fn default() -> Self {
        Self {
            campaign_steps: 0,
            violations: 0,
            headway_violations: 0,
            collision_level_violations: 0,
            infeasible: 0,
            infeasible_excused: 0,
            infeasible_changing: 0,
            excused: 0,
            excused_known_late: 0,
            excused_leaving: 0,
            excused_steps: 0,
            collisions: 0,
            touched: 0,
            lane_excess_steps: 0,
            largest_lane_excess_m: f64::NEG_INFINITY,
            curve_speed_steps: 0,
            lateral_accel_steps: 0,
            beyond_estimate_steps: 0,
            bad_inputs: 0,
            rear_gap_breaches: 0,
            smallest_rear_room_m: f64::INFINITY,
            smallest_h_m: f64::INFINITY,
            smallest_h0_m: f64::INFINITY,
            smallest_set_h_m: f64::INFINITY,
            smallest_headway_m: f64::INFINITY,
            lane_changes: 0,
            cause: BTreeMap::new(),
            rear_cause: BTreeMap::new(),
            unattributed: 0,
            first_bad_episode: None,
            lines: None,
        }
    }
}

impl Tally {
    /// Takes up what another part of the campaign found; the order does not matter.
    pub fn add(&mut self, other: &Self) {
        self.campaign_steps += other.campaign_steps;
        self.violations += other.violations;
        self.headway_violations += other.headway_violations;
        self.collision_level_violations += other.collision_level_violations;
        self.infeasible += other.infeasible;
        self.infeasible_excused += other.infeasible_excused;
        self.infeasible_changing += other.infeasible_changing;
        self.excused += other.excused;
        self.excused_known_late += other.excused_known_late;
        self.excused_leaving += other.excused_leaving;
        self.excused_steps += other.excused_steps;
        self.collisions += other.collisions;
        self.touched += other.touched;
        self.lane_excess_steps += other.lane_excess_steps;
        self.largest_lane_excess_m = self.largest_lane_excess_m.max(other.largest_lane_excess_m);
        self.curve_speed_steps += other.curve_speed_steps;
        self.lateral_accel_steps += other.lateral_accel_steps;
        self.beyond_estimate_steps += other.beyond_estimate_steps;
        self.bad_inputs += other.bad_inputs;
        self.rear_gap_breaches += other.rear_gap_breaches;
        self.smallest_rear_room_m = self.smallest_rear_room_m.min(other.smallest_rear_room_m);
        self.smallest_h_m = self.smallest_h_m.min(other.smallest_h_m);
        self.smallest_h0_m = self.smallest_h0_m.min(other.smallest_h0_m);
        self.smallest_set_h_m = self.smallest_set_h_m.min(other.smallest_set_h_m);
        self.smallest_headway_m = self.smallest_headway_m.min(other.smallest_headway_m);
        self.lane_changes += other.lane_changes;
        for (causes, others) in [
            (&mut self.cause, &other.cause),
            (&mut self.rear_cause, &other.rear_cause),
        ] {
            for (&cause, count) in others {
                *causes.entry(cause).or_default() += count;
            }
        }
        self.unattributed += other.unattributed;
        let episodes = [self.first_bad_episode, other.first_bad_episode];
        self.first_bad_episode = episodes.into_iter().flatten().min();
    }

    /// Keeps a line of what was found, if anybody looks.
    pub(super) fn log(&mut self, line: impl FnOnce() -> String) {
        if let Some(lines) = &mut self.lines {
            lines.push(line());
        }
    }

    /// Keeps what was found of one vehicle, if anybody looks.
    pub(super) fn note(
        &mut self,
        what: &str,
        scene: &Scene<'_>,
        seen: &Seen,
        levels: Option<Levels>,
    ) {
        self.log(|| {
            let Seen {
                truth, speed_mps, ..
            } = seen;
            let (step, ego) = (scene.step, scene.ego);
            format!(
                "step {step}: {what}, {:?}, ego at {:.3} m/s, {:.2?} m along, {:.2?} m across, vehicle {} at \
                 {speed_mps:.3} m/s, {:.2?} m along, {:.2?} m across, {levels:.6?}",
                scene.manoeuvre, ego.speed_mps, ego.s_range_m, ego.d_range_m,
                truth.id.0, truth.s_range_m, truth.d_range_m
            )
        });
    }

    /// Takes up what the monitor counted.
    pub(super) fn add_causes(&mut self, monitor: &Monitor) {
        for (causes, counted) in [
            (&mut self.cause, monitor.violations()),
            (&mut self.rear_cause, monitor.rear_losses()),
        ] {
            for (&cause, &count) in counted {
                *causes.entry(cause.name()).or_default() += count as u64;
                if cause == Cause::Unattributed {
                    self.unattributed += count as u64;
                }
            }
        }
    }

    /// Whether anything happened that the promise excludes.
    pub fn is_bad(&self) -> bool {
        let counts = [
            self.violations,
            self.headway_violations,
            self.collision_level_violations,
            self.infeasible,
            self.collisions,
            self.lane_excess_steps,
            self.beyond_estimate_steps,
            self.bad_inputs,
            self.curve_speed_steps,
            self.lateral_accel_steps,
            self.unattributed,
            self.rear_gap_breaches,
        ];
        counts.iter().any(|count| *count > 0)
    }

    /// The cause that the monitor named most often.
    pub fn most_frequent_cause(&self) -> Option<&'static str> {
        most_frequent(&self.cause)
    }

    /// The cause of lost gaps to followers that the monitor named most often.
    pub fn most_frequent_rear_cause(&self) -> Option<&'static str> {
        most_frequent(&self.rear_cause)
    }
}

fn most_frequent(causes: &BTreeMap<&'static str, u64>) -> Option<&'static str> {
    let of = causes.iter().filter(|(_, count)| **count > 0);
    of.max_by_key(|(_, count)| **count).map(|(cause, _)| *cause)
}
