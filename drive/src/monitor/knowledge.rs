use covista_control::{SafetySettings, SightLine};
use covista_traffic::VehicleId;
use covista_world::{LaneIndex, Road, Se2Pose, Track};
use nalgebra::{Rotation2, Vector2};

use super::Cause;
use crate::truth::{Lanes, TrueVehicle, range};

/// A track within this distance of a vehicle, and nearer to it than to any other, is a track of it.
const SAME_OBJECT_M: f64 = 4.0;
/// What projecting a body onto a curved road may be wrong by.
const PROJECTION_M: f64 = 0.05;
const PROJECTION_MPS: f64 = 0.05;
/// How far from a lane a body may be for vision's lane of it to count.
const VISION_LANE_REACH_M: f64 = 1.0;

/// What a CAV knows, against the truth.
#[derive(Clone, Copy)]
pub(super) struct Knowledge<'a> {
    pub time_s: f64,
    pub road: &'a Road,
    pub truth: &'a [TrueVehicle],
    pub tracks: &'a [PlacedTrack],
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
    pub track: Option<&'a PlacedTrack>,
    /// When it came into the newest of its lanes.
    pub entered_s: f64,
    /// Since when it has been in sight.
    pub in_sight_since_s: Option<f64>,
    /// Distance along the road between the bumpers.
    pub away_m: f64,
}

impl<'a> Knowledge<'a> {
    /// The track that stands for `vehicle`: what it tells of itself, or else the nearest one.
    pub fn track_of(&self, vehicle: &TrueVehicle) -> Option<&'a PlacedTrack> {
        let own = |placed: &&PlacedTrack| {
            (placed.track.station).is_some_and(|station| VehicleId(station.0) == vehicle.id)
        };
        self.tracks.iter().find(own).or_else(|| {
            let reaches = |placed: &&PlacedTrack| {
                let error_m = (placed.track.state.center.position() - vehicle.center).norm();
                error_m <= self.reach_m(&placed.track)
            };
            (self.tracks.iter().filter(reaches))
                .min_by(|a, b| unlike(&a.track, vehicle).total_cmp(&unlike(&b.track, vehicle)))
                .filter(|placed| self.is_likest(&placed.track, vehicle.id))
        })
    }

    /// A track goes on with constant velocity; the vehicle may have braked or turned since.
    fn reach_m(&self, track: &Track) -> f64 {
        SAME_OBJECT_M + 0.5 * self.settings.brake_mps2 * self.age_s(track).powi(2)
    }

    fn is_likest(&self, track: &Track, id: VehicleId) -> bool {
        (self.truth.iter())
            .min_by(|a, b| unlike(track, a).total_cmp(&unlike(track, b)))
            .is_some_and(|likest| likest.id == id)
    }

    fn age_s(&self, track: &Track) -> f64 {
        (self.time_s - measured_s(track)).max(0.0)
    }

    /// Which assumption about what the CAV knows of `other` does not hold.
    pub fn broken(&self, other: &Other<'_>) -> Option<Cause> {
        match other.track {
            None => self.unknown(other),
            Some(placed) if self.age_s(&placed.track) > self.settings.knowledge_age_max_s => {
                Some(Cause::MessageAge)
            }
            Some(placed) => self
                .is_misjudged(other, placed)
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
    /// side on which it matters: nearer and slower ahead, nearer and faster behind. A lane that it
    /// came into since it was measured is none that the track could tell of.
    fn is_misjudged(&self, other: &Other<'_>, placed: &PlacedTrack) -> bool {
        let (settings, vehicle) = (self.settings, other.vehicle);
        let PlacedTrack { track, body: known } = placed;
        let age_s = self.age_s(track);
        let position_m = settings.error_sigmas * track.position_std_m + PROJECTION_M;
        let speed_mps = settings.error_sigmas * track.velocity_std_mps;
        let center = (self.road).to_frenet_near(vehicle.center, vehicle.frenet.s_m);
        let turned_rad = self.road.turn_rad(known.center_s_m, center.s_m);
        let driven_m = center.s_m - known.center_s_m - center.d_m * turned_rad;
        let beyond = if other.ahead {
            let (braked_m, braked_mps) = known.braked(age_s, speed_mps, settings);
            let true_mps = vehicle.along_mps().max(0.0);
            driven_m < braked_m - position_m || true_mps < braked_mps - PROJECTION_MPS
        } else {
            let fast_mps = known.along_mps.max(0.0) + speed_mps;
            let gained_mps = settings.follower_accel_mps2 * age_s;
            driven_m > (fast_mps + 0.5 * gained_mps) * age_s + position_m
                || vehicle.along_mps() > fast_mps + gained_mps + PROJECTION_MPS
        };
        let could_tell = measured_s(track) >= other.entered_s;
        let lanes = known.lanes(
            track,
            self.road,
            age_s,
            settings.lane_entry_m - PROJECTION_M,
        );
        beyond || could_tell && !other.shared.without(lanes).is_empty()
    }

    /// What a track makes of a vehicle now.
    pub fn known(&self, placed: &PlacedTrack) -> Known {
        let settings = self.settings;
        let PlacedTrack { track, body } = placed;
        let age_s = self.age_s(track);
        let length_m = track.state.length_m;
        let error_m = settings.error_sigmas * track.position_std_m;
        let error_mps = settings.error_sigmas * track.velocity_std_mps;
        let (braked_m, braked_mps) = body.braked(age_s, error_mps, settings);
        let driven_m = body.along_mps.max(0.0) * age_s;
        let circle_m = 0.5 * length_m.hypot(track.state.width_m);
        Known {
            lanes: body.lanes(track, self.road, age_s, settings.lane_entry_m),
            measured_s: measured_s(track),
            middle_s_m: body.center_s_m + driven_m,
            best: Member {
                rear_s_m: body.s_range_m[0] + driven_m,
                along_mps: body.along_mps.max(0.0),
                length_m,
            },
            worst: Member {
                rear_s_m: body.center_s_m - circle_m - error_m + braked_m,
                along_mps: braked_mps,
                length_m,
            },
        }
    }
}

/// What a vehicle ahead may be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Member {
    /// Road s of its rearmost point.
    pub rear_s_m: f64,
    /// Speed along the road.
    pub along_mps: f64,
    pub length_m: f64,
}

/// What a track makes of a vehicle now.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub lanes: Lanes,
    pub measured_s: f64,
    pub middle_s_m: f64,
    /// By the newest measurement, at constant speed since.
    pub best: Member,
    /// As near and slow as error and age allow.
    pub worst: Member,
}

/// A track with its place on the road.
#[derive(Debug, Clone)]
pub struct PlacedTrack {
    pub(super) track: Track,
    body: OnRoad,
}

impl PlacedTrack {
    /// Places `track` on the road, where it was measured.
    pub fn new(track: Track, road: &Road) -> Self {
        Self {
            body: OnRoad::new(&track, road),
            track,
        }
    }
}

/// A track's body along the road, where it was measured.
#[derive(Debug, Clone, Copy)]
struct OnRoad {
    center_s_m: f64,
    s_range_m: [f64; 2],
    d_range_m: [f64; 2],
    along_mps: f64,
    left_mps: f64,
}

impl OnRoad {
    fn new(track: &Track, road: &Road) -> Self {
        let state = &track.state;
        let straight_s = track.time_s - measured_s(track);
        let center = state.center.position() - state.velocity_mps * straight_s;
        let point = road.to_frenet(center);
        let (line, _) = road.reference(point.s_m);
        let velocity = Rotation2::new(-line.yaw_rad) * state.velocity_mps;
        let half = Vector2::new(state.length_m, state.width_m) / 2.0;
        let pose = Se2Pose {
            x_m: center.x,
            y_m: center.y,
            ..state.center
        };
        let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(x, y)| {
            let corner = pose.transform(Vector2::new(x * half.x, y * half.y));
            road.to_frenet_near(corner, point.s_m)
        });
        Self {
            center_s_m: point.s_m,
            s_range_m: range(corners.iter().map(|corner| corner.s_m)),
            d_range_m: range(corners.iter().map(|corner| corner.d_m)),
            along_mps: velocity.x,
            left_mps: velocity.y,
        }
    }

    /// The way along the road and the speed left, `age_s` after it was measured, if it was slower by
    /// `error_mps` and has braked as hard as leaders may.
    fn braked(&self, age_s: f64, error_mps: f64, settings: &SafetySettings) -> (f64, f64) {
        let slow_mps = (self.along_mps - error_mps).max(0.0);
        let braking_s = age_s.min(slow_mps / settings.leader_brake_mps2);
        let way_m = (slow_mps - 0.5 * settings.leader_brake_mps2 * braking_s) * braking_s;
        let left_mps = (slow_mps - settings.leader_brake_mps2 * age_s).max(0.0);
        (way_m, left_mps)
    }

    /// The lanes that it is known in, `age_s` after it was measured: by its body, anywhere between
    /// where it was and where it would be, or by vision.
    fn lanes(&self, track: &Track, road: &Road, age_s: f64, entry_m: f64) -> Lanes {
        let sideways_m = self.left_mps * age_s;
        let right_m = self.d_range_m[0] + sideways_m.min(0.0);
        let left_m = self.d_range_m[1] + sideways_m.max(0.0);
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

/// How unlike a vehicle a track is: in place, and in velocity times a second.
fn unlike(track: &Track, vehicle: &TrueVehicle) -> f64 {
    let apart_m = track.state.center.position() - vehicle.center;
    let apart_mps = track.state.velocity_mps - vehicle.velocity;
    apart_m.norm_squared() + apart_mps.norm_squared()
}

/// When a track was last measured; one without sightings stands for its own time.
fn measured_s(track: &Track) -> f64 {
    if track.sightings.is_empty() {
        track.time_s
    } else {
        track.measured_s().min(track.time_s)
    }
}
