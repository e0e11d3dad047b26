//! Cases and their figures as tables, diagrams and claims.

mod action_design;
mod by_density;
mod by_ratio;
mod headway;
mod scene;
mod training;
mod truncation;

use super::{
    Behaviour, Case, Diagram, Experiment, Figures, Key, Line, LoopCase, LoopFigures, Plan,
    Quantity, Results, Row, Spread, claims,
};
use crate::environment::BEHAVIOUR_S;

impl Plan {
    /// The table, the claims and the figures of the cases that have been driven; rows without a
    /// case are left out, and so are all claims while a case is missing.
    pub fn results(&self, driven: &[(Case, Figures)], is_complete: bool) -> Results {
        let mut results = match self.experiment {
            Experiment::CavRatio => by_ratio::cav_ratio(&loops(driven)),
            Experiment::Density => by_density::density(&loops(driven)),
            Experiment::Safety => by_density::safety(&loops(driven)),
            Experiment::Headway => headway::headway(&loops(driven)),
            Experiment::EpisodeReward => training::episode_reward(driven),
            Experiment::ActionDesign => action_design::action_design(&loops(driven)),
            Experiment::ObstacleAtCorner => scene::obstacle_at_corner(driven),
            Experiment::Truncation => truncation::truncation(driven),
        };
        if is_complete {
            results.claims = claims::of(self.experiment, &results.rows, driven);
        }
        results
    }
}

type Loops<'a> = Vec<(&'a LoopCase, &'a LoopFigures)>;

fn loops(driven: &[(Case, Figures)]) -> Loops<'_> {
    let of = driven
        .iter()
        .filter_map(|(case, figures)| match (case, figures) {
            (Case::Loop(case), Figures::Loop(figures)) => Some((case, figures.as_ref())),
            _ => None,
        });
    of.collect()
}

/// A quantity of some runs, with the paper's value.
fn quantity<'a, F: 'a>(
    (name, title, digits): (&'static str, &'static str, usize),
    runs: &[&'a F],
    value: impl Fn(&'a F) -> Option<f64>,
    paper: Option<f64>,
) -> Quantity {
    Quantity {
        name,
        title,
        spread: Spread::of(runs.iter().filter_map(|run| value(run))),
        paper,
        digits,
    }
}

fn algorithm(behaviour: Behaviour) -> (&'static str, Key) {
    ("algorithm", Key::Text(behaviour.name().to_owned()))
}

fn unsafe_actions(runs: &[&LoopFigures], paper: Option<f64>) -> Quantity {
    let count = |run: &LoopFigures| Some(run.tally.unsafe_actions as f64);
    quantity(("unsafe_actions", "unsafe actions", 1), runs, count, paper)
}

fn collisions(runs: &[&LoopFigures]) -> Quantity {
    let count = |run: &LoopFigures| Some(run.collisions as f64);
    quantity(("collisions", "collisions", 1), runs, count, None)
}

/// The mean over runs at each behaviour step.
fn over_time(label: &str, curves: &[&Vec<Option<f64>>]) -> Line {
    let longest = curves.iter().map(|curve| curve.len()).max().unwrap_or(0);
    let point = |step: usize| {
        let values = curves.iter().filter_map(|curve| *curve.get(step)?);
        let spread = Spread::of(values)?;
        Some([(step + 1) as f64 * BEHAVIOUR_S, spread.mean, spread.std])
    };
    line(label, (0..longest).filter_map(point).collect())
}

fn line(label: &str, points: Vec<[f64; 3]>) -> Line {
    Line {
        label: label.to_owned(),
        points,
    }
}

/// A diagram of one quantity over a key of the rows, a line for each algorithm.
fn by_key(rows: &[Row], title: &str, (key, x): (&str, &str), name: &str, y: &str) -> Diagram {
    let mut lines: Vec<Line> = Vec::new();
    for row in rows {
        let spread = row.get(name).and_then(|quantity| quantity.spread);
        let (Some(place), Some(spread)) = (row.number(key), spread) else {
            continue;
        };
        let label = row.text("algorithm").unwrap_or_default();
        let point = [place, spread.mean, spread.std];
        match lines.iter_mut().find(|line| line.label == label) {
            Some(known) => known.points.push(point),
            None => lines.push(line(label, vec![point])),
        }
    }
    Diagram {
        title: title.to_owned(),
        x: x.to_owned(),
        y: y.to_owned(),
        lines,
    }
}
