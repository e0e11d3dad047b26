use std::collections::BTreeMap;

use serde::Serialize;

/// One vehicle's way through the obstacle-at-corner scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CavSummary {
    /// Station id.
    pub id: u32,
    /// Lane at the start, 0 the leftmost.
    pub initial_lane: u8,
    /// When it first had line of sight to an obstacle, in seconds; `None` if never.
    pub first_line_of_sight_s: Option<f64>,
    /// When its first lane change began, in seconds; `None` if never.
    pub lane_change_start_s: Option<f64>,
    /// Hardest braking in m/s^2, as a positive number.
    pub hardest_braking_mps2: f64,
    /// Smallest headway between reference points to a vehicle ahead in its lane, in metres.
    pub min_headway_m: Option<f64>,
}

/// Wall time of each stage, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct StageWallTimes {
    /// Ray casting of LIDAR and camera.
    pub sensors_s: f64,
    /// Lane network and detector, with their pre- and post-processing, and fusion.
    pub perception_s: f64,
    /// Tracking and messages.
    pub sharing_s: f64,
    /// Policy and safe action mapping.
    pub planner_s: f64,
    /// References, QP, validation.
    pub control_s: f64,
    /// Plant step and human drivers.
    pub traffic_s: f64,
    /// Monitor on the truth, trace and recording.
    pub record_s: f64,
}

/// What one run shows, computed on the truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunSummary {
    /// Whether the CAVs shared what they saw.
    pub sharing: bool,
    /// Simulated time in seconds.
    pub duration_s: f64,
    /// Mean speed over all moving vehicles (CAVs and humans) and all time, in m/s.
    pub mean_velocity_mps: f64,
    /// Mean of the paper's comfort (Section V-A) over CAVs and behaviour steps, 0 to 3.
    pub mean_comfort: f64,
    /// CAVs and humans that were slower than 0.5 m/s for 5 s on end.
    pub vehicles_stuck: usize,
    /// CAVs of an obstacle's lane whose first lane change began before their own line of sight to
    /// an obstacle.
    pub lane_changes_before_sight: usize,
    /// Lane changes that CAVs began, all together.
    pub lane_changes: usize,
    /// What the CAVs drove, together, in km.
    pub cav_km: f64,
    /// Mean speed of the CAVs in m/s.
    pub cav_mean_velocity_mps: f64,
    /// Lane changes that CAVs began, by the kilometre.
    pub lane_changes_per_km: f64,
    /// Emergency stops of CAVs, by the kilometre.
    pub emergency_stops_per_km: f64,
    /// Share of the CAVs' behaviour steps at which the safe action mapping did not take the action
    /// that the policy valued highest.
    pub actions_overruled_share: f64,
    /// The CAVs, by station id.
    pub vehicles: Vec<CavSummary>,
    /// Pairs of bodies that overlapped at any time.
    pub collisions: usize,
    /// Lane changes that began inside the collision set of the truth.
    pub unsafe_actions: usize,
    /// Times a CAV left the safe set (h < 0 on the truth), excused and attributed ones included.
    pub violations: usize,
    /// Times a CAV left the collision set (h_0 < 0 on the truth), whatever the cause.
    pub collision_set_left: usize,
    /// Violations that no broken assumption explains.
    pub violations_unattributed: usize,
    /// Violations by the assumption that broke.
    pub violations_by_cause: BTreeMap<String, usize>,
    /// Share of the CAVs' time on which their smallest h was negative on the truth, by its cause.
    pub excused_share: BTreeMap<String, f64>,
    /// Gaps to a follower that a CAV lost after a lane change, by cause. They are not promised.
    pub rear_gaps_lost_by_cause: BTreeMap<String, usize>,
    /// Time to collision that a hundredth of the steps of CAVs that close in on the vehicle ahead
    /// lie at or below, in seconds.
    pub ttc_p1_s: Option<f64>,
    /// The same for a twentieth.
    pub ttc_p5_s: Option<f64>,
    /// The same for half.
    pub ttc_p50_s: Option<f64>,
    /// Share of the CAVs' time with a time to collision below 1.5 s.
    pub ttc_below_1_5_s_share: f64,
    /// |jerk| of CAVs that half of their time lies at or below, in m/s^3; of means over 0.1 s.
    pub jerk_p50_mps3: Option<f64>,
    /// The same for 95 %.
    pub jerk_p95_mps3: Option<f64>,
    /// The same for 99 %.
    pub jerk_p99_mps3: Option<f64>,
    /// Share of the CAVs' time with |jerk| of 10 m/s^3 or more.
    pub jerk_above_10_share: f64,
    /// Smallest headway of a CAV between reference points, in metres.
    pub min_headway_m: Option<f64>,
    /// Hardest braking of a CAV in m/s^2, as a positive number.
    pub hardest_braking_mps2: f64,
    /// Steps of 0.01 s, summed over CAVs, on which the QP needed slack.
    pub relaxed_steps: usize,
    /// Steps of 0.01 s, summed over CAVs, on which the controller fell back to hardest braking.
    pub backup_steps: usize,
    /// Behaviour steps on which no action was safe.
    pub emergency_stop_steps: usize,
    /// Emergency stops: such steps of one CAV in a row count as one.
    pub emergency_stops: usize,
    /// Camera and LIDAR frames that went through perception.
    pub frames_perceived: usize,
    /// Bytes of the messages that were broadcast, each counted once.
    pub bytes_shared: usize,
    /// Wall time of the run in seconds.
    pub wall_s: f64,
    /// Wall time of each stage.
    pub stages: StageWallTimes,
    /// File name of the recording, beside the summary.
    pub rrd: String,
}
