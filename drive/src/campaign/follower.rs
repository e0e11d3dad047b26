use covista_control::{LaneSet, Manoeuvre};
use covista_world::STEP_S;

use super::{
    pair::{Scene, Seen},
    tally::Tally,
};

/// Round-off.
const TOLERANCE_M: f64 = 1e-6;

/// A follower in the lane that the ego vehicle enters, from step to step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Behind {
    is_broken: bool,
    /// When the lane change before it began.
    changing_since: Option<usize>,
}

impl Behind {
    /// Takes in one step: the room that is left beyond P_safe, and, once the follower had time to
    /// react, beyond what it takes to stop behind the ego vehicle's hardest braking.
    pub fn step(
        &mut self,
        scene: &Scene<'_>,
        seen: &Seen,
        lanes: LaneSet,
        is_behind: bool,
        tally: &mut Tally,
    ) {
        let Manoeuvre::ChangeLane { to, .. } = scene.manoeuvre else {
            self.changing_since = None;
            return;
        };
        if !is_behind || !lanes.contains(to) {
            return;
        }
        let (settings, ego) = (scene.set.settings, scene.ego);
        let since = *self.changing_since.get_or_insert(scene.step);
        let reaction = (settings.reaction_human_s / STEP_S).ceil() as usize;
        let has_reacted = scene.step > since + reaction;
        let gap_m = (scene.set).gap_behind_m(ego, to, seen.truth.s_range_m[1]);
        let own_m = scene.set.follower_stop_m(seen.speed_mps);
        let ego_m = scene.set.shortest_stop_m(ego.speed_mps);
        let closed_m = if has_reacted {
            (own_m - ego_m).max(0.0)
        } else {
            0.0
        };
        let keep_m = scene.set.keep_m(ego, seen.truth.dimensions.length_m);
        let room_m = gap_m - keep_m - closed_m;
        tally.smallest_rear_room_m = tally.smallest_rear_room_m.min(room_m);
        let broken = room_m < -TOLERANCE_M;
        if broken && !self.is_broken {
            tally.rear_gap_breaches += 1;
            tally.note("follower too near", scene, seen, None);
        }
        self.is_broken = broken;
    }
}
