use covista_world::{FrenetPose, LaneIndex, Road, STEP_S};

use crate::{
    TAN_DELTA_MAX,
    idm::{Ahead, Idm},
};

/// Distance over which steering takes back an error of the path.
const STEERING_LENGTH_M: f64 = 6.0;
/// Room a driver keeps on either side of the body.
const SIDE_ROOM_M: f64 = 0.4;
const LANE_CHANGE_S: f64 = 4.0;
const LANE_CHANGE_MIN_M: f64 = 10.0;
/// Below this gap nobody can pull out from behind a standing vehicle any more.
const PULL_OUT_GAP_M: f64 = 3.5;
/// Extra room kept behind a standing vehicle, to be able to pull out.
const PULL_OUT_ROOM_M: f64 = 6.0;
/// Whoever is slower counts as standing.
const STANDING_MPS: f64 = 0.5;
/// Jam distance to what is being pulled out from behind.
const CHANGING_GAP_M: f64 = 0.5;
/// The hardest braking a lane change may ask of the follower or of oneself (MOBIL's safety).
const SAFE_BRAKING_MPS2: f64 = 2.5;
const SIDE_GAP_M: f64 = 1.0;

/// When a driver looks for another lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Habit {
    /// A leader below this share of the desired speed holds the driver up.
    held_up_share: f64,
    /// Gain in acceleration that is worth a lane change (MOBIL's threshold).
    gain_mps2: f64,
    /// How much faster the new leader has to be.
    faster_mps: f64,
    /// How much the new follower's loss in acceleration counts against the own gain (MOBIL's p).
    politeness: f64,
}

impl Habit {
    /// Keeps the lane unless it is blocked or nearly so.
    pub const KEEPS_LANE: Self = Self {
        held_up_share: 0.35,
        gain_mps2: 0.3,
        faster_mps: 1.0,
        politeness: 0.0,
    };
    /// Passes whoever is slower, by MOBIL.
    pub const PASSES: Self = Self {
        held_up_share: 1.0,
        gain_mps2: 0.1,
        faster_mps: 0.0,
        politeness: 0.3,
    };
}

/// The strip of road a vehicle covers, or is about to cover, in Frenet coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Strip {
    pub rear_m: f64,
    pub front_m: f64,
    pub across: Across,
    /// What the front bumper alone covers.
    pub front_across: Across,
    pub speed_mps: f64,
}

/// An interval of the offset d.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Across {
    pub right_m: f64,
    pub left_m: f64,
}

impl Across {
    pub fn around(center_m: f64, half_m: f64) -> Self {
        Self {
            right_m: center_m - half_m,
            left_m: center_m + half_m,
        }
    }

    pub fn union(self, other: Self) -> Self {
        Self {
            right_m: self.right_m.min(other.right_m),
            left_m: self.left_m.max(other.left_m),
        }
    }

    /// With all that a movement of `left_m` to the left passes over.
    pub fn moving(self, left_m: f64) -> Self {
        Self {
            right_m: self.right_m + left_m.min(0.0),
            left_m: self.left_m + left_m.max(0.0),
        }
    }

    pub fn overlaps(self, other: Self) -> bool {
        self.right_m < other.left_m && other.right_m < self.left_m
    }
}

/// A lane change under way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LaneChange {
    target: LaneIndex,
    from_d_m: f64,
    length_m: f64,
    travelled_m: f64,
}

/// A human driver: follows by the IDM, keeps the lane, and changes it when clearly held up.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HumanDriver {
    idm: Idm,
    habit: Habit,
    lane: LaneIndex,
    change: Option<LaneChange>,
    half_width_m: f64,
    pub accel_mps2: f64,
}

impl HumanDriver {
    pub fn new(idm: Idm, habit: Habit, lane: LaneIndex, width_m: f64) -> Self {
        Self {
            idm,
            habit,
            lane,
            change: None,
            half_width_m: width_m / 2.0,
            accel_mps2: 0.0,
        }
    }

    /// The lane a change under way leads to.
    pub fn lane_change(&self) -> Option<LaneIndex> {
        self.change.map(|change| change.target)
    }

    /// The swath the driver means to cover in `lane`.
    pub fn swath(&self, lane: LaneIndex, road: &Road) -> Across {
        Across::around(road.lane_center_m(lane), self.half_width_m + SIDE_ROOM_M)
    }

    /// Decides on acceleration and lane, from the own strip and those of the vehicles in sight;
    /// gives which of these the driver follows.
    pub fn decide(&mut self, own: &Strip, seen: &[Strip], d_m: f64, road: &Road) -> Option<usize> {
        let target = self.lane_change().unwrap_or(self.lane);
        let corridor = self.swath(target, road).union(own.front_across);
        let followed = leader(own, seen, corridor);
        let ahead = followed.map(|(_, ahead)| ahead);
        self.follow(own.speed_mps, ahead);
        if self.change.is_none() && self.is_held_up(ahead) {
            self.change = self.best_change(own, seen, ahead, d_m, road);
            self.follow(own.speed_mps, ahead);
        }
        followed.map(|(index, _)| index)
    }

    /// Decides on the acceleration alone, behind whoever is `ahead`.
    pub fn follow(&mut self, speed_mps: f64, ahead: Option<Ahead>) {
        let mut idm = self.idm;
        if self.change.is_some() {
            idm.jam_distance_m = CHANGING_GAP_M;
        } else if ahead.is_some_and(|leader| leader.speed_mps < STANDING_MPS) {
            idm.jam_distance_m += PULL_OUT_ROOM_M;
        }
        self.accel_mps2 = idm.acceleration(speed_mps, ahead);
    }

    fn is_held_up(&self, leader: Option<Ahead>) -> bool {
        leader.is_some_and(|leader| {
            leader.speed_mps < self.habit.held_up_share * self.idm.desired_speed_mps
                && leader.gap_m > PULL_OUT_GAP_M
        })
    }

    /// The neighbouring lane that gains most, if it is worth it and safe.
    fn best_change(
        &self,
        own: &Strip,
        seen: &[Strip],
        held_by: Option<Ahead>,
        d_m: f64,
        road: &Road,
    ) -> Option<LaneChange> {
        let gain = |lane: LaneIndex| {
            let swath = self.swath(lane, road);
            let ahead = leader(own, seen, swath).map(|(_, ahead)| ahead);
            let then = self.idm.acceleration(own.speed_mps, ahead);
            let faster = ahead.map_or(f64::INFINITY, |leader| leader.speed_mps)
                > held_by.map_or(0.0, |leader| leader.speed_mps) + self.habit.faster_mps;
            let safe = then > -SAFE_BRAKING_MPS2
                && ahead.is_none_or(|leader| leader.gap_m > SIDE_GAP_M)
                && self.follower_is_safe(own, seen, swath);
            let courtesy = self.habit.politeness * self.loss_of_follower(own, seen, swath);
            let worth = then > self.accel_mps2 + self.habit.gain_mps2 + courtesy;
            (safe && faster && worth).then_some((lane, then - courtesy))
        };
        let (target, _) = [self.lane.left(), self.lane.right()]
            .into_iter()
            .flatten()
            .filter_map(gain)
            .max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        let room_m = held_by.map_or(f64::INFINITY, |leader| 1.5 * leader.gap_m);
        Some(LaneChange {
            target,
            from_d_m: d_m,
            length_m: (LANE_CHANGE_S * own.speed_mps)
                .min(room_m)
                .max(LANE_CHANGE_MIN_M),
            travelled_m: 0.0,
        })
    }

    /// What the nearest follower in `swath` would lose in acceleration, taken to drive as this
    /// driver does.
    fn loss_of_follower(&self, own: &Strip, seen: &[Strip], swath: Across) -> f64 {
        let follower = seen
            .iter()
            .filter(|other| other.front_m <= own.front_m && other.across.overlaps(swath))
            .max_by(|a, b| a.front_m.total_cmp(&b.front_m));
        follower.map_or(0.0, |follower| {
            let now = leader(follower, seen, swath).map(|(_, ahead)| ahead);
            let then = Ahead {
                gap_m: own.rear_m - follower.front_m,
                speed_mps: own.speed_mps,
            };
            let accel = |ahead| self.idm.acceleration(follower.speed_mps, ahead);
            (accel(now) - accel(Some(then))).max(0.0)
        })
    }

    /// Whether the follower in `swath` need not brake hard, taken to drive as this driver does.
    fn follower_is_safe(&self, own: &Strip, seen: &[Strip], swath: Across) -> bool {
        seen.iter()
            .filter(|other| other.front_m <= own.front_m && other.across.overlaps(swath))
            .all(|other| {
                let gap_m = own.rear_m - other.front_m;
                let to_own = Ahead {
                    gap_m,
                    speed_mps: own.speed_mps,
                };
                let braking = -self.idm.acceleration(other.speed_mps, Some(to_own));
                gap_m > SIDE_GAP_M && braking < SAFE_BRAKING_MPS2
            })
    }

    /// One step along the path: tan of the steering angle that keeps the vehicle on it.
    pub fn steer(
        &mut self,
        frenet: FrenetPose,
        speed_mps: f64,
        road: &Road,
        wheelbase_m: f64,
    ) -> f64 {
        let [d_ref_m, heading, bend] = self.path(road);
        let along = frenet.curvature_per_m * frenet.psi_rad.cos()
            / (1.0 - frenet.curvature_per_m * frenet.d_m).max(0.2);
        let curvature = along + bend
            - (frenet.d_m - d_ref_m) / STEERING_LENGTH_M.powi(2)
            - 2.0 * (frenet.psi_rad - heading) / STEERING_LENGTH_M;
        if let Some(change) = &mut self.change {
            change.travelled_m += speed_mps * STEP_S;
            if change.travelled_m >= change.length_m {
                self.lane = change.target;
                self.change = None;
            }
        }
        (wheelbase_m * curvature).clamp(-TAN_DELTA_MAX, TAN_DELTA_MAX)
    }

    /// Offset d of the path, its heading and its curvature relative to the road.
    fn path(&self, road: &Road) -> [f64; 3] {
        let Some(change) = self.change else {
            return [road.lane_center_m(self.lane), 0.0, 0.0];
        };
        let p = change.travelled_m / change.length_m;
        let across_m = road.lane_center_m(change.target) - change.from_d_m;
        // The quintic with zero slope and bend at both ends.
        let shape = p.powi(3) * (10.0 - 15.0 * p + 6.0 * p * p);
        let slope = 30.0 * p * p * (1.0 - p).powi(2);
        let bend = 60.0 * p * (1.0 - p) * (1.0 - 2.0 * p);
        [
            change.from_d_m + across_m * shape,
            (across_m * slope / change.length_m).atan(),
            across_m * bend / change.length_m.powi(2),
        ]
    }
}

/// The nearest vehicle ahead that overlaps `corridor`, and which one it is.
pub(crate) fn leader(own: &Strip, seen: &[Strip], corridor: Across) -> Option<(usize, Ahead)> {
    seen.iter()
        .enumerate()
        .filter(|(_, other)| other.front_m > own.front_m && other.across.overlaps(corridor))
        .map(|(index, other)| {
            let ahead = Ahead {
                gap_m: other.rear_m - own.front_m,
                speed_mps: other.speed_mps,
            };
            (index, ahead)
        })
        .min_by(|(_, a), (_, b)| a.gap_m.total_cmp(&b.gap_m))
}
