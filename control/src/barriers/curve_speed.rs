use covista_world::{BarrierKind, Road, STEP_S};

use super::{Input, Row, target};
use crate::SafetySettings;
use crate::situation::{EgoState, half_width_m};

/// Road that is looked at as one, in metres.
const STRETCH_M: f64 = 2.0;

/// Largest speed at road s such that v^2 <= a_lat_max / (|kappa| + k_min) holds everywhere ahead
/// when `brake_mps2` is used to reach it.
///
/// In steps of explicit Euler, braking from v to v_c takes
/// `(v^2 - v_c^2) / (2 b) + (v - v_c) Ts / 2`; the second term is bounded by `v Ts / 2`.
pub fn speed_limit_mps(
    road: &Road,
    s_m: f64,
    speed_mps: f64,
    brake_mps2: f64,
    settings: &SafetySettings,
) -> f64 {
    let half_width = half_width_m(road);
    // The innermost path is the shortest.
    let sharpest = road.sharpest_per_m();
    let brake = brake_mps2 * (1.0 - sharpest * half_width);
    let horizon_m = speed_mps.powi(2) / (2.0 * brake) + 2.0 * STRETCH_M;
    let stretches = (horizon_m / STRETCH_M).ceil().min(500.0) as usize;
    // Stretches that do not move with the vehicle, so that the limit ahead never drops at once.
    let first_m = (s_m / STRETCH_M).floor() * STRETCH_M;
    (0..stretches).fold(f64::INFINITY, |limit, i| {
        let from_m = first_m + STRETCH_M * i as f64;
        let ahead_m = (from_m - s_m).max(0.0);
        let curvature = road_curvature(road.max_abs_curvature(from_m, from_m + STRETCH_M), road);
        let squared = settings.lateral_accel_max_mps2
            / (curvature + settings.counter_curvature_min_per_m)
            + 2.0 * brake * ahead_m;
        // v^2 + v b Ts = squared.
        let half = 0.5 * brake * STEP_S;
        limit.min((squared + half * half).sqrt() - half)
    })
}

/// |kappa| / (1 - |kappa| d_max): the curvature of the sharpest path along the road.
pub fn road_curvature(curvature_per_m: f64, road: &Road) -> f64 {
    curvature_per_m / (1.0 - curvature_per_m * half_width_m(road))
}

/// The row v+ <= limit(s+), as an upper bound on a.
pub fn row(road: &Road, ego: &EgoState, next_s_m: f64, settings: &SafetySettings) -> Row {
    let v = ego.state.speed_mps;
    let brake = settings.brake_mps2 - settings.noise_speed_mps / STEP_S;
    let limit = |s_m: f64| speed_limit_mps(road, s_m, v, brake, settings);
    let h = limit(ego.frenet.s_m) - v;
    let next = limit(next_s_m) - target(h, settings.eta).max(0.0);
    let upper = ((next - settings.noise_speed_mps - v) / STEP_S).max(-v / STEP_S);
    let upper = if h < -1e-9 {
        upper.clamp(-settings.brake_mps2, -settings.gentle_brake_mps2)
    } else {
        upper
    };
    Row::at_most(BarrierKind::CurveSpeed, Input::Accel, upper, h)
}
