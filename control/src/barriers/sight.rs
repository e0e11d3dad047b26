use covista_world::{BarrierKind, STEP_S};

use super::front::{Ahead, Gap, recovery_accel_mps2};
use super::{Input, ROUNDING_M, Row, target};
use crate::situation::{ArcRates, lane_arc_m};
use crate::{Closing, SafetySettings};

/// h_vis = s_clear - P_bumper - D(v, 0): something may stand where the sight ends.
///
/// A line of sight that breaks off inside the set (a leader's cut-out, a passing truck) is outside
/// the promise; speed then follows with the gentle braking.
pub fn row(ahead: &Ahead<'_>, clear_s_m: f64, settings: &SafetySettings) -> Row {
    let rates = ArcRates::new(ahead.road, ahead.off_center_m);
    let closing = Closing::new(settings, rates.high, 1.0);
    let gap = gap(ahead, clear_s_m);
    // The hidden thing is taken to be as long as the ego vehicle.
    let keep_m = ahead.headway_bumper_m(ahead.ego.dimensions.length_m, settings);
    let h = gap.h_m(&closing, keep_m);
    let upper = if h >= -ROUNDING_M {
        gap.accel_max_mps2(&closing, settings, keep_m, target(h, settings.eta), 0.0)
    } else if ahead.leaving && gap.speed_mps <= settings.leaving_speed_mps {
        let h0 = gap.h_m(&closing, settings.collision_margin_m);
        let kept = target(h0, settings.eta);
        gap.accel_max_mps2(&closing, settings, settings.collision_margin_m, kept, 0.0)
            .min((settings.leaving_speed_mps - gap.speed_mps) / STEP_S)
    } else {
        recovery_accel_mps2(gap, &closing, keep_m, settings)
    };
    Row::at_most(BarrierKind::Sight, Input::Accel, upper, h)
}

/// Sight beyond this changes nothing.
const FARTHEST_M: f64 = 1e4;

/// From the ego vehicle's front to the end of what is seen, along the lane.
pub fn gap(ahead: &Ahead<'_>, clear_s_m: f64) -> Gap {
    let reach = ArcRates::new(ahead.road, ahead.off_center_m).high * ahead.ego.front_reach_m();
    let from_m = ahead.ego.frenet.s_m;
    let to_m = clear_s_m.clamp(from_m, from_m + FARTHEST_M);
    Gap {
        gap_m: lane_arc_m(ahead.road, ahead.lane, from_m, to_m) - reach,
        speed_mps: ahead.ego.state.speed_mps,
        leader_mps: 0.0,
    }
}
