use covista_control::{Neighbour, SafetySettings};
use covista_world::{
    Action, ObjectClass, ObjectState, Road, STEP_S, Se2Pose, Sighting, StationId, Track,
};
use nalgebra::Vector2;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::other::{Other, heading_rad};

/// Who sees for the ego vehicle.
const OBSERVER: StationId = StationId(900);

/// How the estimate of a vehicle ahead errs.
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
    /// For each vehicle the step of its newest measurement, and its error in shares of the bounds.
    last: Vec<Option<(usize, [f64; 2])>>,
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
        let [position, velocity] = self.error_shares(index, step, age_steps, dice);
        let bound = settings.error_sigmas * self.excess;
        let along = road.pose_from_frenet(motion.s_m, motion.d_m, 0.0);
        let forward = along.forward();
        let left = Vector2::new(-forward.y, forward.x);
        let position_m = along.position() + forward * (position * bound * self.position_std_m);
        let speed_mps = (motion.speed_mps + velocity * bound * self.velocity_std_mps).max(0.0);
        let velocity_mps = forward * speed_mps + left * motion.sideways_mps;
        let age_s = age_steps as f64 * STEP_S;
        let now = position_m + velocity_mps * age_s;
        let time_s = step as f64 * STEP_S;
        Track {
            id: other.id,
            station: other.station,
            state: ObjectState {
                center: Se2Pose::new(now.x, now.y, along.yaw_rad + heading_rad(&motion)),
                velocity_mps,
                length_m: other.dimensions.length_m,
                width_m: other.dimensions.width_m,
                height_m: other.dimensions.height_m,
                class: ObjectClass::Car,
            },
            time_s,
            position_std_m: self.position_std_m,
            velocity_std_mps: self.velocity_std_mps,
            confidence: 0.9,
            lane: None,
            action: other.station.map(|_| Action::KeepLane),
            announced_s: other.station.map(|_| 0.0),
            sightings: vec![Sighting {
                station: OBSERVER,
                measured_s: time_s - age_s,
            }],
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

    /// Errors in position and speed, in shares of their bounds, drawn once a measurement.
    fn error_shares(
        &mut self,
        index: usize,
        step: usize,
        age_steps: usize,
        dice: &mut ChaCha8Rng,
    ) -> [f64; 2] {
        // Steps before the start have measurements, too.
        let measured = step + super::other::MEMORY_STEPS - age_steps;
        match self.last.get(index).copied().flatten() {
            Some((newest, shares)) if newest == measured => return shares,
            _ => {}
        }
        let shares = match self.error {
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
        if let Some(last) = self.last.get_mut(index) {
            *last = Some((measured, shares));
        }
        shares
    }
}
