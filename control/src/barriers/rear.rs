use covista_world::{BarrierKind, ControlInput, STEP_S};

use super::front::Ahead;
use super::{Barrier, Input, Row, target};
use crate::{Neighbour, SafetySettings};

/// h_bt in the shape of RSS: the follower may accelerate with a_b for its reaction time, then
/// brakes with b_min; the ego vehicle may brake with b_e.
///
/// `h_bt = g - P_bumper - [v_b rho + a_b rho^2 / 2 + (v_b + rho a_b)^2 / (2 b_min) - v^2 / (2 b_e)]+`
///
/// For explicit Euler and noise the follower's way is taken longer by one step at its top speed,
/// and the ego vehicle's shorter by W_p a step and by W_v.
#[derive(Debug, Clone, Copy)]
pub struct Rear<'a> {
    safety: &'a SafetySettings,
    id: u32,
    gap_m: f64,
    speed_mps: f64,
    /// As long as it did not react the follower may accelerate.
    follower_next_mps: f64,
    reaction_s: f64,
    keep_m: f64,
    /// Change of the gap in one step at the least.
    gap_change_m: f64,
    h_m: f64,
}

impl<'a> Rear<'a> {
    /// `behind`, in the lane of `ahead`, which is the target lane.
    pub fn new(ahead: &Ahead<'_>, behind: &Neighbour, safety: &'a SafetySettings) -> Self {
        let reach_m = ahead.rates.high * ahead.ego.rear_reach_m();
        let v = ahead.ego.state.speed_mps;
        let gap_m = -ahead.arc_to_m(behind.worst_s_front_m) - reach_m;
        let own_m = ahead.rates.low * v * STEP_S - moving(v) * safety.noise_position_m;
        let mut rear = Self {
            safety,
            id: behind.id,
            gap_m,
            speed_mps: v,
            follower_next_mps: behind.worst_fast_mps + safety.follower_accel_mps2 * STEP_S,
            reaction_s: if behind.action.is_some() {
                safety.reaction_cav_s
            } else {
                safety.reaction_human_s
            },
            keep_m: ahead.headway_bumper_m(behind.length_m, safety),
            gap_change_m: own_m - ahead.rates_in_lane.high * behind.worst_fast_mps * STEP_S,
            h_m: 0.0,
        };
        rear.h_m = rear.level_m(rear.gap_m, v, behind.worst_fast_mps) - rear.keep_m;
        rear
    }

    /// The collision level: without the headway, but with the collision margin.
    pub fn h0_m(&self) -> f64 {
        self.h_m + self.keep_m - self.safety.collision_margin_m
    }

    fn level_m(&self, gap_m: f64, speed_mps: f64, follower_mps: f64) -> f64 {
        let stop_m = self.follower_stop_m(follower_mps);
        gap_m - (stop_m - self.own_stop_m(speed_mps)).max(0.0)
    }

    /// What the follower drives at most until it stands.
    fn follower_stop_m(&self, speed_mps: f64) -> f64 {
        let (accel, reaction_s) = (self.safety.follower_accel_mps2, self.reaction_s);
        let top = speed_mps + reaction_s * accel;
        speed_mps * reaction_s
            + 0.5 * accel * reaction_s.powi(2)
            + top.powi(2) / (2.0 * self.safety.follower_brake_mps2)
            + top * STEP_S
    }

    /// What the ego vehicle drives at least when it brakes as hard as it can.
    fn own_stop_m(&self, speed_mps: f64) -> f64 {
        let brake = self.safety.brake_mps2 + self.safety.noise_speed_mps / STEP_S;
        let steps = speed_mps / (self.safety.brake_mps2 * STEP_S);
        (speed_mps.powi(2) / (2.0 * brake) - steps * self.safety.noise_position_m).max(0.0)
    }
}

fn moving(speed_mps: f64) -> f64 {
    if speed_mps > 0.0 { 1.0 } else { 0.0 }
}

impl Barrier for Rear<'_> {
    fn kind(&self) -> BarrierKind {
        BarrierKind::RearTarget
    }

    fn h(&self) -> f64 {
        self.h_m
    }

    fn h_next(&self, u: ControlInput) -> f64 {
        let noise_mps = self.safety.noise_speed_mps;
        let next_mps = (self.speed_mps + u.accel_mps2 * STEP_S - noise_mps).max(0.0);
        let gap_m = self.gap_m + self.gap_change_m;
        self.level_m(gap_m, next_mps, self.follower_next_mps) - self.keep_m
    }

    fn target(&self) -> f64 {
        target(self.h_m, self.safety.eta)
    }

    fn row(&self) -> Row {
        let budget = self.gap_m + self.gap_change_m - self.keep_m - self.target();
        let missing_m = self.follower_stop_m(self.follower_next_mps) - budget;
        let lower = if budget < 0.0 {
            f64::INFINITY
        } else if missing_m <= 0.0 {
            f64::NEG_INFINITY
        } else {
            let next = self.speed_to_stop_in_mps(missing_m) + self.safety.noise_speed_mps;
            (next - self.speed_mps) / STEP_S
        };
        Row {
            neighbour: Some(self.id),
            h0_m: self.h0_m(),
            ..Row::at_least(BarrierKind::RearTarget, Input::Accel, lower, self.h_m)
        }
    }
}

impl Rear<'_> {
    /// The speed at which [`Self::own_stop_m`] is `distance_m` > 0.
    fn speed_to_stop_in_mps(&self, distance_m: f64) -> f64 {
        let brake = self.safety.brake_mps2 + self.safety.noise_speed_mps / STEP_S;
        let per_mps = self.safety.noise_position_m / (self.safety.brake_mps2 * STEP_S);
        // v^2 / (2 b) - v p = distance.
        brake * (per_mps + (per_mps.powi(2) + 2.0 * distance_m / brake).sqrt())
    }
}
