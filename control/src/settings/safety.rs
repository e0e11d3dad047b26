use serde::{Deserialize, Serialize};

/// Every assumption of the promise, and every choice of the controller, by name.
///
/// "If h(x_0) >= 0 on the road as it is, leaders brake at most `leader_brake_mps2`, noise,
/// perception error and message age stay within their bounds, and nobody cuts in or is revealed
/// inside the set, a CAV's headway never falls below `headway_safe_m`; and inside the collision
/// set it never hits the vehicle ahead."
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SafetySettings {
    /// b_e: hardest braking of the ego vehicle in U.
    pub brake_mps2: f64,
    /// Largest acceleration in U.
    pub accel_max_mps2: f64,
    /// |tan(delta)| in U.
    pub tan_delta_max: f64,
    /// Largest lateral acceleration v^2 tan(delta) / L.
    pub lateral_accel_max_mps2: f64,
    /// b_l: hardest braking assumed of a vehicle ahead.
    pub leader_brake_mps2: f64,
    /// b_min: braking that a follower really has.
    pub follower_brake_mps2: f64,
    /// a_b: acceleration of a follower until it reacts.
    pub follower_accel_mps2: f64,
    /// rho of a CAV.
    pub reaction_cav_s: f64,
    /// rho of a human driver.
    pub reaction_human_s: f64,
    /// W_p: bound on the position noise of one step.
    pub noise_position_m: f64,
    /// Position noise is at most this share of the way driven in the step, too.
    pub noise_position_share: f64,
    /// W_v: bound on the speed noise of one step.
    pub noise_speed_mps: f64,
    /// Bound on the angle between the direction of travel and the heading (side slip).
    pub noise_slip_rad: f64,
    /// Bound on what the driven curvature differs from tan(delta) / L by.
    pub noise_curvature_per_m: f64,
    /// P_safe between the bodies' centres.
    pub headway_safe_m: f64,
    /// Bumper distance of the collision level.
    pub collision_margin_m: f64,
    /// eta in (0, 1]: h may fall to (1 - eta) h in a step.
    pub eta: f64,
    /// Largest braking while the distance level is broken and the collision level holds.
    pub gentle_brake_mps2: f64,
    /// Below this speed a vehicle that leaves its lane round a stopped one keeps only the
    /// collision level towards it.
    pub leaving_speed_mps: f64,
    /// k_min: counter-curvature that the curve speed leaves at least.
    pub counter_curvature_min_per_m: f64,
    /// How many standard deviations an estimate may be wrong.
    pub error_sigmas: f64,
    /// How far a body must reach over a line to be in the lane.
    pub lane_entry_m: f64,
    /// From the first line of sight to a vehicle to its track, at most.
    pub perception_delay_s: f64,
    /// Age of the newest measurement that an estimate rests on, at most.
    pub knowledge_age_max_s: f64,
    /// Range within which the own line of sight confirms a lane as free.
    pub sight_range_m: f64,
    /// How far beyond the truth the free sight may be said to reach.
    pub sight_error_m: f64,
    /// Length of the shortest vehicle that may stand where the sight ends.
    pub shortest_vehicle_m: f64,
    /// Length of the longest vehicle.
    pub longest_vehicle_m: f64,
    /// Width of the widest vehicle.
    pub widest_vehicle_m: f64,
    /// How long a stretch that was seen free counts as free.
    pub sight_memory_s: f64,
    /// Time between the announcement of a lane change and its start; a CAV's intention counts as
    /// known when it was heard within this time.
    pub announcement_s: f64,
}

impl Default for SafetySettings {
    fn default() -> Self {
        Self {
            brake_mps2: 8.0,
            accel_max_mps2: 3.0,
            tan_delta_max: 0.6,
            lateral_accel_max_mps2: 4.0,
            leader_brake_mps2: 8.0,
            follower_brake_mps2: 4.0,
            follower_accel_mps2: 1.0,
            reaction_cav_s: 0.1,
            reaction_human_s: 0.75,
            noise_position_m: 1e-3,
            noise_position_share: 0.1,
            noise_speed_mps: 5e-3,
            noise_slip_rad: 2e-3,
            noise_curvature_per_m: 1e-4,
            headway_safe_m: 18.5,
            collision_margin_m: 2.0,
            eta: 0.2,
            gentle_brake_mps2: 3.0,
            leaving_speed_mps: 5.0,
            counter_curvature_min_per_m: 0.003,
            error_sigmas: 3.0,
            lane_entry_m: 0.2,
            perception_delay_s: 1.5,
            knowledge_age_max_s: 1.0,
            sight_range_m: 65.0,
            sight_error_m: 1.0,
            shortest_vehicle_m: 3.0,
            longest_vehicle_m: 18.75,
            widest_vehicle_m: 2.6,
            sight_memory_s: 1.0,
            announcement_s: 0.3,
        }
    }
}

impl SafetySettings {
    /// How far the circle round a vehicle that stands where the sight ends may reach before it.
    pub(crate) fn hidden_corner_m(&self) -> f64 {
        let length_m = self.shortest_vehicle_m;
        0.5 * (length_m.hypot(self.widest_vehicle_m) - length_m)
    }

    /// What a step may drive beyond v Ts, in shares of v Ts: the position noise at speed v.
    pub(crate) fn overrun(&self, speed_mps: f64) -> f64 {
        let step_m = speed_mps * covista_world::STEP_S;
        if self.noise_position_m > 0.0 {
            self.noise_position_share
                .min(self.noise_position_m / step_m)
        } else {
            0.0
        }
    }
}
