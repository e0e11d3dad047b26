use covista_world::{BicycleState, FrenetPose, Road, STEP_S};

/// Share of the way to its input that a first-order lag goes in one step.
pub(super) fn lag_share(time_constant_s: f64) -> f64 {
    1.0 - (-STEP_S / time_constant_s).exp()
}

/// Seconds by which an input comes late: the time constant, less what sampling takes off it.
pub(super) fn lead_s(time_constant_s: f64) -> f64 {
    let share = lag_share(time_constant_s);
    STEP_S * (1.0 - share) / share
}

/// What a vehicle with lagging actuators does at this moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    pub speed_mps: f64,
    pub accel_mps2: f64,
    /// Of its path, positive to the left.
    pub curvature_per_m: f64,
}

/// Where the actuators lead to from `now`, in the plane and on the road.
///
/// With `x' = v`, `v' = a` and `a' = (u - a) / tau` the point `x + tau v` at the speed `v + tau a`
/// moves as if there were no lag, and x follows it with that lag: it stays in any interval in which
/// the point stays, and never passes it. So do the offset and the heading relative to the road, for
/// small headings at a constant speed and curvature.
pub(super) fn led(
    time_constant_s: f64,
    motion: Motion,
    now: FrenetPose,
    road: &Road,
) -> (BicycleState, FrenetPose) {
    let lead_s = lead_s(time_constant_s);
    // At the speed of the step before: then position and speed are exact along a line.
    let before_mps = motion.speed_mps - motion.accel_mps2 * STEP_S;
    let way_m = lead_s * before_mps.max(0.0);
    let (sin, cos) = now.psi_rad.sin_cos();
    let s_m = now.s_m + way_m * cos / (1.0 - now.curvature_per_m * now.d_m);
    let turned_rad = way_m * motion.curvature_per_m - road.turn_rad(now.s_m, s_m);
    let there = FrenetPose {
        s_m,
        d_m: now.d_m + way_m * sin,
        psi_rad: now.psi_rad + turned_rad,
        curvature_per_m: road.curvature(s_m),
    };
    let state = BicycleState {
        pose: road.pose_from_frenet(there.s_m, there.d_m, there.psi_rad),
        speed_mps: (motion.speed_mps + lead_s * motion.accel_mps2).max(0.0),
    };
    (state, there)
}
