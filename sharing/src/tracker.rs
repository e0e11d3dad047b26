use std::collections::BTreeMap;

use covista_world::{
    Action, CollectivePerceptionMessage, LaneIndex, PerceivedObject, Percept, Se2Pose, StationId,
    Track, VehicleDimensions, wrap_angle,
};
use nalgebra::{Vector2, Vector3};

use crate::{
    TrackerSettings,
    association::{Body, associate},
    boundary::{ReceptionCounts, Refusal, is_usable, refusal},
    estimate::Measurement,
    known_object::{Knowledge, KnownObject, SelfReport},
    own_path::OwnPath,
};

/// For how long it is remembered which of a station's measurements were taken up.
const HEARD_S: f64 = 12.0;
/// Another station's sighting is recent within this time.
const RECENT_S: f64 = 1.0;

/// What a vehicle tells of itself in a message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnState {
    /// Pose of the rear axle in the world.
    pub pose: Se2Pose,
    /// Speed in m/s.
    pub speed_mps: f64,
    /// Acceleration in m/s^2.
    pub accel_mps2: f64,
    /// Lane.
    pub lane: LaneIndex,
    /// The action that it executes or announces.
    pub action: Action,
    /// When it announced that action, in seconds.
    pub announced_s: f64,
}

/// The multi-source tracker of one vehicle.
///
/// An object is believed to exist, and appears in [`Tracker::tracks`], after two own detections,
/// after one of high score, or when a CAV that believes in it, or that it is, was heard. An object
/// seen once has velocity zero with the standard deviation of the prior (10 m/s): consumers read
/// `velocity_std_mps` before they trust the speed.
///
/// The estimate is a function of the set of measurements of the last two seconds, each known by
/// its station and time: neither the order of arrival nor a repeated report changes it.
#[derive(Debug, Clone)]
pub struct Tracker {
    own: StationId,
    dimensions: VehicleDimensions,
    settings: TrackerSettings,
    objects: Vec<KnownObject>,
    next_id: u32,
    own_path: OwnPath,
    /// For each station's object the time of the newest measurement that was taken up.
    heard: BTreeMap<(StationId, u32), f64>,
    counts: ReceptionCounts,
}

impl Tracker {
    /// A tracker that knows of nothing, for the vehicle `own` with these dimensions.
    pub fn new(own: StationId, dimensions: VehicleDimensions, settings: TrackerSettings) -> Self {
        Self {
            own,
            dimensions,
            settings,
            objects: Vec::new(),
            next_id: 0,
            own_path: OwnPath::new(dimensions),
            heard: BTreeMap::new(),
            counts: ReceptionCounts::default(),
        }
    }

    /// What came in and what was refused so far.
    pub fn counts(&self) -> ReceptionCounts {
        self.counts
    }

    /// Takes up one frame of own percepts (vehicle frame), measured at `time_s` from `pose` (rear
    /// axle, world frame). To be called for an empty frame, too: it tells where nothing is.
    pub fn observe(&mut self, time_s: f64, pose: Se2Pose, speed_mps: f64, percepts: &[Percept]) {
        let own = [time_s, pose.x_m, pose.y_m, pose.yaw_rad, speed_mps];
        if own.iter().any(|value| !value.is_finite()) {
            self.counts.invalid_percepts += percepts.len() as u64;
            return;
        }
        self.own_path.push(time_s, pose, speed_mps);
        self.forget(time_s);

        let (usable, refused): (Vec<&Percept>, Vec<&Percept>) =
            percepts.iter().partition(|percept| is_usable(percept));
        self.counts.invalid_percepts += refused.len() as u64;
        let own_body = self.own_path.body(pose);
        let seen: Vec<(Measurement, &Percept)> = usable
            .into_iter()
            .map(|percept| (self.own_measurement(time_s, pose, percept), percept))
            .filter(|(z, _)| !own_body.coincides(&body_of(z)))
            .collect();

        let known_before = self.objects.len();
        let measurements: Vec<Measurement> = seen.iter().map(|(z, _)| *z).collect();
        let matches = self.matches(&measurements);
        let mut shown = vec![false; known_before];
        for (&(z, percept), found) in seen.iter().zip(matches) {
            if let Some(index) = found.or_else(|| self.newcomer(&z)) {
                self.objects[index].take_own(
                    z,
                    percept.lane,
                    percept.detection.score,
                    &self.settings,
                );
                if let Some(shown) = shown.get_mut(index) {
                    *shown = true;
                }
            }
        }
        self.count_misses(time_s, pose, &shown);
        self.merge(time_s);
    }

    /// Takes up the messages that arrived by `now_s`, in whatever order.
    ///
    /// Messages that are unusable, from the future or too old are refused and counted.
    pub fn receive<'a>(
        &mut self,
        now_s: f64,
        messages: impl IntoIterator<Item = &'a CollectivePerceptionMessage>,
    ) {
        let mut accepted: Vec<_> = messages
            .into_iter()
            .filter(|message| message.station != self.own && self.accepts(now_s, message))
            .collect();
        accepted.sort_by(|a, b| {
            a.time_s
                .total_cmp(&b.time_s)
                .then(a.station.cmp(&b.station))
        });
        self.forget(now_s);
        // Who is a CAV is settled before what they saw, so that each one is recognised in that.
        for message in &accepted {
            self.take_report(message);
        }
        for message in &accepted {
            self.take_objects(message);
        }
        self.merge(now_s);
        self.forget(now_s);
    }

    /// What is believed to be there, carried on to `now_s`, by identity.
    pub fn tracks(&self, now_s: f64) -> Vec<Track> {
        self.objects
            .iter()
            .filter(|object| {
                object.is_alive(now_s, &self.settings) && object.is_confirmed(&self.settings)
            })
            .filter_map(|object| object.track(self.own, now_s, &self.settings))
            .collect()
    }

    /// The message to broadcast: own state and the objects that own sensors saw.
    ///
    /// The tracker remembers the pose, to recognise its own vehicle in what others report.
    pub fn message(&mut self, now_s: f64, own: &OwnState) -> CollectivePerceptionMessage {
        self.own_path.push(now_s, own.pose, own.speed_mps);
        CollectivePerceptionMessage {
            station: self.own,
            time_s: now_s,
            pose: own.pose,
            speed_mps: own.speed_mps,
            accel_mps2: own.accel_mps2,
            dimensions: self.dimensions,
            lane: own.lane,
            action: own.action,
            announced_s: own.announced_s,
            objects: self
                .objects
                .iter()
                .filter(|object| object.is_alive(now_s, &self.settings))
                .filter_map(|object| object.shared(self.own, &self.settings))
                .collect(),
        }
    }

    fn accepts(&mut self, now_s: f64, message: &CollectivePerceptionMessage) -> bool {
        let refusal = refusal(message, now_s, self.settings.oldest_message_s);
        match refusal {
            None => self.counts.accepted += 1,
            Some(Refusal::Invalid) => self.counts.invalid += 1,
            Some(Refusal::Future) => self.counts.future += 1,
            Some(Refusal::Stale) => self.counts.stale += 1,
        }
        refusal.is_none()
    }

    fn take_report(&mut self, message: &CollectivePerceptionMessage) {
        let report = SelfReport::new(message, &self.settings);
        let said = report.at(report.time_s());
        let known = self
            .objects
            .iter()
            .position(|object| object.station == Some(message.station))
            .or_else(|| self.nearest_anonymous(report.time_s(), &said));
        let index = known.unwrap_or_else(|| self.create());
        self.objects[index].take_report(message.station, report);
    }

    fn nearest_anonymous(&self, time_s: f64, said: &Knowledge) -> Option<usize> {
        self.objects
            .iter()
            .enumerate()
            .filter(|(_, object)| object.station.is_none())
            .filter_map(|(index, object)| {
                let known = object.at(time_s, &self.settings)?;
                let offset = known.state.center.position() - said.state.center.position();
                known.is_same_object(said).then(|| (index, offset.norm()))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(index, _)| index)
    }

    fn take_objects(&mut self, message: &CollectivePerceptionMessage) {
        let mut news: Vec<&PerceivedObject> = message
            .objects
            .iter()
            .filter(|object| {
                let newest = self.heard.get(&(message.station, object.object_id));
                newest.is_none_or(|&newest_s| object.measured_s > newest_s)
            })
            .collect();
        news.sort_by(|a, b| a.measured_s.total_cmp(&b.measured_s));
        for frame in news.chunk_by(|a, b| a.measured_s.total_cmp(&b.measured_s).is_eq()) {
            for object in frame {
                let key = (message.station, object.object_id);
                self.heard.insert(key, object.measured_s);
            }
            let (lanes, measurements): (Vec<_>, Vec<_>) = frame
                .iter()
                .map(|object| (object.lane, self.shared_measurement(message, object)))
                .filter(|(_, z)| !self.own_path.shows(z.time_s, &body_of(z)))
                .unzip();
            let matches = self.matches(&measurements);
            for ((z, lane), found) in measurements.into_iter().zip(lanes).zip(matches) {
                if let Some(index) = found.or_else(|| self.newcomer(&z)) {
                    self.objects[index].take_shared(z, lane, &self.settings);
                }
            }
        }
    }

    /// For each measurement of one station at one time the object that it shows.
    fn matches(&self, measurements: &[Measurement]) -> Vec<Option<usize>> {
        let Some(time_s) = measurements.first().map(|z| z.time_s) else {
            return Vec::new();
        };
        let (indices, expected): (Vec<_>, Vec<_>) = self
            .objects
            .iter()
            .enumerate()
            .filter_map(|(i, object)| Some((i, object.expectation(time_s, &self.settings)?)))
            .unzip();
        let detections: Vec<_> = measurements
            .iter()
            .map(|z| (z.position, z.position_std_m))
            .collect();
        associate(&detections, &expected)
            .into_iter()
            .map(|found| found.map(|i: usize| indices[i]))
            .collect()
    }

    /// A place for an object that no known one matches, unless it overlaps one whose place is
    /// well known: then it is a second box for the same body.
    fn newcomer(&mut self, z: &Measurement) -> Option<usize> {
        let body = body_of(z);
        let doubles = self.objects.iter().any(|object| {
            object
                .at(z.time_s, &self.settings)
                .is_some_and(|known| known.position_std_m() < 1.0 && known.body().coincides(&body))
        });
        (!doubles).then(|| self.create())
    }

    fn create(&mut self) -> usize {
        self.objects.push(KnownObject::new(self.next_id));
        self.next_id += 1;
        self.objects.len() - 1
    }

    fn forget(&mut self, now_s: f64) {
        let settings = self.settings;
        self.objects
            .retain(|object| object.is_alive(now_s, &settings));
        self.heard
            .retain(|_, measured_s| now_s - *measured_s <= HEARD_S);
    }

    /// Makes one of those that turn out to be the same, under the older identity.
    fn merge(&mut self, now_s: f64) {
        let mut kept: Vec<KnownObject> = Vec::with_capacity(self.objects.len());
        for object in std::mem::take(&mut self.objects) {
            let settings = &self.settings;
            let twin = object.at(now_s, settings).and_then(|known| {
                kept.iter_mut().find(|other| {
                    let distinct =
                        matches!((other.station, object.station), (Some(a), Some(b)) if a != b);
                    !distinct
                        && other
                            .at(now_s, settings)
                            .is_some_and(|other| other.is_same_object(&known))
                })
            });
            match twin {
                Some(twin) => twin.absorb(object, settings),
                None => kept.push(object),
            }
        }
        self.objects = kept;
    }

    /// Forgets what an own frame fails to show again and again although it is near and no other
    /// object stands before it.
    fn count_misses(&mut self, time_s: f64, pose: Se2Pose, shown: &[bool]) {
        let places: Vec<Option<Vector2<f64>>> = self
            .objects
            .iter()
            .map(|object| {
                let known = object.at(time_s, &self.settings)?;
                Some(pose.inverse_transform(known.state.center.position()))
            })
            .collect();
        let hides = |target: Vector2<f64>, other: Vector2<f64>| {
            let direction = target.normalize();
            let along = direction.dot(&other);
            along > 0.0 && along < target.norm() - 1.0 && (other - direction * along).norm() < 3.0
        };
        for (index, object) in self.objects.iter_mut().enumerate() {
            let Some(target) = places[index] else {
                continue;
            };
            let was_shown = shown.get(index).copied().unwrap_or(true);
            let in_view = target.norm() < self.settings.certain_view_m
                && !places
                    .iter()
                    .enumerate()
                    .any(|(i, other)| i != index && other.is_some_and(|o| hides(target, o)));
            if was_shown {
                object.misses = 0;
            } else if in_view && !object.is_seen_by_others(self.own, time_s - RECENT_S) {
                object.misses += 1;
            }
        }
        let allowed = self.settings.certain_view_misses;
        self.objects.retain(|object| object.misses < allowed);
    }

    fn own_measurement(&self, time_s: f64, pose: Se2Pose, percept: &Percept) -> Measurement {
        let detection = &percept.detection;
        Measurement {
            time_s,
            station: self.own,
            position: pose.transform(detection.center_m.xy()),
            position_std_m: self.settings.position_std_m,
            yaw_rad: wrap_angle(pose.yaw_rad + detection.yaw_rad),
            size_m: detection.size_m,
            class: detection.class,
            score: detection.score,
            velocity: None,
        }
    }

    fn shared_measurement(
        &self,
        message: &CollectivePerceptionMessage,
        object: &PerceivedObject,
    ) -> Measurement {
        let state = &object.state;
        let position = state.center.position();
        let distance_m = (position - message.pose.position()).norm();
        let sender_std_m = self.settings.pose_noise.position_std_at_m(distance_m);
        Measurement {
            time_s: object.measured_s,
            station: message.station,
            position,
            position_std_m: object.position_std_m.hypot(sender_std_m),
            yaw_rad: state.center.yaw_rad,
            size_m: Vector3::new(state.length_m, state.width_m, state.height_m),
            class: state.class,
            score: object.confidence,
            velocity: Some((state.velocity_mps, object.velocity_std_mps)),
        }
    }
}

fn body_of(z: &Measurement) -> Body {
    Body {
        center: Se2Pose::new(z.position.x, z.position.y, z.yaw_rad),
        length_m: z.size_m.x,
        width_m: z.size_m.y,
    }
}
