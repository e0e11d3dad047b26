use covista_world::{Action, FrenetPoint, LaneIndex, Road, Se2Pose, StationId, Track};
use nalgebra::{Rotation2, Vector2};

use crate::profile::path_curvature;
use crate::situation::lateral_extent_m;
use crate::{EgoState, LaneSet, SafetySettings};

/// Another vehicle on the road, as the ego vehicle knows it: a best estimate and the worst that
/// the estimate's error and age allow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// The track's id.
    pub id: u32,
    /// Its station, where it is a CAV.
    pub station: Option<StationId>,
    /// Lanes that it reaches into, by geometry or by vision.
    pub lanes: LaneSet,
    /// Road s of its rear bumper now, estimated.
    pub s_rear_m: f64,
    /// Road s of its front bumper now, estimated.
    pub s_front_m: f64,
    /// Offset d of its right side.
    pub d_right_m: f64,
    /// Offset d of its left side.
    pub d_left_m: f64,
    /// Speed along the road now, estimated.
    pub speed_mps: f64,
    /// Length of its body.
    pub length_m: f64,
    /// Metres of the road from its centre within which its body lies at any heading.
    pub reach_m: f64,
    /// Road s of its rearmost point at any heading, if it braked with b_l ever since it was measured.
    pub worst_s_rear_m: f64,
    /// Its speed then.
    pub worst_slow_mps: f64,
    /// The same, if it accelerated as the ego vehicle can ever since it was measured.
    pub best_s_rear_m: f64,
    /// Its speed then.
    pub best_fast_mps: f64,
    /// Road s of its foremost point at any heading, if it accelerated with a_b ever since it was
    /// measured.
    pub worst_s_front_m: f64,
    /// Its speed then.
    pub worst_fast_mps: f64,
    /// The action that it announced, where it is a CAV.
    pub action: Option<Action>,
    /// When it announced that action.
    pub announced_s: Option<f64>,
}

/// A vehicle that is surely slower stands.
const STANDING_MPS: f64 = 0.5;
/// How far from a lane a body may be for vision's lane to be believed.
const VISION_LANE_REACH_M: f64 = 1.0;

/// A track placed on the road where it was measured: all of it that does not change with time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    id: u32,
    station: Option<StationId>,
    measured_s: f64,
    /// When the station was last heard itself.
    heard_s: Option<f64>,
    center: FrenetPoint,
    /// Speeds along and across the road, the former not below zero.
    along_mps: f64,
    across_mps: f64,
    position_std_m: f64,
    velocity_std_mps: f64,
    rear_m: f64,
    front_m: f64,
    right_m: f64,
    left_m: f64,
    length_m: f64,
    half_diagonal_m: f64,
    /// Its lane by vision.
    lane: Option<LaneIndex>,
    action: Option<Action>,
    announced_s: Option<f64>,
}

impl Measured {
    /// Places `track` on the road.
    pub fn new(track: &Track, road: &Road) -> Self {
        let state = &track.state;
        let measured_s = if track.sightings.is_empty() {
            track.time_s
        } else {
            track.measured_s().min(track.time_s)
        };
        // The track goes on straight; from where it was measured the vehicle follows the road.
        let straight = state.velocity_mps * (track.time_s - measured_s);
        let measured = Se2Pose {
            x_m: state.center.x_m - straight.x,
            y_m: state.center.y_m - straight.y,
            ..state.center
        };
        let center = road.to_frenet(measured.position());
        let (along_road, _) = road.reference(center.s_m);
        let velocity = Rotation2::new(-along_road.yaw_rad) * state.velocity_mps;
        let half = Vector2::new(state.length_m / 2.0, state.width_m / 2.0);
        let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)]
            .map(|(x, y)| measured.transform(Vector2::new(x * half.x, y * half.y)));
        let on_road = corners.map(|corner| road.to_frenet_near(corner, center.s_m));
        let (right_m, left_m) = lateral_extent_m(corners, road, center.s_m);
        Self {
            id: track.id,
            station: track.station,
            measured_s,
            heard_s: track.station.and_then(|station| track.seen_by(station)),
            center,
            along_mps: velocity.x.max(0.0),
            across_mps: velocity.y,
            position_std_m: track.position_std_m,
            velocity_std_mps: track.velocity_std_mps,
            rear_m: fold_s(&on_road, f64::min),
            front_m: fold_s(&on_road, f64::max),
            right_m,
            left_m,
            length_m: state.length_m,
            half_diagonal_m: half.norm(),
            lane: track.lane,
            action: track.action,
            announced_s: track.announced_s,
        }
    }

    /// What is known of it at time `now_s`; `None` where it is not finite.
    pub fn at(&self, now_s: f64, road: &Road, settings: &SafetySettings) -> Option<Neighbour> {
        let age_s = (now_s - self.measured_s).max(0.0);
        let (center, speed_mps) = (self.center, self.along_mps);
        let sideways_m = self.across_mps * age_s;
        let position_error_m = settings.error_sigmas * self.position_std_m;
        let speed_error_mps = settings.error_sigmas * self.velocity_std_mps;
        let (d_right_m, d_left_m) = (self.right_m + sideways_m, self.left_m + sideways_m);

        let driven_so_far_m = speed_mps * age_s;
        let way_m =
            |speed_mps: f64, accel_mps2: f64| speed_mps * age_s + 0.5 * accel_mps2 * age_s.powi(2);
        let across_m = position_error_m + self.across_mps.abs() * age_s;
        let along_m = position_error_m
            + way_m(
                speed_mps + speed_error_mps,
                settings.accel_max_mps2.max(settings.follower_accel_mps2),
            );
        let reach_m = 2.0 * (along_m + self.half_diagonal_m);
        let span_m = [center.s_m - reach_m, center.s_m + reach_m];
        let metres = MetresOfRoad::around(road, span_m, center, across_m);
        // Whatever its heading is, or will be, its body lies within a circle, in a larger one if
        // its place or its length is wrong.
        let around_m = |radius_m| circle_m(road, radius_m, metres.curvature_per_m);
        let circle_m = around_m(self.half_diagonal_m);
        let worst_circle_m = around_m(self.half_diagonal_m + position_error_m);
        // Elsewhere on a curve some of its speed across the road is along it, and the other way round.
        let turned_rad = metres.sharpest_per_m * along_m;
        let turned_mps = turned_rad * (self.across_mps.abs() + turned_rad * speed_mps);

        let slow_mps = (speed_mps - speed_error_mps - turned_mps).max(0.0);
        let braking_s = age_s.min(slow_mps / settings.leader_brake_mps2);
        let braked_m = slow_mps * braking_s - 0.5 * settings.leader_brake_mps2 * braking_s.powi(2);
        let fast_mps = speed_mps + speed_error_mps + turned_mps;
        let driven_m = way_m(fast_mps, settings.follower_accel_mps2);
        let farthest_m = way_m(fast_mps, settings.accel_max_mps2);

        let intends =
            (self.heard_s).is_some_and(|heard_s| now_s - heard_s <= settings.announcement_s + 1e-9);

        let neighbour = Neighbour {
            id: self.id,
            station: self.station,
            // It may have stopped anywhere on the way between where it was and where it would be.
            lanes: lanes_of(
                self.lane,
                road,
                self.right_m.min(d_right_m),
                self.left_m.max(d_left_m),
                settings.lane_entry_m,
            ),
            s_rear_m: self.rear_m + driven_so_far_m * metres.mean,
            s_front_m: self.front_m + driven_so_far_m * metres.mean,
            d_right_m,
            d_left_m,
            speed_mps,
            length_m: self.length_m,
            reach_m: circle_m,
            worst_s_rear_m: center.s_m - worst_circle_m + braked_m * metres.least,
            worst_slow_mps: (slow_mps - settings.leader_brake_mps2 * age_s).max(0.0),
            best_s_rear_m: center.s_m - circle_m + (farthest_m + position_error_m) * metres.most,
            best_fast_mps: fast_mps + settings.accel_max_mps2 * age_s,
            worst_s_front_m: center.s_m + worst_circle_m + driven_m * metres.most,
            worst_fast_mps: fast_mps + settings.follower_accel_mps2 * age_s,
            action: self.action.filter(|_| intends),
            announced_s: self.announced_s.filter(|_| intends),
        };
        (now_s.is_finite() && neighbour.is_finite()).then_some(neighbour)
    }
}

impl Neighbour {
    /// Places a track on the road at time `now_s`; `None` where it is not finite.
    pub fn from_track(
        track: &Track,
        road: &Road,
        now_s: f64,
        settings: &SafetySettings,
    ) -> Option<Self> {
        Measured::new(track, road).at(now_s, road, settings)
    }

    /// The same vehicle `by_m` farther along a road that repeats with that length.
    #[must_use]
    pub fn farther(self, by_m: f64) -> Self {
        Self {
            s_rear_m: self.s_rear_m + by_m,
            s_front_m: self.s_front_m + by_m,
            worst_s_rear_m: self.worst_s_rear_m + by_m,
            best_s_rear_m: self.best_s_rear_m + by_m,
            worst_s_front_m: self.worst_s_front_m + by_m,
            ..self
        }
    }

    /// The same vehicle for somebody whom it does not tell what it is about.
    #[must_use]
    pub fn untold(self) -> Self {
        Self {
            station: None,
            action: None,
            announced_s: None,
            ..self
        }
    }

    pub(crate) fn center_s_m(&self) -> f64 {
        0.5 * (self.s_rear_m + self.s_front_m)
    }

    /// Whether it is ahead of the ego vehicle: by the bodies' centres.
    pub(crate) fn is_ahead_of(&self, ego: &EgoState) -> bool {
        self.center_s_m() > ego.frenet.s_m + ego.dimensions.center_ahead_of_axle_m()
    }

    /// Whether it may be faster than one that stands, which changes no lane.
    pub(crate) fn may_move(&self) -> bool {
        self.best_fast_mps > STANDING_MPS
    }

    /// Whether it is a CAV that announced what it is about before the ego vehicle did, at
    /// `announced_s`; ties go to the lower station. What it does not date it announced just now.
    pub(crate) fn precedes(&self, ego: &EgoState, announced_s: f64, now_s: f64) -> bool {
        let theirs_s = self.announced_s.unwrap_or(now_s);
        let is_before = |station: StationId| {
            theirs_s < announced_s || theirs_s <= announced_s && station < ego.station
        };
        self.station.is_some_and(is_before)
    }

    /// The lane that it announced to enter.
    pub(crate) fn entering(&self, road: &Road) -> Option<LaneIndex> {
        let lane = road.lane_at(0.5 * (self.d_right_m + self.d_left_m))?;
        match self.action? {
            Action::ChangeLeft => lane.left(),
            Action::ChangeRight => lane.right(),
            Action::KeepLane | Action::EmergencyStop => None,
        }
    }

    pub(crate) fn is_finite(&self) -> bool {
        [
            self.s_rear_m,
            self.s_front_m,
            self.d_right_m,
            self.d_left_m,
            self.speed_mps,
            self.length_m,
            self.reach_m,
            self.worst_s_rear_m,
            self.worst_slow_mps,
            self.best_s_rear_m,
            self.best_fast_mps,
            self.worst_s_front_m,
            self.worst_fast_mps,
            self.announced_s.unwrap_or(0.0),
        ]
        .iter()
        .all(|x| x.is_finite())
    }
}

/// A parallel is not taken to be shorter than this share of the reference line.
const LEAST_SHARE: f64 = 0.5;
/// A road less curved than this is straight.
const STRAIGHT_PER_M: f64 = 1e-9;

/// Metres of the reference line per metre driven at an offset d: 1 / (1 - kappa d).
struct MetresOfRoad {
    least: f64,
    mean: f64,
    most: f64,
    /// The sharpest curvature of the road there, and that of a parallel.
    curvature_per_m: f64,
    sharpest_per_m: f64,
}

impl MetresOfRoad {
    /// Between two road s, within `across_m` of the offset of `center`.
    fn around(road: &Road, [from_m, to_m]: [f64; 2], center: FrenetPoint, across_m: f64) -> Self {
        let (right, left) = road.curvature_range(from_m, to_m);
        let per_metre = |curvature: f64, d_m: f64| 1.0 / (1.0 - curvature * d_m).max(LEAST_SHARE);
        let [one, other] = [right, left].map(|curvature| per_metre(curvature, center.d_m));
        let [low, high] = [center.d_m - across_m, center.d_m + across_m];
        let all = [(right, low), (right, high), (left, low), (left, high)];
        let each = all.map(|(curvature, d_m)| per_metre(curvature, d_m));
        let most = each.iter().fold(1.0_f64, |most, each| most.max(*each));
        let curvature_per_m = right.abs().max(left.abs());
        Self {
            least: each.iter().fold(1.0, |least, each| least.min(*each)),
            mean: 0.5 * (one + other),
            most,
            curvature_per_m,
            sharpest_per_m: curvature_per_m * most,
        }
    }
}

/// How far a circle of radius `radius_m` reaches along a road of curvature `curvature_per_m`: seen
/// from the centre of curvature it spans asin(r k) with k the curvature of its parallel. With the
/// sharpest of all parallels, so that sliding across the road brings it no nearer.
fn circle_m(road: &Road, radius_m: f64, curvature_per_m: f64) -> f64 {
    if curvature_per_m < STRAIGHT_PER_M {
        return radius_m;
    }
    (radius_m * path_curvature(curvature_per_m, road))
        .min(1.0)
        .asin()
        / curvature_per_m
}

fn fold_s(points: &[FrenetPoint; 4], pick: fn(f64, f64) -> f64) -> f64 {
    points
        .iter()
        .map(|point| point.s_m)
        .fold(points[0].s_m, pick)
}

fn lanes_of(
    by_vision: Option<LaneIndex>,
    road: &Road,
    right_m: f64,
    left_m: f64,
    entry_m: f64,
) -> LaneSet {
    let mut lanes = LaneSet::between(road, right_m, left_m, entry_m);
    if let Some(lane) = by_vision {
        let near = LaneSet::between(road, right_m, left_m, -VISION_LANE_REACH_M);
        if near.contains(lane) {
            lanes.insert(lane);
        }
    }
    lanes
}
