use super::{algorithm, over_time, quantity};
use crate::{
    environment::BEHAVIOUR_S,
    experiment::{
        Behaviour, Case, Diagram, Experiment, Figures, LearningCurve, Results, Row, Spread, paper,
    },
};

/// Rounds at the end of a training whose mean reward is told.
const LAST_ROUNDS: usize = 10;

/// Rewards over the training.
pub(super) fn episode_reward(driven: &[(Case, Figures)]) -> Results {
    let mut rows = Vec::new();
    let mut diagrams = Vec::new();
    for &behaviour in Experiment::EpisodeReward.behaviours() {
        let curves: Vec<&LearningCurve> = (driven.iter())
            .filter_map(|(case, figures)| match (case, figures) {
                (Case::Training(case), Figures::Training(curve)) => {
                    let of = Behaviour::of(case.config.training.algorithm);
                    (of == behaviour).then_some(curve)
                }
                _ => None,
            })
            .collect();
        if curves.is_empty() {
            continue;
        }
        let [paper_largest, paper_round] = paper::largest_reward(behaviour);
        let last = |curve: &LearningCurve| {
            let from = curve.reward.len().saturating_sub(LAST_ROUNDS);
            Spread::of(curve.reward[from..].iter().copied()).map(|spread| spread.mean)
        };
        let all_unsafe =
            |curve: &LearningCurve| Some(curve.unsafe_actions.iter().sum::<u64>() as f64);
        let all_unattributed = |curve: &LearningCurve| {
            let seen: Option<usize> = curve.unattributed.iter().copied().sum();
            Some(seen? as f64)
        };
        rows.push(Row {
            keys: vec![algorithm(behaviour)],
            seeds: curves.len(),
            quantities: vec![
                quantity(
                    ("largest_reward", "largest reward", 1),
                    &curves,
                    |curve| Some(largest(curve)?.1),
                    paper_largest,
                ),
                quantity(
                    ("largest_in_round", "in round", 0),
                    &curves,
                    |curve| Some((largest(curve)?.0 + 1) as f64),
                    paper_round,
                ),
                quantity(
                    ("last_reward", "mean of the last ten", 1),
                    &curves,
                    last,
                    None,
                ),
                quantity(
                    ("unsafe_actions_training", "unsafe actions in training", 0),
                    &curves,
                    all_unsafe,
                    None,
                ),
                quantity(
                    (
                        "violations_unattributed_training",
                        "violations without a cause in training",
                        0,
                    ),
                    &curves,
                    all_unattributed,
                    None,
                ),
            ],
        });
        let rewards: Vec<Vec<Option<f64>>> = (curves.iter())
            .map(|curve| curve.reward.iter().copied().map(Some).collect())
            .collect();
        let mut line = over_time(behaviour.name(), &rewards.iter().collect::<Vec<_>>());
        line.points.iter_mut().for_each(|[x, ..]| *x /= BEHAVIOUR_S);
        diagrams.push(Diagram {
            title: behaviour.name().to_owned(),
            x: "round".to_owned(),
            y: "reward of an episode, a CAV".to_owned(),
            lines: vec![line],
        });
    }
    Results {
        rows,
        diagrams,
        notes: vec![
            "The total reward of an episode, mean over the CAVs, with exploration. A collision ends an episode. Sizes depend on the episode's length and on the weight of speed; the paper's are of another scale.".into(),
        ],
        claims: Vec::new(),
    }
}

fn largest(curve: &LearningCurve) -> Option<(usize, f64)> {
    let rounds = curve.reward.iter().copied().enumerate();
    rounds.reduce(|best, round| if round.1 > best.1 { round } else { best })
}
