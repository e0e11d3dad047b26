use covista_world::{BarrierKind, LaneIndex, Road, STEP_S};

use super::{Input, ROUNDING_M, Row, target};
use crate::situation::{ArcRates, EgoState, Neighbour, lane_arc_m};
use crate::{Closing, SafetySettings};

/// A gap that closes at two speeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Bumper to bumper along the lane, in metres.
    pub gap_m: f64,
    /// Speed of the ego vehicle.
    pub speed_mps: f64,
    /// Speed of what is ahead.
    pub leader_mps: f64,
}

impl Gap {
    /// h = gap - `keep_m` - D.
    pub fn h_m(&self, closing: &Closing, keep_m: f64) -> f64 {
        self.gap_m - keep_m - closing.distance_m(self.speed_mps, self.leader_mps)
    }

    /// Largest acceleration with h(x+) >= `target_m`, when the leader has `leader_next_mps` at x+.
    ///
    /// The position at x+ does not depend on u, and D rises with v+: the row is exact. The next
    /// speed carries the noise W_v, except at standstill.
    pub fn accel_max_mps2(
        &self,
        closing: &Closing,
        settings: &SafetySettings,
        keep_m: f64,
        target_m: f64,
        leader_next_mps: f64,
    ) -> f64 {
        let v = self.speed_mps;
        let gap_next = self.gap_m - closing.step_m(v, self.leader_mps);
        let budget = gap_next - keep_m - target_m;
        // A brake that just holds the row may miss it by rounding.
        let budget = if budget > -1e-9 {
            budget.max(0.0)
        } else {
            budget
        };
        let ceiling = v + settings.accel_max_mps2 * STEP_S + settings.noise_speed_mps;
        match closing.max_speed_mps(budget, leader_next_mps, ceiling) {
            Some(next) => ((next - settings.noise_speed_mps - v) / STEP_S).max(-v / STEP_S),
            None => f64::NEG_INFINITY,
        }
    }
}

/// What a front row is about.
#[derive(Debug, Clone, Copy)]
pub struct Ahead<'a> {
    /// The road.
    pub road: &'a Road,
    /// The ego vehicle.
    pub ego: EgoState,
    /// The lane in which the gap is measured.
    pub lane: LaneIndex,
    /// How far the ego vehicle's rear axle may be from that lane's centre.
    pub off_center_m: f64,
    /// What the rows of this lane are called.
    pub kind: BarrierKind,
    /// Whether the ego vehicle leaves the lane, which is enough for the collision level towards a
    /// vehicle that stands.
    pub leaving: bool,
}

/// The two levels of a front barrier in metres: h and h_0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrontLevels {
    /// The distance level.
    pub h_m: f64,
    /// The collision level.
    pub h0_m: f64,
    /// Whether the distance level is given up to drive round the leader.
    pub leaving: bool,
}

/// A leader slower than this stands.
const STANDING_MPS: f64 = 0.5;

impl Ahead<'_> {
    fn closing(&self, settings: &SafetySettings) -> Closing {
        let ego = ArcRates::new(self.road, self.off_center_m);
        let leader = ArcRates::new(self.road, self.road.lane_width_m() / 2.0);
        Closing::new(settings, ego.high, leader.low)
    }

    fn gap(&self, rear_s_m: f64, leader_mps: f64) -> Gap {
        let reach = ArcRates::new(self.road, self.off_center_m).high * self.ego.front_reach_m();
        Gap {
            gap_m: lane_arc_m(self.road, self.lane, self.ego.frenet.s_m, rear_s_m) - reach,
            speed_mps: self.ego.state.speed_mps,
            leader_mps,
        }
    }

    /// Bumper distance to the best estimate of `leader`.
    pub fn measured(&self, leader: &Neighbour) -> Gap {
        self.gap(leader.s_rear_m, leader.speed_mps)
    }

    fn worst(&self, leader: &Neighbour) -> Gap {
        self.gap(leader.worst_s_rear_m, leader.worst_slow_mps)
    }

    /// P_bumper = P_safe - (l_e + l_k) / 2.
    pub fn headway_bumper_m(&self, leader_length_m: f64, settings: &SafetySettings) -> f64 {
        settings.headway_safe_m - 0.5 * (self.ego.dimensions.length_m + leader_length_m)
    }

    /// Whether the distance level towards `leader` is given up to drive round it.
    pub fn leaves_round(&self, leader: &Neighbour, settings: &SafetySettings) -> bool {
        self.leaving
            && leader.speed_mps < STANDING_MPS
            && self.ego.state.speed_mps <= settings.leaving_speed_mps
    }

    /// h and h_0 towards the worst member of what `leader` may be.
    pub fn levels(&self, leader: &Neighbour, settings: &SafetySettings) -> FrontLevels {
        let closing = self.closing(settings);
        let worst = self.worst(leader);
        let keep_m = self.headway_bumper_m(leader.length_m, settings);
        FrontLevels {
            h_m: worst.h_m(&closing, keep_m),
            h0_m: worst.h_m(&closing, settings.collision_margin_m),
            leaving: self.leaves_round(leader, settings),
        }
    }

    /// The row towards `leader`.
    ///
    /// The collision level is always hard. The distance level is hard while h >= 0, and while only
    /// the estimate's error makes it negative; when the measured gap itself is short (a cut-in, a
    /// reveal) it is won back with at most the gentle braking, against the leader's measured
    /// motion.
    pub fn row(&self, leader: &Neighbour, settings: &SafetySettings) -> Row {
        let closing = self.closing(settings);
        let keep_m = self.headway_bumper_m(leader.length_m, settings);
        let levels = self.levels(leader, settings);
        let worst = self.worst(leader);
        let next = closing.leader_after_step_mps(worst.leader_mps);
        let limit = |keep_m: f64, h: f64| {
            worst.accel_max_mps2(&closing, settings, keep_m, target(h, settings.eta), next)
        };
        let collision = limit(settings.collision_margin_m, levels.h0_m);
        let measured = self.measured(leader);
        let distance = if levels.h_m >= -ROUNDING_M {
            limit(keep_m, levels.h_m)
        } else if levels.leaving {
            (settings.leaving_speed_mps - self.ego.state.speed_mps) / STEP_S
        } else if measured.h_m(&closing, keep_m) >= 0.0 {
            limit(keep_m, levels.h_m)
        } else {
            recovery_accel_mps2(measured, &closing, keep_m, settings)
        };
        Row {
            neighbour: Some(leader.id),
            h0_m: levels.h0_m,
            ..Row::at_most(self.kind, Input::Accel, collision.min(distance), levels.h_m)
        }
    }
}

/// Share of a metre that a broken distance level is won back in a second.
const RECOVERY_PER_S: f64 = 0.5;

/// Largest acceleration that wins the distance level back, no less than the gentle braking.
pub fn recovery_accel_mps2(
    measured: Gap,
    closing: &Closing,
    keep_m: f64,
    settings: &SafetySettings,
) -> f64 {
    let h = measured.h_m(closing, keep_m);
    let wanted = if h >= 0.0 {
        target(h, settings.eta)
    } else {
        h + (-h).min(1.0) * RECOVERY_PER_S * STEP_S
    };
    measured
        .accel_max_mps2(closing, settings, keep_m, wanted, measured.leader_mps)
        .max(-settings.gentle_brake_mps2)
}
