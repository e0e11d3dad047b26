use covista_control::{Manoeuvre, SafetySettings};
use covista_world::LaneIndex;

use super::{
    Cause, CavView, Encounter, Instant, Monitor, TOLERANCE_M,
    barriers::{Gaps, reaction_s},
    cav_state::CavState,
    motion::Motion,
};
use crate::truth::{Lanes, TrueVehicle};

/// A vehicle follows a CAV that has begun to change into its lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Following {
    pub lane: LaneIndex,
    since_s: f64,
    lost: bool,
}

impl Following {
    pub fn new(lane: LaneIndex, since_s: f64) -> Self {
        Self {
            lane,
            since_s,
            lost: false,
        }
    }

    /// Whether the gap to the follower is lost with this step: hardest braking of the CAV could
    /// no longer be answered by b_min.
    pub fn loses(&mut self, gaps: &Gaps<'_>, behind: &TrueVehicle) -> bool {
        let lost = gaps.behind_after_reaction_m(behind, self.lane) < -TOLERANCE_M;
        !std::mem::replace(&mut self.lost, lost) && lost
    }

    /// Whether the follower broke its assumption: it accelerated by more than a_b, or, its
    /// reaction time over, brakes with less than b_min as the gap is lost.
    pub fn broke_assumption(
        &self,
        time_s: f64,
        behind: &TrueVehicle,
        motion: &Motion,
        settings: &SafetySettings,
    ) -> bool {
        let reacted = time_s - self.since_s > reaction_s(behind, settings);
        let slack_mps2 = 1e-3;
        motion.accelerated_too_hard.explains(time_s)
            || reacted && motion.accel_mps2 > -settings.follower_brake_mps2 + slack_mps2
    }
}

impl Monitor {
    /// Counts a lane change that begins inside the collision set of the truth, towards a vehicle
    /// ahead or behind in the lane that it enters; whoever is behind follows from now on.
    pub(super) fn judge_lane_change(
        &mut self,
        now: &Instant<'_>,
        cav: &mut CavState,
        view: &CavView<'_>,
        gaps: &Gaps<'_>,
    ) {
        let target = match view.manoeuvre {
            Manoeuvre::ChangeLane { to, .. } => Some(to),
            _ => None,
        };
        let begins = target.filter(|_| !cav.changing);
        cav.changing = target.is_some();
        let Some(to) = begins else { return };
        let mut collides = false;
        for other in now.truth.iter().filter(|other| other.id != view.id) {
            let in_lane = other
                .lanes(now.road, gaps.settings.lane_entry_m)
                .contains(to);
            let pair = self.pairs.entry((view.id, other.id)).or_default();
            pair.following = None;
            if !in_lane {
                continue;
            }
            let h0_m = match gaps.ahead(other, Lanes::only(to)) {
                Some(ahead) => ahead.h0_m,
                None => gaps.behind_before_reaction_m(other, to),
            };
            collides |= h0_m < 0.0;
            if h0_m >= 0.0 && !gaps.ego.is_behind(other) {
                pair.following = Some(Following::new(to, now.time_s));
            }
        }
        self.unsafe_actions += usize::from(collides);
    }

    /// Counts a gap to a follower that is lost after a lane change.
    pub(super) fn watch_follower(
        &mut self,
        now: &Instant<'_>,
        cav: &CavState,
        encounter: &Encounter<'_>,
    ) {
        let &Encounter {
            gaps,
            other,
            others,
            ..
        } = encounter;
        let Some(pair) = self.pairs.get_mut(&(gaps.ego.id, other.id)) else {
            return;
        };
        let Some(mut following) = pair.following else {
            return;
        };
        if gaps.ego.is_behind(other) || !others.contains(following.lane) {
            pair.following = None;
            return;
        }
        let loses = following.loses(gaps, other);
        pair.following = Some(following);
        if !loses {
            return;
        }
        let motion = self.vehicles.get(&other.id).copied().unwrap_or_default();
        let settings = gaps.settings;
        let cause = if following.broke_assumption(now.time_s, other, &motion, settings) {
            Cause::FollowerMotion
        } else if cav.plant.strayed.explains(now.time_s) {
            Cause::ProcessNoise
        } else {
            let broken = pair.broken_lately(now.time_s);
            broken.map_or(Cause::Unattributed, |(cause, _)| cause)
        };
        *self.rear_losses.entry(cause).or_default() += 1;
    }
}
