use covista_control::{ControlOutput, LaneSet, Manoeuvre, SafetySettings};
use covista_world::{ControlInput, FilterOutcome, LANE_COUNT, LaneIndex, Road, STEP_S};

use super::{
    exact::{Levels, SafeSet},
    tally::Tally,
};
use crate::TrueVehicle;

/// Round-off.
const TOLERANCE_M: f64 = 1e-6;
/// What discrete steps of the follower's own braking may take from its gap.
const REAR_TOLERANCE_M: f64 = 0.05;
/// A vehicle slower than this stands.
const STANDING_MPS: f64 = 0.5;

/// Why h < 0 towards a vehicle is no violation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Excuse {
    /// It was so at once, and at the collision level, too, where `collides`.
    AtOnce { collides: bool },
    /// It was outside the set, but no measurement showed it in the lane yet.
    KnownLate,
    /// The ego vehicle drives round it, slowly.
    Leaving,
}

/// One other vehicle as it truly is in this step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub truth: TrueVehicle,
    /// Along its lane.
    pub speed_mps: f64,
    /// The same at its newest measurement.
    pub measured_mps: f64,
    /// In the ego vehicle's sight, or known.
    pub is_visible: bool,
    /// Step of the newest measurement of it that is known.
    pub measured: Option<usize>,
    /// Whether it keeps its distance to the ego vehicle in the manner of RSS.
    pub follows: bool,
    /// How much worse than the truth it may be taken to be.
    pub doubt: Doubt,
}

/// How much nearer and slower than it is a vehicle ahead may be taken to be: estimation error
/// either way, and what it may have done since it was measured.
#[derive(Debug, Clone, Copy)]
pub(super) struct Doubt {
    pub position_m: f64,
    pub speed_mps: f64,
}

/// What was true of a vehicle one step before.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    occupied: LaneSet,
    is_visible: bool,
    is_ahead: bool,
    shares_lane: bool,
    /// Ahead, visible and in a lane of the ego vehicle's.
    counts: bool,
    excuse: Option<Excuse>,
    /// Whether the set is won back as far as can be known.
    won_back: bool,
    /// When it entered the lane.
    entered: Option<usize>,
    /// Keeping a lane inside the set's own definition.
    in_set: bool,
    violates: bool,
    violates_h0: bool,
    headway_broken: bool,
    touches: bool,
    came_from_beside: bool,
    rear_broken: bool,
    /// When the lane change before this follower began.
    changing_since: Option<usize>,
}

/// What of the controller a step is judged by.
#[derive(Debug, Clone, Copy)]
pub(super) struct Judged<'a> {
    pub step: usize,
    pub ego: &'a TrueVehicle,
    pub manoeuvre: Manoeuvre,
    pub output: &'a ControlOutput,
}

/// Watches one episode on the truth.
pub(super) struct Watch<'a> {
    set: SafeSet<'a>,
    /// Whether cut-ins and reveals inside the set count as violations: they were made on purpose.
    excuses_nothing: bool,
    pairs: Vec<Pair>,
    own_lanes: LaneSet,
    was_changing: bool,
    pub tally: Tally,
}

impl<'a> Watch<'a> {
    pub fn new(
        settings: &'a SafetySettings,
        road: &'a Road,
        others: usize,
        excuses_nothing: bool,
    ) -> Self {
        Self {
            set: SafeSet { settings, road },
            excuses_nothing,
            pairs: vec![Pair::default(); others],
            own_lanes: LaneSet::default(),
            was_changing: false,
            tally: Tally::default(),
        }
    }

    /// One step: the truth at its begin, and the input that the controller gave for it.
    pub fn observe(&mut self, judged: &Judged<'_>, others: &[Seen]) {
        let ego = judged.ego;
        let changing = matches!(
            judged.manoeuvre,
            Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. }
        );
        self.tally.campaign_steps += 1;
        self.tally.lane_changes += u64::from(changing && !self.was_changing);
        self.was_changing = changing;
        let own = LaneSet::between(self.set.road, ego.d_range_m[0], ego.d_range_m[1], 0.0);
        for (index, seen) in others.iter().enumerate() {
            let Some(before) = self.pairs.get(index).copied() else {
                continue;
            };
            let pair = self.judge(judged, seen, before, own, changing);
            self.pairs[index] = pair;
        }
        self.own_lanes = own;
        let excused = self.pairs.iter().any(|pair| pair.excuse.is_some());
        self.tally.excused_steps += u64::from(excused);
        self.judge_input(judged.output, ego, changing, excused);
        self.judge_place(ego, judged.manoeuvre);
    }

    fn judge(
        &mut self,
        judged: &Judged<'_>,
        seen: &Seen,
        before: Pair,
        own: LaneSet,
        changing: bool,
    ) -> Pair {
        let (road, ego, other) = (self.set.road, judged.ego, &seen.truth);
        let [right_m, left_m] = other.d_range_m;
        let entry_m = self.set.settings.lane_entry_m;
        let occupied = LaneSet::between(road, right_m, left_m, entry_m);
        let shared =
            || LaneIndex::all().filter(|lane| own.contains(*lane) && occupied.contains(*lane));
        let middle_m = |of: &TrueVehicle| 0.5 * (of.s_range_m[0] + of.s_range_m[1]);
        let mut pair = Pair {
            occupied,
            is_visible: seen.is_visible,
            is_ahead: middle_m(other) > middle_m(ego),
            shares_lane: shared().next().is_some(),
            ..before
        };
        let entered =
            shared().any(|lane| !before.occupied.contains(lane) && self.own_lanes.contains(lane));
        if !pair.shares_lane {
            pair.came_from_beside = false;
        } else if entered && !pair.is_ahead {
            pair.came_from_beside = true;
        }
        pair.counts = pair.shares_lane && pair.is_visible && pair.is_ahead;
        if pair.counts {
            let lanes_off = if changing { 1.5 } else { 0.5 };
            let levels = |speed_mps: f64| {
                shared()
                    .map(|lane| self.set.levels(ego, other, speed_mps, lane, lanes_off))
                    .min_by(|a, b| a.h_m.total_cmp(&b.h_m))
            };
            // An excuse holds where the set may be broken as far as can be known, and lasts until
            // it is won back as far.
            let new = !before.counts;
            if new || pair.excuse.is_some() {
                let unseen_m = if new && !before.is_visible {
                    let settings = self.set.settings;
                    let longer_m = other.dimensions.length_m - settings.shortest_vehicle_m;
                    settings.sight_error_m + 0.5 * longer_m.max(0.0)
                } else {
                    0.0
                };
                let feared = levels((seen.speed_mps - seen.doubt.speed_mps).max(0.0));
                let doubt_m = seen.doubt.position_m.max(unseen_m);
                pair.won_back = feared.is_none_or(|feared| feared.set_h_m >= doubt_m);
            }
            let levels = levels(seen.speed_mps);
            if let Some(levels) = levels {
                self.judge_ahead(judged, seen, before, &mut pair, levels, entered, changing);
            }
        } else {
            (pair.excuse, pair.entered) = (None, None);
            (pair.violates, pair.violates_h0, pair.headway_broken) = (false, false, false);
            pair.in_set = false;
        }
        self.judge_touch(ego, other, before, &mut pair);
        if seen.follows {
            self.judge_behind(judged, seen, &mut pair);
        }
        pair
    }

    #[expect(
        clippy::too_many_arguments,
        reason = "one step of one pair, before and after"
    )]
    fn judge_ahead(
        &mut self,
        judged: &Judged<'_>,
        seen: &Seen,
        before: Pair,
        pair: &mut Pair,
        levels: Levels,
        entered: bool,
        changing: bool,
    ) {
        let inside = levels.h_m >= -TOLERANCE_M;
        if !before.counts {
            let passed = before.shares_lane && !before.is_ahead;
            let revealed = !before.is_visible;
            let excusable = judged.step == 0 || entered || passed || revealed;
            let doubtful = if judged.step == 0 {
                !inside
            } else {
                !pair.won_back
            };
            if excusable && doubtful && !self.excuses_nothing {
                let collides = levels.h0_m < -TOLERANCE_M;
                pair.excuse = Some(Excuse::AtOnce { collides });
                self.tally.excused += 1;
            }
            pair.entered = entered.then_some(judged.step);
        }
        if inside {
            pair.violates = false;
            let lasts = matches!(pair.excuse, Some(Excuse::AtOnce { .. })) && !pair.won_back;
            pair.excuse = pair.excuse.filter(|_| lasts);
        } else if pair.excuse.is_none() && !pair.violates {
            pair.excuse = self.late_excuse(judged, seen, pair, levels, changing);
            if pair.excuse.is_none() {
                pair.violates = true;
                {
                    eprintln!(
                        "VIOL step {} h {:.6} set {:.5} h0 {:.3} hw {:.3} v {:.3} vk {:.3} out {:?} man {:?} id {:?} s {:.2} d {:.2} rear {:.2} u {:?} ctl h {:.4} binding {:?}",
                        judged.step,
                        levels.h_m,
                        levels.set_h_m,
                        levels.h0_m,
                        levels.headway_m,
                        judged.ego.speed_mps,
                        seen.speed_mps,
                        judged.output.outcome,
                        judged.manoeuvre,
                        seen.truth.id,
                        judged.ego.frenet.s_m,
                        judged.ego.frenet.d_m,
                        seen.truth.s_range_m[0],
                        judged.output.u,
                        judged.output.h_m,
                        judged.output.binding
                    );
                }
                self.tally.violations += 1;
            }
        }
        if levels.h0_m >= -TOLERANCE_M {
            pair.violates_h0 = false;
        } else if !pair.violates_h0
            && !matches!(
                pair.excuse,
                Some(Excuse::AtOnce { collides: true } | Excuse::KnownLate)
            )
        {
            pair.violates_h0 = true;
            self.tally.collision_level_violations += 1;
        }
        if pair.excuse.is_some() {
            (pair.headway_broken, pair.in_set) = (false, false);
            return;
        }
        let tally = &mut self.tally;
        let in_set = !changing && levels.set_h_m >= -TOLERANCE_M;
        if !changing && (before.in_set || in_set) {
            tally.smallest_set_h_m = tally.smallest_set_h_m.min(levels.set_h_m);
            tally.set_violations += u64::from(!in_set);
            if !in_set {
                eprintln!(
                    "SET step {} h {:.6} set {:.5} h0 {:.3} hw {:.3} v {:.3} vk {:.3} out {:?} man {:?} id {:?} s {:.2} d {:.2} rear {:.2} u {:?} ctl h {:.4} binding {:?}",
                    judged.step,
                    levels.h_m,
                    levels.set_h_m,
                    levels.h0_m,
                    levels.headway_m,
                    judged.ego.speed_mps,
                    seen.speed_mps,
                    judged.output.outcome,
                    judged.manoeuvre,
                    seen.truth.id,
                    judged.ego.frenet.s_m,
                    judged.ego.frenet.d_m,
                    seen.truth.s_range_m[0],
                    judged.output.u,
                    judged.output.h_m,
                    judged.output.binding
                );
            }
        }
        pair.in_set = in_set;
        tally.smallest_h_m = tally.smallest_h_m.min(levels.h_m);
        tally.smallest_h0_m = tally.smallest_h0_m.min(levels.h0_m);
        tally.smallest_headway_m = tally.smallest_headway_m.min(levels.headway_m);
        let broken = levels.headway_m < self.set.settings.headway_safe_m - TOLERANCE_M;
        tally.headway_violations += u64::from(broken && !pair.headway_broken);
        pair.headway_broken = broken;
    }

    /// An excuse for h that was not negative at once.
    fn late_excuse(
        &mut self,
        judged: &Judged<'_>,
        seen: &Seen,
        pair: &Pair,
        levels: Levels,
        changing: bool,
    ) -> Option<Excuse> {
        let leaves = changing
            && judged.ego.speed_mps <= self.set.settings.leaving_speed_mps + 0.1
            && seen.speed_mps.min(seen.measured_mps) < STANDING_MPS
            && levels.h0_m >= -TOLERANCE_M;
        let late = pair
            .entered
            .is_some_and(|entered| seen.measured.is_none_or(|measured| measured <= entered));
        if leaves {
            self.tally.excused_leaving += 1;
            Some(Excuse::Leaving)
        } else if late && !self.excuses_nothing {
            self.tally.excused_known_late += 1;
            Some(Excuse::KnownLate)
        } else {
            None
        }
    }

    fn judge_touch(
        &mut self,
        ego: &TrueVehicle,
        other: &TrueVehicle,
        before: Pair,
        pair: &mut Pair,
    ) {
        let overlap = |a: [f64; 2], b: [f64; 2]| a[0] < b[1] && b[0] < a[1];
        pair.touches =
            overlap(ego.s_range_m, other.s_range_m) && overlap(ego.d_range_m, other.d_range_m);
        let excused = pair.came_from_beside
            || !pair.is_visible
            || matches!(
                pair.excuse,
                Some(Excuse::AtOnce { collides: true } | Excuse::KnownLate)
            );
        self.tally.collisions += u64::from(pair.touches && !before.touches && !excused);
    }

    fn judge_behind(&mut self, judged: &Judged<'_>, seen: &Seen, pair: &mut Pair) {
        let Manoeuvre::ChangeLane { to, .. } = judged.manoeuvre else {
            pair.changing_since = None;
            return;
        };
        if pair.is_ahead || !pair.occupied.contains(to) {
            return;
        }
        let since = *pair.changing_since.get_or_insert(judged.step);
        let reaction = (self.set.settings.reaction_human_s / STEP_S).ceil() as usize;
        let has_reacted = judged.step > since + reaction;
        let other = &seen.truth;
        let gap_m = self
            .set
            .arc_m(to, other.s_range_m[1], judged.ego.s_range_m[0]);
        let half_lengths_m = (judged.ego.dimensions.length_m + other.dimensions.length_m) / 2.0;
        let settings = self.set.settings;
        let stop_m = |v: f64, brake: f64| v * v / (2.0 * brake);
        let own_m = stop_m(seen.speed_mps, settings.follower_brake_mps2);
        let ego_m = stop_m(judged.ego.speed_mps, settings.brake_mps2);
        let closed_m = if has_reacted {
            (own_m - ego_m).max(0.0)
        } else {
            0.0
        };
        let room_m = gap_m - (settings.headway_safe_m - half_lengths_m) - closed_m;
        let tally = &mut self.tally;
        tally.smallest_rear_room_m = tally.smallest_rear_room_m.min(room_m);
        let broken = room_m < -REAR_TOLERANCE_M;
        tally.rear_gap_breaches += u64::from(broken && !pair.rear_broken);
        pair.rear_broken = broken;
    }

    fn judge_input(
        &mut self,
        output: &ControlOutput,
        ego: &TrueVehicle,
        changing: bool,
        excused: bool,
    ) {
        let settings = self.set.settings;
        let ControlInput {
            tan_delta,
            accel_mps2,
        } = output.u;
        let within = tan_delta.abs() <= settings.tan_delta_max + 1e-9
            && accel_mps2 >= -settings.brake_mps2 - 1e-9
            && accel_mps2 <= settings.accel_max_mps2 + 1e-9;
        let lateral_mps2 = ego.speed_mps.powi(2) * tan_delta.abs() / ego.dimensions.wheelbase_m;
        let failed = matches!(
            output.outcome,
            FilterOutcome::Relaxed | FilterOutcome::Backup
        );
        let tally = &mut self.tally;
        // A NaN is not within.
        tally.bad_inputs += u64::from(!within);
        tally.lateral_accel_steps +=
            u64::from(lateral_mps2 > settings.lateral_accel_max_mps2 + 1e-6);
        if std::env::var("TRACE").as_deref() == Ok("2") {
            eprintln!(
                "STEP v {:.6} s {:.4} d {:.5} psi {:.6} hl {:.7} u {:.5} {:.3} {:?} {:?} h {:.4}",
                ego.speed_mps,
                ego.frenet.s_m,
                ego.frenet.d_m,
                ego.frenet.psi_rad,
                output.h_lateral_m,
                output.u.tan_delta,
                output.u.accel_mps2,
                output.outcome,
                output.binding,
                output.h_m
            );
        }
        if failed && !changing && !excused {
            eprintln!(
                "INF v {} {:?} s {} d {} psi {}",
                ego.speed_mps, output, ego.frenet.s_m, ego.frenet.d_m, ego.frenet.psi_rad
            );
        }
        if failed && !changing {
            tally.infeasible += u64::from(!excused);
            tally.infeasible_excused += u64::from(excused);
        }
    }

    /// The body within its lane, or both lanes of a change, and the speed within the curve's.
    fn judge_place(&mut self, ego: &TrueVehicle, manoeuvre: Manoeuvre) {
        let (road, settings) = (self.set.road, self.set.settings);
        let lanes = [manoeuvre.lane(), manoeuvre.destination()];
        let lanes = match manoeuvre {
            Manoeuvre::Announced { lane, .. } => [lane, lane],
            _ => lanes,
        };
        let bounds = lanes.map(|lane| road.lane_bounds_m(lane));
        let right_m = bounds[0].0.min(bounds[1].0);
        let left_m = bounds[0].1.max(bounds[1].1);
        let excess_m = (ego.d_range_m[1] - left_m).max(right_m - ego.d_range_m[0]);
        let curvature = road.curvature(ego.frenet.s_m).abs();
        let half_road_m = 0.5 * f64::from(LANE_COUNT) * road.lane_width_m();
        let sharpest = curvature / (1.0 - curvature * half_road_m);
        let lateral_mps2 =
            ego.speed_mps.powi(2) * (sharpest + settings.counter_curvature_min_per_m);
        let tally = &mut self.tally;
        tally.largest_lane_excess_m = tally.largest_lane_excess_m.max(excess_m);
        if excess_m > TOLERANCE_M {
            eprintln!(
                "EXC {excess_m} {manoeuvre:?} v {} d {} psi {}",
                ego.speed_mps, ego.frenet.d_m, ego.frenet.psi_rad
            );
        }
        tally.lane_excess_steps += u64::from(excess_m > TOLERANCE_M);
        tally.curve_speed_steps +=
            u64::from(lateral_mps2 > settings.lateral_accel_max_mps2 * (1.0 + 1e-6));
    }
}
