use std::collections::BTreeMap;

use covista_world::{
    Action, CollectivePerceptionMessage, LaneIndex, ObjectClass, ObjectState, PerceivedObject,
    Se2Pose, Sighting, StationId, Track, VehicleDimensions,
};
use nalgebra::{Matrix2, Vector2};

use crate::{
    TrackerSettings,
    association::{Body, Expectation},
    estimate::{Estimate, Measurement},
};

/// Lane votes older than this, against the newest measurement, no longer count.
const LANE_VOTE_S: f64 = 2.0;
/// Votes of which the majority is taken.
const LANE_VOTES: usize = 3;
/// Vans and trucks are higher than this.
const TRUCK_HEIGHT_M: f64 = 2.0;
/// How well a vehicle knows its own position, in metres, and speed, in m/s.
const REPORT_STD: f64 = 0.1;
/// Acceleration that a report may fail to tell, in m/s^2.
const REPORT_ACCEL_STD_MPS2: f64 = 1.0;
/// Objects placed less certainly than this cannot be told to coincide with another.
const PLACED_STD_M: f64 = 1.0;

/// What a CAV said of itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SelfReport {
    time_s: f64,
    center: Se2Pose,
    speed_mps: f64,
    accel_mps2: f64,
    dimensions: VehicleDimensions,
    lane: LaneIndex,
    action: Action,
    announced_s: f64,
    position_std_m: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct LaneVote {
    time_s: f64,
    station: StationId,
    lane: LaneIndex,
}

/// State, standard deviation of the position and of the velocity.
pub(crate) struct Knowledge {
    pub state: ObjectState,
    pub position_covariance: Matrix2<f64>,
    pub velocity_std_mps: f64,
}

impl Knowledge {
    pub fn body(&self) -> Body {
        Body {
            center: self.state.center,
            length_m: self.state.length_m,
            width_m: self.state.width_m,
        }
    }

    pub fn position_std_m(&self) -> f64 {
        (self.position_covariance.trace() / 2.0).sqrt()
    }

    /// Whether the two can only be one object: they overlap and do not move apart.
    pub fn is_same_object(&self, other: &Self) -> bool {
        let relative = self.state.velocity_mps - other.state.velocity_mps;
        self.position_std_m().max(other.position_std_m()) < PLACED_STD_M
            && self.body().coincides(&other.body())
            && relative.norm() < 3.0 * (self.velocity_std_mps + other.velocity_std_mps)
    }
}

/// An object and all that was measured of it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct KnownObject {
    pub id: u32,
    pub station: Option<StationId>,
    report: Option<SelfReport>,
    /// By own measurements alone: this is what is broadcast.
    own: Option<Estimate>,
    /// By the measurements of all stations.
    fused: Option<Estimate>,
    own_hits: u32,
    best_score: f64,
    confirmed_by_others: bool,
    sightings: BTreeMap<StationId, f64>,
    votes: Vec<LaneVote>,
    /// Own frames in a row that failed to show it in certain view.
    pub misses: u32,
}

impl KnownObject {
    pub fn new(id: u32) -> Self {
        Self {
            id,
            station: None,
            report: None,
            own: None,
            fused: None,
            own_hits: 0,
            best_score: 0.0,
            confirmed_by_others: false,
            sightings: BTreeMap::new(),
            votes: Vec::new(),
            misses: 0,
        }
    }

    pub fn take_own(
        &mut self,
        z: Measurement,
        lane: Option<LaneIndex>,
        score: f64,
        settings: &TrackerSettings,
    ) {
        let is_new = (self.own.as_ref().and_then(Estimate::newest))
            .is_none_or(|newest| newest.time_s < z.time_s);
        self.own_hits = self.own_hits.saturating_add(is_new.into());
        add(&mut self.own, z, settings);
        self.best_score = self.best_score.max(score);
        self.misses = 0;
        self.take(z, lane, settings);
    }

    pub fn take_shared(
        &mut self,
        z: Measurement,
        lane: Option<LaneIndex>,
        settings: &TrackerSettings,
    ) {
        self.confirmed_by_others = true;
        self.take(z, lane, settings);
    }

    fn take(&mut self, z: Measurement, lane: Option<LaneIndex>, settings: &TrackerSettings) {
        add(&mut self.fused, z, settings);
        self.sight(z.station, z.time_s);
        if let Some(lane) = lane {
            self.votes.push(LaneVote {
                time_s: z.time_s,
                station: z.station,
                lane,
            });
        }
        self.sort_votes();
    }

    fn sort_votes(&mut self) {
        let newest_s = self.measured_s();
        self.votes
            .retain(|vote| vote.time_s >= newest_s - LANE_VOTE_S);
        self.votes.sort_by(|a, b| {
            b.time_s
                .total_cmp(&a.time_s)
                .then(a.station.cmp(&b.station))
        });
    }

    pub fn take_report(&mut self, station: StationId, report: SelfReport) {
        if self.report.is_none_or(|old| old.time_s < report.time_s) {
            self.station = Some(station);
            self.sight(station, report.time_s);
            self.report = Some(report);
        }
    }

    fn sight(&mut self, station: StationId, measured_s: f64) {
        let newest = self.sightings.entry(station).or_insert(measured_s);
        *newest = newest.max(measured_s);
    }

    /// Takes up all that was measured of an object that turned out to be the same.
    pub fn absorb(&mut self, other: Self, settings: &TrackerSettings) {
        absorb(&mut self.own, other.own, settings);
        absorb(&mut self.fused, other.fused, settings);
        if let (Some(station), Some(report)) = (other.station, other.report) {
            self.take_report(station, report);
        }
        self.station = self.station.or(other.station);
        self.own_hits = self.own_hits.saturating_add(other.own_hits);
        self.best_score = self.best_score.max(other.best_score);
        self.confirmed_by_others |= other.confirmed_by_others;
        self.misses = self.misses.min(other.misses);
        for (station, measured_s) in other.sightings {
            self.sight(station, measured_s);
        }
        self.votes.extend(other.votes);
        self.sort_votes();
    }

    fn measured_s(&self) -> f64 {
        self.sightings
            .values()
            .fold(f64::NEG_INFINITY, |newest, &s| newest.max(s))
    }

    fn fresh_report(&self, now_s: f64, settings: &TrackerSettings) -> Option<&SelfReport> {
        self.report
            .as_ref()
            .filter(|report| now_s - report.time_s <= settings.forget_moving_s)
    }

    /// Whether anybody but `own` saw it, or it was heard itself, after `since_s`.
    pub fn is_seen_by_others(&self, own: StationId, since_s: f64) -> bool {
        (self.sightings.iter()).any(|(&station, &s)| station != own && s > since_s)
    }

    /// After this time without a measurement it is forgotten. An object that stood still is kept
    /// longer, because what is parked does not vanish out of sight.
    fn forget_s(&self, settings: &TrackerSettings) -> f64 {
        let stands = self
            .fused
            .as_ref()
            .is_some_and(|estimate| estimate.belief().stands());
        if stands {
            settings.forget_standing_s
        } else {
            settings.forget_moving_s
        }
    }

    /// Confidence that it is there at `now_s`, in [0, 1]: that of who measured it lately, 1 of a
    /// vehicle's own word, and less the nearer it is to being forgotten.
    fn confidence(&self, now_s: f64, settings: &TrackerSettings) -> f64 {
        let measured = match (self.fresh_report(now_s, settings), &self.fused) {
            (Some(_), _) => 1.0,
            (None, Some(fused)) => fused.mean_score(),
            (None, None) => 0.0,
        };
        let age_s = now_s - self.measured_s();
        measured * (1.0 - age_s / self.forget_s(settings)).clamp(0.0, 1.0)
    }

    /// Whether it is still worth knowing: heard, or measured not too long ago.
    pub fn is_alive(&self, now_s: f64, settings: &TrackerSettings) -> bool {
        now_s - self.measured_s() <= self.forget_s(settings)
            && (self.fused.is_some() || self.fresh_report(now_s, settings).is_some())
    }

    fn is_confirmed_by_own(&self, settings: &TrackerSettings) -> bool {
        self.own_hits >= settings.confirming_hits
            || (self.own_hits > 0 && self.best_score >= settings.confirming_score)
    }

    /// Whether it is believed to exist.
    pub fn is_confirmed(&self, settings: &TrackerSettings) -> bool {
        self.report.is_some() || self.confirmed_by_others || self.is_confirmed_by_own(settings)
    }

    /// What is known of it at `time_s`: by its own word while that is fresh, else by measurements.
    pub fn at(&self, time_s: f64, settings: &TrackerSettings) -> Option<Knowledge> {
        if let Some(report) = self.fresh_report(time_s, settings) {
            return Some(report.at(time_s));
        }
        let belief = self.fused.as_ref()?.belief().predicted(time_s, settings);
        let position = belief.filter.position();
        Some(Knowledge {
            position_covariance: belief.filter.position_covariance(),
            velocity_std_mps: belief.velocity_std_mps(),
            state: ObjectState {
                center: Se2Pose::new(position.x, position.y, belief.yaw_rad),
                velocity_mps: belief.filter.velocity(),
                length_m: belief.size_m.x,
                width_m: belief.size_m.y,
                height_m: belief.size_m.z,
                class: belief.class,
            },
        })
    }

    pub fn expectation(&self, time_s: f64, settings: &TrackerSettings) -> Option<Expectation> {
        self.at(time_s, settings).map(|known| Expectation {
            body: known.body(),
            position_covariance: known.position_covariance,
        })
    }

    /// Its lane: by its own word, else by the majority of the newest own votes, else of the newest
    /// shared ones.
    fn lane(&self, own: StationId, now_s: f64, settings: &TrackerSettings) -> Option<LaneIndex> {
        let said = self.fresh_report(now_s, settings).map(|report| report.lane);
        said.or_else(|| majority(self.votes.iter().filter(|vote| vote.station == own)))
            .or_else(|| majority(self.votes.iter().filter(|vote| vote.station != own)))
    }

    pub fn track(&self, own: StationId, now_s: f64, settings: &TrackerSettings) -> Option<Track> {
        let known = self.at(now_s, settings)?;
        let report = self.fresh_report(now_s, settings);
        let measured = match (report, &self.fused) {
            (Some(report), _) => report.at(report.time_s()),
            (None, Some(fused)) => {
                let measured_s = fused.belief().filter.time_s;
                self.at(measured_s, settings)?
            }
            (None, None) => return None,
        };
        Some(Track {
            id: self.id,
            station: self.station,
            state: known.state,
            time_s: now_s,
            position_std_m: measured.position_std_m(),
            velocity_std_mps: measured.velocity_std_mps,
            confidence: self.confidence(now_s, settings),
            lane: self.lane(own, now_s, settings),
            action: report.map(|report| report.action),
            announced_s: report.map(|report| report.announced_s),
            sightings: self
                .sightings
                .iter()
                .map(|(&station, &measured_s)| Sighting {
                    station,
                    measured_s,
                })
                .collect(),
        })
    }

    /// What own sensors alone tell of it: the newest measurement as it was made, and the velocity
    /// by own measurements.
    pub fn shared(&self, own: StationId, settings: &TrackerSettings) -> Option<PerceivedObject> {
        let estimate = self.own.as_ref()?;
        let newest = estimate.newest()?;
        let belief = estimate.belief();
        self.is_confirmed_by_own(settings).then(|| PerceivedObject {
            object_id: self.id,
            state: ObjectState {
                center: Se2Pose::new(newest.position.x, newest.position.y, belief.yaw_rad),
                velocity_mps: belief.filter.velocity(),
                length_m: belief.size_m.x,
                width_m: belief.size_m.y,
                height_m: belief.size_m.z,
                class: belief.class,
            },
            position_std_m: newest.position_std_m,
            velocity_std_mps: belief.velocity_std_mps(),
            lane: majority(self.votes.iter().filter(|vote| vote.station == own)),
            measured_s: newest.time_s,
            confidence: self.best_score,
        })
    }
}

impl SelfReport {
    pub fn new(message: &CollectivePerceptionMessage, settings: &TrackerSettings) -> Self {
        Self {
            time_s: message.time_s,
            center: message.dimensions.center_pose(message.pose),
            speed_mps: message.speed_mps,
            accel_mps2: message.accel_mps2,
            dimensions: message.dimensions,
            lane: message.lane,
            action: message.action,
            announced_s: message.announced_s,
            position_std_m: REPORT_STD.hypot(settings.pose_noise.position_std_m),
        }
    }

    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The reported motion carried on with the reported acceleration, no further than standstill.
    pub fn at(&self, time_s: f64) -> Knowledge {
        let stops_in_s = if self.accel_mps2 < 0.0 {
            -self.speed_mps / self.accel_mps2
        } else {
            f64::INFINITY
        };
        let dt = (time_s - self.time_s).min(stops_in_s);
        let speed_mps = (self.speed_mps + self.accel_mps2 * dt).max(0.0);
        let travelled_m = 0.5 * (self.speed_mps + speed_mps) * dt;
        let velocity_std_mps = REPORT_STD + REPORT_ACCEL_STD_MPS2 * dt.abs();
        let position_std_m = self.position_std_m + 0.5 * REPORT_ACCEL_STD_MPS2 * dt * dt;
        Knowledge {
            state: ObjectState {
                center: self.center.compose(Se2Pose::new(travelled_m, 0.0, 0.0)),
                velocity_mps: self.center.forward() * speed_mps,
                length_m: self.dimensions.length_m,
                width_m: self.dimensions.width_m,
                height_m: self.dimensions.height_m,
                class: if self.dimensions.height_m > TRUCK_HEIGHT_M {
                    ObjectClass::Truck
                } else {
                    ObjectClass::Car
                },
            },
            position_covariance: Matrix2::from_diagonal(&Vector2::repeat(position_std_m.powi(2))),
            velocity_std_mps,
        }
    }
}

fn add(estimate: &mut Option<Estimate>, z: Measurement, settings: &TrackerSettings) {
    match estimate {
        Some(estimate) => estimate.add(z, settings),
        None => *estimate = Some(Estimate::new(z, settings)),
    }
}

fn absorb(into: &mut Option<Estimate>, other: Option<Estimate>, settings: &TrackerSettings) {
    match (into.as_mut(), other) {
        (Some(estimate), Some(other)) => estimate.absorb(&other, settings),
        (None, other) => *into = other,
        (Some(_), None) => {}
    }
}

/// The most frequent lane of the newest votes; of equals the newest.
fn majority<'a>(votes: impl Iterator<Item = &'a LaneVote>) -> Option<LaneIndex> {
    let newest: Vec<LaneIndex> = votes.take(LANE_VOTES).map(|vote| vote.lane).collect();
    let count = |lane: LaneIndex| newest.iter().filter(|&&other| other == lane).count();
    newest.iter().rev().copied().max_by_key(|&lane| count(lane))
}
