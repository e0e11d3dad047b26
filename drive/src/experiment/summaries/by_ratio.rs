use super::{Loops, algorithm, by_key, collisions, quantity, unsafe_actions};
use crate::experiment::{Behaviour, Experiment, Key, LoopCase, Results, Row, paper};

/// Velocity and comfort of all traffic by the share of CAVs.
pub(super) fn cav_ratio(loops: &Loops<'_>) -> Results {
    let mut rows = Vec::new();
    for &behaviour in Experiment::CavRatio.behaviours() {
        for index in 0..=6 {
            let cavs = 5 * index;
            // Without CAVs there is nobody to behave in one way or the other.
            let by = if cavs == 0 { Behaviour::Idm } else { behaviour };
            let is_of =
                |case: &LoopCase| case.behaviour == by && case.environment.ring.cavs == cavs;
            let runs: Vec<_> = loops.iter().filter(|(case, _)| is_of(case)).collect();
            let Some(vehicles) = runs.first().map(|(case, _)| case.environment.ring.vehicles)
            else {
                continue;
            };
            let runs: Vec<_> = runs.iter().map(|(_, figures)| *figures).collect();
            let papers = paper::by_ratio(behaviour, index);
            let ratio = cavs as f64 / vehicles as f64;
            rows.push(Row {
                keys: vec![
                    algorithm(behaviour),
                    ("cav_ratio", Key::Number((100.0 * ratio).round() / 100.0)),
                    ("cavs", Key::Number(cavs as f64)),
                ],
                seeds: runs.len(),
                quantities: vec![
                    quantity(
                        ("mean_velocity_mph", "velocity, mph", 2),
                        &runs,
                        |run| Some(run.mean_velocity_mph),
                        papers.map(|[velocity, _]| velocity),
                    ),
                    quantity(
                        ("mean_comfort", "comfort", 3),
                        &runs,
                        |run| Some(run.mean_comfort),
                        papers.map(|[_, comfort]| comfort),
                    ),
                    unsafe_actions(&runs, None),
                    collisions(&runs),
                ],
            });
        }
    }
    let diagram =
        |title: &str, name, y: &str| by_key(&rows, title, ("cav_ratio", "CAV ratio"), name, y);
    Results {
        diagrams: vec![
            diagram("Velocity of all traffic", "mean_velocity_mph", "mph"),
            diagram("Comfort of all traffic", "mean_comfort", "comfort, 0 to 3"),
        ],
        notes: vec![
            "Velocity and comfort are means over all vehicles, CAVs and humans, and all steps.".into(),
            "Without CAVs all rows are the same runs, of human drivers alone. The paper's vehicles drive about 60 mph on its road; ours have the speed limit and the desired speeds of the settings, so the course counts, not the size.".into(),
        ],
        rows,
        claims: Vec::new(),
    }
}
