use covista_world::{BarrierKind, ControlInput, LaneIndex, Road, STEP_S};

use super::{Barrier, Input, ROUNDING_M, Row, target};
use crate::arc::ArcRates;
use crate::memory::Excuse;
use crate::{Closing, EgoState, Neighbour, SafetySettings};

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

    /// h(x+) at the acceleration `accel_mps2`, when what is ahead has `leader_next_mps` at x+: the
    /// position at x+ does not depend on u. The next speed carries the noise W_v, except at
    /// standstill.
    pub fn h_next_m(
        &self,
        closing: &Closing,
        safety: &SafetySettings,
        keep_m: f64,
        leader_next_mps: f64,
        accel_mps2: f64,
    ) -> f64 {
        let wanted_mps = self.speed_mps + accel_mps2 * STEP_S;
        let noise_mps = if wanted_mps > 0.0 {
            safety.noise_speed_mps
        } else {
            0.0
        };
        self.gap_next_m(closing)
            - keep_m
            - closing.distance_m(wanted_mps + noise_mps, leader_next_mps)
    }

    /// Largest acceleration with h(x+) >= `target_m`; infinite where all of U has it. D rises with
    /// v+, so that the row is exact.
    pub fn accel_max_mps2(
        &self,
        closing: &Closing,
        safety: &SafetySettings,
        keep_m: f64,
        target_m: f64,
        leader_next_mps: f64,
    ) -> f64 {
        let v = self.speed_mps;
        let budget = self.gap_next_m(closing) - keep_m - target_m + ROUNDING_A_STEP_M;
        // A brake that just holds the row may miss it by rounding.
        let budget = if budget > -1e-9 {
            budget.max(0.0)
        } else {
            budget
        };
        let ceiling = v + safety.accel_max_mps2 * STEP_S + safety.noise_speed_mps;
        match closing.max_speed_mps(budget, leader_next_mps, ceiling) {
            Some(next) if next >= ceiling => f64::INFINITY,
            Some(next) => ((next - safety.noise_speed_mps - v) / STEP_S).max(-v / STEP_S),
            None => f64::NEG_INFINITY,
        }
    }

    fn gap_next_m(&self, closing: &Closing) -> f64 {
        self.gap_m - closing.step_m(self.speed_mps, self.leader_mps)
    }
}

/// Rounding of positions some kilometres along the road: hardest braking holds a row exactly, also
/// where D is flat, and must not miss it for that.
const ROUNDING_A_STEP_M: f64 = 5e-12;

/// What the front rows of one lane have in common.
#[derive(Debug, Clone, Copy)]
pub struct Ahead<'a> {
    /// The road.
    pub road: &'a Road,
    /// The ego vehicle.
    pub ego: EgoState,
    /// The lane in which the gap is measured.
    pub lane: LaneIndex,
    /// What the rows of this lane are called.
    pub kind: BarrierKind,
    /// Whether the ego vehicle leaves the lane, which is enough for the collision level towards a
    /// vehicle that stands.
    pub leaving: bool,
    /// c_min and c_max of the ego vehicle.
    pub rates: ArcRates,
    /// The bounds on a vehicle of which any part is in this lane.
    pub rates_in_lane: ArcRates,
    /// How far ahead of the rear axle the body's front may be, in metres of the lane.
    reach_m: f64,
    /// Offset d of the lane's centre, and the angle that the road has turned up to the ego vehicle.
    center_m: f64,
    turned_rad: f64,
}

impl<'a> Ahead<'a> {
    /// For an ego vehicle whose rear axle is at most `off_center_m` from the lane's centre.
    pub fn new(
        road: &'a Road,
        ego: EgoState,
        lane: LaneIndex,
        off_center_m: f64,
        kind: BarrierKind,
        leaving: bool,
    ) -> Self {
        let rates = ArcRates::new(road, off_center_m);
        Self {
            road,
            ego,
            lane,
            kind,
            leaving,
            rates,
            rates_in_lane: ArcRates::new(road, road.lane_width_m()),
            reach_m: rates.high * ego.front_reach_m(),
            center_m: road.lane_center_m(lane),
            turned_rad: road.turned_rad(ego.frenet.s_m),
        }
    }

    /// How the ego vehicle and a leader of this lane close in.
    pub fn closing(&self, safety: &SafetySettings) -> Closing {
        Closing::new(safety, self.rates.high, self.rates_in_lane.low)
    }

    /// Arc length of the lane's centre line from the rear axle to road s `s_m`, signed: a parallel
    /// at offset d is shorter by d times the angle turned.
    pub fn arc_to_m(&self, s_m: f64) -> f64 {
        let turn_rad = self.road.turned_rad(s_m) - self.turned_rad;
        (s_m - self.ego.frenet.s_m) - self.center_m * turn_rad
    }

    /// Bumper distance along the lane to road s `s_m`.
    pub fn gap_to_m(&self, s_m: f64) -> f64 {
        self.arc_to_m(s_m) - self.reach_m
    }

    /// Bumper distance to the best estimate of `leader`, whatever its heading.
    pub fn measured(&self, leader: &Neighbour) -> Gap {
        self.gap(leader.center_s_m() - leader.reach_m, leader.speed_mps)
    }

    /// Bumper distance to the worst member of what `leader` may be.
    pub fn worst(&self, leader: &Neighbour) -> Gap {
        self.gap(leader.worst_s_rear_m, leader.worst_slow_mps)
    }

    fn gap(&self, rear_s_m: f64, leader_mps: f64) -> Gap {
        Gap {
            gap_m: self.gap_to_m(rear_s_m),
            speed_mps: self.ego.state.speed_mps,
            leader_mps,
        }
    }

    /// P_bumper = P_safe - (l_e + l_k) / 2, but no less than the collision margin, which very long
    /// vehicles would undercut.
    pub fn headway_bumper_m(&self, leader_length_m: f64, safety: &SafetySettings) -> f64 {
        let half_lengths_m = 0.5 * (self.ego.dimensions.length_m + leader_length_m);
        (safety.headway_safe_m - half_lengths_m).max(safety.collision_margin_m)
    }

    /// Whether the distance level towards `leader` is given up to drive round it.
    pub fn leaves_round(&self, leader: &Neighbour, safety: &SafetySettings) -> bool {
        self.leaving
            && leader.speed_mps < STANDING_MPS
            && self.ego.state.speed_mps <= safety.leaving_speed_mps
    }
}

/// A leader slower than this stands.
const STANDING_MPS: f64 = 0.5;

/// h_fc and h_ft: a vehicle ahead, in two levels.
///
/// The collision level `h_0 = g - 2 m - D` is always hard. The distance level
/// `h = g - P_bumper - D` is hard, too; below zero h must not fall any further, which hardest
/// braking always achieves: what only the estimate's error or its age takes from h costs no true
/// metre. A cut-in or a reveal that is inside the set by its measured gap is excused: the distance
/// is won back with at most the gentle braking, against the leader's measured motion.
#[derive(Debug, Clone, Copy)]
pub struct Front<'a> {
    safety: &'a SafetySettings,
    closing: Closing,
    ahead: &'a Ahead<'a>,
    leader: &'a Neighbour,
    worst: Gap,
    keep_m: f64,
    h_m: f64,
    excuse: Option<Excuse>,
}

impl<'a> Front<'a> {
    /// Towards `leader`, with c_max and c_min in `closing`.
    pub fn new(
        ahead: &'a Ahead<'a>,
        closing: Closing,
        leader: &'a Neighbour,
        safety: &'a SafetySettings,
    ) -> Self {
        let worst = ahead.worst(leader);
        let keep_m = ahead.headway_bumper_m(leader.length_m, safety);
        Self {
            safety,
            closing,
            ahead,
            leader,
            worst,
            keep_m,
            h_m: worst.h_m(&closing, keep_m),
            excuse: None,
        }
    }

    /// Excuses a broken distance level.
    pub fn excused(self, excuse: Option<Excuse>) -> Self {
        Self { excuse, ..self }
    }

    /// The lane of the row.
    pub fn lane(&self) -> LaneIndex {
        self.ahead.lane
    }

    /// h_0: the collision level.
    pub fn h0_m(&self) -> f64 {
        self.h_m + self.keep_m - self.safety.collision_margin_m
    }

    /// h of the best estimate, without its error and age.
    pub fn measured_h_m(&self) -> f64 {
        self.ahead
            .measured(self.leader)
            .h_m(&self.closing, self.keep_m)
    }

    /// h of the most favourable member of what the leader may be.
    pub fn best_h_m(&self) -> f64 {
        let best = (self.ahead).gap(self.leader.best_s_rear_m, self.leader.best_fast_mps);
        best.h_m(&self.closing, self.keep_m)
    }

    /// Whether the distance level may be given up to drive round the leader.
    pub fn leaves_round(&self) -> bool {
        self.ahead.leaves_round(self.leader, self.safety)
    }

    fn leader_next_mps(&self) -> f64 {
        self.closing.leader_after_step_mps(self.worst.leader_mps)
    }

    fn limit_mps2(&self, keep_m: f64, h: f64) -> f64 {
        let kept = target(h, self.safety.eta);
        let next = self.leader_next_mps();
        self.worst
            .accel_max_mps2(&self.closing, self.safety, keep_m, kept, next)
    }
}

impl Barrier for Front<'_> {
    fn kind(&self) -> BarrierKind {
        self.ahead.kind
    }

    fn h(&self) -> f64 {
        self.h_m
    }

    fn h_next(&self, u: ControlInput) -> f64 {
        let next = self.leader_next_mps();
        self.worst
            .h_next_m(&self.closing, self.safety, self.keep_m, next, u.accel_mps2)
    }

    fn target(&self) -> f64 {
        target(self.h_m, self.safety.eta)
    }

    fn row(&self) -> Row {
        let collision = || self.limit_mps2(self.safety.collision_margin_m, self.h0_m());
        let upper = match self.excuse {
            // The collision level is the weaker one while the distance level holds.
            _ if self.h_m >= -ROUNDING_M => self.limit_mps2(self.keep_m, self.h_m),
            None | Some(Excuse::Revised) => self.limit_mps2(self.keep_m, self.h_m),
            Some(Excuse::Leaving) => {
                let fastest_mps = self.safety.leaving_speed_mps - self.safety.noise_speed_mps;
                let slow = (fastest_mps - self.worst.speed_mps) / STEP_S;
                collision().min(slow)
            }
            Some(Excuse::CutIn | Excuse::Revealed) => collision().min(recovery_accel_mps2(
                self.ahead.measured(self.leader),
                &self.closing,
                self.keep_m,
                self.h_m,
                self.safety,
            )),
        };
        Row {
            neighbour: Some(self.leader.id),
            h0_m: self.h0_m(),
            excuse: self.excuse,
            ..Row::at_most(self.kind(), Input::Accel, upper, self.h_m)
        }
    }
}

/// Share of a metre that a broken distance level is won back in a second.
const RECOVERY_PER_S: f64 = 0.5;

/// Largest acceleration that wins a distance level `h_m` < 0 back against the measured motion: no
/// less than the gentle braking, and none that gains speed.
pub fn recovery_accel_mps2(
    measured: Gap,
    closing: &Closing,
    keep_m: f64,
    h_m: f64,
    safety: &SafetySettings,
) -> f64 {
    let wanted = measured.h_m(closing, keep_m) + (-h_m).min(1.0) * RECOVERY_PER_S * STEP_S;
    measured
        .accel_max_mps2(closing, safety, keep_m, wanted, measured.leader_mps)
        .clamp(-safety.gentle_brake_mps2, 0.0)
        .max(-measured.speed_mps / STEP_S)
}
