use std::time::Instant;

use covista_world::Action;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::learner::{Learner, Workspace};
use super::plan::Plan;
use super::{
    ActionSet, Algorithm, GLOBAL_FEATURES, Hyperparameters, LearningError, NEIGHBOUR_FEATURES,
    OWN_FEATURES, Options, Shape, Sharing, Situation, TrainingSettings,
};

/// What one agent's update costs.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct UpdateCost {
    /// What learns.
    pub algorithm: Algorithm,
    /// CAVs.
    pub agents: usize,
    /// Neighbours of each, K.
    pub neighbours: usize,
    /// Updates (critic, actor and targets) a second on one core, by the median.
    pub updates_per_s: f64,
    /// Median time of an update in milliseconds.
    pub median_ms: f64,
    /// What a critic reads in one transition at one instant, in bytes of f32.
    pub critic_input_bytes: usize,
    /// What a transition takes in the replay buffer, in bytes.
    pub transition_bytes: usize,
}

/// Measures `updates` updates of one agent among `agents`, with random transitions in which all
/// `neighbours` places are taken.
///
/// # Errors
/// When a hyperparameter makes no sense, there is no agent, or too many neighbours.
pub fn update_cost(
    algorithm: Algorithm,
    agents: usize,
    neighbours: usize,
    hyperparameters: Hyperparameters,
    updates: usize,
) -> Result<UpdateCost, LearningError> {
    let (mut learner, mut workspace, plan) =
        prepared(algorithm, agents, neighbours, hyperparameters)?;
    let mut times_ms = Vec::with_capacity(updates.max(1));
    learner.update(&mut workspace)?;
    for _ in 0..updates.max(1) {
        let start = Instant::now();
        learner.update(&mut workspace)?;
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times_ms.sort_by(f64::total_cmp);
    let median_ms = times_ms[times_ms.len() / 2];
    Ok(UpdateCost {
        algorithm,
        agents,
        neighbours,
        updates_per_s: 1e3 / median_ms,
        median_ms,
        critic_input_bytes: plan.critic.inputs_per_row(neighbours) * size_of::<f32>(),
        transition_bytes: learner.replay.bytes_per_transition(),
    })
}

/// A learner whose buffer is full of random transitions, what it writes to, and its sizes.
pub(super) fn prepared(
    algorithm: Algorithm,
    agents: usize,
    neighbours: usize,
    hyperparameters: Hyperparameters,
) -> Result<(Learner, Workspace, Plan), LearningError> {
    let hyperparameters = Hyperparameters {
        replay: 512.max(2 * hyperparameters.minibatch),
        warm_up: hyperparameters.minibatch,
        ..hyperparameters
    };
    hyperparameters.validate()?;
    let shape = Shape {
        agents,
        own: OWN_FEATURES,
        neighbours,
        neighbour: NEIGHBOUR_FEATURES,
        global: GLOBAL_FEATURES,
    };
    shape.validate()?;
    let settings = TrainingSettings {
        algorithm,
        sharing: Sharing::Independent,
        hyperparameters,
        seed: 0,
    };
    let plan = Plan::new(shape, &settings);
    let (mut learner, workspace) = (plan.learner(0), plan.workspace());
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut draw =
        |count| -> Vec<f32> { (0..count).map(|_| rng.random_range(-1.0..1.0)).collect() };
    let others = vec![None; neighbours];
    let mut before = None;
    for index in 0..hyperparameters.replay {
        let (own, around) = (draw(shape.own), draw(neighbours * shape.neighbour));
        let situation = Situation {
            own: &own,
            neighbours: &around,
            agents: &others,
            options: Options {
                legal: ActionSet::ALL,
                safe: ActionSet::ALL,
            },
        };
        let central = draw(plan.central_features());
        let frame = learner
            .replay
            .push(0, &situation, ActionSet::ALL, &central)?;
        let action = Action::ALL[index % Action::ALL.len()];
        let (told, joint) = (
            others.iter().map(|_| Some(action)),
            (1..agents).map(|_| action),
        );
        if algorithm.steers() {
            let input = [own[0], own[1]];
            let told = others.iter().map(|_| Some(input));
            learner.replay.decide(frame, input, told, [].into_iter());
        } else {
            learner.replay.decide(frame, action, told, joint);
        }
        if let Some(before) = before.replace(frame) {
            learner.replay.complete(0, before, own[0], Some(frame))?;
        }
    }
    Ok((learner, workspace, plan))
}
