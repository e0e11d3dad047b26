use super::{Loops, algorithm, collisions, line, quantity};
use crate::{
    RingMotion,
    experiment::{Diagram, Experiment, LoopFigures, Results, Row},
};

/// How smoothly the CAVs drive.
pub(super) fn action_design(loops: &Loops<'_>) -> Results {
    let (mut rows, mut traces) = (Vec::new(), Vec::new());
    for &behaviour in Experiment::ActionDesign.behaviours() {
        let runs: Vec<_> = (loops.iter())
            .filter(|(case, _)| case.behaviour == behaviour)
            .map(|(_, figures)| *figures)
            .collect();
        let Some(first) = runs.first() else {
            continue;
        };
        let smoothness = |name, title, digits, of: fn(&RingMotion) -> f64| {
            let value = |run: &LoopFigures| run.motion.as_ref().map(of);
            quantity((name, title, digits), &runs, value, None)
        };
        rows.push(Row {
            keys: vec![algorithm(behaviour)],
            seeds: runs.len(),
            quantities: vec![
                smoothness(
                    "lateral_accel_rms_mps2",
                    "lateral acceleration RMS, m/s2",
                    3,
                    |m| m.lateral_accel_rms_mps2,
                ),
                smoothness("lateral_accel_p99_mps2", "p99", 2, |m| {
                    m.lateral_accel_p99_mps2
                }),
                smoothness("lateral_jerk_rms_mps3", "lateral jerk RMS, m/s3", 3, |m| {
                    m.lateral_jerk_rms_mps3
                }),
                smoothness("lateral_jerk_p99_mps3", "p99", 2, |m| {
                    m.lateral_jerk_p99_mps3
                }),
                smoothness("heading_rms_deg", "heading RMS, deg", 3, |m| {
                    m.heading_rms_deg
                }),
                smoothness(
                    "heading_rate_rms_degps",
                    "heading rate RMS, deg/s",
                    3,
                    |m| m.heading_rate_rms_degps,
                ),
                smoothness(
                    "steering_reversals_per_km",
                    "steering reversals a km",
                    1,
                    |m| m.steering_reversals_per_km,
                ),
                smoothness("lateral_way_m_per_km", "way to the side, m a km", 1, |m| {
                    m.lateral_way_m_per_km
                }),
                smoothness("lane_changes_per_km", "lane changes a km", 2, |m| {
                    m.lane_changes_per_km
                }),
                quantity(
                    ("time_s", "driven, s", 1),
                    &runs,
                    |run| Some(run.time_s),
                    None,
                ),
                quantity(
                    ("cav_mean_velocity_mps", "velocity of CAVs, m/s", 2),
                    &runs,
                    |run| run.cav_mean_velocity_mps,
                    None,
                ),
                quantity(
                    ("cav_mean_comfort", "their comfort", 3),
                    &runs,
                    |run| run.cav_mean_comfort,
                    None,
                ),
                quantity(
                    ("filtered_share", "steps filtered, %", 1),
                    &runs,
                    |run| {
                        let steps = run.tally.control_steps.max(1);
                        Some(100.0 * run.tally.filtered_steps as f64 / steps as f64)
                    },
                    None,
                ),
                collisions(&runs),
                quantity(
                    ("violations", "violations of h >= 0", 1),
                    &runs,
                    |run| run.safety.as_ref().map(|safety| safety.violations as f64),
                    None,
                ),
                quantity(
                    ("violations_unattributed", "unattributed", 1),
                    &runs,
                    |run| {
                        let safety = run.safety.as_ref();
                        safety.map(|safety| safety.violations_unattributed as f64)
                    },
                    None,
                ),
            ],
        });
        if let Some(motion) = &first.motion {
            traces.push(trace(behaviour.name(), motion));
        }
    }
    Results {
        diagrams: traces,
        notes: vec![
            "Of the CAVs, relative to the line along the road, as means over 0.1 s. A steering reversal is a turn back by more than 2 degrees at the steering wheel (ratio 15). The way to the side is less the width of the lanes that were changed.".into(),
            "The picture has the first kilometre of the CAV that moved most to the side, with the first seed. Lanes are 3.5 m wide.".into(),
            "Without the filter an episode ends where a CAV leaves the road or touches another vehicle.".into(),
            "Comfort is the paper's: the end-to-end variant has no lane changes to announce, so that standing on a line counts as one.".into(),
        ],
        rows,
        claims: Vec::new(),
    }
}

/// The offset of one CAV among the lines of the lanes, which give all panels the same scale.
fn trace(label: &str, motion: &RingMotion) -> Diagram {
    let driven = motion.trace.iter().map(|&[s_m, d_m]| [s_m, d_m, 0.0]);
    let lane_line = |&d_m: &f64| {
        let along = motion.trace.iter().map(|&[s_m, _]| [s_m, d_m, 0.0]);
        line("lines of the lanes and edges of the road", along.collect())
    };
    let mut lines = vec![line(label, driven.collect())];
    lines.extend(motion.lane_lines_m.iter().map(lane_line));
    Diagram {
        title: format!("Course of one CAV, {label}"),
        x: "way in m".to_owned(),
        y: "offset to the left in m".to_owned(),
        lines,
    }
}
