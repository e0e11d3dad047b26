use covista_control::{SafetySettings, SightLine};
use covista_traffic::VehicleId;
use covista_world::{LaneIndex, Road, Track};
use nalgebra::{Rotation2, Vector2};

use super::Cause;
use crate::truth::{Lanes, TrueVehicle};

/// A track within this distance of a vehicle, and nearer to it than to any other, is a track of it.
const SAME_OBJECT_M: f64 = 4.0;
/// What projecting a body onto a curved road may be wrong by.
const PROJECTION_M: f64 = 0.01;
const PROJECTION_MPS: f64 = 0.01;
/// How far from a lane a body may be for vision's lane of it to count.
const VISION_LANE_REACH_M: f64 = 1.0;

/// What a CAV knows, against the truth.
#[derive(Clone, Copy)]
pub(super) struct Knowledge<'a> {
    pub time_s: f64,
    pub road: &'a Road,
    pub truth: &'a [TrueVehicle],
    pub tracks: &'a [Track],
    pub sight: Option<&'a SightLine>,
    pub settings: &'a SafetySettings,
}

/// Another vehicle and how the CAV meets it.
#[derive(Clone, Copy)]
pub(super) struct Other<'a> {
    pub vehicle: &'a TrueVehicle,
    /// Whether it is ahead of the CAV.
    pub ahead: bool,
    /// Lanes that both occupy.
    pub shared: Lanes,
    /// What the CAV knows of it.
    pub track: Option<&'a Track>,
    /// Since when it has been in sight.
    pub in_sight_since_s: Option<f64>,
    /// Distance along the road between the bumpers.
    pub away_m: f64,
}

impl<'a> Knowledge<'a> {
    /// The track that stands for `vehicle`: what it tells of itself, or else the nearest one.
    pub fn track_of(&self, vehicle: &TrueVehicle) -> Option<&'a Track> {
        let own = |track: &&Track| {
            track
                .station
                .is_some_and(|station| VehicleId(station.0) == vehicle.id)
        };
        self.tracks.iter().find(own).or_else(|| {
            let error_m2 =
                |track: &Track| (track.state.center.position() - vehicle.center).norm_squared();
            self.tracks
                .iter()
                .min_by(|a, b| error_m2(a).total_cmp(&error_m2(b)))
                .filter(|track| error_m2(track) <= self.reach_m(track).powi(2))
                .filter(|track| self.is_nearest_to(track, vehicle.id))
        })
    }

    /// A track goes on with constant velocity; the vehicle may have braked or turned since.
    fn reach_m(&self, track: &Track) -> f64 {
        SAME_OBJECT_M + 0.5 * self.settings.brake_mps2 * self.age_s(track).powi(2)
    }

    fn is_nearest_to(&self, track: &Track, id: VehicleId) -> bool {
        let position = track.state.center.position();
        let distance_m2 = |vehicle: &TrueVehicle| (vehicle.center - position).norm_squared();
        self.truth
            .iter()
            .min_by(|a, b| distance_m2(a).total_cmp(&distance_m2(b)))
            .is_some_and(|nearest| nearest.id == id)
    }

    fn age_s(&self, track: &Track) -> f64 {
        (self.time_s - measured_s(track)).max(0.0)
    }

    /// Which assumption about what the CAV knows of `other` does not hold.
    pub fn broken(&self, other: &Other<'_>) -> Option<Cause> {
        match other.track {
            None => self.unknown(other),
            Some(track) if self.age_s(track) > self.settings.knowledge_age_max_s => {
                Some(Cause::MessageAge)
            }
            Some(track) => self
                .is_misjudged(other, track)
                .then_some(Cause::PerceptionError),
        }
    }

    fn unknown(&self, other: &Other<'_>) -> Option<Cause> {
        let seen_s = self.time_s - other.in_sight_since_s?;
        let in_range = other.away_m < self.settings.sight_range_m;
        if in_range && seen_s >= self.settings.perception_delay_s {
            return Some(Cause::MissedObject);
        }
        let limit_m = other.vehicle.s_range_m[0] + self.settings.sight_error_m;
        let claims = |sight: &SightLine, lane: LaneIndex| sight.open_s_m(lane) > limit_m;
        let overreaches = self
            .sight
            .is_some_and(|sight| other.shared.iter().any(|lane| claims(sight, lane)));
        (other.ahead && overreaches).then_some(Cause::SightError)
    }

    /// Whether the truth lies outside of what the track, its deviations and its age allow, to the
    /// side on which it matters: nearer and slower ahead, nearer and faster behind.
    fn is_misjudged(&self, other: &Other<'_>, track: &Track) -> bool {
        let (settings, vehicle) = (self.settings, other.vehicle);
        let known = OnRoad::new(track, self.road, vehicle.frenet.s_m, self.time_s);
        let age_s = self.age_s(track);
        let allowed = ErrorBound::new(Some(track), settings);
        let (position_m, speed_mps) = (allowed.position_m + PROJECTION_M, allowed.speed_mps);
        let bumper = if other.ahead { 0 } else { 1 };
        let (known_s_m, true_s_m) = (known.s_range_m[bumper], vehicle.s_range_m[bumper]);
        let turned_rad = self.road.turn_rad(known_s_m, true_s_m);
        let driven_m = true_s_m - known_s_m - vehicle.frenet.d_m * turned_rad;
        let beyond = if other.ahead {
            let slow_mps = (known.along_mps - speed_mps).max(0.0);
            let braked_s = age_s.min(slow_mps / settings.leader_brake_mps2);
            let braked_m = (slow_mps - 0.5 * settings.leader_brake_mps2 * braked_s) * braked_s;
            let braked_mps = (slow_mps - settings.leader_brake_mps2 * age_s).max(0.0);
            let true_mps = vehicle.along_mps().max(0.0);
            driven_m < braked_m - position_m || true_mps < braked_mps - PROJECTION_MPS
        } else {
            let fast_mps = known.along_mps.max(0.0) + speed_mps;
            let gained_mps = settings.follower_accel_mps2 * age_s;
            driven_m > (fast_mps + 0.5 * gained_mps) * age_s + position_m
                || vehicle.along_mps() > fast_mps + gained_mps + PROJECTION_MPS
        };
        let lanes = known.lanes(track, self.road, age_s, settings.lane_entry_m);
        beyond || !other.shared.without(lanes).is_empty()
    }
}

/// How wrong a track may be where it was measured.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ErrorBound {
    pub position_m: f64,
    pub speed_mps: f64,
}

impl ErrorBound {
    /// That of `track`; none without one.
    pub fn new(track: Option<&Track>, settings: &SafetySettings) -> Self {
        track.map_or(Self::default(), |track| Self {
            position_m: settings.error_sigmas * track.position_std_m,
            speed_mps: settings.error_sigmas * track.velocity_std_mps,
        })
    }

    /// The same, with what the vehicle may have done since `track` was measured: a CAV that wins
    /// its distance back heeds that, too.
    pub fn aged(self, track: Option<&Track>, time_s: f64, settings: &SafetySettings) -> Self {
        let age_s = track.map_or(0.0, |track| (time_s - measured_s(track)).max(0.0));
        let apart_mps2 = settings.leader_brake_mps2 + settings.follower_accel_mps2;
        Self {
            position_m: self.position_m + (self.speed_mps + 0.5 * apart_mps2 * age_s) * age_s,
            speed_mps: self.speed_mps + settings.leader_brake_mps2 * age_s,
        }
    }
}

/// A track's body along the road, where it was measured.
struct OnRoad {
    s_range_m: [f64; 2],
    d_range_m: [f64; 2],
    along_mps: f64,
    left_mps: f64,
}

impl OnRoad {
    fn new(track: &Track, road: &Road, s_now_m: f64, time_s: f64) -> Self {
        let state = &track.state;
        let straight_s = track.time_s - measured_s(track);
        let center = state.center.position() - state.velocity_mps * straight_s;
        let hint_m = s_now_m - state.velocity_mps.norm() * (time_s - measured_s(track)).max(0.0);
        let point = road.to_frenet_near(center, hint_m);
        let (line, curvature_per_m) = road.reference(point.s_m);
        let velocity = Rotation2::new(-line.yaw_rad) * state.velocity_mps;
        let (sin, cos) = (state.center.yaw_rad - line.yaw_rad).sin_cos();
        let half = Vector2::new(state.length_m, state.width_m) / 2.0;
        let stretch = (1.0 - curvature_per_m * point.d_m).max(0.2);
        let half_s_m = (half.x * cos.abs() + half.y * sin.abs()) / stretch;
        let half_d_m = half.x * sin.abs() + half.y * cos.abs();
        Self {
            s_range_m: [point.s_m - half_s_m, point.s_m + half_s_m],
            d_range_m: [point.d_m - half_d_m, point.d_m + half_d_m],
            along_mps: velocity.x,
            left_mps: velocity.y,
        }
    }

    /// The lanes that it is known in, `age_s` after it was measured: by its body, or by vision.
    fn lanes(&self, track: &Track, road: &Road, age_s: f64, entry_m: f64) -> Lanes {
        let [right_m, left_m] = self.d_range_m.map(|d_m| d_m + self.left_mps * age_s);
        let reaches = |lane: LaneIndex, by_m: f64| {
            let (lane_right_m, lane_left_m) = road.lane_bounds_m(lane);
            right_m < lane_left_m - by_m && left_m > lane_right_m + by_m
        };
        let is_in = |lane: &LaneIndex| {
            reaches(*lane, entry_m)
                || (track.lane == Some(*lane) && reaches(*lane, -VISION_LANE_REACH_M))
        };
        LaneIndex::all().filter(is_in).collect()
    }
}

/// When a track was last measured; one without sightings stands for its own time.
fn measured_s(track: &Track) -> f64 {
    if track.sightings.is_empty() {
        track.time_s
    } else {
        track.measured_s().min(track.time_s)
    }
}
