use std::f64::consts::PI;

use covista_control::{LaneSet, Neighbour, SafetySettings};
use covista_world::{
    Action, ObjectClass, ObjectState, Road, STEP_S, Se2Pose, Sighting, StationId, Track,
};
use nalgebra::Vector2;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::other::{Other, heading_rad, sideways_mps};

/// Who sees for the ego vehicle.
const OBSERVER: StationId = StationId(900);

/// How the estimate of a vehicle ahead errs along the road. Across it, in heading and in length it
/// errs as well unless there is no error at all: see [`Shares`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ErrorMode {
    /// Not at all.
    None,
    /// It looks farther and faster by exactly the bound.
    Far,
    /// It looks nearer and slower by exactly the bound.
    Near,
    /// By the bound, one way and the other from measurement to measurement.
    Jumping,
    /// Anywhere within the bounds, anew with every measurement.
    Random,
}

/// When a vehicle is measured, and when that becomes known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Messages {
    /// Every step, at once.
    Fresh,
    /// Every step, but known only so many steps later.
    Late(usize),
    /// Every so many steps; carried on with constant velocity meanwhile.
    Every { period: usize, late: usize },
}

/// What the ego vehicle is told of the others.
#[derive(Debug, Clone)]
pub(super) struct Estimate {
    pub error: ErrorMode,
    pub messages: Messages,
    pub position_std_m: f64,
    pub velocity_std_mps: f64,
    /// Errors are this many times their bound.
    pub excess: f64,
    /// Whether the ego vehicle is told that every measurement is new.
    pub conceals_age: bool,
    /// For each vehicle the step of its newest measurement, and its error.
    last: Vec<Option<(usize, Shares)>>,
}

/// The error of one measurement, in shares of its bounds.
///
/// Position and speed are wrong by at most `error_sigmas` standard deviations. What the length is
/// wrong by, half of it at either end, counts to the position. Across the road and in heading an
/// estimate may err as long as it is in the lanes that the vehicle is in: which these are is an
/// assumption of its own.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Shares {
    along: f64,
    speed: f64,
    across: f64,
    /// Half the length.
    length: f64,
    heading_rad: f64,
}

impl Estimate {
    pub fn new(error: ErrorMode, messages: Messages, stds: [f64; 2], others: usize) -> Self {
        Self {
            error,
            messages,
            position_std_m: stds[0],
            velocity_std_mps: stds[1],
            excess: 1.0,
            conceals_age: false,
            last: vec![None; others],
        }
    }

    /// How many steps before `step` the newest measurement that is known then was made.
    pub fn age_steps(&self, step: usize) -> usize {
        match self.messages {
            Messages::Fresh => 0,
            Messages::Late(late) => late,
            Messages::Every { period, late } => late + step % period,
        }
    }

    /// The track of vehicle `index` at `step`: its newest measurement with its error, carried on
    /// with constant velocity as the tracker does.
    pub fn track(
        &mut self,
        index: usize,
        other: &Other,
        step: usize,
        road: &Road,
        settings: &SafetySettings,
        dice: &mut ChaCha8Rng,
    ) -> Track {
        let age_steps = self.age_steps(step);
        let motion = other.before(age_steps, road);
        let shares = self.error_shares(index, step, age_steps, dice);
        let bound = settings.error_sigmas * self.excess;
        let bound_m = bound * self.position_std_m;
        let along = road.pose_from_frenet(motion.s_m, motion.d_m, 0.0);
        let forward = along.forward();
        let left = Vector2::new(-forward.y, forward.x);
        let exact = Body {
            center: Se2Pose {
                yaw_rad: along.yaw_rad + heading_rad(&motion),
                ..along
            },
            length_m: other.dimensions.length_m,
            width_m: other.dimensions.width_m,
        };
        let left_m = (1.0 - shares.length.abs()) * bound_m;
        let moved = exact.moved(forward * (shares.along * left_m));
        let longer = moved.longer_by(2.0 * shares.length * bound_m);
        let turned = longer
            .moved(left * (shares.across * left_m))
            .turned(shares.heading_rad);
        let lanes = |body: &Body| body.lanes(road, settings.lane_entry_m, motion.s_m);
        let is_told_right = |body: &Body| lanes(body) == lanes(&exact);
        let body = [turned, longer, moved]
            .into_iter()
            .find(is_told_right)
            .unwrap_or(exact);
        let speed_mps = (motion.speed_mps + shares.speed * bound * self.velocity_std_mps).max(0.0);
        let velocity_mps = forward * speed_mps + left * sideways_mps(&motion);
        let age_s = age_steps as f64 * STEP_S;
        let now = body.center.position() + velocity_mps * age_s;
        let time_s = step as f64 * STEP_S;
        Track {
            id: other.id,
            station: other.station,
            state: ObjectState {
                center: Se2Pose::new(now.x, now.y, body.center.yaw_rad),
                velocity_mps,
                length_m: body.length_m,
                width_m: body.width_m,
                height_m: other.dimensions.height_m,
                class: ObjectClass::Car,
            },
            time_s,
            position_std_m: self.position_std_m,
            velocity_std_mps: self.velocity_std_mps,
            confidence: 0.9,
            lane: None,
            action: other.station.map(|_| {
                other
                    .announced
                    .map_or(Action::KeepLane, |(action, _)| action)
            }),
            announced_s: (other.station)
                .map(|_| other.announced.map_or(0.0, |(_, since_s)| since_s)),
            sightings: [Some(OBSERVER), other.station.filter(|_| other.is_heard)]
                .into_iter()
                .flatten()
                .map(|station| Sighting {
                    station,
                    measured_s: time_s - age_s,
                })
                .collect(),
        }
    }

    /// What the ego vehicle makes of a track.
    pub fn neighbour(
        &self,
        track: &Track,
        road: &Road,
        settings: &SafetySettings,
    ) -> Option<Neighbour> {
        if !self.conceals_age {
            return Neighbour::from_track(track, road, track.time_s, settings);
        }
        let mut told = track.clone();
        for sighting in &mut told.sightings {
            sighting.measured_s = told.time_s;
        }
        Neighbour::from_track(&told, road, told.time_s, settings)
    }

    /// The error of the newest measurement, drawn once a measurement.
    fn error_shares(
        &mut self,
        index: usize,
        step: usize,
        age_steps: usize,
        dice: &mut ChaCha8Rng,
    ) -> Shares {
        // Steps before the start have measurements, too.
        let measured = step + super::other::MEMORY_STEPS - age_steps;
        match self.last.get(index).copied().flatten() {
            Some((newest, shares)) if newest == measured => return shares,
            _ => {}
        }
        let [along, speed] = match self.error {
            ErrorMode::None => [0.0, 0.0],
            ErrorMode::Far => [1.0, 1.0],
            ErrorMode::Near => [-1.0, -1.0],
            ErrorMode::Jumping => {
                if dice.random() {
                    [1.0, 1.0]
                } else {
                    [-1.0, -1.0]
                }
            }
            ErrorMode::Random => [dice.random_range(-1.0..=1.0), dice.random_range(-1.0..=1.0)],
        };
        let mut shares = Shares {
            along,
            speed,
            ..Shares::default()
        };
        // Half of the time the whole bound is left to the error along the road.
        if self.error != ErrorMode::None {
            // A position errs by no more than its bound, whichever way.
            shares.across = dice.random_range(-1.0..=1.0_f64);
            if dice.random() {
                shares.across *= (1.0 - along.powi(2)).sqrt();
            } else {
                shares.along *= (1.0 - shares.across.powi(2)).sqrt();
            }
            if dice.random() {
                shares.length = dice.random_range(-1.0..=1.0);
            }
            shares.heading_rad = match dice.random_range(0..4) {
                0 => 0.0,
                1 => PI,
                2 => dice.random_range(-PI..PI),
                _ => dice.random_range(-0.1..0.1),
            };
        }
        if let Some(last) = self.last.get_mut(index) {
            *last = Some((measured, shares));
        }
        shares
    }
}

/// A body as it is measured.
#[derive(Debug, Clone, Copy)]
struct Body {
    center: Se2Pose,
    length_m: f64,
    width_m: f64,
}

impl Body {
    fn moved(self, by_m: Vector2<f64>) -> Self {
        let center = Se2Pose {
            x_m: self.center.x_m + by_m.x,
            y_m: self.center.y_m + by_m.y,
            ..self.center
        };
        Self { center, ..self }
    }

    fn turned(self, by_rad: f64) -> Self {
        let center = Se2Pose {
            yaw_rad: self.center.yaw_rad + by_rad,
            ..self.center
        };
        Self { center, ..self }
    }

    /// No vehicle is taken for shorter than wide.
    fn longer_by(self, by_m: f64) -> Self {
        let length_m = (self.length_m + by_m).max(self.width_m);
        Self { length_m, ..self }
    }

    fn lanes(self, road: &Road, entry_m: f64, s_hint_m: f64) -> LaneSet {
        let (x, y) = (self.length_m / 2.0, self.width_m / 2.0);
        let (right_m, left_m) = [(x, y), (x, -y), (-x, -y), (-x, y)]
            .map(|(x, y)| {
                let corner = self.center.transform(Vector2::new(x, y));
                road.to_frenet_near(corner, s_hint_m).d_m
            })
            .into_iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), d_m| {
                (low.min(d_m), high.max(d_m))
            });
        LaneSet::between(road, right_m, left_m, entry_m)
    }
}
