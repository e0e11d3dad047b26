use covista_control::{LaneSet, Manoeuvre, Neighbour};
use covista_traffic::Footprint;
use covista_world::{LaneIndex, STEP_S};

use super::{
    exact::{Body, Levels, SafeSet},
    follower::Behind,
    tally::Tally,
};
use crate::{
    TrueVehicle,
    excuse::{Excuse, Moment},
};

/// Round-off.
pub(super) const TOLERANCE_M: f64 = 1e-6;
/// A vehicle known to be slower than this stands.
const STANDING_MPS: f64 = 0.5;
/// What noise may add to the speed of one that wins its distance back without speeding up.
const NEARLY_MPS: f64 = 0.1;

/// One other vehicle as it truly is in this step, and what the ego vehicle has of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub truth: TrueVehicle,
    /// Along its lane.
    pub speed_mps: f64,
    /// In the ego vehicle's sight, or known.
    pub is_visible: bool,
    /// As the ego vehicle knows it.
    pub known: Option<Neighbour>,
    /// Step of the newest measurement of it that is known.
    pub measured: Option<usize>,
    /// Whether it keeps its distance to the ego vehicle in the manner of RSS.
    pub follows: bool,
}

/// The ego vehicle in one step.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub set: SafeSet<'a>,
    pub step: usize,
    pub ego: &'a TrueVehicle,
    pub manoeuvre: Manoeuvre,
    /// Whether a lane change or its abort runs.
    pub changing: bool,
    /// Whether the body is within the lane that it keeps, or has yet to leave.
    pub within_lane: bool,
    /// Lanes that its body is in, and the one that it keeps or enters: there h is judged.
    pub own: LaneSet,
    /// The same, and the lane that it leaves as long as the change runs: there rows may be excused.
    pub claimed: LaneSet,
    /// `claimed` one step before.
    pub claimed_before: LaneSet,
    /// Whether cut-ins and reveals inside the set count as violations: they were made on purpose.
    pub excuses_nothing: bool,
}

/// The ego vehicle and one other, from step to step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pair {
    occupied: LaneSet,
    is_visible: bool,
    /// In a lane of the ego vehicle's.
    shares_lane: bool,
    is_ahead: bool,
    known: Option<LaneSet>,
    is_known_ahead: bool,
    /// When it came into the lane.
    entered: Option<usize>,
    excuse: Excuse,
    /// The distance may be given up to drive round it, and it was.
    leaving: bool,
    gave_up: bool,
    /// Whether h >= 0 towards the worst that may be made of what is known.
    is_won_back: bool,
    /// h_0 < 0 at once.
    collides: bool,
    h: Level,
    h0: Level,
    headway_broken: bool,
    contact: Contact,
    behind: Behind,
}

/// One level of the barrier, from step to step.
#[derive(Debug, Clone, Copy, Default)]
struct Level {
    /// It was at or above zero in the set's own definition since the lane is kept.
    in_set: bool,
    violates: bool,
}

/// How the bodies came together.
#[derive(Debug, Clone, Copy, Default)]
struct Contact {
    touches: bool,
    from: Side,
    /// There was no room for the collision level since they came near each other.
    had_no_room: bool,
}

/// Where the other was before the bodies came near each other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Side {
    #[default]
    Beside,
    Ahead,
    Behind,
}

impl Level {
    /// Whether it falls below zero in this step: in the set's own definition while a lane is kept,
    /// once it has been reached there, and by the true bumpers otherwise.
    fn falls(&mut self, plain_m: f64, set_m: f64, changing: bool) -> bool {
        self.in_set = !changing && (self.in_set || set_m >= -TOLERANCE_M);
        let level_m = if self.in_set { set_m } else { plain_m };
        let violates = level_m < -TOLERANCE_M;
        !std::mem::replace(&mut self.violates, violates) && violates
    }
}

impl Pair {
    /// Whether h < 0 towards it is excused.
    pub fn is_excused(&self) -> bool {
        self.leaving || self.excuse.holds()
    }

    /// Takes in one step.
    pub fn step(&mut self, scene: &Scene<'_>, seen: &Seen, tally: &mut Tally) {
        let (before, road, other) = (*self, scene.set.road, &seen.truth);
        let [right_m, left_m] = other.d_range_m;
        let entry_m = scene.set.settings.lane_entry_m;
        self.occupied = LaneSet::between(road, right_m, left_m, entry_m);
        self.is_visible = seen.is_visible;
        self.shares_lane = scene.shared(self.occupied).next().is_some();
        self.is_ahead = scene.ego.is_behind(other);
        self.known = seen.known.map(|known| known.lanes);
        self.is_known_ahead = (seen.known)
            .is_some_and(|known| 0.5 * (known.s_rear_m + known.s_front_m) > scene.ego.middle_s_m());

        let is_met = self.is_ahead && seen.is_visible;
        let claimed = scene.levels(seen, scene.shared(self.occupied));
        let claimed = claimed.filter(|_| is_met);
        let levels = if scene.own == scene.claimed {
            claimed
        } else {
            let own = scene.levels(seen, common(scene.own, self.occupied));
            own.filter(|_| is_met)
        };
        self.judge_excuse(scene, seen, before, claimed, tally);
        match levels {
            Some(levels) => self.judge_levels(scene, seen, levels, tally),
            None => {
                (self.h, self.h0) = (Level::default(), Level::default());
                self.headway_broken = false;
                self.leaving &= claimed.is_some();
                self.collides &= claimed.is_some();
            }
        }
        self.judge_estimate(scene, seen, levels, tally);
        self.judge_contact(scene, seen, tally);
        let is_behind = !self.is_ahead && seen.follows;
        self.behind
            .step(scene, seen, self.occupied, is_behind, tally);
    }

    fn judge_excuse(
        &mut self,
        scene: &Scene<'_>,
        seen: &Seen,
        before: Self,
        levels: Option<Levels>,
        tally: &mut Tally,
    ) {
        let new_in = |now: LaneSet, then: LaneSet| {
            (scene.shared(now))
                .any(|lane| !then.contains(lane) && scene.claimed_before.contains(lane))
        };
        let passes = before.shares_lane && !before.is_ahead;
        let comes_in = levels.is_some() && (new_in(self.occupied, before.occupied) || passes);
        let known = self
            .known
            .filter(|lanes| self.is_known_ahead && scene.shared(*lanes).next().is_some());
        // A row for the lane that is left ends before the change does.
        let is_known_in_own = known.is_some_and(|lanes| common(scene.own, lanes).next().is_some());
        if levels.is_none() && known.is_none() || scene.excuses_nothing {
            (self.excuse, self.entered) = (Excuse::default(), None);
            return;
        }
        if comes_in {
            self.entered = Some(scene.step);
        }
        let known_h_m = |body: fn(&Neighbour) -> Body| {
            let (known, lanes) = seen.known.as_ref().zip(self.known)?;
            (scene.shared(lanes))
                .map(|lane| {
                    let off = scene.lanes_off();
                    scene.set.known_h_m(scene.ego, body(known), lane, off)
                })
                .min_by(f64::total_cmp)
        };
        let is_newer = |entered: usize| {
            seen.measured.is_some_and(|measured| measured >= entered)
                || scene.step > entered + scene.latest_steps()
        };
        let is_known_to_come_in = known
            .zip(before.known)
            .is_some_and(|(lanes, then)| new_in(lanes, then) || !before.is_known_ahead);
        let worst = |known: &Neighbour| Body {
            rear_s_m: known.worst_s_rear_m,
            speed_mps: known.worst_slow_mps,
            length_m: known.length_m,
        };
        let measured = |known: &Neighbour| Body {
            rear_s_m: 0.5 * (known.s_rear_m + known.s_front_m) - known.reach_m,
            speed_mps: known.speed_mps,
            length_m: known.length_m,
        };
        let moment = Moment {
            comes_in,
            appears: levels.is_some() && !before.is_visible,
            is_known_to_come_in,
            is_untold: !is_known_in_own && self.entered.is_some_and(|entered| !is_newer(entered)),
            is_inside: levels.is_some_and(|levels| levels.set_h_m < -TOLERANCE_M),
            is_inside_as_known: known.is_some() && known_h_m(measured).is_some_and(|h| h < 0.0),
            is_won_back: known_h_m(worst).is_some_and(|h| h >= 0.0),
        };
        self.is_won_back = moment.is_won_back;
        self.excuse = before.excuse.after(&moment);
        let begins = self.excuse.at_once && !before.excuse.at_once;
        let late = before.excuse.untold && !self.excuse.untold;
        tally.excused += u64::from(begins && !late);
        tally.excused_known_late += u64::from(begins && late);
        // The collision level is excused only where it was broken at once, too.
        let at_once = moment.comes_in || moment.appears || late;
        let broken = levels.is_some_and(|levels| levels.set_h0_m < -TOLERANCE_M);
        self.collides = self.excuse.at_once && broken && (at_once || before.collides);
    }

    /// Whether not even the collision level could be kept.
    fn has_no_room(&self) -> bool {
        self.collides || self.excuse.untold
    }

    fn judge_levels(&mut self, scene: &Scene<'_>, seen: &Seen, levels: Levels, tally: &mut Tally) {
        let changing = scene.changing;
        self.judge_leaving(scene, seen, levels, tally);
        if self.has_no_room() {
            self.h0 = Level::default();
        } else {
            tally.smallest_h0_m = tally.smallest_h0_m.min(levels.h0_m);
            let falls = self.h0.falls(levels.h0_m, levels.set_h0_m, changing);
            if falls {
                tally.collision_level_violations += 1;
                tally.note("collision level", scene, seen, Some(levels));
            }
        }
        if self.is_excused() {
            (self.h, self.headway_broken) = (Level::default(), false);
            return;
        }
        if self.h.falls(levels.h_m, levels.set_h_m, changing) {
            tally.violations += 1;
            tally.note("violation", scene, seen, Some(levels));
        }
        if self.h.in_set {
            tally.smallest_set_h_m = tally.smallest_set_h_m.min(levels.set_h_m);
        }
        tally.smallest_h_m = tally.smallest_h_m.min(levels.h_m);
        tally.smallest_headway_m = tally.smallest_headway_m.min(levels.headway_m);
        let broken = levels.headway_m < scene.set.settings.headway_safe_m - TOLERANCE_M;
        tally.headway_violations += u64::from(broken && !self.headway_broken);
        self.headway_broken = broken;
    }

    /// A slow vehicle that leaves its lane round one which is known to stand gives the distance up,
    /// and stays slow until that is won back.
    fn judge_leaving(&mut self, scene: &Scene<'_>, seen: &Seen, levels: Levels, tally: &mut Tally) {
        let slow_mps = scene.set.settings.leaving_speed_mps;
        let v = scene.ego.speed_mps;
        let stands = (seen.known).is_some_and(|known| known.speed_mps < STANDING_MPS);
        let is_left = scene.changing && self.occupied.contains(scene.manoeuvre.lane());
        let leaves = is_left && stands && v <= slow_mps + TOLERANCE_M;
        let begins = leaves && !self.is_excused() && !self.h.violates;
        let goes_on = self.leaving && v <= slow_mps + NEARLY_MPS;
        let is_broken = !self.is_won_back;
        self.leaving = is_broken && (begins || goes_on);
        let gives_up = self.leaving && levels.h_m < -TOLERANCE_M;
        tally.excused_leaving += u64::from(gives_up && !self.gave_up);
        self.gave_up = gives_up;
    }

    /// What the ego vehicle must reckon with is never better than the truth.
    fn judge_estimate(
        &self,
        scene: &Scene<'_>,
        seen: &Seen,
        levels: Option<Levels>,
        tally: &mut Tally,
    ) {
        let (Some(known), Some(_)) = (seen.known, levels) else {
            return;
        };
        let nearer_m = known.worst_s_rear_m - scene.set.rearmost_s_m(&seen.truth);
        let slower_mps = known.worst_slow_mps - seen.speed_mps;
        if nearer_m > TOLERANCE_M || slower_mps > TOLERANCE_M {
            tally.beyond_estimate_steps += 1;
            tally.note(
                &format!("nearer by {nearer_m:.6} m, slower by {slower_mps:.6} m/s"),
                scene,
                seen,
                levels,
            );
        }
    }

    /// A contact is a collision when the ego vehicle runs into what was ahead of it, touches one beside
    /// it while it is outside of the lane that it keeps or has yet to leave, or is run into by one
    /// that follows as assumed. Any other is the other's doing, and so is one with a vehicle that came
    /// in, or into sight, inside the collision set.
    fn judge_contact(&mut self, scene: &Scene<'_>, seen: &Seen, tally: &mut Tally) {
        let (ego, other) = (scene.ego, &seen.truth);
        let meets = |a: [f64; 2], b: [f64; 2]| a[0] < b[1] && b[0] < a[1];
        let is_near =
            meets(ego.s_range_m, other.s_range_m) && meets(ego.d_range_m, other.d_range_m);
        if !is_near {
            let from = if other.s_range_m[0] >= ego.s_range_m[1] {
                Side::Ahead
            } else if other.s_range_m[1] <= ego.s_range_m[0] {
                Side::Behind
            } else {
                Side::Beside
            };
            self.contact = Contact {
                touches: false,
                from,
                had_no_room: self.has_no_room(),
            };
            return;
        }
        self.contact.had_no_room |= self.has_no_room();
        let touches = scene.footprint(ego).overlaps(&scene.footprint(other));
        if std::mem::replace(&mut self.contact.touches, touches) || !touches {
            return;
        }
        let others_doing = self.contact.had_no_room
            || match self.contact.from {
                Side::Ahead => false,
                Side::Behind => !seen.follows,
                Side::Beside => scene.within_lane,
            };
        if others_doing {
            tally.touched += 1;
        } else {
            tally.collisions += 1;
            tally.note("collision", scene, seen, None);
        }
    }
}

impl Scene<'_> {
    /// Those of `lanes` that the ego vehicle claims.
    fn shared(&self, lanes: LaneSet) -> impl Iterator<Item = LaneIndex> + use<> {
        common(self.claimed, lanes)
    }

    /// How far the rear axle may be from a lane's centre, in lane widths.
    fn lanes_off(&self) -> f64 {
        if self.changing { 1.5 } else { 0.5 }
    }

    /// The worst of the true levels towards a vehicle in `lanes`.
    fn levels(&self, seen: &Seen, lanes: impl Iterator<Item = LaneIndex>) -> Option<Levels> {
        lanes
            .map(|lane| {
                let off = self.lanes_off();
                (self.set).levels(self.ego, &seen.truth, seen.speed_mps, lane, off)
            })
            .min_by(|a, b| a.h_m.total_cmp(&b.h_m))
    }

    /// Steps within which a vehicle in sight is known, and so is what it does.
    fn latest_steps(&self) -> usize {
        let settings = self.set.settings;
        let latest_s = settings.perception_delay_s + settings.knowledge_age_max_s;
        (latest_s / STEP_S).ceil() as usize
    }

    fn footprint(&self, of: &TrueVehicle) -> Footprint {
        let at = &of.frenet;
        let pose = self.set.road.pose_from_frenet(at.s_m, at.d_m, at.psi_rad);
        Footprint::new(pose, of.dimensions, 0.0)
    }
}

/// Those that are in both.
fn common(a: LaneSet, b: LaneSet) -> impl Iterator<Item = LaneIndex> {
    LaneIndex::all().filter(move |lane| a.contains(*lane) && b.contains(*lane))
}
