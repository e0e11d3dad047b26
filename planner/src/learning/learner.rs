mod steering;

use covista_world::Action;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::batch::BatchShape;
use super::exploration::Exploration;
use super::input_shares::INPUTS;
use super::network::{Buffers, Network};
use super::nn::{Adam, clip_to_norm, norm, soft_update};
use super::policy_distribution::{mapped_best, mapped_distribution, objective_gradient};
use super::replay::{Minibatch, ReplayBuffer};
use super::{ACTIONS, CHOICES, Hyperparameters, InputShares, LearningError, Situation};

/// A network with its target and its optimiser.
#[derive(Debug, Clone)]
pub(super) struct Learnt {
    pub network: Network,
    pub weights: Vec<f32>,
    pub target: Vec<f32>,
    pub adam: Adam,
}

impl Learnt {
    fn new(network: Network, rng: &mut impl Rng) -> Self {
        let weights = network.initialise(rng);
        Self {
            target: weights.clone(),
            adam: Adam::new(weights.len()),
            network,
            weights,
        }
    }

    /// All its numbers, by name.
    pub fn parts(&self) -> [(&'static str, &[f32]); 4] {
        [
            ("weights", &self.weights),
            ("target", &self.target),
            ("mean", &self.adam.mean),
            ("square", &self.adam.square),
        ]
    }

    /// One step of Adam along `gradient`, shortened where the settings say so; then the target
    /// follows. False, with nothing changed, where the gradient is not finite.
    fn step(&mut self, settings: &Hyperparameters, rate: f32, gradient: &mut [f32]) -> bool {
        let length = match settings.gradient_norm {
            Some(limit) => clip_to_norm(gradient, limit),
            None => norm(gradient),
        };
        if !length.is_finite() {
            return false;
        }
        self.adam
            .step(&settings.adam, rate, &mut self.weights, gradient);
        soft_update(&mut self.target, &self.weights, settings.target_rate);
        true
    }
}

/// What one update found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Losses {
    /// Mean squared error of the critic against its targets.
    pub critic: f32,
    /// Mean value of the actor's mapped distribution, by the critic.
    pub value: f32,
}

/// One agent's critic and actor, or those that all share.
pub(super) struct Learner {
    pub index: usize,
    pub actor: Learnt,
    pub critic: Learnt,
    pub replay: ReplayBuffer,
    pub updates: u64,
    pub decisions: u64,
    settings: Hyperparameters,
    draws: ChaCha8Rng,
    exploration: Exploration,
    /// What exploration adds to each control input, and for how many decisions more.
    noise: Vec<(u32, InputShares)>,
}

/// What an update writes; any learner of the same sizes may use it.
#[derive(Debug)]
pub(super) struct Workspace {
    pub minibatch: Minibatch,
    actor: Buffers,
    critic: Buffers,
    actor_gradient: Vec<f32>,
    critic_gradient: Vec<f32>,
    shares: Vec<[f32; ACTIONS]>,
    targets: Vec<f32>,
    logits_gradient: Vec<f32>,
    values_gradient: Vec<f32>,
    slopes: Vec<f32>,
}

impl Workspace {
    pub fn new(actor: &Network, critic: &Network, shape: BatchShape) -> Self {
        Self {
            minibatch: Minibatch::new(shape),
            actor: Buffers::new(actor, shape),
            critic: Buffers::new(critic, shape),
            actor_gradient: vec![0.0; actor.len()],
            critic_gradient: vec![0.0; critic.len()],
            shares: vec![[0.0; ACTIONS]; shape.rows],
            targets: vec![0.0; shape.rows],
            logits_gradient: vec![0.0; shape.rows * CHOICES],
            values_gradient: vec![0.0; shape.rows * ACTIONS],
            slopes: vec![0.0; shape.rows * INPUTS],
        }
    }
}

impl Learner {
    pub fn new(
        index: usize,
        actor: Network,
        critic: Network,
        replay: ReplayBuffer,
        settings: Hyperparameters,
        seed: u64,
    ) -> Self {
        let mut draws = ChaCha8Rng::seed_from_u64(seed);
        draws.set_stream(index as u64);
        Self {
            index,
            actor: Learnt::new(actor, &mut draws),
            critic: Learnt::new(critic, &mut draws),
            replay,
            updates: 0,
            decisions: 0,
            exploration: Exploration::after(0, &settings),
            settings,
            draws,
            noise: Vec::new(),
        }
    }

    /// Begins a new stretch of random numbers: what follows depends on the seed and the stretch
    /// only.
    pub fn reseed(&mut self, seed: u64) {
        self.draws = ChaCha8Rng::seed_from_u64(seed);
        self.draws.set_stream(self.index as u64);
        self.exploration.stop();
        self.noise.iter_mut().for_each(|(left, _)| *left = 0);
    }

    /// Decides for each situation, exploring or not: epsilon-greedy within the options that it is
    /// given as safe.
    pub fn act<'s>(
        &mut self,
        situation: impl Fn(usize) -> Situation<'s>,
        explores: bool,
        workspace: &mut Workspace,
        actions: &mut [Action],
    ) {
        if explores {
            self.exploration.fade(self.decisions, &self.settings);
        }
        let most = workspace.minibatch.now.shape().rows;
        let batch = &mut workspace.minibatch.now;
        for (chunk, actions) in actions.chunks_mut(most).enumerate() {
            let of = |item: usize| situation(chunk * most + item);
            batch.write_all(actions.len(), of);
            let logits =
                self.actor
                    .network
                    .forward(&self.actor.weights, batch, &mut workspace.actor);
            for (row, logits) in logits.chunks_exact(CHOICES).enumerate() {
                let item = batch.order[row];
                let safe = batch.safe[row];
                let best = mapped_best(logits, safe);
                actions[item] = if explores {
                    let agent = chunk * most + item;
                    (self.exploration).choose(agent, best, safe, &mut self.draws)
                } else {
                    best
                };
            }
        }
        if explores {
            self.decisions += 1;
        }
    }

    /// One round of Alg. 2 on a minibatch: the critic towards y, the actor up the critic's values,
    /// the targets after them. `None` while there is too little to draw from.
    ///
    /// The critic's values are read once, before its step, for both networks.
    pub fn update(&mut self, workspace: &mut Workspace) -> Result<Option<Losses>, LearningError> {
        if self.replay.len() < self.settings.warm_up {
            return Ok(None);
        }
        self.replay
            .sample(&mut self.draws, &mut workspace.minibatch);
        if self.critic.network.reads_input() {
            return self.update_steering(workspace).map(Some);
        }
        self.write_targets(workspace);

        let Workspace {
            minibatch,
            actor: actor_buffers,
            critic: critic_buffers,
            actor_gradient,
            critic_gradient,
            targets,
            logits_gradient,
            values_gradient,
            ..
        } = workspace;
        let now = &minibatch.now;
        let scale = 1.0 / now.rows() as f32;
        let mut losses = Losses::default();

        let Self { actor, critic, .. } = self;
        let logits = actor.network.forward(&actor.weights, now, actor_buffers);
        let values = critic.network.forward(&critic.weights, now, critic_buffers);
        values_gradient.fill(0.0);
        for (row, (logits, values)) in logits
            .chunks_exact(CHOICES)
            .zip(values.chunks_exact(ACTIONS))
            .enumerate()
        {
            let place = usize::from(minibatch.action[row]);
            let error = values[place] - targets[row];
            losses.critic += scale * error * error;
            values_gradient[row * ACTIONS + place] = 2.0 * scale * error;

            let shares = mapped_distribution(logits, now.safe[row]);
            losses.value += scale * shares.iter().zip(values).map(|(p, q)| p * q).sum::<f32>();
            let uphill = objective_gradient(&shares, values, self.settings.entropy_weight);
            for (to, slope) in logits_gradient[row * CHOICES..].iter_mut().zip(uphill) {
                *to = -scale * slope;
            }
        }
        critic_gradient.fill(0.0);
        critic.network.backward(
            &critic.weights,
            now,
            critic_buffers,
            values_gradient,
            critic_gradient,
        );
        actor_gradient.fill(0.0);
        actor.network.backward(
            &actor.weights,
            now,
            actor_buffers,
            logits_gradient,
            actor_gradient,
        );
        self.step(losses, workspace).map(Some)
    }

    /// Steps both networks along their gradients, and the targets after them.
    fn step(&mut self, losses: Losses, workspace: &mut Workspace) -> Result<Losses, LearningError> {
        let Self { actor, critic, .. } = self;
        let diverged = |network| LearningError::Diverged {
            learner: self.index,
            network,
            updates: self.updates,
        };
        if !losses.critic.is_finite() {
            return Err(diverged("critic"));
        }
        let settings = &self.settings;
        let gradient = &mut workspace.critic_gradient;
        if !critic.step(settings, settings.critic_learning_rate, gradient) {
            return Err(diverged("critic"));
        }
        let gradient = &mut workspace.actor_gradient;
        if !actor.step(settings, settings.actor_learning_rate, gradient) {
            return Err(diverged("actor"));
        }
        self.updates += 1;
        Ok(losses)
    }

    /// y = r + gamma Q'(s', Phi(pi'(s')), a'^N), the expectation over Phi(pi').
    fn write_targets(&self, workspace: &mut Workspace) {
        let minibatch = &workspace.minibatch;
        let (actor, critic) = (&self.actor, &self.critic);
        let next = &minibatch.next;
        let logits = actor
            .network
            .forward(&actor.target, next, &mut workspace.actor);
        for (row, logits) in logits.chunks_exact(CHOICES).enumerate() {
            workspace.shares[row] = mapped_distribution(logits, next.safe[row]);
        }
        let values = critic
            .network
            .forward(&critic.target, next, &mut workspace.critic);
        for (row, target) in workspace.targets.iter_mut().enumerate() {
            let future = minibatch.next_row[row].map_or(0.0, |next_row| {
                let values = &values[next_row * ACTIONS..][..ACTIONS];
                let shares = &workspace.shares[next_row];
                shares.iter().zip(values).map(|(p, q)| p * q).sum::<f32>()
            });
            *target = minibatch.reward[row] + self.settings.discount * future;
        }
    }

    /// The critic's values of every own action in the situations of `batch`.
    #[cfg(test)]
    pub fn values<'a>(
        &self,
        batch: &super::batch::Batch,
        workspace: &'a mut Workspace,
    ) -> &'a [f32] {
        self.critic
            .network
            .forward(&self.critic.weights, batch, &mut workspace.critic)
    }
}
