use serde::{Deserialize, Serialize};

/// How the reference drives: comfort, not safety.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReferenceSettings {
    /// Acceleration from standstill.
    pub accel_mps2: f64,
    /// Braking behind a leader.
    pub brake_mps2: f64,
    /// Hardest braking of the reference.
    pub brake_max_mps2: f64,
    /// Jerk of the reference.
    pub jerk_mps3: f64,
    /// Time gap to the leader beyond the safe headway.
    pub time_gap_s: f64,
    /// Gap beyond the safe headway at standstill.
    pub standstill_gap_m: f64,
    /// Duration of a lane change.
    pub lane_change_s: f64,
    /// Shortest length of a lane change.
    pub lane_change_min_m: f64,
    /// Lateral acceleration that a lane change and the road may take together.
    pub lateral_accel_mps2: f64,
    /// Speed round a stopped vehicle that is left from near standstill.
    pub leaving_speed_mps: f64,
    /// Share of the safe speed for curve and sight that is driven.
    pub speed_share: f64,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self {
            accel_mps2: 1.8,
            brake_mps2: 2.0,
            brake_max_mps2: 4.0,
            jerk_mps3: 6.0,
            time_gap_s: 0.2,
            standstill_gap_m: 0.5,
            lane_change_s: 4.0,
            lane_change_min_m: 12.0,
            lateral_accel_mps2: 3.4,
            leaving_speed_mps: 3.5,
            speed_share: 0.96,
        }
    }
}
