use covista_world::{ControlInput, STEP_S};

use crate::barriers::bounds::tan_delta_limit;
use crate::barriers::front::{Ahead, Gap};
use crate::barriers::sight;
use crate::manoeuvre::Course;
use crate::path::LateralPath;
use crate::rows::{ahead_in, leaders};
use crate::{Closing, ControlSettings, Mode, Situation};

/// The reference u_nominal = U a of one step: flat outputs for the steering, and a speed that
/// leaves the filter little to do.
pub fn reference(
    situation: &Situation<'_>,
    course: &Course,
    path: &LateralPath,
    last_accel_mps2: f64,
    settings: &ControlSettings,
) -> ControlInput {
    ControlInput {
        tan_delta: steering(situation, path, settings),
        accel_mps2: accel(situation, course, last_accel_mps2, settings),
    }
}

/// Steers along the path: the endogenous transformation of the flat outputs, with their error fed
/// back in d and heading over the length that is driven in about 0.7 s.
fn steering(situation: &Situation<'_>, path: &LateralPath, settings: &ControlSettings) -> f64 {
    let ego = &situation.ego;
    let v = ego.state.speed_mps;
    let point = path.at(situation.road(), ego.frenet.s_m);
    let length_m = (0.7 * v).max(3.5);
    let error_m = ego.frenet.d_m - point.d_m;
    let heading_error = (ego.frenet.psi_rad - point.psi_rad).sin();
    let curvature =
        point.curvature_per_m - error_m / length_m.powi(2) - 2.0 * heading_error / length_m;
    let limit = tan_delta_limit(v, ego.dimensions.wheelbase_m, &settings.safety);
    (curvature * ego.dimensions.wheelbase_m).clamp(-limit, limit)
}

/// Follows the nearest leader as the intelligent driver model does, at a speed for the curve and
/// the sight ahead, with bounded jerk.
fn accel(
    situation: &Situation<'_>,
    course: &Course,
    last_accel_mps2: f64,
    settings: &ControlSettings,
) -> f64 {
    let reference = &settings.reference;
    let v = situation.ego.state.speed_mps;
    let mut wanted_mps = situation
        .desired_speed_mps
        .min(curve_speed_mps(situation, settings));
    let mut following = f64::INFINITY;
    // The paper's references track a trajectory and leave the distance to its QP.
    let heeds_others = settings.mode != Mode::Paper;
    for ahead in ahead_in(situation, course).filter(|_| heeds_others) {
        wanted_mps = sight_speed_mps(situation, &ahead, wanted_mps, settings);
        for leader in leaders(situation, &ahead) {
            let leaving = ahead.leaves_round(leader, &settings.safety);
            if leaving {
                wanted_mps = wanted_mps.min(reference.leaving_speed_mps);
            }
            let keep_m = if leaving {
                settings.safety.collision_margin_m
            } else {
                ahead.headway_bumper_m(leader.length_m, &settings.safety)
            };
            let time_gap_s = if leaving { 0.0 } else { reference.time_gap_s };
            let gap = ahead.measured(leader);
            following = following.min(follow_mps2(gap, keep_m, time_gap_s, settings));
        }
    }
    let free = if v <= wanted_mps {
        reference.accel_mps2 * (1.0 - (v / wanted_mps.max(0.1)).powi(4))
    } else {
        (wanted_mps - v) / 0.4
    };
    let last = last_accel_mps2.clamp(-reference.brake_max_mps2, reference.accel_mps2);
    let jerk = reference.jerk_mps3 * STEP_S;
    free.min(following)
        .clamp(-reference.brake_max_mps2, reference.accel_mps2)
        .clamp(last - jerk, last + jerk)
        .max(-v / STEP_S)
}

/// The intelligent driver model's interaction a (1 - (s* / s)^2), where s is the gap beyond the
/// one to keep. A gap that is too small but does not close is opened comfortably.
fn follow_mps2(gap: Gap, keep_m: f64, time_gap_s: f64, settings: &ControlSettings) -> f64 {
    let reference = &settings.reference;
    let (v, closing_mps) = (gap.speed_mps, gap.speed_mps - gap.leader_mps);
    let comfort = 2.0 * (reference.accel_mps2 * reference.brake_mps2).sqrt();
    let dynamic_m = (v * time_gap_s + v * closing_mps / comfort).max(0.0);
    let wanted_m = reference.standstill_gap_m + dynamic_m;
    let room_m = (gap.gap_m - keep_m).max(0.1);
    let hardest = if closing_mps < 1.0 {
        reference.brake_mps2
    } else {
        reference.brake_max_mps2
    };
    (reference.accel_mps2 * (1.0 - (wanted_m / room_m).powi(2))).max(-hardest)
}

/// The speed for the curvature ahead, looked at 0.4 s early.
fn curve_speed_mps(situation: &Situation<'_>, settings: &ControlSettings) -> f64 {
    let ego = &situation.ego;
    let preview_s_m = ego.frenet.s_m + 0.4 * ego.state.speed_mps;
    settings.reference.speed_share * situation.profile.comfortable_speed_mps(preview_s_m)
}

/// The end of the sight stays where it is until the next sweep.
const SIGHT_PREVIEW_S: f64 = 0.2;

/// The speed up to `wanted_mps` from which the sight allows to stop.
fn sight_speed_mps(
    situation: &Situation<'_>,
    ahead: &Ahead<'_>,
    wanted_mps: f64,
    settings: &ControlSettings,
) -> f64 {
    let safety = &settings.safety;
    let gap = sight::gap(ahead, situation.sight.clear_s_m(ahead.lane), safety);
    let keep_m = if ahead.leaving {
        safety.collision_margin_m
    } else {
        ahead.headway_bumper_m(safety.shortest_vehicle_m, safety)
    };
    let closing = Closing::new(safety, 1.0, 1.0);
    let driven_m = SIGHT_PREVIEW_S * situation.ego.state.speed_mps;
    let share = settings.reference.speed_share;
    let limit = closing.max_speed_mps(gap.gap_m - keep_m - driven_m, 0.0, wanted_mps / share);
    wanted_mps.min(share * limit.unwrap_or(0.0))
}
