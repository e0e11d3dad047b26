use covista_world::{BarrierKind, ControlInput, STEP_S};

use super::front::{Ahead, Gap, recovery_accel_mps2};
use super::{Barrier, Input, ROUNDING_M, Row, target};
use crate::{Closing, SafetySettings};

/// h_vis = s_clear - P_bumper - D(v, 0): a vehicle may stand where the sight ends. It is taken to
/// be the shortest there is, which leaves the longest P_bumper.
///
/// A line of sight that breaks off inside the set (a leader's cut-out, a passing truck) is outside
/// the promise; speed then follows with the gentle braking. As long as the set may hold, the sight's
/// error taken for nothing and the vehicle for the longest there is, the row is hard.
#[derive(Debug, Clone, Copy)]
pub struct Sight<'a> {
    safety: &'a SafetySettings,
    closing: Closing,
    gap: Gap,
    keep_m: f64,
    h_m: f64,
    leaving: bool,
}

impl<'a> Sight<'a> {
    /// Where the lane is said to be free up to road s `clear_s_m`.
    pub fn new(ahead: &Ahead<'_>, clear_s_m: f64, safety: &'a SafetySettings) -> Self {
        let closing = Closing::new(safety, ahead.rates.high, 1.0);
        let gap = gap(ahead, clear_s_m, safety);
        let keep_m = ahead.headway_bumper_m(safety.shortest_vehicle_m, safety);
        Self {
            safety,
            closing,
            gap,
            keep_m,
            h_m: gap.h_m(&closing, keep_m),
            leaving: ahead.leaving && gap.speed_mps <= safety.leaving_speed_mps,
        }
    }

    /// Whether h >= 0 towards some vehicle that may stand at the end of sight.
    pub fn may_hold(&self) -> bool {
        let longer_m = self.safety.longest_vehicle_m - self.safety.shortest_vehicle_m;
        let unsure_m = self.safety.sight_error_m + self.safety.hidden_corner_m();
        self.h_m >= -(unsure_m + 0.5 * longer_m) - ROUNDING_M
    }

    fn limit_mps2(&self, keep_m: f64, h: f64) -> f64 {
        let kept = target(h, self.safety.eta);
        self.gap
            .accel_max_mps2(&self.closing, self.safety, keep_m, kept, 0.0)
    }

    /// The limit of the collision level, which is always hard.
    fn collision_mps2(&self) -> f64 {
        let margin_m = self.safety.collision_margin_m;
        self.limit_mps2(margin_m, self.gap.h_m(&self.closing, margin_m))
    }
}

impl Barrier for Sight<'_> {
    fn kind(&self) -> BarrierKind {
        BarrierKind::Sight
    }

    fn h(&self) -> f64 {
        self.h_m
    }

    fn h_next(&self, u: ControlInput) -> f64 {
        self.gap
            .h_next_m(&self.closing, self.safety, self.keep_m, 0.0, u.accel_mps2)
    }

    fn target(&self) -> f64 {
        target(self.h_m, self.safety.eta)
    }

    fn row(&self) -> Row {
        let upper = if self.h_m >= -ROUNDING_M || self.may_hold() && !self.leaving {
            self.limit_mps2(self.keep_m, self.h_m)
        } else if self.leaving {
            let fastest_mps = self.safety.leaving_speed_mps - self.safety.noise_speed_mps;
            let slow = (fastest_mps - self.gap.speed_mps) / STEP_S;
            self.collision_mps2().min(slow)
        } else {
            let gentle =
                recovery_accel_mps2(self.gap, &self.closing, self.keep_m, self.h_m, self.safety);
            self.collision_mps2().min(gentle)
        };
        Row::at_most(BarrierKind::Sight, Input::Accel, upper, self.h_m)
    }
}

/// Sight beyond this changes nothing.
const FARTHEST_M: f64 = 1e4;

/// From the ego vehicle's front to the end of what is surely free, along the lane: to the circle
/// round what may stand there.
pub fn gap(ahead: &Ahead<'_>, clear_s_m: f64, safety: &SafetySettings) -> Gap {
    let from_m = ahead.ego.frenet.s_m;
    let unsure_m = safety.sight_error_m + safety.hidden_corner_m();
    let to_m = (clear_s_m - unsure_m).clamp(from_m, from_m + FARTHEST_M);
    Gap {
        gap_m: ahead.gap_to_m(to_m),
        speed_mps: ahead.ego.state.speed_mps,
        leader_mps: 0.0,
    }
}
