use super::{line, quantity};
use crate::experiment::{Case, Diagram, Figures, Key, Line, Results, Row, SceneFigures};

/// A scenario with and without shared vision.
pub(super) fn obstacle_at_corner(driven: &[(Case, Figures)]) -> Results {
    let mut rows = Vec::new();
    for sharing in [true, false] {
        let runs: Vec<_> = runs(driven, sharing).collect();
        if runs.is_empty() {
            continue;
        }
        let of =
            |named, value: fn(&SceneFigures) -> Option<f64>| quantity(named, &runs, value, None);
        rows.push(Row {
            keys: vec![(
                "sharing",
                Key::Text(if sharing { "on" } else { "off" }.to_owned()),
            )],
            seeds: runs.len(),
            quantities: vec![
                of(("vehicles_stuck", "stuck", 1), |run| {
                    Some(run.vehicles_stuck as f64)
                }),
                of(("delay_s", "delay, s", 2), |run| Some(run.delay_s)),
                of(
                    ("blocked_delay_s", "delay behind the obstacle, s", 2),
                    |run| run.blocked_delay_s,
                ),
                of(("mean_velocity_mps", "velocity, m/s", 2), |run| {
                    Some(run.mean_velocity_mps)
                }),
                of(("mean_comfort", "comfort", 2), |run| Some(run.mean_comfort)),
                of(
                    ("change_before_obstacle_m", "change before obstacle, m", 1),
                    |run| run.change_before_obstacle_m,
                ),
                of(("changed_before_sight", "before own sight", 1), |run| {
                    Some(run.changed_before_sight as f64)
                }),
                of(("unsafe_actions", "unsafe actions", 1), |run| {
                    Some(run.unsafe_actions as f64)
                }),
                of(("violations_unattributed", "unattributed", 1), |run| {
                    Some(run.violations_unattributed as f64)
                }),
            ],
        });
    }
    let diagram = |title: &str, y: &str, value: fn(&SceneFigures) -> Option<f64>| Diagram {
        title: title.to_owned(),
        x: "seed, counted from the first".to_owned(),
        y: y.to_owned(),
        lines: [true, false]
            .into_iter()
            .map(|sharing| by_seed(driven, sharing, value))
            .collect(),
    };
    Results {
        diagrams: vec![
            diagram("Vehicles stuck", "vehicles", |run| Some(run.vehicles_stuck as f64)),
            diagram("Delay behind the obstacle", "s", |run| run.blocked_delay_s),
        ],
        notes: vec![
            "Delay is the time of the run less what the way took at the desired speed, mean over all moving vehicles, and over the CAVs that began in the obstacles' lane; curves and others ahead cost some in both rows. A lane change counts for how far before the nearest obstacle of its lane it began.".into(),
        ],
        rows,
        claims: Vec::new(),
    }
}

/// The runs with or without sharing, in the order of their seeds.
fn runs(driven: &[(Case, Figures)], sharing: bool) -> impl Iterator<Item = &SceneFigures> {
    driven
        .iter()
        .filter_map(move |(case, figures)| match (case, figures) {
            (Case::Scene(case), Figures::Scene(figures)) => {
                (case.sharing == sharing).then_some(figures)
            }
            _ => None,
        })
}

fn by_seed(
    driven: &[(Case, Figures)],
    sharing: bool,
    value: fn(&SceneFigures) -> Option<f64>,
) -> Line {
    let points = runs(driven, sharing).enumerate();
    let points = points.filter_map(|(index, run)| Some([(index + 1) as f64, value(run)?, 0.0]));
    line(
        if sharing { "sharing on" } else { "sharing off" },
        points.collect(),
    )
}
