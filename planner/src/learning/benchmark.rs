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

/// The sizes of one agent's update.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct UpdateSizes {
    /// Transitions of a minibatch.
    pub minibatch: usize,
    /// Own features.
    pub own: usize,
    /// Neighbours of each transition, K.
    pub neighbours: usize,
    /// Features of a neighbour.
    pub neighbour: usize,
    /// Units of the LSTM and of the hidden layer.
    pub hidden: usize,
}

/// One agent's learner under the clock, its buffer full of random transitions in which the places
/// of all neighbours are taken.
pub struct TimedLearner {
    learner: Learner,
    workspace: Workspace,
    plan: Plan,
    sizes: UpdateSizes,
}

impl TimedLearner {
    /// A learner of one among `agents`, with `neighbours` neighbours each.
    ///
    /// # Errors
    /// When a hyperparameter makes no sense, there is no agent, or too many neighbours.
    pub fn new(
        algorithm: Algorithm,
        agents: usize,
        neighbours: usize,
        hyperparameters: Hyperparameters,
    ) -> Result<Self, LearningError> {
        let (learner, workspace, plan) = prepared(algorithm, agents, neighbours, hyperparameters)?;
        Ok(Self {
            sizes: UpdateSizes {
                minibatch: hyperparameters.minibatch,
                own: OWN_FEATURES,
                neighbours,
                neighbour: NEIGHBOUR_FEATURES,
                hidden: hyperparameters.hidden,
            },
            learner,
            workspace,
            plan,
        })
    }

    /// What an equal update elsewhere is made of.
    pub fn sizes(&self) -> UpdateSizes {
        self.sizes
    }

    /// Makes `updates` updates and tells the seconds of each.
    ///
    /// # Errors
    /// When a network diverges.
    pub fn time(&mut self, updates: usize) -> Result<Vec<f64>, LearningError> {
        let mut times_s = Vec::with_capacity(updates);
        for _ in 0..updates {
            let start = Instant::now();
            self.learner.update(&mut self.workspace)?;
            times_s.push(start.elapsed().as_secs_f64());
        }
        Ok(times_s)
    }
}

/// Measures `updates` updates of one agent among `agents`, after one that does not count.
///
/// # Errors
/// Those of [`TimedLearner`].
pub fn update_cost(
    algorithm: Algorithm,
    agents: usize,
    neighbours: usize,
    hyperparameters: Hyperparameters,
    updates: usize,
) -> Result<UpdateCost, LearningError> {
    let mut timed = TimedLearner::new(algorithm, agents, neighbours, hyperparameters)?;
    timed.time(1)?;
    let mut times_s = timed.time(updates.max(1))?;
    times_s.sort_by(f64::total_cmp);
    let median_s = times_s[times_s.len() / 2];
    let TimedLearner { learner, plan, .. } = timed;
    Ok(UpdateCost {
        algorithm,
        agents,
        neighbours,
        updates_per_s: 1.0 / median_s,
        median_ms: 1e3 * median_s,
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
        ..TrainingSettings::default()
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
