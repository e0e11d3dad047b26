use covista_world::{BarrierKind, STEP_S};

use super::front::Ahead;
use super::{Input, Row, target};
use crate::SafetySettings;
use crate::situation::{ArcRates, Neighbour, lane_arc_m};

/// h_bt in the shape of RSS: the follower may accelerate with a_b for its reaction time, then
/// brakes with b_min; the ego vehicle may brake with b_e.
///
/// `h_bt = g - P_bumper - [v_b rho + a_b rho^2 / 2 + (v_b + rho a_b)^2 / (2 b_min) - v^2 / (2 b_e)]+`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Follower {
    gap_m: f64,
    speed_mps: f64,
    /// What the follower drives until it stands.
    stop_m: f64,
    keep_m: f64,
    /// Change of the gap in one step.
    gap_change_m: f64,
}

impl Follower {
    /// `behind`, in the lane of `ahead`, which is the target lane.
    pub fn new(ahead: &Ahead<'_>, behind: &Neighbour, settings: &SafetySettings) -> Self {
        let ego_rate = ArcRates::new(ahead.road, ahead.off_center_m);
        let other_rate = ArcRates::new(ahead.road, ahead.road.lane_width_m() / 2.0);
        let reach = ego_rate.high * ahead.ego.rear_reach_m();
        let rho = if behind.action.is_some() {
            settings.reaction_cav_s
        } else {
            settings.reaction_human_s
        };
        let (v, v_b) = (ahead.ego.state.speed_mps, behind.worst_fast_mps);
        let top = v_b + rho * settings.follower_accel_mps2;
        Self {
            gap_m: lane_arc_m(
                ahead.road,
                ahead.lane,
                behind.worst_s_front_m,
                ahead.ego.frenet.s_m,
            ) - reach,
            speed_mps: v,
            stop_m: v_b * rho
                + 0.5 * settings.follower_accel_mps2 * rho * rho
                + top * top / (2.0 * settings.follower_brake_mps2),
            keep_m: ahead.headway_bumper_m(behind.length_m, settings),
            gap_change_m: (ego_rate.low * v - other_rate.high * v_b) * STEP_S,
        }
    }

    /// h_bt in metres.
    pub fn h_m(&self, settings: &SafetySettings) -> f64 {
        self.gap_m - self.keep_m - self.closed_m(settings)
    }

    /// The collision level: without the headway, but with the collision margin.
    pub fn h0_m(&self, settings: &SafetySettings) -> f64 {
        self.gap_m - settings.collision_margin_m - self.closed_m(settings)
    }

    fn closed_m(&self, settings: &SafetySettings) -> f64 {
        (self.stop_m - self.speed_mps.powi(2) / (2.0 * settings.brake_mps2)).max(0.0)
    }

    /// The row: a lower bound on a.
    pub fn row(&self, id: u32, settings: &SafetySettings) -> Row {
        let h = self.h_m(settings);
        let budget = self.gap_m + self.gap_change_m - self.keep_m - target(h, settings.eta);
        let lower = if budget >= self.stop_m {
            f64::NEG_INFINITY
        } else if budget < 0.0 {
            f64::INFINITY
        } else {
            let next = (2.0 * settings.brake_mps2 * (self.stop_m - budget)).sqrt();
            (next - self.speed_mps) / STEP_S
        };
        Row {
            neighbour: Some(id),
            h0_m: self.h0_m(settings),
            ..Row::at_least(BarrierKind::RearTarget, Input::Accel, lower, h)
        }
    }
}
