use super::{Loops, by_key, collisions, quantity, unsafe_actions};
use crate::{
    RingSafety,
    experiment::{
        Behaviour, Experiment, Key, LoopCase, LoopFigures, Quantity, Results, Row, paper,
        plan::densities,
    },
};

/// The runs of a behaviour at a density, those that explore or the others.
fn at_density<'a>(
    loops: &Loops<'a>,
    behaviour: Behaviour,
    explores: bool,
    density: f64,
) -> Vec<&'a LoopFigures> {
    let is_of = |case: &LoopCase| {
        case.behaviour == behaviour
            && case.explores == explores
            && (case.environment.ring.density - density).abs() < 1e-9
    };
    let runs = loops.iter().filter(|(case, _)| is_of(case));
    runs.map(|(_, figures)| *figures).collect()
}

/// A row for each behaviour and density of which there are runs, after them those that explore.
fn by_density(
    loops: &Loops<'_>,
    experiment: Experiment,
    quantities: impl Fn(Option<f64>, &[&LoopFigures]) -> Vec<Quantity>,
) -> Vec<Row> {
    let mut rows = Vec::new();
    for explores in [false, true] {
        for &behaviour in experiment.behaviours() {
            for (index, rho) in densities().enumerate() {
                let runs = at_density(loops, behaviour, explores, rho);
                if !runs.is_empty() {
                    let paper = paper_unsafe(behaviour, explores, index);
                    rows.push(Row {
                        keys: vec![driver(behaviour, explores), ("density", Key::Number(rho))],
                        seeds: runs.len(),
                        quantities: quantities(paper, &runs),
                    });
                }
            }
        }
    }
    rows
}

/// The paper counts in the last episodes of its training.
fn paper_unsafe(behaviour: Behaviour, explores: bool, index: usize) -> Option<f64> {
    explores.then(|| paper::unsafe_actions(behaviour, index))?
}

fn driver(behaviour: Behaviour, explores: bool) -> (&'static str, Key) {
    let exploring = if explores { ", exploring" } else { "" };
    let name = format!("{}{exploring}", behaviour.name());
    ("algorithm", Key::Text(name))
}

/// Flow and comfort by density.
pub(super) fn density(loops: &Loops<'_>) -> Results {
    let rows = by_density(loops, Experiment::Density, |_, runs| {
        vec![
            quantity(
                ("flow", "flow rho v, m/s", 3),
                runs,
                |run| Some(run.flow),
                None,
            ),
            quantity(
                ("flow_per_h_lane", "flow, vehicles/h lane", 0),
                runs,
                |run| Some(run.flow_per_h_lane),
                None,
            ),
            quantity(
                ("mean_velocity_mph", "velocity, mph", 2),
                runs,
                |run| Some(run.mean_velocity_mph),
                None,
            ),
            quantity(
                ("mean_comfort", "comfort", 3),
                runs,
                |run| Some(run.mean_comfort),
                None,
            ),
            unsafe_actions(runs, None),
            collisions(runs),
        ]
    });
    let diagram =
        |title: &str, name, y: &str| by_key(&rows, title, ("density", "density rho"), name, y);
    Results {
        diagrams: vec![
            diagram("Traffic flow", "flow_per_h_lane", "vehicles/h and lane"),
            diagram("Comfort of all traffic", "mean_comfort", "comfort, 0 to 3"),
        ],
        notes: vec![
            "idm is a loop of human drivers alone; the others have CAVs at a ratio of 0.6. Flow and comfort are of all vehicles. The paper shows these curves without numbers.".into(),
            "A collision does not end an episode here: vehicles drive on through each other, and each time that two bodies come to overlap counts.".into(),
        ],
        rows,
        claims: Vec::new(),
    }
}

/// Unsafe actions by density.
pub(super) fn safety(loops: &Loops<'_>) -> Results {
    let watched = |of: fn(&RingSafety) -> usize| {
        move |run: &LoopFigures| run.safety.as_ref().map(|safety| of(safety) as f64)
    };
    let rows = by_density(loops, Experiment::Safety, |paper_unsafe, runs| {
        vec![
            unsafe_actions(runs, paper_unsafe),
            quantity(
                ("decisions", "decisions", 0),
                runs,
                |run| Some(run.tally.decisions as f64),
                None,
            ),
            quantity(
                ("violations", "violations of h >= 0", 1),
                runs,
                watched(|safety| safety.violations),
                None,
            ),
            quantity(
                ("violations_unattributed", "unattributed", 1),
                runs,
                watched(|safety| safety.violations_unattributed),
                None,
            ),
            quantity(
                (
                    "unsafe_lane_changes",
                    "begun inside the set of collisions",
                    1,
                ),
                runs,
                watched(|safety| safety.unsafe_lane_changes),
                None,
            ),
            quantity(
                ("collision_set_left", "h_0 became negative", 1),
                runs,
                watched(|safety| safety.collision_set_left),
                None,
            ),
            quantity(
                ("emergency_stops", "emergency stops", 1),
                runs,
                |run| Some(run.tally.emergency_stops as f64),
                None,
            ),
            collisions(runs),
        ]
    });
    Results {
        diagrams: vec![by_key(
            &rows,
            "Unsafe actions of an episode",
            ("density", "density rho"),
            "unsafe_actions",
            "decisions",
        )],
        notes: vec![
            "An action is unsafe when the filter's verdict on it, at the moment of the decision, is unsafe. Counts are of one episode. Those who explore take a random action in place of their own as often as at the end of their training, ours a safe one: the paper's counts are of the last ten episodes of its training, each of up to 40,000 steps.".into(),
        ],
        rows,
        claims: Vec::new(),
    }
}
