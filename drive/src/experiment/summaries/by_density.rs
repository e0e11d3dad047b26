use super::{Loops, by_key, collisions, quantity, unsafe_actions};
use crate::{
    RingSafety,
    experiment::{
        Behaviour, Experiment, Key, LoopCase, LoopFigures, Quantity, Results, Row, paper,
        plan::densities,
    },
};

/// Who drives, and whether while exploring.
#[derive(Clone, Copy)]
struct Driver {
    behaviour: Behaviour,
    explores: bool,
}

impl Driver {
    fn key(self) -> (&'static str, Key) {
        let exploring = if self.explores { ", exploring" } else { "" };
        let name = format!("{}{exploring}", self.behaviour.name());
        ("algorithm", Key::Text(name))
    }

    /// The paper counts in the last episodes of its training.
    fn paper_unsafe_actions(self, index: usize) -> Option<f64> {
        paper::unsafe_actions(self.behaviour, index).filter(|_| self.explores)
    }
}

/// The runs of a driver at a density.
fn at_density<'a>(loops: &Loops<'a>, driver: Driver, density: f64) -> Vec<&'a LoopFigures> {
    let is_of = |case: &LoopCase| {
        case.behaviour == driver.behaviour
            && case.explores == driver.explores
            && (case.environment.ring.density - density).abs() < 1e-9
    };
    let runs = loops.iter().filter(|(case, _)| is_of(case));
    runs.map(|(_, figures)| *figures).collect()
}

/// A row for each behaviour and density of which there are runs, after them those that explore.
fn by_density(
    loops: &Loops<'_>,
    experiment: Experiment,
    quantities: impl Fn(Driver, usize, &[&LoopFigures]) -> Vec<Quantity>,
) -> Vec<Row> {
    let mut rows = Vec::new();
    let drivers = [false, true].into_iter().flat_map(|explores| {
        let behaviours = experiment.behaviours().iter();
        behaviours.map(move |&behaviour| Driver {
            behaviour,
            explores,
        })
    });
    for driver in drivers {
        for (index, rho) in densities().enumerate() {
            let runs = at_density(loops, driver, rho);
            if !runs.is_empty() {
                rows.push(Row {
                    keys: vec![driver.key(), ("density", Key::Number(rho))],
                    seeds: runs.len(),
                    quantities: quantities(driver, index, &runs),
                });
            }
        }
    }
    rows
}

/// Flow and comfort by density.
pub(super) fn density(loops: &Loops<'_>) -> Results {
    let rows = by_density(loops, Experiment::Density, |_, _, runs| {
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
    let rows = by_density(loops, Experiment::Safety, |driver, index, runs| {
        vec![
            unsafe_actions(runs, driver.paper_unsafe_actions(index)),
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
            "An action is unsafe when the filter's verdict on it, at the moment of the decision, is unsafe. Counts are of one episode. Those who explore take a random action in place of their own as often as the settings of their training end with (5 % of the time), ours a safe one: the paper's counts are of the last ten episodes of its training, each of up to 40,000 steps.".into(),
        ],
        rows,
        claims: Vec::new(),
    }
}
